"""Is solve_nearest ever farther than a fine grid, and does an aligned posture stay where it is?

1. Rows of random arms, ranges, weights and present postures, against the least motion over a grid of swivels, in every
   branch and every turn that the ranges admit. Worse by more than 1e-9 of it counts.
2. Targets of exactly aligned postures (shoulder, wrist, both, each with the elbow straight or not), with the posture as
   the present one: motion above 1e-9, or a joint outside its range, counts.

Run: ``python -m benchmarks.nearest_grid --minutes 10``; ``--aligned 10000`` for the second part, with ``--arm`` of one
arm alone.
"""

import argparse
import dataclasses
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np

import jaxik
from jaxik import Status
from tests.helpers.arms import ALL_PRESETS, random_arm
from tests.helpers.reachable import aligned_postures, target_of

ROWS, SWIVELS = 2048, 361
RANGES = {
    "2": (-2.0, 2.0),
    "pi": (-np.pi, np.pi),
    "3.2": (-3.2, 3.2),
    "2 pi": (-2 * np.pi, 2 * np.pi),
    "from 0 to 7": (0.0, 7.0),
    "above -1": (-1.0, 200 * np.pi),
    "7 to 12": (7.0, 12.0),
    "none": (-np.inf, np.inf),
    "of each joint": None,
}  # fmt: skip
WORSE = 1e-9
KINDS = [(joints, straight) for joints in ((1,), (5,), (1, 5)) for straight in (False, True)]


@jax.jit
def grid_motion(arm: jaxik.Arm, target: jaxik.Pose, q_now: jax.Array, weights: jax.Array) -> jax.Array:
    """Least motion over a grid of swivels, every branch and every turn in the ranges, ``(n,)``."""
    turn = 2 * jnp.pi
    free = dataclasses.replace(arm, lower=jnp.full_like(arm.lower, -jnp.pi), upper=jnp.full_like(arm.upper, jnp.pi))

    def better(i: int, best: jax.Array) -> jax.Array:
        swivel = -jnp.pi + i * (turn / SWIVELS)
        solution = jaxik.solve_ik(free, target, jnp.broadcast_to(swivel, best.shape))
        q, now = solution.q, q_now[:, None]
        least, most = jnp.ceil((arm.lower - q) / turn), jnp.floor((arm.upper - q) / turn)
        off = q + turn * jnp.clip(jnp.round((now - q) / turn), least, most) - now
        fits = jnp.all(least <= most, axis=-1) & (solution.status < Status.KEEP_OUT)
        return jnp.minimum(best, jnp.min(jnp.where(fits, jnp.sum(weights * off**2, axis=-1), jnp.inf), axis=-1))

    return jax.lax.fori_loop(0, SWIVELS, better, jnp.full(q_now.shape[0], jnp.inf))


def with_ranges(arm: jaxik.Arm, name: str, rng: np.random.Generator) -> jaxik.Arm:
    """An arm with ranges of a name."""
    if RANGES[name] is None:
        middle, half = rng.uniform(-8, 8, arm.n_joints), rng.uniform(0.3, 8, arm.n_joints)
        low, high = middle - half, middle + half
    else:
        low, high = (np.full(arm.n_joints, x) for x in RANGES[name])
    return dataclasses.replace(arm, lower=jnp.asarray(low), upper=jnp.asarray(high))


def check_grid(minutes: float, seed: int, kinds: list[str]) -> int:
    """Compare batches until the time is over; print and return the number of rows that are worse."""
    rng, bad, rows, began = np.random.default_rng(seed), 0, 0, time.process_time()
    counts = dict.fromkeys(kinds, 0)
    batch = 0
    while time.process_time() - began < 60 * minutes:
        name = kinds[batch % len(kinds)]
        base = random_arm(int(rng.integers(1 << 30)), 7, limits=False) if batch % 2 else ALL_PRESETS["iiwa7"]().arm
        arm = with_ranges(base, name, rng)
        q = rng.uniform(np.maximum(arm.lower, -10), np.minimum(arm.upper, 10), (ROWS, 7))
        q_now, weights = rng.uniform(-8, 8, (ROWS, 7)), rng.uniform(0.2, 2.0, 7)
        near = rng.uniform(size=ROWS) < 0.3
        q_now[near] = q[near] + rng.normal(size=(near.sum(), 7)) * 10 ** rng.uniform(-6, 0, (near.sum(), 1))
        weights[rng.uniform(size=7) < 0.2] = 0.0
        target = target_of(arm, q)
        found = jaxik.solve_nearest(arm, target, q_now, weights=weights)
        least = np.asarray(grid_motion(arm, target, jnp.asarray(q_now), jnp.asarray(weights)))
        moved, ok = np.asarray(found.motion), np.asarray(found.ok)
        outside = ok & np.any((found.q < arm.lower) | (found.q > arm.upper), axis=-1)
        worse = (~ok & np.isfinite(least)) | (ok & (moved > least * (1 + WORSE) + 1e-12)) | outside
        for row in np.flatnonzero(worse):
            said = f"{Status(int(found.status[row])).name}{', outside' if outside[row] else ''}"
            print(
                f"{name}, batch {batch}, row {row}: {moved[row]:.9g}, {least[row]:.9g} on the grid, {said}", flush=True
            )
        bad, rows, batch = bad + int(worse.sum()), rows + ROWS, batch + 1
        counts[name] += ROWS
    print(f"{rows} rows, {SWIVELS} swivels of 8 branches each: {bad} worse or outside")
    print("  " + ", ".join(f"{name} {count}" for name, count in counts.items()))
    return bad


def check_aligned(count: int, only: str | None = None) -> int:
    """Print and return the number of aligned postures that do not stay."""
    arms = {name: preset().arm for name, preset in ALL_PRESETS.items()}
    arms |= {f"random {seed}": random_arm(seed, 6 + seed % 2, limits=False) for seed in range(20)}
    arms = {name: arm for name, arm in arms.items() if only in (None, name)}
    bad = total = 0
    for name, arm in arms.items():
        for joints, straight in KINDS:
            q = aligned_postures(arm, joints, straight, count)
            if not len(q):  # the limits leave no such posture
                continue
            found = jaxik.solve_nearest(arm, target_of(arm, q), q)
            inside = np.all((found.q >= arm.lower) & (found.q <= arm.upper), axis=-1)
            moves = ~np.asarray(found.ok) | (np.asarray(found.motion) > 1e-9) | ~inside
            total, bad = total + len(q), bad + int(moves.sum())
            if moves.any():
                print(f"{name}, aligned {joints}, straight {straight}: {moves.sum()} of {len(q)} do not stay, "
                      f"{float(np.max(found.motion)):.3g} at worst", flush=True)  # fmt: skip
    print(f"{total} aligned postures of {len(arms)} arms: {bad} do not stay")
    return bad


def main() -> None:
    """Run both parts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0, help="CPU time of the grid")
    parser.add_argument("--aligned", type=int, default=500, help="aligned postures per arm and kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--arm", help='of the aligned postures, such as paper_arm or "random 3"; default all')
    parser.add_argument("--ranges", choices=list(RANGES), help="ranges of the grid's arms; default all in turn")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    began = time.process_time()
    bad = check_aligned(options.aligned, options.arm) if options.aligned else 0
    kinds = [options.ranges] if options.ranges else list(RANGES)
    bad += check_grid(options.minutes, options.seed, kinds) if options.minutes else 0
    print(f"{time.process_time() - began:.0f} s of CPU time")
    sys.exit(bad > 0)


if __name__ == "__main__":
    main()
