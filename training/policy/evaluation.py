"""How good and how fast a policy is, against the planner on the same paths."""

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik import energy as energies
from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.kinematics import joint_positions
from jaxik.paths import Path, as_pointing
from jaxik.planning import least_energy_motion
from jaxik.planning.chart import make_chart, postures
from jaxik.planning.continuity import turning_joints, unwrap
from jaxik.planning.polishing import polish
from training.policy.policy import ElbowPolicy
from training.policy.random_paths import followable, random_paths

HELD_OUT_WAYPOINTS = 100
_STEP = 0.08  # tool motion between searched waypoints, in arm lengths and radians: as in jaxik.plan
_FEWEST, _MOST = 32, 128
_LIMIT_SLACK = 1e-9  # rounding of a posture at its limit [rad]
_POLISH = 5


@dataclass(frozen=True)
class PolicyScore:
    """A policy against the planner; arrays have one entry for each path that the planner could plan.

    Attributes:
        excess: Energy above the planner's, relative, ``(path,)``.
        polished: The same after a few polish steps, ``(path,)``.
        violations: Waypoints outside joint limits or keep-out, after the projection.
        waypoints: Waypoints in all.
        planner: Energies of the planner's motions, ``(path,)``.
    """

    excess: np.ndarray
    polished: np.ndarray
    violations: int
    waypoints: int
    planner: np.ndarray

    def report(self) -> str:
        """Some lines for a person."""
        return (
            f"{len(self.excess)} paths, energy above the planner's: mean {100 * self.excess.mean():.2f} %, median "
            f"{100 * np.median(self.excess):.2f} %, worst {100 * self.excess.max():.1f} %\n"
            f"after {_POLISH} polish steps: mean {100 * self.polished.mean():.2f} %, worst "
            f"{100 * self.polished.max():.1f} %\n"
            f"{self.violations} of {self.waypoints} waypoints outside limits"
        )

    def facts(self) -> dict[str, float | int]:
        """The same as plain values."""
        return {
            "paths": len(self.excess),
            "excess_mean": float(self.excess.mean()),
            "excess_median": float(np.median(self.excess)),
            "polished_mean": float(self.polished.mean()),
            "violations": self.violations,
        }


def held_out_paths(arm: Arm, count: int, seed: int, waypoints: int = HELD_OUT_WAYPOINTS) -> Path:
    """Paths that one branch can follow with room to spare.

    Args:
        arm: The arm.
        count: How many paths.
        seed: One seed, the same paths.
        waypoints: K.

    Returns:
        The paths, leading axes ``(count, K)``.
    """
    drawn = random_paths(jax.random.key(seed), arm, jnp.arange(4 * count, dtype=jnp.int32), waypoints)
    good = np.flatnonzero(np.asarray(followable(arm, drawn)))[:count]
    return jax.tree.map(lambda x: x[good], drawn)


def evaluate(
    policy: ElbowPolicy,
    paths: Path,
    *,
    energy: Energy | None = None,
    arm: Arm | None = None,
    search: int | None = None,
    optimum: Float[ArrayLike, "path"] | None = None,
) -> PolicyScore:
    """Compares a policy's motions with the planner's.

    Energies are those of double-precision joint angles at the policy's swivels where the process has double precision.

    Args:
        policy: The policy.
        paths: One path ``(K, ...)``, or many with leading axes ``(n, K)``.
        energy: What is compared; None for :func:`jaxik.energy.joint_motion`.
        arm: The policy's arm in the precision to compare in; None for the policy's own in jax's default one.
        search: Waypoints of the planner's search; None for what the path's length asks for.
        optimum: Energies to compare with, such as those of certified plans, ``(path,)``; infinite where there is no
            motion. None searches and polishes, without a proof.

    Returns:
        The score over the paths on which the planner found a motion.
    """
    energy = energies.joint_motion() if energy is None else energy
    arm = policy.arm.astype(jnp.result_type(float)) if arm is None else arm
    if paths.time.ndim == 1:
        paths = jax.tree.map(lambda x: x[None], paths)
    paths = paths.astype(arm.axes.dtype)
    motion = policy(paths.target, paths.time)
    look = searched_waypoints(arm, paths) if search is None else search
    if optimum is None:
        best, found = jax.device_get(_planned(arm, energy, paths.target, paths.time, look))
        optimum = np.where(found, best, np.inf)
    best = np.asarray(optimum)
    rows = paths.target, paths.time, motion.swivel, motion.branch
    mine, ahead, q = jax.device_get(_motions(arm, energy, rows))
    lower, upper = np.asarray(arm.lower), np.asarray(arm.upper)
    outside = (np.maximum(lower - q, q - upper) > _LIMIT_SLACK).any(-1)
    elbow = np.asarray(joint_positions(arm, jnp.asarray(q)))[..., 1, :]
    room = np.asarray(arm.keep_out.offset) - elbow @ np.asarray(arm.keep_out.normal).T
    outside |= (room < -_LIMIT_SLACK * float(arm.length)).any(-1)
    good = np.isfinite(best)
    return PolicyScore(
        (mine / best - 1)[good], (ahead / best - 1)[good], int(outside[good].sum()), int(outside[good].size), best[good]
    )


def searched_waypoints(arm: Arm, paths: Path) -> int:
    """Waypoints of the planner's search for the longest of some paths, as :func:`jaxik.plan` has them."""
    way = np.linalg.norm(np.diff(np.asarray(paths.target.position), axis=-2), axis=-1).sum(-1) / float(arm.length)
    turn = as_pointing(paths.target).direction
    turned = np.linalg.norm(np.diff(np.asarray(turn), axis=-2), axis=-1).sum(-1)
    return int(np.clip(np.ceil((way + turned).max() / _STEP), _FEWEST, min(_MOST, paths.time.shape[-1])))


@jax.jit
def _joints(arm: Arm, target: Any, swivel: Array, branch: Array) -> Array:
    chart = make_chart(arm, target)
    return postures(arm, chart, swivel, jnp.broadcast_to(branch, swivel.shape)).T


def _planned(arm: Arm, energy: Energy, target: Any, time: Array, search: int) -> tuple[Array, Array]:
    """The planner's energies and whether they converged."""

    @jax.jit
    def plans(rows: Any) -> tuple[Array, Array]:
        def one(row: Any) -> tuple[Array, Array]:
            motion = least_energy_motion(arm, row[0], row[1], energy, search=search)
            return motion.energy, motion.converged

        return jax.lax.map(one, rows)

    return plans((target, time))


def _motions(arm: Arm, energy: Energy, rows: Any) -> tuple[Array, Array, Array]:
    """Energies of a policy's motions and of the polished ones, and the policy's angles."""
    turning = jnp.asarray(turning_joints(arm))

    @jax.jit
    def policies(rows: Any) -> tuple[Array, Array, Array]:
        def one(row: Any) -> tuple[Array, Array, Array]:
            target, time, swivel, branch = row
            q = _joints(arm, target, swivel.astype(time.dtype), branch)
            better = polish(arm, target, time, swivel, branch, energy, iterations=_POLISH)[2]
            return energy(arm, unwrap(q, turning), time), better, q

        return jax.lax.map(one, rows)

    return policies(rows)


def seconds_per_path(call: Callable[[], Any], paths: int, repeats: int = 5) -> float:
    """Best wall time of a call over some repeats, per path, after one that is not counted."""
    jax.block_until_ready(call())
    times = []
    for _ in range(repeats):
        began = perf_counter()
        jax.block_until_ready(call())
        times.append(perf_counter() - began)
    return min(times) / paths
