"""Quality of a policy against the planner on the same paths."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik import energy as energies
from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.energy import Energy
from jaxik.kinematics import joint_positions
from jaxik.numerics import unwrap
from jaxik.paths import Path
from jaxik.planning import least_energy_motion, searched_waypoints
from jaxik.redundancy import self_motion
from training.policy.policy import ElbowPolicy
from training.policy.random_paths import followable, random_paths

HELD_OUT_WAYPOINTS = 100
_LIMIT_SLACK = 1e-9  # rounding of a posture at its limit [rad]
_REFINEMENT = 5  # Newton steps


@dataclass(frozen=True)
class PolicyScore:
    """A policy against the planner; arrays have one entry for each path that the planner could plan.

    Attributes:
        excess: Energy above the planner's, relative, ``(path,)``.
        refined: The same after a few Newton steps, ``(path,)``.
        violations: Number of waypoints outside joint limits or keep-out.
        waypoints: Number of waypoints in all.
        planner: Energies of the planner's motions, ``(path,)``.
    """

    excess: np.ndarray
    refined: np.ndarray
    violations: int
    waypoints: int
    planner: np.ndarray

    def report(self) -> str:
        """Return a summary of the score in a few lines of text."""
        return (
            f"{len(self.excess)} paths, energy above the planner's: mean {100 * self.excess.mean():.2f} %, median "
            f"{100 * np.median(self.excess):.2f} %, worst {100 * self.excess.max():.1f} %\n"
            f"after {_REFINEMENT} Newton steps: mean {100 * self.refined.mean():.2f} %, worst "
            f"{100 * self.refined.max():.1f} %\n"
            f"{self.violations} of {self.waypoints} waypoints outside limits"
        )

    def facts(self) -> dict[str, float | int]:
        """Return the score as plain values."""
        return {
            "paths": len(self.excess),
            "excess_mean": float(self.excess.mean()),
            "excess_median": float(np.median(self.excess)),
            "refined_mean": float(self.refined.mean()),
            "violations": self.violations,
        }


def held_out_paths(arm: Arm | ArmModel, count: int, *, seed: int, waypoints: int = HELD_OUT_WAYPOINTS) -> Path:
    """Return random paths that one branch can follow with room to spare.

    Args:
        arm: The arm.
        count: Number of paths.
        seed: Seed of the paths: one seed, the same paths.
        waypoints: Number of waypoints K.

    Returns:
        The paths, leading axes ``(count, K)``.
    """
    arm = as_arm(arm)
    drawn = random_paths(jax.random.key(seed), arm, jnp.arange(4 * count, dtype=jnp.int32), waypoints)
    good = np.flatnonzero(np.asarray(followable(arm, drawn)))[:count]
    return jax.tree.map(lambda x: x[good], drawn)


def evaluate(
    policy: ElbowPolicy,
    paths: Path,
    *,
    energy: Energy | None = None,
    arm: Arm | ArmModel | None = None,
    search: int | None = None,
    optimum: Float[ArrayLike, "path"] | None = None,
) -> PolicyScore:
    """Compare a policy's motions with the planner's.

    Energies are those of double-precision joint angles at the policy's swivels where the process has double precision.

    Args:
        policy: The policy.
        paths: One path ``(K, ...)``, or many with leading axes ``(n, K)``.
        energy: Energy to compare; None for :func:`jaxik.energy.joint_motion`.
        arm: The policy's arm in the precision to compare in; None for the policy's own in jax's default one.
        search: Waypoints that the planner's search sees; None for :func:`jaxik.searched_waypoints`.
        optimum: Energies to compare with, such as those of certified plans, ``(path,)``; infinite where there is no
            motion. None searches and refines, without a proof.

    Returns:
        The score over the paths on which the planner found a motion.
    """
    energy = energies.joint_motion() if energy is None else energy
    arm = policy.arm.astype(jnp.result_type(float)) if arm is None else as_arm(arm)
    if paths.time.ndim == 1:
        paths = jax.tree.map(lambda x: x[None], paths)
    paths = paths.astype(arm.axes.dtype)
    motion = policy(paths.target, paths.time)
    search = searched_waypoints(arm, paths.target) if search is None else search
    if optimum is None:
        best, found = jax.device_get(_planned(arm, energy, paths.target, paths.time, search))
        optimum = np.where(found, best, np.inf)
    best = np.asarray(optimum)
    rows = paths.target, paths.time, motion.swivel, motion.branch
    mine, refined, q = jax.device_get(_motions(arm, energy, rows))
    lower, upper = np.asarray(arm.lower), np.asarray(arm.upper)
    outside = (np.maximum(lower - q, q - upper) > _LIMIT_SLACK).any(-1)
    elbow = np.asarray(joint_positions(arm, jnp.asarray(q)))[..., 1, :]
    room = np.asarray(arm.keep_out.offset) - elbow @ np.asarray(arm.keep_out.normal).T
    outside |= (room < -_LIMIT_SLACK * float(arm.length)).any(-1)
    good = np.isfinite(best)
    return PolicyScore(
        mine[good] / best[good] - 1,
        refined[good] / best[good] - 1,
        int(outside[good].sum()),
        int(outside[good].size),
        best[good],
    )


@partial(jax.jit, static_argnames="search")
def _planned(arm: Arm, energy: Energy, target: Any, time: Array, search: int) -> tuple[Array, Array]:
    """The planner's energies, infinite where it has no motion, and whether they converged."""

    def one(row: Any) -> tuple[Array, Array]:
        motion = least_energy_motion(arm, *row, energy=energy, search=search)
        return jnp.where(motion.ok, motion.energy, jnp.inf), motion.converged

    return jax.lax.map(one, (target, time))


@jax.jit
def _motions(arm: Arm, energy: Energy, rows: Any) -> tuple[Array, Array, Array]:
    """Energies of a policy's motions and of the refined ones, and the policy's joint angles."""

    def one(row: Any) -> tuple[Array, Array, Array]:
        target, time, swivel, branch = row
        q = self_motion(arm, target).branch(branch).angles(swivel.astype(time.dtype)).T
        guess = {"guess": (swivel, branch), "iterations": _REFINEMENT}
        refined = least_energy_motion(arm, target, time, energy=energy, **guess)
        return energy(arm, unwrap(q, arm.turning), time), refined.energy, q

    return jax.lax.map(one, rows)
