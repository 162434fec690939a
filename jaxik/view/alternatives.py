"""Simpler motions along the path of a trajectory, for comparison with it."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from jaxik import energy as energies
from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.kinematics import forward_kinematics
from jaxik.numerics import shortest, unwrap
from jaxik.paths import Path
from jaxik.planning import swivel_grid
from jaxik.redundancy import solve_nearest, swivel_of
from jaxik.trajectories import Trajectory

_SWIVELS = 72  # candidates for the fixed swivel, one per 5 degrees


@dataclass(frozen=True)
class Motion:
    """A motion along a path, with its energy.

    Attributes:
        name: Description of how the elbow moves.
        trajectory: Joint angles, with swivel and branch.
        energy: Energy of the motion.
        unit: Unit of the energy.
        infeasible: Waypoints outside the joint limits or inside the keep-out, ``(K,)`` bool.
    """

    name: str
    trajectory: Trajectory
    energy: float
    unit: str
    infeasible: np.ndarray

    @property
    def ok(self) -> bool:
        """True if every waypoint is feasible."""
        return not self.infeasible.any()

    def caption(self) -> str:
        """Return a line with name, energy and the number of infeasible waypoints."""
        count = int(self.infeasible.sum())
        note = f", out of limits at {count} of {len(self.infeasible)} waypoints" if count else ""
        return f"{self.name}: {self.energy:.4g} {self.unit}{note}"


def path_of(arm: Arm, trajectory: Trajectory) -> Path:
    """Return the path of a trajectory's tool; a pointing path if the arm has no joint for the roll of the tool.

    Args:
        arm: The arm.
        trajectory: Its motion.

    Returns:
        One target per waypoint.
    """
    pose = forward_kinematics(arm, jnp.asarray(trajectory.q, arm.axes.dtype))
    target = pose if arm.n_joints == 7 else pose.pointing()
    return Path(target, jnp.asarray(trajectory.time, arm.axes.dtype))


def given_motion(arm: Arm, trajectory: Trajectory, energy: Energy | None = None) -> Motion:
    """Return the motion of the trajectory itself.

    Args:
        arm: The arm.
        trajectory: Its motion.
        energy: Energy to evaluate; None for :func:`jaxik.energy.joint_motion`.

    Returns:
        The motion, with swivel and branch.
    """
    return _motion("this motion", arm, trajectory.time, trajectory.q, trajectory, energy)


def fixed_swivel(arm: Arm, trajectory: Trajectory, energy: Energy | None = None) -> Motion:
    """Return the motion along the same path with the best constant swivel, in one branch.

    Of 72 swivels in eight branches, it takes the one with the fewest infeasible waypoints and, among equals, with the
    least squared joint motion.

    Args:
        arm: The arm.
        trajectory: Motion that defines the path.
        energy: Energy to evaluate; None for :func:`jaxik.energy.joint_motion`.

    Returns:
        The motion.
    """
    grid = swivel_grid(arm, path_of(arm, trajectory).target, _SWIVELS)
    count = (~grid.ok).sum(0)  # (swivel, branch)
    step = np.asarray(shortest(jnp.asarray(np.diff(grid.q, axis=0)), arm.turning))
    length = np.where(count == count.min(), (step**2).sum((0, 3)), np.inf)
    t, b = np.unravel_index(np.argmin(length), length.shape)
    name = f"swivel fixed at {np.degrees(grid.swivel[t]):.0f}°"
    return _motion(name, arm, trajectory.time, grid.q[:, t, b], trajectory, energy, ~grid.ok[:, t, b])


def greedy(arm: Arm, trajectory: Trajectory, energy: Energy | None = None) -> Motion:
    """Return the motion along the same path that takes the nearest posture at each waypoint.

    It starts at the first posture of the trajectory and uses :func:`jaxik.solve_nearest` from there.

    Args:
        arm: The arm.
        trajectory: Motion that defines the path and the first posture.
        energy: Energy to evaluate; None for :func:`jaxik.energy.joint_motion`.

    Returns:
        The motion.
    """
    target = jax.tree.map(np.asarray, path_of(arm, trajectory).target)
    q, infeasible = [np.asarray(trajectory.q[0], target.position.dtype)], [False]
    for k in range(1, len(trajectory)):
        found = solve_nearest(arm, target[k], q[-1])
        q.append(np.asarray(found.q))
        infeasible.append(not bool(found.ok))
    name = "greedy: nearest posture"
    return _motion(name, arm, trajectory.time, np.stack(q), trajectory, energy, np.array(infeasible))


def _motion(
    name: str,
    arm: Arm,
    time: np.ndarray,
    q: np.ndarray,
    like: Trajectory,
    energy: Energy | None,
    infeasible: np.ndarray | None = None,
) -> Motion:
    """A motion from joint angles ``(K, joint)``, with swivel, branch and energy."""
    energy = energies.joint_motion() if energy is None else energy
    dtype = arm.axes.dtype
    q = np.asarray(unwrap(jnp.asarray(q, dtype), arm.turning), float)
    swivel, branch = swivel_of(arm, jnp.asarray(q, dtype))
    trajectory = Trajectory(time, q, like.joint_names, like.arm_name, np.asarray(swivel, float), np.asarray(branch))
    cost = float(energy(arm, jnp.asarray(q, dtype), jnp.asarray(time, dtype)))
    infeasible = np.zeros(len(time), bool) if infeasible is None else np.asarray(infeasible)
    return Motion(name, trajectory, cost, energy.unit, infeasible)
