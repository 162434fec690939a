"""Accuracy of a calibration from some probe points, and coverage of its standard errors.

python -m benchmarks.calibration [--trials 200] [--points 50]

The Meccanoid preset with lengths wrong by 5 %, joint zeros by 3 degrees and 1 mm of noise per coordinate. Every trial
has its own deviations, probe points and noise, and is evaluated on the same 200 new postures.
"""

import argparse
import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from scipy import stats

import jaxik
from benchmarks.common import table
from training.calibration.calibrate import GROUPS, fit_kinematics, fitted_parameters
from training.calibration.kinematic_errors import KinematicErrors, deviating_arm

jax.config.update("jax_enable_x64", True)

NOISE = 1e-3  # of a coordinate [m]
LENGTH, ZERO = 0.05, math.radians(3)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--points", type=int, default=50)
    options = parser.parse_args()
    arm = jaxik.presets.meccanoid("right").arm
    rng = np.random.default_rng(0)
    truth = [_deviations(rng, arm) for _ in range(options.trials)]
    truth = jax.tree.map(lambda *x: jnp.stack(x), *truth)
    q = jnp.asarray(rng.uniform(arm.lower, arm.upper, (options.trials, options.points, arm.n_joints)))
    tips = jax.jit(jax.vmap(lambda true, q: _tips(arm, true, q)))
    measured = tips(truth, q) + NOISE * rng.standard_normal((options.trials, options.points, 3))
    mask = jnp.asarray(fitted_parameters(arm, GROUPS))
    found = jax.jit(jax.vmap(lambda q, tip: fit_kinematics(arm, q, tip, mask)))(q, measured)

    new = jnp.asarray(rng.uniform(arm.lower, arm.upper, (200, arm.n_joints)))
    new = jnp.broadcast_to(new, (options.trials, *new.shape))
    off = 1e3 * np.linalg.norm(tips(found.errors, new) - tips(truth, new), axis=-1)
    nominal = 1e3 * np.linalg.norm(tips(jax.tree.map(jnp.zeros_like, truth), new) - tips(truth, new), axis=-1)
    rows = [
        (name, f"{x.mean():.2f}", f"{x.mean(axis=1).max():.2f}", f"{np.percentile(x, 95):.2f}", f"{x.max():.2f}")
        for name, x in (("nominal", nominal), ("calibrated", off))
    ]
    header = ("arm", "mean", "largest mean of a trial", "95th percentile", "max")
    table(f"Tip on new postures, {options.trials} trials of {options.points} probe points [mm]", header, rows)

    flat = jax.vmap(lambda e: e.flat())
    deviation, right = np.asarray(flat(found.deviation)), np.asarray(flat(truth))
    # The zero of the first joint and the rotation of the mount about its axis are equivalent, so neither is determined.
    determined = np.ones(right.shape[1], bool)
    determined[_undetermined(arm)] = False
    ratio = np.abs(np.asarray(flat(found.errors)) - right)[:, determined] / deviation[:, determined]
    rows = []
    for rate in (0.6827, 0.95):
        covered = ratio <= stats.norm.ppf((1 + rate) / 2)
        each = covered.mean(axis=0)
        rows.append((f"{100 * rate:.1f} %", *(f"{100 * x:.1f} %" for x in (covered.mean(), each.min(), each.max()))))
    table("Truth within the standard errors, all parameters", ("expected", "covered", "min", "max"), rows)


def _deviations(rng: np.random.Generator, arm: jaxik.Arm) -> KinematicErrors:
    """Lengths and zeros wrong by a constant amount with random signs."""
    return dataclasses.replace(
        KinematicErrors.none(arm),
        length=jnp.asarray(LENGTH * rng.choice([-1.0, 1.0], 3)),
        zero=jnp.asarray(ZERO * rng.choice([-1.0, 1.0], arm.n_joints)),
    )


def _tips(arm: jaxik.Arm, true: KinematicErrors, q: jax.Array) -> jax.Array:
    return jaxik.forward_kinematics(deviating_arm(arm, true), (1 + true.scale) * q).position


def _undetermined(arm: jaxik.Arm) -> list[int]:
    """Indices of the zero of the first joint and of the rotation of the mount about its axis."""
    axis = int(np.argmax(np.abs(np.asarray(arm.axes[0]))))
    none = KinematicErrors.none(arm)
    one = [
        dataclasses.replace(none, turn=none.turn.at[axis].set(1.0)),
        dataclasses.replace(none, zero=none.zero.at[0].set(1.0)),
    ]
    return [int(np.argmax(np.asarray(x.flat()))) for x in one]


if __name__ == "__main__":
    main()
