"""Postures of targets at evenly spaced redundancy parameters: in the place of arcs, for planning in joint space."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.ik import Status, all_branches
from jaxik.redundancy import ParameterMotion, parameter_nodes

STATES = 512
"""Postures kept of a target; where there are more, they are evenly thinned."""

NODES = 64
"""Parameters they are sought at: 5.6 degrees apart on a whole circle."""


class FeasibleTargets(NamedTuple):
    """Postures of K targets at a few parameters, in single precision: a search needs no more.

    Attributes:
        q: Joint angles, ``(K, joint, STATES)`` [rad], neighbors in the parameter side by side.
        allowed: True within limits and keep-out, ``(K, STATES)``.
        on_target: True on the target, ``(K, STATES)``.
    """

    q: Array
    allowed: Array
    on_target: Array

    @property
    def ok(self) -> Array:
        """True where any of them is feasible, ``(K,)``."""
        return jnp.any(self.allowed, axis=-1)


def feasible_targets(motion: ParameterMotion) -> FeasibleTargets:
    """Return the postures of K targets."""
    motion = jax.lax.stop_gradient(motion)
    motion = jax.tree.map(lambda x: x.astype(jnp.float32) if jnp.issubdtype(x.dtype, jnp.floating) else x, motion)
    parameter, n = parameter_nodes(motion.arm, NODES), motion.status.shape[0]

    def repeated(x: Array) -> Array:
        return jnp.broadcast_to(x[..., None, :], (*x.shape[:-1], NODES, n)).reshape(*x.shape[:-1], NODES * n)

    solved = all_branches(motion.arm, repeated(motion.position), repeated(motion.directions), jnp.repeat(parameter, n))
    status = jnp.where(motion.status == Status.OK, solved.status.reshape(-1, n), jnp.int32(Status.INVALID_TARGET))
    q = jnp.moveaxis(solved.q, 1, 0).reshape(solved.q.shape[1], -1, n)
    allowed, on_target = status <= Status.NEAR_SINGULAR, status <= Status.KEEP_OUT
    index = _evenly_thinned(allowed, on_target)
    q = jnp.take_along_axis(q, index[None], axis=1)
    allowed, on_target = (jnp.take_along_axis(x, index, axis=0).T for x in (allowed, on_target))
    return FeasibleTargets(jnp.transpose(q, (2, 0, 1)), allowed, on_target)


def _evenly_thinned(allowed: Array, on_target: Array) -> Array:
    """Places of ``STATES`` postures of ``(m, n)``: allowed ones, evenly thinned if need be, then others."""
    count = jnp.sum(allowed, axis=0, dtype=jnp.int32)
    before = jnp.cumsum(allowed, axis=0, dtype=jnp.int32) - allowed.astype(jnp.int32)
    most = jnp.maximum(count, STATES)
    kept = allowed & ((before + 1) * STATES // most > before * STATES // most)
    rank = jnp.where(kept, 0, jnp.where(on_target, 1, 2)).astype(jnp.int32)
    return jnp.argsort(rank, axis=0, stable=True)[:STATES]
