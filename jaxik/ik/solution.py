"""Results of a solve: joint angles, a status per branch, the error that forward kinematics leaves, and the choice."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxik.arm import Arm, ArmModel, as_arm, clip_value
from jaxik.ik.refusal import raise_unless_ok
from jaxik.ik.status import Status
from jaxik.ik.turns import Turns, list_turns, turn_counts
from jaxik.numerics import at_hand, toward
from jaxik.targets import as_array

if TYPE_CHECKING:
    from typing import Self


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Residual:
    """Distance between the target asked for and the one reached, by forward kinematics.

    It is rounding for a feasible branch, except where an angle outside a limit by rounding was put on it; at most 4e-6
    rad and arm lengths (1.05e-3 in float32).

    Attributes:
        position: Distance of the tool points, ``(*batch, 8)`` [m]; ``(*batch,)`` for one branch per row.
        rotation: Angle between the rotations, or between the directions of a pointing target, likewise [rad].
    """

    position: Float[Array, "*branches"]
    rotation: Float[Array, "*branches"]

    @property
    def computed(self) -> bool:
        """False for a residual that waits to be asked for."""
        return "compute" not in self.__dict__

    @classmethod
    def deferred(cls, compute: "Callable[[], Residual]") -> "Residual":
        """Return a residual that is computed when its arrays are first asked for, by whoever: code, JAX, pickle.

        Args:
            compute: Function without arguments, of arrays that are at hand.
        """
        later = object.__new__(cls)
        later.__dict__["compute"] = compute
        return later

    def __getattr__(self, name: str) -> Array:
        """Compute a deferred residual; Python asks here for what an object does not have."""
        if name in ("position", "rotation"):
            if compute := self.__dict__.get("compute"):
                with jax.ensure_compile_time_eval():  # also where a trace asks
                    computed = compute()
                self.__dict__.update(position=computed.position, rotation=computed.rotation)
                self.__dict__.pop("compute", None)
            if name in self.__dict__:  # or another thread was faster
                return self.__dict__[name]
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def __reduce__(self) -> tuple:
        """Pickle and copy the arrays."""
        return type(self), (self.position, self.rotation)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class BranchSolution:
    """One branch per row, chosen by :meth:`IKSolution.best`.

    Attributes:
        q: Joint angles, ``(*batch, n_joints)`` [rad], always finite.
        branch: Branch number, ``(*batch,)``, 0 to 7.
        status: :class:`Status` as integers, ``(*batch,)``.
        residual: Distance from the target, ``(*batch,)`` in meters and radians.
    """

    q: Float[Array, "*batch joint"]
    branch: Int[Array, "*batch"]
    status: Int[Array, "*batch"]
    residual: Residual

    @property
    def ok(self) -> Bool[Array, "*batch"]:
        """Rows with a feasible posture: in reach, within limits, elbow outside its keep-out."""
        return self.status <= Status.NEAR_SINGULAR

    def raise_if_invalid(self) -> "Self":
        """Return the solution itself, so that calls chain; for use outside ``jit``.

        Raises:
            UnreachableError: A row has no feasible branch; with the rows, the status of the first and the next step.
        """
        raise_unless_ok(self.status, "no feasible branch")
        return self


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class IKSolution:
    """All eight closed-form solutions of a batch of targets at given swivels.

    Branch number = ``4 * shoulder + 2 * elbow + wrist``, each bit 0 or 1 (see :mod:`jaxik.ik.solve`).

    Attributes:
        q: Joint angles, ``(*batch, 8, n_joints)`` [rad], always finite.
        status: :class:`Status` as integers, ``(*batch, 8)``.
        residual: Distance from the target, ``(*batch, 8)`` in meters and radians.
    """

    q: Float[Array, "*batch branch joint"]
    status: Int[Array, "*batch branch"]
    residual: Residual

    @property
    def ok(self) -> Bool[Array, "*batch branch"]:
        """Feasible branches: in reach, exactly within limits, on target, elbow outside its keep-out."""
        return self.status <= Status.NEAR_SINGULAR

    def raise_if_invalid(self) -> "Self":
        """Return the solution itself, so that calls chain; for use outside ``jit``.

        Raises:
            UnreachableError: A row has no feasible branch; with the rows, the best status of the first and the next
                step.
        """
        raise_unless_ok(jnp.min(self.status, axis=-1), "no feasible branch")
        return self

    def best(
        self,
        q_now: Float[ArrayLike, "*#batch joint"] | None = None,
        *,
        arm: Arm | ArmModel | None = None,
        weights: Float[ArrayLike, "joint"] | None = None,
    ) -> BranchSolution:
        """Return the feasible branch nearest to a posture, at the swivel that was solved for.

        It minimizes sum(weights * (q - q_now)²) over the feasible branches. A row without any gets the branch with the
        least status, whose status says why. :func:`jaxik.solve_nearest` searches all swivels instead.

        Args:
            q_now: Present joint angles, ``(*batch, n_joints)`` [rad], broadcast against the solution. None chooses the
                least status, then the lowest branch number.
            arm: With the arm, joints that turn by more than a turn (:attr:`jaxik.Arm.turning`) come at the turn nearest
                to ``q_now`` within their limits, in the distance and in the result.
            weights: Weight of each joint's squared motion, ``(n_joints,)``, not negative; all 1 by default.

        Returns:
            Joint angles, branch, status and residual of each row. A row whose ``q_now`` is not finite has the status
            NONFINITE_INPUT.

        Raises:
            ValueError: Wrong shapes, or ``arm`` is not an arm.

        **Differentiability**: the joint angles in the target, swivel and arm, as :func:`jaxik.solve_ik`; the choice
        itself has no derivative.

        Example:
            >>> import jaxik
            >>> model, q = jaxik.presets.iiwa7(), jnp.array([0.3, 0.8, -0.2, -1.2, 0.5, 0.9, 0.1])
            >>> solution = jaxik.solve_ik(model, jaxik.forward_kinematics(model, q), jaxik.swivel_of(model, q).swivel)
            >>> bool(jnp.allclose(solution.best(q).q, q, atol=1e-5))
            True
        """
        joints = self.q.shape[-1]
        if q_now is not None:
            q_now = _checked("q_now", q_now, joints, "*batch, ")
        if weights is not None:
            weights = _checked("weights", weights, joints)
        q, branch, status = _best(self.q, self.status, q_now, None if arm is None else self._own(arm), weights)
        residual = self.residual
        if at_hand(q, branch) and not residual.computed:
            return BranchSolution(q, branch, status, Residual.deferred(lambda: _pick(residual, branch)))
        return BranchSolution(q, branch, status, _pick(residual, branch))

    def turns(
        self,
        arm: Arm | ArmModel,
        q_now: Float[ArrayLike, "*#batch joint"] | None = None,
        *,
        window: float = math.inf,
        places: int | None = None,
    ) -> Turns:
        """List every in-limit posture of each branch that full turns of its joints lead to.

        Where a joint's range exceeds a turn, the same posture of the links has several joint vectors. ``q`` has the one
        with the fewest turns; a motion that must not reach the end of a range, or that unwinds a cable, needs the
        others.

        Args:
            arm: The arm of the solution.
            q_now: Present joint angles, ``(*batch, n_joints)`` [rad], broadcast against the solution; the postures
                nearest to them come first. The zero posture by default.
            window: List only angles at most this far from ``q_now`` [rad], in every joint. By default all that the
                limits admit, and of joints without limits the one nearest to ``q_now``.
            places: Number of postures listed per branch, those nearest to ``q_now``; as many as the limits can admit by
                default (the product over the joints, 3 for a range of ±2 pi, where the angle 0 has three turns).

        Returns:
            Postures and which of the places hold one.

        Raises:
            ValueError: Wrong shapes, ``arm`` is traced or no arm, or the limits admit more than 100 000 postures.

        **Differentiability**: the joint angles as in the solution; order and places have no derivative. Inside ``jit``
        and ``vmap`` the arm must be a constant, since its limits set the number of places.

        Example:
            >>> import jaxik
            >>> z, y = [0, 0, 1], [0, 1, 0]
            >>> points = [0, 0, 0], [0, 0, 0.4], [0, 0, 0.8], [0, 0, 1.0]
            >>> arm = jaxik.make_arm([z, y, z, y, z, y, z], *points, lower=[-6, *[-3] * 6], upper=[6, *[3] * 6])
            >>> q = jnp.array([0.4, 0.8, -0.2, 1.2, 0.5, 0.9, 0.1])
            >>> solution = jaxik.solve_ik(arm, jaxik.forward_kinematics(arm, q), jaxik.swivel_of(arm, q).swivel)
            >>> jnp.round(solution.turns(arm).q[0, :, 0], 3).tolist()  # of joint 1 in branch 0
            [0.4, -5.883]
        """
        joints = self.q.shape[-1]
        arm = self._own(arm)
        now = jnp.zeros(joints, self.q.dtype) if q_now is None else _checked("q_now", q_now, joints, "*batch, ")
        counts = turn_counts(arm, window)
        total = math.prod(counts)
        if places is not None and places < 1:
            raise ValueError(f"expected a positive number of places, got {places}")
        now = jnp.asarray(now, self.q.dtype)
        batch = jnp.broadcast_shapes(self.status.shape[:-1], now.shape[:-1])
        q, status = (jnp.broadcast_to(x, batch + x.shape[self.status.ndim - 1 :]) for x in (self.q, self.status))
        places = total if places is None else min(places, total)
        return list_turns(arm, q, status, now[..., None, :], window, counts=counts, places=places)

    def _own(self, arm: object) -> Arm:
        """Return the arm, checked to have this solution's joints."""
        joints = self.q.shape[-1]
        if (arm := as_arm(arm, any_class=True)).n_joints != joints:
            raise ValueError(f"expected the arm of this solution with {joints} joints, got one of {arm.n_joints}")
        return arm


@jax.jit
def _best(
    q: Array, status: Array, q_now: ArrayLike | None, arm: Arm | None, weights: ArrayLike | None
) -> tuple[Array, Array, Array]:
    """Joint angles, branch and status of the choice."""
    axes, rank, motion, given = status.ndim - 1, status, jnp.zeros(status.shape, q.dtype), True
    if q_now is not None:
        q_now = jnp.asarray(q_now, q.dtype)
        given = jnp.all(jnp.isfinite(q_now), axis=-1)
        q_now = jnp.where(given[..., None], q_now, 0.0)[..., None, :]
        batch = jnp.broadcast_shapes(status.shape[:-1], given.shape)
        q, status = (jnp.broadcast_to(x, batch + x.shape[axes:]) for x in (q, status))
        if arm is not None:
            lower, upper = arm.lower.astype(q.dtype), arm.upper.astype(q.dtype)
            turned = toward(q, q_now, lower, upper)
            inside = (q >= lower) & (q <= upper)  # and stays so, whatever the turn's rounding
            q = jnp.where(arm.turning, jnp.where(inside, clip_value(turned, lower, upper), turned), q)
        weights = jnp.ones(q.shape[-1], q.dtype) if weights is None else jnp.asarray(weights, q.dtype)
        rank = jnp.where(status <= Status.NEAR_SINGULAR, jnp.int32(Status.OK), status)
        # Finite for any q_now: infinity marks the branches that are out of the choice.
        motion = jnp.minimum(jnp.sum(weights * (q - q_now) ** 2, axis=-1), jnp.finfo(q.dtype).max)
    best = rank == jnp.min(rank, axis=-1, keepdims=True)
    branch = jnp.argmin(jnp.where(best, motion, jnp.inf), axis=-1)
    at = branch[..., None]
    status = jnp.take_along_axis(status, at, axis=-1)[..., 0]
    q = jnp.take_along_axis(q, at[..., None], axis=-2)[..., 0, :]
    return q, branch, jnp.where(given, status, jnp.int32(Status.NONFINITE_INPUT))


@jax.jit
def _pick(residual: Residual, branch: Array) -> Residual:
    """The residual of one branch per row."""
    return jax.tree.map(lambda x: _of_branch(x, branch), residual)


def _of_branch(x: Array, branch: Array) -> Array:
    every = jnp.broadcast_to(x, branch.shape + x.shape[-1:])
    return jnp.take_along_axis(every, branch[..., None], axis=-1)[..., 0]


def _checked(name: str, value: Any, joints: int, batch: str = "") -> Any:
    expected = f"{name} of shape ({batch}{joints}{'' if batch else ','})"
    array = as_array(expected, value)
    shape = jnp.shape(array)
    if shape[-1:] != (joints,) or (len(shape) > 1 and not batch):
        raise ValueError(f"expected {expected}, got {shape}")
    return array
