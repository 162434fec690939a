"""What simpler ways of choosing the elbow do along a motion's path: motions to show beside the planned one."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from jaxik import energy as energies
from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.kinematics import forward_kinematics
from jaxik.paths import Path, as_pointing
from jaxik.planning.continuity import turning_joints, unwrap
from jaxik.planning.grid import solve_grid
from jaxik.redundancy import solve_nearest, swivel_of
from jaxik.trajectories import Trajectory

_SWIVELS = 72  # tried for the fixed one: every 5 degrees


@dataclass(frozen=True)
class Motion:
    """A motion along a path, and what is to be said of it.

    Attributes:
        name: What it does with the elbow.
        trajectory: Joint angles, with swivel and branch.
        energy: What it costs, in the energy's unit.
        unit: The unit.
        broken: Waypoints at which it leaves limits or keep-out, ``(K,)`` bool.
    """

    name: str
    trajectory: Trajectory
    energy: float
    unit: str
    broken: np.ndarray

    @property
    def ok(self) -> bool:
        """Whether a robot could take it."""
        return not self.broken.any()

    def caption(self) -> str:
        """Name, energy, and what is wrong with it."""
        bad = "" if self.ok else f", out of limits at {int(self.broken.sum())} of {len(self.broken)} waypoints"
        return f"{self.name}: {self.energy:.4g} {self.unit}{bad}"


def path_of(arm: Arm, trajectory: Trajectory) -> Path:
    """The path that a trajectory's tool follows; a pointing one where the tool's roll is no joint.

    Args:
        arm: The arm.
        trajectory: Its motion.

    Returns:
        One target per waypoint.
    """
    pose = forward_kinematics(arm, jnp.asarray(trajectory.q, arm.axes.dtype))
    target = pose if arm.n_joints == 7 else as_pointing(pose)
    return Path(target, jnp.asarray(trajectory.time, arm.axes.dtype))


def as_it_is(arm: Arm, trajectory: Trajectory, energy: Energy | None = None) -> Motion:
    """A trajectory itself as a motion to show.

    Args:
        arm: The arm.
        trajectory: Its motion.
        energy: What is counted; None for :func:`jaxik.energy.joint_motion`.

    Returns:
        The motion, its swivel and branch worked out where the trajectory does not know them.
    """
    return _motion("this motion", arm, trajectory.time, trajectory.q, trajectory, energy)


def fixed_swivel(arm: Arm, trajectory: Trajectory, energy: Energy | None = None) -> Motion:
    """The same path with one swivel held throughout: of 72, in one branch, that which breaks least and costs least.

    Args:
        arm: The arm.
        trajectory: Whose path.
        energy: What is counted; None for :func:`jaxik.energy.joint_motion`.

    Returns:
        The motion.
    """
    grid = solve_grid(arm, path_of(arm, trajectory).target, _SWIVELS)
    broken = (~grid.ok).sum(0)  # (swivel, branch)
    kept = np.argwhere(broken == broken.min())
    motions = np.stack([grid.q[:, t, b] for t, b in kept])
    step = np.diff(motions, axis=1)
    step -= 2 * np.pi * np.round(step / (2 * np.pi)) * np.array(turning_joints(arm))
    t, b = kept[np.argmin((step**2).sum((1, 2)))]
    name = f"swivel fixed at {np.degrees(grid.swivel[0, t, b]):.0f}°"
    return _motion(name, arm, trajectory.time, grid.q[:, t, b], trajectory, energy, ~grid.ok[:, t, b])


def greedy(arm: Arm, trajectory: Trajectory, energy: Energy | None = None) -> Motion:
    """The same path from waypoint to waypoint to the nearest posture, from the trajectory's own start.

    Args:
        arm: The arm.
        trajectory: Whose path.
        energy: What is counted; None for :func:`jaxik.energy.joint_motion`.

    Returns:
        The motion, by :func:`jaxik.solve_nearest` at every waypoint.
    """
    target = jax.tree.map(np.asarray, path_of(arm, trajectory).target)
    q, broken = [np.asarray(trajectory.q[0], target.position.dtype)], [False]
    for k in range(1, len(trajectory)):
        found = solve_nearest(arm, jax.tree.map(lambda x, k=k: x[k], target), q[-1])
        q.append(np.asarray(found.q))
        broken.append(int(found.status) > 1)
    return _motion("greedy: nearest posture", arm, trajectory.time, np.stack(q), trajectory, energy, np.array(broken))


def _motion(
    name: str,
    arm: Arm,
    time: np.ndarray,
    q: np.ndarray,
    like: Trajectory,
    energy: Energy | None,
    broken: np.ndarray | None = None,
) -> Motion:
    """Completes joint angles to a motion."""
    energy = energies.joint_motion() if energy is None else energy
    dtype = arm.axes.dtype
    q = np.asarray(unwrap(jnp.asarray(q, dtype), turning_joints(arm)), float)
    swivel, branch = swivel_of(arm, jnp.asarray(q, dtype))
    trajectory = Trajectory(time, q, like.joint_names, like.arm_name, np.asarray(swivel, float), np.asarray(branch))
    cost = float(energy(arm, jnp.asarray(q, dtype), jnp.asarray(time, dtype)))
    broken = np.zeros(len(time), bool) if broken is None else np.asarray(broken)
    return Motion(name, trajectory, cost, energy.unit, broken)
