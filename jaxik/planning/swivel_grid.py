"""Postures on a grid of swivels, for host programs: any number of waypoints, one compilation."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.arm import Arm
from jaxik.ik import BRANCHES
from jaxik.numerics import compiled_sooner
from jaxik.planning.feasible_targets import NODES
from jaxik.planning.padding import motion_and_arcs_by_part
from jaxik.planning.problem import in_joint_space
from jaxik.redundancy import SelfMotion, SwivelArcs
from jaxik.targets import Target


class SwivelGrid(NamedTuple):
    """Postures of K targets at T swivels.

    Attributes:
        swivel: Swivels, evenly spaced from -pi on, ``(T,)`` [rad].
        q: Joint angles, ``(K, T, 8, joint)`` [rad].
        ok: True within limits and keep-out, ``(K, T, 8)``.
    """

    swivel: np.ndarray
    q: np.ndarray
    ok: np.ndarray


def swivel_grid(arm: Arm, target: Target, swivels: int) -> SwivelGrid:
    """Return the postures of K targets at evenly spaced swivels.

    Args:
        arm: The arm.
        target: K targets in the arm's dtype.
        swivels: Number of swivels T.

    Returns:
        The grid, as host arrays.
    """
    swivel = np.linspace(-np.pi, np.pi, swivels, endpoint=False).astype(arm.axes.dtype)
    parts = [_postures(motion, arcs, swivel) for motion, arcs in motion_and_arcs_by_part(arm, target)]
    q, ok = (np.concatenate([np.asarray(x) for x in each])[: len(target.position)] for each in zip(*parts, strict=True))
    return SwivelGrid(swivel, q, ok)


def feasible_shares(arm: Arm, target: Target, swivels: int) -> np.ndarray:
    """Return the fraction of evenly spaced swivels that each branch can take, of K targets: ``(K, 8)``.

    Of arms planned in joint space, whose branches pass into one another smoothly, the number of feasible postures over
    that of parameters they are sought at, at most one, ``(K, 1)``.
    """
    parts: list[Any] = [arcs for _, arcs in motion_and_arcs_by_part(arm, target)]
    if in_joint_space(arm):
        shares = [np.minimum(np.asarray(found.allowed).sum(axis=-1, keepdims=True) / NODES, 1.0) for found in parts]
    else:
        swivel = np.linspace(-np.pi, np.pi, swivels, endpoint=False).astype(arm.axes.dtype)
        shares = [np.asarray(_inside(arcs, swivel)).mean(axis=1) for arcs in parts]
    return np.concatenate(shares)[: len(target.position)]


@compiled_sooner
def _postures(motion: SelfMotion, arcs: SwivelArcs, swivel: Array) -> tuple[Array, Array]:
    at = jnp.broadcast_to(swivel[:, None], (len(swivel), len(motion.status)))
    q = motion.branch(np.arange(BRANCHES)[:, None, None]).angles(at)  # (joint, 8, T, K)
    return jnp.transpose(q, (3, 2, 1, 0)), _inside(arcs, swivel)


@compiled_sooner
def _inside(arcs: SwivelArcs, swivel: Array) -> Array:
    """Test whether swivels ``(T,)`` are in arcs, ``(K, T, 8)``."""
    at = jnp.broadcast_to(swivel[:, None], (len(swivel), len(arcs.status)))
    return jax.vmap(arcs.contains, out_axes=1)(at)
