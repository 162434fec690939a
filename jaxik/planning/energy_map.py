"""The energy map: the local cost of each swivel at each point of a path, for pictures and for understanding."""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Int

from jaxik import energy as energies
from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.energy import Energy
from jaxik.numerics import compiled_sooner, shortest
from jaxik.obstacles import World, in_world, moves
from jaxik.paths import Path
from jaxik.planning.padding import motion_and_arcs_in_parts, padded, padded_size
from jaxik.redundancy import SelfMotion, SwivelArcs


class EnergyMap(NamedTuple):
    """Local cost over a path and the circle.

    Attributes:
        time: Times of the columns, ``(K,)`` [s].
        swivel: Swivels of the rows, ``(T,)`` [rad].
        cost: Energy per second of following the path with the elbow held at a swivel, ``(K, T)``; nan where there is no
            feasible posture.
        unit: Unit of the cost.
    """

    time: np.ndarray
    swivel: np.ndarray
    cost: np.ndarray
    unit: str


def energy_map(
    arm: Arm | ArmModel,
    path: Path,
    branch: Int[ArrayLike, "*waypoint"],
    *,
    energy: Energy | None = None,
    swivels: int = 180,
    waypoints: int = 160,
    world: World | None = None,
) -> EnergyMap:
    """Return the local cost of every swivel along a path, in the branch that a plan takes.

    Args:
        arm: The arm.
        path: The path in the arm's base frame.
        branch: Branch at every waypoint, or one for all.
        energy: The energy; None for :func:`jaxik.energy.joint_motion`.
        swivels: Resolution on the circle.
        waypoints: Largest number of columns.
        world: Obstacles, for an arm with a body (:func:`jaxik.with_body`), one world or one per waypoint of the path:
            swivels at which the body meets them cost nan, as those beyond limits.

    Returns:
        The map, as host arrays.

    Raises:
        ValueError: Not a path; a world for an arm without a body, or one of another length than the path.
    """
    instead = "draw solve_ik at many parameters instead"
    arm = in_world(as_arm(arm, any_class=True, closed_form=True, instead=instead), world)
    if moves(arm) and arm.surroundings.world.batch != (len(path),):
        raise ValueError(
            f"a moving world needs one row per waypoint, ({len(path)},); got {arm.surroundings.world.batch}"
        )
    energy = energies.joint_motion() if energy is None else energy
    path = path.checked().astype(arm.axes.dtype)
    index = np.unique(np.linspace(0, len(path) - 1, min(waypoints, len(path))).round().astype(int))
    few = jax.tree.map(lambda x: np.asarray(x)[index], Path(path.target, path.time))
    arm = replace(arm, surroundings=arm.surroundings.rows(index)) if moves(arm) else arm
    taken = np.broadcast_to(np.asarray(branch), len(path))[index]
    swivel = np.linspace(-np.pi, np.pi, swivels, endpoint=False).astype(arm.axes.dtype)
    size = padded_size(len(index))
    motion, arcs = motion_and_arcs_in_parts(arm, few.target, size)
    cost = np.asarray(_costs(motion, arcs, padded(few.time, size), padded(taken, size), swivel, energy))[: len(index)]
    return EnergyMap(np.asarray(few.time, float), swivel, cost, f"{energy.unit} per s")


@compiled_sooner
def _costs(motion: SelfMotion, arcs: SwivelArcs, time: Array, branch: Array, swivel: Array, energy: Energy) -> Array:
    """Costs ``(K, T)``."""
    arm = motion.arm
    at = jnp.broadcast_to(swivel[:, None], (len(swivel), len(branch)))
    q = motion.branch(branch).angles(at).T  # (K, T, joint)
    step = shortest(jnp.diff(q, axis=0), arm.turning)
    rate = jnp.sum(energy.motion_weights(arm) * step**2, axis=-1) / energies.durations(time)[:, None] ** 2
    # Half from the step before, half from the step after. The last waypoint has none after it.
    rate = rate[jnp.minimum(jnp.arange(len(rate)), jnp.maximum(jnp.sum(energies.counted(time)) - 2, 0))]
    moving = (jnp.concatenate([rate[:1], rate]) + jnp.concatenate([rate, rate[-1:]])) / 2
    inside = jax.vmap(arcs.contains, out_axes=1)(at)
    inside = jnp.take_along_axis(inside, branch[:, None, None], axis=2)[..., 0]
    return jnp.where(inside, moving + energy.rest_rate(arm, q), jnp.nan)
