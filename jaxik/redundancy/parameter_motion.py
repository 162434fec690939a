"""The self-motion of arms whose redundancy parameter is no swivel: postures at parameters, by the arm's solver.

It has the interface of :class:`jaxik.redundancy.SelfMotion` that planning needs, and so does its motion in a branch.
Derivatives come from the Jacobian at the posture (:mod:`jaxik.redundancy.tangent`).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxik.arm import Arm
from jaxik.ik import Status, all_branches, replace_bad_rows, target_columns
from jaxik.kinematics import joint_positions
from jaxik.redundancy.branch_motion import Rates, near_range
from jaxik.redundancy.swivel import swivel_of
from jaxik.redundancy.tangent import tangent
from jaxik.targets import Target

_TURNS_BACK = 1e-7  # least rate of the parameter along the self-motion, which vanishes where branches meet


class ParameterMotion(NamedTuple):
    """Targets whose axes come last, called rows.

    Attributes:
        arm: The arm.
        position: Tool points, ``(3, *rows)`` [m].
        directions: Rotations, ``(3, 3, *rows)``.
        status: :class:`jaxik.Status` of the target alone, ``(*rows,)``: OK, INVALID_TARGET or NONFINITE_INPUT.
        free: None; obstacles are for S-R-S arms.
    """

    arm: Arm
    position: Array
    directions: Array
    status: Array
    free: None = None

    def map_rows(self, f: Callable[[Array], Any]) -> "ParameterMotion":
        """Apply a function of the trailing axes to all that belongs to targets."""
        return self._replace(position=f(self.position), directions=f(self.directions), status=f(self.status))

    def at(self, *index: Any) -> "ParameterMotion":
        """Pick targets: an index for each of the last axes."""
        return self.map_rows(lambda x: x[(..., *index)])

    def branch(self, branch: ArrayLike) -> "ParameterBranch":
        """Self-motion in branches ``(*more, *rows)`` that broadcast against the rows."""
        return ParameterBranch(self.arm, self.position, self.directions, jnp.asarray(branch))


class ParameterBranch(NamedTuple):
    """The self-motion of targets in one branch each, a function of the parameter.

    Attributes:
        arm: The arm.
        position: Tool points, ``(3, *rows)`` [m].
        directions: Rotations, ``(3, 3, *rows)``.
        branch: Branches, ``(*more, *rows)``.
    """

    arm: Arm
    position: Array
    directions: Array
    branch: Array

    def angles(self, parameter: Array) -> Array:
        """Joint angles at parameters ``(*more, *rows)``: ``(joint, *more, *rows)`` [rad].

        Each is in the turn nearest to the middle of its joint's range. Where the branch has no posture, those of the
        closest one.

        **Differentiability**: as :func:`jaxik.solve_ik`.
        """
        shape = jnp.broadcast_shapes(parameter.shape, self.branch.shape)
        position, directions = self._columns(shape)
        branch = jnp.broadcast_to(self.branch, shape).reshape(-1)
        q = all_branches(self.arm, position, directions, jnp.broadcast_to(parameter, shape).reshape(-1)).q
        q = near_range(self.arm, jnp.take_along_axis(q, branch[None, None], axis=0)[0])
        # No parameter, no posture: the solver would take another one.
        return jnp.where(jnp.isfinite(parameter), q.reshape(-1, *shape), jnp.nan)

    def slopes(self, parameter: Array) -> tuple[Array, Array]:
        """Joint angles and their first derivatives in the parameter, ``(joint, *more, *rows)`` each."""
        rates = self.rates(parameter)
        return rates.q, rates.first

    def rates(self, parameter: Array) -> Rates:
        """Joint angles with their first and second derivatives in the parameter."""
        q = self.angles(parameter)
        at = tangent(self.arm, *self._columns(q.shape[1:]), q.reshape(len(q), -1))
        first, second = _along(self.arm, q.reshape(len(q), -1), at.direction, at.bend)
        size = jnp.maximum(jnp.abs(first), _TURNS_BACK)
        inverse = jnp.where(first < 0.0, -1.0, 1.0).astype(q.dtype) / size
        slope, bend = at.direction * inverse, (at.bend - at.direction * (second * inverse)) * inverse**2
        return Rates(q, slope.reshape(q.shape), bend.reshape(q.shape))

    def keep_out_distance(self, parameter: Array) -> Array:
        """Distance of the elbow to each half-space, ``(half_spaces, *more, *rows)`` [m]; negative is forbidden."""
        return self._room_of_elbow(self.angles(parameter))

    def excess(self, q: Array, parameter: Array) -> Array:
        """Sum of the violations of limits [rad] and keep-out [arm lengths], ``(*more, *rows)``."""
        del parameter
        lower, upper = (x.reshape(-1, *(1,) * (q.ndim - 1)) for x in (self.arm.lower, self.arm.upper))
        over = jnp.sum(jnp.maximum(jnp.maximum(lower - q, q - upper), 0.0), axis=0)
        return over + jnp.sum(jnp.maximum(-self._room_of_elbow(q), 0.0), axis=0) / self.arm.length

    def _room_of_elbow(self, q: Array) -> Array:
        elbow = joint_positions(self.arm, jnp.moveaxis(q, 0, -1))[..., 1, :]
        room = self.arm.keep_out.offset - elbow @ self.arm.keep_out.normal.T
        return jnp.moveaxis(room, -1, 0)

    def _columns(self, shape: tuple[int, ...]) -> tuple[Array, Array]:
        """Targets of postures ``shape``, ``(3, n)`` and ``(3, 3, n)``."""
        position = jnp.broadcast_to(self._lifted(self.position, 1, shape), (3, *shape)).reshape(3, -1)
        return position, jnp.broadcast_to(self._lifted(self.directions, 2, shape), (3, 3, *shape)).reshape(3, 3, -1)

    def _lifted(self, x: Array, head: int, shape: tuple[int, ...]) -> Array:
        lift = (1,) * (len(shape) - (x.ndim - head))
        return x.reshape(*x.shape[:head], *lift, *x.shape[head:])


def parameter_motion(arm: Arm, target: Target) -> ParameterMotion:
    """Return the self-motion of targets with batch axes, which become its rows."""
    batch = target.position.shape[:-1]
    position, directions, zeros = target_columns(target, jnp.zeros((), target.position.dtype), batch)
    checked = replace_bad_rows(arm, position, directions, zeros)
    status = jnp.where(checked.invalid, jnp.int32(Status.INVALID_TARGET), jnp.int32(Status.OK))
    status = jnp.where(checked.nonfinite, jnp.int32(Status.NONFINITE_INPUT), status)
    flat = ParameterMotion(arm, checked.position, checked.directions, status)
    return flat if len(batch) == 1 else flat.map_rows(lambda x: x.reshape(*x.shape[:-1], *batch))


def _along(arm: Arm, q: Array, direction: Array, bend: Array) -> tuple[Array, Array]:
    """First and second derivative of the parameter along a curve through postures ``(joint, n)``, ``(n,)`` each."""
    joint = getattr(arm, "outer_joint", None)
    if joint is not None:
        return direction[joint], bend[joint]

    def parameter(s: Array) -> Array:
        return swivel_of(arm, (q + s * direction + 0.5 * s * s * bend).T).swivel

    def rate(s: Array) -> Array:
        return jax.jvp(parameter, (s,), (jnp.ones_like(s),))[1]

    here = jnp.zeros_like(q[0])
    return jax.jvp(rate, (here,), (jnp.ones_like(here),))
