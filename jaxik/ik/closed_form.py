"""The closed form, batch last: from a checked target to the 26 distinct angles of its eight branches.

1. Take the hand off the target: the wrist (kinematic decoupling; the paper's eqs. (7)-(10)).
2. The distance from shoulder to wrist gives the elbow joint, up to a sign (law of cosines, half-angle form).
3. The elbow lies on a circle about the shoulder-wrist line; the swivel angle picks the point (eqs. (28)-(40)).
4. The arm plane gives the shoulder's rotation, the rest of the tool's rotation is the wrist's; the angles of both
   spherical joints are read off up to a sign.

Two elbows times two solutions per spherical joint: the eight branches share their angles, and cost little more than
one.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.arm import Arm, fit_to_limits, resting_angle, within_limits
from jaxik.ik.arm_constants import ArmConstants, arm_constants
from jaxik.ik.branches import branch_bits
from jaxik.ik.elbow_circle import Bend, Reach, bend, elbow_slack, plane_matrix, reach
from jaxik.ik.refusal import raise_unless_ok
from jaxik.ik.status import Status
from jaxik.ik.target_checks import CheckedTarget, replace_bad_rows
from jaxik.ik.zyz import ZYZRotation, both_solutions, split_values, zyz_sides
from jaxik.numerics import (
    arctan2,
    fused_separately,
    merge_leading,
    principal,
    sincos_apart,
    tolerances,
    vec3,
    with_value,
    wrap,
)

if TYPE_CHECKING:
    from typing import Self


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Branches:
    """Angles and statuses of the eight branches of n targets, stored once where branches share them.

    Attributes:
        shoulder: Joints 1 to 3, ``(shoulder bit, 3, elbow bit, n)`` [rad].
        elbow: Joint 4, ``(elbow bit, n)`` [rad].
        wrist: Joints from 5 on, ``(wrist bit, 3 or 2, elbow bit, n)`` [rad].
        shoulder_inside: True where joints 1 to 3 are in their limits, ``(shoulder bit, elbow bit, n)``.
        elbow_inside: True where joint 4 is in its limits, ``(elbow bit, n)``.
        wrist_inside: True where the joints from 5 on are in their limits, ``(wrist bit, elbow bit, n)``.
        elbow_status: Worst status that depends on the elbow bit alone, ``(elbow bit, n)``.
        off_target: True where several angles at once were put on their limits and may leave the target, ``(8, n)``.
    """

    shoulder: Array
    elbow: Array
    wrist: Array
    shoulder_inside: Array
    elbow_inside: Array
    wrist_inside: Array
    elbow_status: Array
    off_target: Array

    def joints(self, branch: int) -> tuple[Array, ...]:
        """Return the joint angles of one branch.

        Args:
            branch: Branch number, 0 to 7.

        Returns:
            One column ``(n,)`` per joint [rad].
        """
        s, e, w = map(int, branch_bits(branch))
        return *self.shoulder[s, :, e], self.elbow[e], *self.wrist[w, :, e]

    def branch_status(self, branch: int) -> Array:
        """Return the status of one branch.

        Args:
            branch: Branch number, 0 to 7.

        Returns:
            :class:`Status` as integers, ``(n,)``.
        """
        s, e, w = map(int, branch_bits(branch))
        inside = self.shoulder_inside[s, e] & self.elbow_inside[e] & self.wrist_inside[w, e] & ~self.off_target[branch]
        return jnp.where(inside, self.elbow_status[e], jnp.maximum(self.elbow_status[e], jnp.int32(Status.LIMITS)))

    @property
    def q(self) -> Array:
        """Joint angles of all branches, ``(8, n_joints, n)`` [rad]; expanded at every use."""
        # Stacked twice, not broadcast: the transpose is then one addition, in the place of a slow sum over an axis.
        shoulder = _twice(jnp.moveaxis(self.shoulder, 2, 1), 2)
        elbow = _twice(_twice(self.elbow, 1), 0)[:, :, :, None]
        wrist = _twice(jnp.moveaxis(self.wrist, 2, 0), 0)
        return merge_leading(jnp.concatenate([shoulder, elbow, wrist], axis=3), 2)

    @property
    def status(self) -> Array:
        """:class:`Status` of all branches as integers, ``(8, n)``; expanded at every use."""
        wrist_inside = jnp.moveaxis(self.wrist_inside, 1, 0)[None]
        inside = self.shoulder_inside[:, :, None] & self.elbow_inside[None, :, None] & wrist_inside
        inside = inside & ~self.off_target.reshape(inside.shape)
        limits = jnp.where(inside, jnp.int32(Status.OK), jnp.int32(Status.LIMITS))
        return merge_leading(jnp.maximum(limits, self.elbow_status[None, :, None]), 1)

    @property
    def ok(self) -> Array:
        """Feasible branches, ``(8, n)``."""
        return self.status <= Status.NEAR_SINGULAR

    def raise_if_invalid(self) -> "Self":
        """Return the branches themselves, so that calls chain; for use outside ``jit``.

        Raises:
            UnreachableError: A target has no feasible branch; with the targets, the status of the first and the next
                step.
        """
        raise_unless_ok(jnp.min(self.status, axis=0), "no feasible branch")
        return self


def closed_form(arm: Arm, position: Array, directions: Array, swivel: Array) -> Branches:
    """Return all branches of targets of one float dtype: ``(3, n)``, ``(3, 3 or 1, n)`` and ``(n,)``."""
    g = arm_constants(arm)
    target = replace_bad_rows(arm, position, directions, swivel)
    w, hand = wrist_and_hand(g, target)
    r, zero, from_singular2, bent = usable_circle(g, w)
    frame = _frame(g, r.n, zero, *sincos_apart(target.swivel))
    shoulder, wrist = _rotations(frame, _seen(frame, hand), _bent(g, bent))
    opposite, adjacent, *sines2 = _sides(shoulder, wrist, r.sin_half, r.cos_half)
    pointing = directions.shape[1] == 1
    angles = _arctan2(opposite, adjacent)
    fixed, sides = jax.lax.stop_gradient(((arm, g, angles), (adjacent, sines2)))
    values = _within_splits(arm, pointing, _fitted_solutions(*fixed), *sides)
    solutions = jax.tree.map(with_value, _linear_in_angles(arm, g, angles), values)
    off_target = _off_target(arm, g, pointing, angles, solutions, adjacent, sines2)
    return _classify(arm, g, target, r, frame, bent, solutions, jnp.minimum(*sines2), from_singular2, off_target)


def usable_circle(g: ArmConstants, w: Array) -> tuple[Reach, Array, Array, Bend]:
    """The elbow's circle for a wrist at ``w``: reach, zero swivel, distance from its singular set, and bend."""
    r = reach(g, w)
    return r, *_circle(g, r)


def elbow_angle(g: ArmConstants, r: Reach) -> Array:
    """Joint 4, ``(elbow bit, n)`` [rad] in (-pi, pi]."""
    return wrap(g.straight + _sides_of_elbow(r.n) * (2.0 * arctan2(r.sin_half, r.cos_half)))


@fused_separately
def wrist_and_hand(g: ArmConstants, target: CheckedTarget) -> tuple[Array, Array]:
    """Shoulder to wrist, and the hand's rotation times the wrist's frame, both in the shoulder frame.

    For a pointing target only the last column exists: the direction of the last axis.
    """
    origin = vec3.matvec(g.to_shoulder_frame, target.position - g.shoulder)
    rotation = vec3.matmul(g.to_shoulder_frame, target.directions)
    if rotation.shape[1] == 1:
        return origin - g.tool_offset[2] * rotation[:, 0], rotation
    return origin - vec3.matvec(rotation, g.tool_offset), vec3.matmul(rotation, g.tool_to_wrist)


@fused_separately
def _circle(g: ArmConstants, r: Reach) -> tuple[Array, Array, Bend]:
    """Zero direction of the swivel, distance from its singular set, and the bend's directions."""
    tol = tolerances(r.n.dtype)
    zero, from_singular2 = g.reference.zero_direction(r.n, tol)
    sin, cos = 2.0 * r.sin_half * r.cos_half, r.cos_half * r.cos_half - r.sin_half * r.sin_half
    return zero, from_singular2, bend(g, sin, cos, tol)


@fused_separately
def _frame(g: ArmConstants, n: Array, zero: Array, sin: Array, cos: Array) -> Array:
    """The arm plane's frame [n, e, n × e] at a swivel angle, in the shoulder frame, ``(3, 3, n)``."""
    sense = g.reference.sense
    quarter = sense * vec3.cross(n, zero)
    return jnp.stack([n, cos * zero + sin * quarter, sense * (cos * quarter - sin * zero)], axis=1)


@fused_separately
def _seen(frame: Array, hand: Array) -> Array:
    """The hand in the arm plane's frame."""
    return vec3.matmul(vec3.transpose(frame), hand)


@fused_separately
def _bent(g: ArmConstants, b: Bend) -> tuple[Array, Array]:
    """The bend as rotations, ``(3, 3, elbow bit, n)``: arm plane to shoulder joint 3, and arm plane to joint 5."""
    side = _sides_of_elbow(b.cos)
    plane = plane_matrix(b, side)
    shoulder = vec3.matmul(plane, g.shoulder_from_elbow[:, :, None])
    # Undo the elbow, C5ᵀ B Rz(-q4): the turn about z takes the columns of the constant along.
    x, y, z = (g.wrist_from_elbow[:, i : i + 1, None] for i in range(3))
    sin = side * b.sin
    unbent = jnp.concatenate(jnp.broadcast_arrays(b.cos * x - sin * y, sin * x + b.cos * y, z), axis=1)
    return shoulder, vec3.matmul(unbent, vec3.transpose(plane))


@fused_separately
def _rotations(frame: Array, seen: Array, bent: tuple[Array, Array]) -> tuple[Array, Array]:
    """Rotations of shoulder and wrist, with the elbow bit before the batch."""
    return vec3.matmul(frame[:, :, None], bent[0]), vec3.matmul(bent[1], seen[:, :, None])


@fused_separately
def _sides(shoulder: Array, wrist: Array, sin_half: Array, cos_half: Array) -> tuple[Array, ...]:
    """Opposite and adjacent sides of every angle, ``(angles, n)``, so that one arctangent serves all.

    And the squared sines of the middle angles of shoulder and wrist, ``(elbow bit, n)``.
    """
    tol = tolerances(sin_half.dtype)
    rotations = (ZYZRotation(m[:, -1], m[:2, :-1]) for m in (shoulder, wrist))
    (s_opposite, s_adjacent, s_sine2), (w_opposite, w_adjacent, w_sine2) = (zyz_sides(m, tol) for m in rotations)
    opposite = jnp.concatenate([merge_leading(s_opposite, 1), merge_leading(w_opposite, 1), sin_half[None]])
    adjacent = jnp.concatenate([merge_leading(s_adjacent, 1), merge_leading(w_adjacent, 1), cos_half[None]])
    return opposite, adjacent, s_sine2, w_sine2


@fused_separately
def _arctan2(opposite: Array, adjacent: Array) -> Array:
    return arctan2(opposite, adjacent)


def _solutions(arm: Arm, g: ArmConstants, angles: Array) -> tuple[Array, Array, Array]:
    """Both solutions of shoulder, elbow and wrist."""
    n = angles.shape[-1]
    shoulder = both_solutions(angles[:6].reshape(3, 2, n), g.shoulder_delta)
    wrist = both_solutions(angles[6:-1].reshape((len(angles) - 7) // 2, 2, n), g.wrist_delta)
    if arm.n_joints == 7 and wrist.shape[1] == 2:
        wrist = jnp.concatenate([wrist, jnp.broadcast_to(resting_angle(arm), (2, 1, 2, n))], axis=1)
    return shoulder, wrap(g.straight + _sides_of_elbow(angles) * (2.0 * angles[-1])), wrist


@fused_separately
def _fitted_solutions(arm: Arm, g: ArmConstants, angles: Array) -> tuple[Array, Array, Array]:
    """Both solutions of shoulder, elbow and wrist, fitted to the limits."""
    shoulder, elbow, wrist = _solutions(arm, g, angles)
    fitted = (fit_to_limits(arm, _rows(first, x), merge_leading(x, 1)) for first, x in ((0, shoulder), (4, wrist)))
    shoulder, wrist = (f.reshape(x.shape) for f, x in zip(fitted, (shoulder, wrist), strict=True))
    return shoulder, fit_to_limits(arm, (3, 3), elbow), wrist


@fused_separately
def _linear_in_angles(arm: Arm, g: ArmConstants, angles: Array) -> tuple[Array, Array, Array]:
    """Expressions with the derivatives of the solutions, whose limits and turns are constants to these."""
    n = angles.shape[-1]
    shoulder, wrist, half_bend = jax.lax.split(angles, (6, len(angles) - 7, 1))
    both = []
    for joint, delta in ((shoulder, g.shoulder_delta), (wrist, g.wrist_delta)):
        joint = joint.reshape(len(joint) // 2, 2, n)
        middle = np.array([0.0, 1.0, 0.0])[: len(joint), None, None].astype(angles.dtype)
        both.append(jnp.stack([joint, (1.0 - 2.0 * middle) * joint]) - middle * delta)
    shoulder, wrist = both
    if arm.n_joints == 7 and wrist.shape[1] == 2:
        wrist = jnp.concatenate([wrist, jnp.broadcast_to(resting_angle(arm), (2, 1, 2, n))], axis=1)
    return shoulder, g.straight + _sides_of_elbow(angles) * (2.0 * half_bend), wrist


def _within_splits(
    arm: Arm, pointing: bool, solutions: tuple[Array, Array, Array], adjacent: Array, sines2: list[Array]
) -> tuple[Array, Array, Array]:
    """The solutions, with the outer angles of aligned joints split so that both are within limits where they can be.

    For every row: to ask whether any row needs it would have devices that share a batch wait for each other.
    """
    shoulder, elbow, wrist = solutions
    s_aligned, w_aligned = (sine2 <= tolerances(sine2.dtype).aligned ** 2 for sine2 in sines2)
    shoulder = split_values(arm, 0, shoulder, adjacent[2:4], s_aligned)
    return shoulder, elbow, split_values(arm, 4, wrist, adjacent[8:10], w_aligned, pointing=pointing)


def _off_target(
    arm: Arm,
    g: ArmConstants,
    pointing: bool,
    angles: Array,
    solutions: tuple[Array, Array, Array],
    adjacent: Array,
    sines2: list[Array],
) -> Array:
    """Branches whose angles were put on their limits by more than two angles may be together, ``(8, n)``.

    All seven together leave the target by less than its own rotation may be off, in double precision.
    """
    tol = tolerances(angles.dtype)
    if arm.n_joints * tol.limit < tol.rotation:
        return jnp.zeros((8, angles.shape[-1]), bool)
    free = jnp.array([False, pointing])  # the first angle of an aligned joint
    zs = adjacent[2:4], adjacent[8:10]
    shoulder, elbow, wrist = _moves(arm, g, angles, solutions, zs, (sines2[0], sines2[1]), free)
    total = shoulder[:, None] + elbow + wrist[None]
    return merge_leading(jnp.swapaxes(total, 1, 2), 1) > 2 * tol.limit + tol.singular


@fused_separately
def _moves(
    arm: Arm,
    g: ArmConstants,
    angles: Array,
    solutions: tuple[Array, Array, Array],
    zs: tuple[Array, Array],
    sines2: tuple[Array, Array],
    free: Array,
) -> tuple[Array, Array, Array]:
    """Sums of the distances by which angles were moved but for full turns: ``(bit, elbow bit, n)``, elbow without bit.

    Of aligned joints the turn counts, not how it is split.
    """
    shoulder, elbow, wrist = (principal(x - y) for x, y in zip(solutions, _solutions(arm, g, angles), strict=True))
    sums = []
    for moves, z, sine2, anywhere in zip((shoulder, wrist), zs, sines2, free, strict=True):
        outer, turn = jnp.abs(moves[:, 0]), jnp.abs(moves[:, 0])
        if moves.shape[1] == 3:
            turn = jnp.abs(principal(moves[:, 0] + jnp.where(z > 0.0, moves[:, 2], -moves[:, 2])))
            outer = outer + jnp.abs(moves[:, 2])
        aligned = sine2 <= tolerances(z.dtype).aligned ** 2
        outer = jnp.where(aligned, jnp.where(anywhere, 0.0, turn), outer)
        sums.append(outer + jnp.abs(moves[:, 1]))
    return sums[0], jnp.abs(elbow), sums[1]


@fused_separately
def _classify(
    arm: Arm,
    g: ArmConstants,
    target: CheckedTarget,
    r: Reach,
    frame: Array,
    b: Bend,
    solutions: tuple[Array, Array, Array],
    sine2: Array,
    from_singular2: Array,
    off_target: Array,
) -> Branches:
    """Classify every branch."""
    shoulder, elbow, wrist = solutions
    elbow_inside = within_limits(arm, (3, 3), elbow)
    inside = (within_limits(arm, _rows(first, x), merge_leading(x, 1)) for first, x in ((0, shoulder), (4, wrist)))
    shoulder_inside, wrist_inside = (
        jnp.all(i.reshape(x.shape), axis=1) for i, x in zip(inside, (shoulder, wrist), strict=True)
    )
    tol = tolerances(elbow.dtype)
    near2 = tol.near_singular**2
    near = (b.sin < tol.near_singular) | (sine2 < near2) | (from_singular2 < near2) | r.centered
    status = jnp.zeros(near.shape, jnp.int32)
    for condition, reason in (
        (near, Status.NEAR_SINGULAR),
        (in_keep_out(arm, g, frame, b), Status.KEEP_OUT),
        (r.out_of_reach, Status.OUT_OF_REACH),
        (target.invalid, Status.INVALID_TARGET),
        (target.nonfinite, Status.NONFINITE_INPUT),
    ):
        status = jnp.where(condition, jnp.int32(reason), status)
    return Branches(shoulder, elbow, wrist, shoulder_inside, elbow_inside, wrist_inside, status, off_target)


def in_keep_out(arm: Arm, g: ArmConstants, frame: Array, b: Bend) -> Array:
    """Test whether the elbow lies in a forbidden half-space, ``(n,)``; touching the boundary is allowed."""
    elbow = g.upper * (b.cos_base * frame[:, 0] + b.sin_base * frame[:, 1])
    normal = vec3.matmul(g.to_shoulder_frame[..., 0], arm.keep_out.normal.T)
    room = arm.keep_out.offset - arm.keep_out.normal @ arm.shoulder
    return jnp.any(vec3.dot(normal[..., None], elbow[:, None]) - room[:, None] > elbow_slack(g, b.sin), axis=0)


def _twice(x: Array, axis: int) -> Array:
    return jnp.stack([x, x], axis=axis)


def _rows(first: int, angles: Array) -> tuple[int, ...]:
    """The joint of every row of a spherical joint's angles ``(bit, joints, elbow bit, n)``, flattened."""
    return tuple(j for _ in range(2) for j in range(first, first + angles.shape[1]) for _ in range(2))


def _sides_of_elbow(like: Array) -> Array:
    """+1 and -1 for elbow bit 0 and 1, ``(2, 1)``."""
    return jnp.array([[1.0], [-1.0]], like.dtype)
