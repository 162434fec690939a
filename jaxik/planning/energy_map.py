"""The energy map: what each swivel would cost at each point of a path, for pictures and for understanding."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxik import energy as energies
from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.paths import Path
from jaxik.planning.continuity import turning_joints
from jaxik.planning.grid import solve_grid


class EnergyMap(NamedTuple):
    """Local cost over a path and the circle.

    Attributes:
        time: Across, ``(K,)`` [s].
        swivel: Up, ``(T,)`` [rad].
        cost: Energy per second of following the path with the elbow held at that swivel, ``(K, T)``; nan where no
            posture.
        unit: Its unit.
    """

    time: np.ndarray
    swivel: np.ndarray
    cost: np.ndarray
    unit: str


def energy_map(
    arm: Arm,
    path: Path,
    branch: np.ndarray | int,
    *,
    energy: Energy | None = None,
    swivels: int = 180,
    waypoints: int = 160,
) -> EnergyMap:
    """Local cost of every swivel along a path, in the branch that a plan takes.

    Args:
        arm: The arm.
        path: The path in the arm's base frame.
        branch: Branch at every waypoint, or one for all.
        energy: The energy; None for :func:`jaxik.energy.joint_motion`.
        swivels: Resolution on the circle.
        waypoints: At most so many columns.

    Returns:
        The map, as host arrays.
    """
    energy = energies.joint_motion() if energy is None else energy
    path = path.checked().astype(arm.axes.dtype)
    index = np.unique(np.linspace(0, len(path) - 1, min(waypoints, len(path))).round().astype(int))
    grid = solve_grid(arm, jax.tree.map(lambda x: x[index], path.target), swivels)
    pick = np.broadcast_to(np.asarray(branch), len(path))[index][:, None, None]
    ok = np.take_along_axis(grid.ok, pick, axis=2)[..., 0]
    q = np.take_along_axis(grid.q, pick[..., None], axis=2)[:, :, 0]
    time = np.asarray(path.time, float)[index]
    step = np.diff(q, axis=0)
    step -= 2 * np.pi * np.round(step / (2 * np.pi)) * np.array(turning_joints(arm))
    moving = (np.asarray(energy.motion_weight(arm)) * step**2).sum(-1) / np.diff(time)[:, None] ** 2
    # Half from the step before, half from the step after.
    moving = (np.concatenate([moving[:1], moving]) + np.concatenate([moving, moving[-1:]])) / 2
    cost = moving + np.asarray(energy.rest_rate(arm, jnp.asarray(q)))
    return EnergyMap(time, grid.swivel[0, :, 0], np.where(ok, cost, np.nan), f"{energy.unit} per s")
