"""Closed-form inverse kinematics of an S-R-S arm at a swivel angle: all eight branches of a batch of targets.

1. Take the hand off the target: the wrist (kinematic decoupling; the paper's eqs. (7)-(10)).
2. The distance from shoulder to wrist gives the elbow joint, up to a sign (law of cosines, half-angle form).
3. The elbow lies on a circle about the shoulder-wrist line; the swivel angle picks the point (eqs. (28)-(40)).
4. The arm plane gives the shoulder's rotation, what remains of the tool's rotation the wrist's; each is three orthogonal
   axes, read off up to a sign.

Branch number = 4 * shoulder + 2 * elbow + wrist. Shoulder bit 0: sin(q2 + delta) >= 0, with delta the angle from axis 1
to axis 3 at zero; wrist bit 0 the same for q6; elbow bit 0: q4 on the positive side of full stretch.

References:
    M. Shimizu et al., "Analytical inverse kinematic computation for 7-DOF redundant manipulators with joint limits and its
    application to redundancy resolution", IEEE T-RO 24(5), 2008. Departures: any axis arrangement and elbow offset of the
    class; half angles instead of arccos; singular postures have values and derivatives.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik import columns as col
from jaxik.arm import Arm
from jaxik.columns import Vec3
from jaxik.elbow import Circle, arm_plane, circle, elbow_rotations
from jaxik.geometry import Geometry, geometry
from jaxik.kinematics import forward_kinematics, tool_direction
from jaxik.limits import Fitted, fit_to_limits, in_keep_out
from jaxik.numerics import Tolerances, arctan2, sincos, tolerances, wrap
from jaxik.screening import Screened, screen
from jaxik.shapes import batch_shape, check_target
from jaxik.solution import IKSolution, Residual, Status
from jaxik.targets import Pose, Target
from jaxik.triple import Triple, both, solve_triple

SIDES = (1.0, -1.0)  # elbow bit 0, 1


@jax.jit
def solve_ik(arm: Arm, target: Target, swivel: Float[ArrayLike, "*batch"]) -> IKSolution:
    """All eight joint vectors that put the tool on the target with the elbow at a swivel angle.

    Args:
        arm: The arm.
        target: A :class:`Pose` (7 joints) or a :class:`Pointing` (6 joints, or 7 whose last joint only rolls the hand: it is
            then left at zero, or at its nearest limit). Leading batch axes, broadcast against ``swivel``.
        swivel: Angle of the elbow on its circle, from the arm's reference, ``(*batch,)`` [rad].

    Returns:
        Joint angles ``(*batch, 8, n_joints)`` in (-pi, pi], or the turn beyond where a limit admits only that, a status
        ``(*batch, 8)`` and the residual of forward kinematics. The dtype is that of the target and swivel; the arm follows.
        Out of reach, the wrist goes to the nearest reachable point on its ray from the shoulder.

    Raises:
        ValueError: Wrong shapes or dtypes, or a :class:`Pose` for a 6-joint arm. Bad values never raise: see ``status``.

    **Differentiability**: forward and reverse in target, swivel and every array of the arm, finite everywhere. At the
    singular postures the derivative is that of every motion the arm can follow there: at an aligned shoulder or wrist with
    q1 (q5) held; on the reference's singular line with the reference carried along without spin; at full stretch, where
    the elbow's rate in the radial direction is infinite, with the rate at a margin of 64 eps; out of reach, with the
    bend held. Rows with a bad input have derivative zero.
    """
    target, (swivel,) = check_target(arm, target, swivel)
    shape = batch_shape(target, swivel)
    arm = arm.astype(swivel.dtype)
    branches = solve_columns(arm, target, swivel)
    q = jnp.stack([col.join_vector(branches.joints(i)) for i in range(8)], axis=-2)
    status = jnp.stack(jnp.broadcast_arrays(*(branches.status(i) for i in range(8))), axis=-1)
    q = jnp.broadcast_to(q, (*shape, 8, arm.n_joints))
    return IKSolution(q, jnp.broadcast_to(status, (*shape, 8)), residual(arm, target, q))


class Branches(NamedTuple):
    """The eight branches as the few distinct columns they are made of: two elbows times two solutions per triple."""

    shoulder: tuple[tuple[Fitted, Fitted], tuple[Fitted, Fitted]]  # [elbow bit][shoulder bit]
    elbow: tuple[Fitted, Fitted]
    wrist: tuple[tuple[Fitted, Fitted], tuple[Fitted, Fitted]]  # [elbow bit][wrist bit]
    near_singular: tuple[Array, Array]  # [elbow bit]
    keep_out: tuple[Array, Array]
    worst: Array  # status that holds for every branch of the row

    def parts(self, branch: int) -> tuple[Fitted, Fitted, Fitted]:
        """Shoulder, elbow and wrist of a branch."""
        s, e, w = branch >> 2 & 1, branch >> 1 & 1, branch & 1
        return self.shoulder[e][s], self.elbow[e], self.wrist[e][w]

    def joints(self, branch: int) -> tuple[Array, ...]:
        """Joint angles of a branch, one column each."""
        shoulder, elbow, wrist = self.parts(branch)
        return shoulder.angles + elbow.angles + wrist.angles

    def status(self, branch: int) -> Array:
        """Status of a branch."""
        shoulder, elbow, wrist = self.parts(branch)
        e = branch >> 1 & 1
        limits = ~(shoulder.inside & elbow.inside & wrist.inside)
        status = jnp.where(self.near_singular[e], int(Status.NEAR_SINGULAR), int(Status.OK))
        status = jnp.where(limits, int(Status.LIMITS), status)
        status = jnp.where(self.keep_out[e], int(Status.KEEP_OUT), status)
        return jnp.maximum(status, self.worst)


def solve_columns(arm: Arm, target: Target, swivel: Array) -> Branches:
    """The closed form itself, columns in and columns out; arm, target and swivel of one float dtype."""
    tol = tolerances(swivel.dtype)
    g = geometry(arm)
    clean = screen(arm, target, swivel, tol)
    w, hand = wrist_and_hand(g, clean)
    c = circle(g, w, tol)
    sin, cos = sincos(clean.swivel)
    plane = elbow_rotations(c, cos, sin)
    shoulder, elbow, wrist, near, keep_out = [], [], [], [], []
    for side in SIDES:
        s, q4, t = _triples(g, c, plane, hand, side, tol)
        shoulder.append(tuple(fit_to_limits(arm, 0, a) for a in both(s, g.shoulder_delta)))
        elbow.append(fit_to_limits(arm, 3, (q4,)))
        rolls = _resting_roll(arm, len(hand))
        wrist.append(tuple(fit_to_limits(arm, 4, a + rolls) for a in both(t, g.wrist_delta)))
        near.append(c.near_singular | (jnp.minimum(s.sine2, t.sine2) < tol.near_singular**2))
        keep_out.append(in_keep_out(arm, g, c, plane, side, tol))
    worst = jnp.where(c.out_of_reach, int(Status.OUT_OF_REACH), int(Status.OK))
    worst = jnp.where(clean.invalid, int(Status.INVALID_TARGET), worst)
    worst = jnp.where(clean.nonfinite, int(Status.NONFINITE_INPUT), worst)
    return Branches(tuple(shoulder), tuple(elbow), tuple(wrist), tuple(near), tuple(keep_out), worst)  # pyright: ignore


def wrist_and_hand(g: Geometry, t: Screened) -> tuple[Vec3, tuple[Vec3, ...]]:
    """Shoulder to wrist, and the hand's rotation times the wrist's frame, both in the shoulder frame.

    For a pointing target only the last column exists: the direction of the last axis.
    """
    *position, = col.transposed_matmul(g.shoulder_frame, (t.position,))
    origin = col.sub(position[0], g.shoulder_origin)
    directions = col.transposed_matmul(g.shoulder_frame, t.directions)
    if len(directions) == 1:
        hand = col.scale(g.hand, directions[0])
        return col.sub(origin, hand), directions
    rotation = directions[0], directions[1], directions[2]
    return col.sub(origin, col.combine(g.tool_offset, rotation)), col.matmul(rotation, g.tool_to_wrist)


def _triples(
    g: Geometry, c: Circle, plane: tuple[Vec3, Vec3, Vec3], hand: tuple[Vec3, ...], side: float, tol: Tolerances
) -> tuple[Triple, Array, Triple]:
    """Shoulder triple, elbow joint and wrist triple for the elbow bent to one side."""
    seen = arm_plane(c.bend, side)
    # Shoulder: [n e n×e] [l̂ o l̂×o]ᵀ Bᵀ C1 Ry(delta).
    shoulder = solve_triple(col.matmul(plane, col.transposed_matmul(seen, g.shoulder_from_elbow)), tol)
    # Wrist: undo the shoulder, then the elbow: C5ᵀ B Rz(-q4) [l̂ o l̂×o] [n e n×e]ᵀ hand.
    in_elbow = col.matmul(seen, col.transposed_matmul(plane, hand))
    sin = side * c.bend.sin
    unbent = tuple((c.bend.cos * x + sin * y, c.bend.cos * y - sin * x, z) for x, y, z in in_elbow)
    wrist = solve_triple(col.matmul(g.wrist_from_elbow, unbent), tol)
    return shoulder, wrap(g.straight + side * c.bend.angle), wrist


def _resting_roll(arm: Arm, hand_columns: int) -> tuple[Array, ...]:
    """Angle of a seventh joint that a pointing target leaves free."""
    if arm.n_joints == 6 or hand_columns == 3:
        return ()
    return (jnp.clip(jnp.zeros_like(arm.lower[6]), arm.lower[6], arm.upper[6]),)


def residual(arm: Arm, target: Target, q: Array) -> Residual:
    """What forward kinematics of ``(*batch, 8, n_joints)`` leaves of the target: metres, and radians."""
    position = col.split_vector(target.position[..., None, :])
    if isinstance(target, Pose):
        reached = forward_kinematics(arm, q)
        miss = col.sub(col.split_vector(reached.position), position)
        turn = sum(
            (
                _square(col.sub(a, b))
                for a, b in zip(
                    col.split_matrix(reached.rotation), col.split_matrix(target.rotation[..., None, :, :]), strict=True
                )
            ),
            start=jnp.zeros((), q.dtype),
        )
        # |R - R'| = 2 sqrt(2) sin(angle / 2), which keeps its digits for small angles where the trace does not.
        half = jnp.clip(turn / 8.0, 0.0, 1.0)
    else:
        point, direction = tool_direction(arm, q)
        miss = col.sub(point, position)
        wanted = col.split_vector(target.direction[..., None, :])
        length2 = _square(wanted)
        usable = length2 > 0.0
        unit = col.scale(1.0 / jnp.sqrt(jnp.where(usable, length2, 1.0)), wanted)
        half = jnp.clip(_square(col.sub(direction, unit)) / 4.0, 0.0, 1.0)
    return Residual(_root(_square(miss)), 2.0 * arctan2(_root(half), _root(1.0 - half)))


def _square(v: Vec3) -> Array:
    return col.dot(v, v)


def _root(x: Array) -> Array:
    """Square root with derivative zero at zero: a residual's own gradient means nothing there."""
    positive = x > 0.0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, x, 1.0)), 0.0)
