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
from jax import Array

from jaxik.arm import Arm, fit_to_limits, resting_angle, within_limits
from jaxik.ik.arm_constants import ArmConstants, arm_constants
from jaxik.ik.branches import branch_bits
from jaxik.ik.elbow_circle import Bend, Reach, bend, into_plane, out_of_plane, reach
from jaxik.ik.refusal import raise_unless_ok
from jaxik.ik.status import Status
from jaxik.ik.target_checks import CheckedTarget, replace_bad_rows
from jaxik.ik.zyz import ZYZRotation, both_solutions, split_within_limits, zyz_sides
from jaxik.numerics import arctan2, fused_separately, merge_leading, sincos, tolerances, vec3, wrap

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
    """

    shoulder: Array
    elbow: Array
    wrist: Array
    shoulder_inside: Array
    elbow_inside: Array
    wrist_inside: Array
    elbow_status: Array

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
        inside = self.shoulder_inside[s, e] & self.elbow_inside[e] & self.wrist_inside[w, e]
        return jnp.where(inside, self.elbow_status[e], jnp.maximum(self.elbow_status[e], jnp.int32(Status.LIMITS)))

    @property
    def q(self) -> Array:
        """Joint angles of all branches, ``(8, n_joints, n)`` [rad]; expanded at every use."""
        n = self.elbow.shape[-1]
        parts = (
            jnp.moveaxis(self.shoulder, 2, 1)[:, :, None],
            self.elbow[None, :, None, None],
            jnp.moveaxis(self.wrist, 2, 0)[None],
        )
        q = jnp.concatenate([jnp.broadcast_to(p, (2, 2, 2, p.shape[3], n)) for p in parts], axis=3)
        return merge_leading(q, 2)

    @property
    def status(self) -> Array:
        """:class:`Status` of all branches as integers, ``(8, n)``; expanded at every use."""
        wrist_inside = jnp.moveaxis(self.wrist_inside, 1, 0)[None]
        inside = self.shoulder_inside[:, :, None] & self.elbow_inside[None, :, None] & wrist_inside
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
    frame = _frame(g, r.n, zero, *_sincos(target.swivel))
    shoulder, wrist = _rotations(g, frame, bent, _seen(frame, hand))
    opposite, adjacent, *sines2 = _sides(shoulder, wrist, r.sin_half, r.cos_half)
    solutions = _solutions(arm, g, _arctan2(opposite, adjacent))
    solutions = _within_splits(arm, g, directions, solutions, sines2)
    return _classify(arm, g, target, r, frame, bent, solutions, jnp.minimum(*sines2), from_singular2)


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
def _sincos(swivel: Array) -> tuple[Array, Array]:
    return sincos(swivel)


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
def _rotations(g: ArmConstants, frame: Array, b: Bend, seen: Array) -> tuple[ZYZRotation, ZYZRotation]:
    """Rotations of shoulder and wrist, with the elbow bit before the batch."""
    # Shoulder: [n e n×e] [l̂ o l̂×o]ᵀ Bᵀ C1 Ry(delta).
    side = _sides_of_elbow(frame)
    shoulder = vec3.matmul(frame[:, :, None], into_plane(b, side, g.shoulder_from_elbow[:, :, None]))
    # Wrist: undo the shoulder, then the elbow: C5ᵀ B Rz(-q4) [l̂ o l̂×o] [n e n×e]ᵀ hand.
    x, y, z = out_of_plane(b, side, seen[:, :, None])
    sin = side * b.sin
    unbent = jnp.stack([b.cos * x + sin * y, b.cos * y - sin * x, z])
    wrist = vec3.matmul(g.wrist_from_elbow[:, :, None], unbent)
    return ZYZRotation(shoulder[:, -1], shoulder[:2, :-1]), ZYZRotation(wrist[:, -1], wrist[:2, :-1])


@fused_separately
def _sides(shoulder: ZYZRotation, wrist: ZYZRotation, sin_half: Array, cos_half: Array) -> tuple[Array, ...]:
    """Opposite and adjacent sides of every angle, ``(angles, n)``, so that one arctangent serves all.

    And the squared sines of the middle angles of shoulder and wrist, ``(elbow bit, n)``.
    """
    tol = tolerances(sin_half.dtype)
    s_opposite, s_adjacent, s_sine2 = zyz_sides(shoulder, tol)
    w_opposite, w_adjacent, w_sine2 = zyz_sides(wrist, tol)
    opposite = jnp.concatenate([merge_leading(s_opposite, 1), merge_leading(w_opposite, 1), sin_half[None]])
    adjacent = jnp.concatenate([merge_leading(s_adjacent, 1), merge_leading(w_adjacent, 1), cos_half[None]])
    return opposite, adjacent, s_sine2, w_sine2


@fused_separately
def _arctan2(opposite: Array, adjacent: Array) -> Array:
    return arctan2(opposite, adjacent)


@fused_separately
def _solutions(arm: Arm, g: ArmConstants, angles: Array) -> tuple[Array, Array, Array]:
    """Both solutions of shoulder, elbow and wrist, fitted to the limits."""
    n = angles.shape[-1]
    shoulder = both_solutions(angles[:6].reshape(3, 2, n), g.shoulder_delta)
    wrist = both_solutions(angles[6:-1].reshape((len(angles) - 7) // 2, 2, n), g.wrist_delta)
    if arm.n_joints == 7 and wrist.shape[1] == 2:
        wrist = jnp.concatenate([wrist, jnp.broadcast_to(resting_angle(arm), (2, 1, 2, n))], axis=1)
    elbow = wrap(g.straight + _sides_of_elbow(angles) * (2.0 * angles[-1]))
    fitted = (fit_to_limits(arm, _rows(first, x), merge_leading(x, 1)) for first, x in ((0, shoulder), (4, wrist)))
    shoulder, wrist = (f.reshape(x.shape) for f, x in zip(fitted, (shoulder, wrist), strict=True))
    return shoulder, fit_to_limits(arm, (3, 3), elbow), wrist


@fused_separately
def _within_splits(
    arm: Arm, g: ArmConstants, directions: Array, solutions: tuple[Array, Array, Array], sines2: list[Array]
) -> tuple[Array, Array, Array]:
    """The solutions, with the outer angles of aligned joints split so that both are within limits where they can be.

    For every row: to ask whether any row needs it would have devices that share a batch wait for each other.
    """
    shoulder, elbow, wrist = solutions
    pointing = directions.shape[1] == 1
    aligned = [sine2 <= tolerances(sine2.dtype).aligned ** 2 for sine2 in sines2]
    shoulder = split_within_limits(arm, 0, g.shoulder_delta, shoulder, aligned[0])
    return shoulder, elbow, split_within_limits(arm, 4, g.wrist_delta, wrist, aligned[1], pointing=pointing)


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
        (in_keep_out(arm, g, frame, b, tol.singular), Status.KEEP_OUT),
        (r.out_of_reach, Status.OUT_OF_REACH),
        (target.invalid, Status.INVALID_TARGET),
        (target.nonfinite, Status.NONFINITE_INPUT),
    ):
        status = jnp.where(condition, jnp.int32(reason), status)
    return Branches(shoulder, elbow, wrist, shoulder_inside, elbow_inside, wrist_inside, status)


def in_keep_out(arm: Arm, g: ArmConstants, frame: Array, b: Bend, slack: float) -> Array:
    """Test whether the elbow lies in a forbidden half-space, ``(n,)``; touching the boundary is allowed."""
    elbow = g.upper * (b.cos_base * frame[:, 0] + b.sin_base * frame[:, 1])
    normal = vec3.matmul(g.to_shoulder_frame[..., 0], arm.keep_out.normal.T)
    room = arm.keep_out.offset - arm.keep_out.normal @ arm.shoulder
    return jnp.any(vec3.dot(normal[..., None], elbow[:, None]) - room[:, None] > slack * g.upper, axis=0)


def _rows(first: int, angles: Array) -> tuple[int, ...]:
    """The joint of every row of a spherical joint's angles ``(bit, joints, elbow bit, n)``, flattened."""
    return tuple(j for _ in range(2) for j in range(first, first + angles.shape[1]) for _ in range(2))


def _sides_of_elbow(like: Array) -> Array:
    """+1 and -1 for elbow bit 0 and 1, ``(2, 1)``."""
    return jnp.array([[1.0], [-1.0]], like.dtype)
