"""The closed form of arms with an outer joint, batch last: eight branches at an angle of that joint.

For a U-R wrist, whose outer joint is joint 7:

1. Take the hand and joint 7 off the target: the wrist W, where axes 5 and 6 meet, and the direction z6 of axis 6.
2. The distance from shoulder to wrist gives the elbow joint, up to a sign, as for S-R-S arms.
3. With the elbow bent, axis 5 makes a known angle with the direction n from shoulder to wrist, and a known angle with
   z6. So it is one of at most two directions, mirror images in the plane of n and z6: the root.
4. The line and axis 5 give the shoulder's rotation, whose three angles are read off up to a sign. The angles of joints
   5 and 6 follow from axes 5 and 6 alone.

Two elbows times two roots times two solutions of the shoulder. The R-U shoulder is the same, read from tip to base.

References:
    Y. He and S. Liu, "Analytical inverse kinematics for Franka Emika Panda - a geometrical solver for 7-DOF
    manipulators with unconventional design", 2021; P. Lopez-Custodio et al., "GeoFIK", 2025. Departures: every arm of
    the class and its mirror image, half angles in the place of arccos, values and derivatives at singular postures.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik.arm import OuterJointArm, fit_to_limits, reversed_arm, within_limits
from jaxik.ik.elbow_circle import Bend, Reach, bend, into_plane, reach
from jaxik.ik.outer_joint_branches import OuterJointBranches
from jaxik.ik.outer_joint_constants import OuterJointConstants, outer_joint_constants
from jaxik.ik.status import Status
from jaxik.ik.target_checks import CheckedTarget, replace_bad_rows
from jaxik.ik.zyz import ZYZRotation, both_solutions, split_within_limits, zyz_sides
from jaxik.numerics import (
    arctan2,
    fused_separately,
    merge_leading,
    principal,
    sincos,
    tolerances,
    unit_sqrt,
    vec3,
    wrap,
)


def outer_joint_form(arm: OuterJointArm, position: Array, directions: Array, parameter: Array) -> OuterJointBranches:
    """Return all branches of targets of one float dtype: ``(3, n)``, ``(3, 3, n)`` and ``(n,)``."""
    if directions.shape[1] == 1:
        raise ValueError(
            f"a {arm.kinematic_class} arm has no closed form for pointing targets, whose roll is free: expected a "
            "jaxik.Pose, got a Pointing"
        )
    target = replace_bad_rows(arm, position, directions, parameter)
    inner, seen = (reversed_arm(arm), from_tip(target)) if arm.mirrored else (arm, target)
    g = outer_joint_constants(inner)
    w, hand = outer_wrist_and_hand(g, seen)
    r, roots, b = outer_joint_roots(g, w, hand)
    opposite, adjacent, sine2 = outer_joint_angles(g, r, b, hand, roots)
    solutions = _solutions(inner, g, _arctan2(opposite, adjacent), target.swivel)
    spherical = _within_splits(inner, g, solutions[0], sine2)
    room = _keep_out_room(arm, inner, g, target, r, b, roots), _reach_room(g, w)
    return _classify(arm, inner, target, r, b, roots, (spherical, *solutions[1:]), sine2, *room)


class Roots(NamedTuple):
    """The two directions of axis 5 of each elbow, about the line from shoulder to wrist.

    Attributes:
        across: Unit vector across the line in its plane with axis 6, ``(3, n)``.
        aside: Unit vector across both, ``(3, n)``.
        sine: Sine of the angle between the line and axis 6, ``(n,)``.
        cosine: Its cosine.
        axis: Cosine of the angle between the line and axis 5, and its sine, ``(2, elbow bit, n)``.
        cos: Cosine of the angle at the line from ``across`` to axis 5, ``(elbow bit, n)``.
        sin: Its sine, not negative: that of root bit 0.
        frame: Components along ``across`` and ``aside`` of the elbow's direction, ``(2, root bit, elbow bit, n)``.
        apart2: Squared product of all three sines, zero where the two roots meet, ``(elbow bit, n)``.
        outside: True where there is no root, ``(elbow bit, n)``.
    """

    across: Array
    aside: Array
    sine: Array
    cosine: Array
    axis: Array
    cos: Array
    sin: Array
    frame: Array
    apart2: Array
    outside: Array


@fused_separately
def from_tip(target: CheckedTarget) -> CheckedTarget:
    """The base as seen from the tool: the target of the reversed arm."""
    turn = vec3.transpose(target.directions)
    return target._replace(position=-vec3.matvec(turn, target.position), directions=turn)


@fused_separately
def outer_wrist_and_hand(g: OuterJointConstants, target: CheckedTarget) -> tuple[Array, Array]:
    """Shoulder to wrist, and axis 6 with two vectors across it as columns, both in the shoulder frame."""
    sin, cos = sincos(principal(target.swivel))
    turn = vec3.matmul(g.inner.to_shoulder_frame, target.directions)
    origin = vec3.matvec(g.inner.to_shoulder_frame, target.position - g.inner.shoulder)
    wrist = g.wrist[0] + cos * g.wrist[1] + sin * g.wrist[2]
    hand = g.hand[0] + cos * g.hand[1] + sin * g.hand[2]
    return origin + vec3.matvec(turn, wrist), vec3.matmul(turn, hand)


def outer_joint_roots(g: OuterJointConstants, w: Array, hand: Array) -> tuple[Reach, Roots, Bend]:
    """Reach, both roots of each elbow, and bend, for a wrist and a hand in the shoulder frame."""
    r = reach(g.inner, w)
    b = _bend(g, r)
    return r, _roots(g, r.n, b, hand), b


@fused_separately
def _bend(g: OuterJointConstants, r: Reach) -> Bend:
    sin, cos = 2.0 * r.sin_half * r.cos_half, r.cos_half * r.cos_half - r.sin_half * r.sin_half
    return bend(g.inner, sin, cos, tolerances(r.n.dtype))


@fused_separately
def _roots(g: OuterJointConstants, n: Array, b: Bend, hand: Array) -> Roots:
    tol = tolerances(n.dtype)
    least = tol.singular
    # Axis 5 along and across the line, in the arm plane's frame.
    along, toward, beside = _in_plane(g, b, g.forearm[:, 0])
    m2 = toward * toward + beside * beside
    m = jnp.sqrt(jnp.maximum(m2, least**2))
    lost = m2 <= least**2
    toward, beside = jnp.where(lost, 1.0, toward / m), jnp.where(lost, 0.0, beside / m)
    # Axis 6 along and across the line; where it lies along it, any direction across serves.
    z = hand[:, 0]
    cosine = vec3.dot(n, z)
    raw = vec3.project_out(z, n)
    sine2 = vec3.dot(raw, raw)
    sine = jnp.sqrt(jnp.maximum(sine2, least**2))
    instead = vec3.project_out(hand[:, 1], n)
    instead = instead / jnp.sqrt(jnp.maximum(vec3.dot(instead, instead), least))
    across = jnp.where(sine2 <= least**2, instead, raw / sine)
    # The spherical triangle of line, axis 5 and axis 6, by half angles.
    both, height = m * sine, g.between - along * cosine
    flat = both <= least
    bounded = jnp.where(flat, 1.0, 2.0 * both)
    sin_half = unit_sqrt(jnp.where(flat, 0.5, (both - height) / bounded))
    cos_half = unit_sqrt(jnp.where(flat, 0.5, (both + height) / bounded))
    cos, sin = cos_half * cos_half - sin_half * sin_half, 2.0 * sin_half * cos_half
    side = _sides_of_root(n)
    frame = jnp.stack([toward * cos + side * beside * sin, side * toward * sin - beside * cos])
    apart2 = (both - height) * (both + height)
    outside = jnp.abs(height) - both > least
    return Roots(across, vec3.cross(n, across), sine, cosine, jnp.stack([along, m]), cos, sin, frame, apart2, outside)


def _in_plane(g: OuterJointConstants, b: Bend, v: Array) -> Array:
    """Resolve vectors ``(3, ..., 1)`` fixed to the forearm along [l̂, o, l̂ × o], ``(3, ..., elbow bit, n)``."""
    side = _sides_of_elbow(b.sin)
    sin, (x, y, z) = side * b.sin, v[..., None, :]
    bent = jnp.stack(jnp.broadcast_arrays(b.cos * x - sin * y, sin * x + b.cos * y, z))
    return into_plane(b, side, bent)


@fused_separately
def outer_joint_angles(
    g: OuterJointConstants, r: Reach, b: Bend, hand: Array, roots: Roots
) -> tuple[Array, Array, Array]:
    """Opposite and adjacent sides of every angle, ``(angles, n)``, and the squared sine of the shoulder's middle one.

    The angles are those of the shoulder, ``(3, root bit, elbow bit)``, of joints 5 and 6, ``(2, root bit, elbow bit)``,
    and half the bend of the elbow.
    """
    tol = tolerances(r.n.dtype)
    along, aside = roots.frame
    lift = roots.across[:, None, None], roots.aside[:, None, None]
    elbow = along * lift[0] + aside * lift[1]
    normal = along * lift[1] - aside * lift[0]
    line = jnp.broadcast_to(r.n[:, None, None], elbow.shape)
    frame = jnp.stack([line, elbow, normal], axis=1)
    seen = into_plane(b, _sides_of_elbow(b.sin), g.inner.shoulder_from_elbow[:, :, None])
    shoulder = vec3.matmul(frame, seen[:, :, None])
    rotation = ZYZRotation(shoulder[:, -1], shoulder[:2, :-1])
    s_opposite, s_adjacent, sine2 = zyz_sides(rotation, tol)
    # Joint 5: axis 6 about axis 5, in the arm plane's frame.
    axis6 = jnp.stack(jnp.broadcast_arrays(roots.cosine, roots.sine * along, -roots.sine * aside))
    forearm = _in_plane(g, b, g.forearm[:, 1:])[:, :, None]
    adjacent5, opposite5 = vec3.dot(axis6[:, None], forearm)
    # Joint 6: axis 5 about axis 6.
    first, second = roots.axis
    turned = jnp.stack(jnp.broadcast_arrays(roots.cos, _sides_of_root(r.n) * roots.sin))
    axis5 = first * line + second * (turned[0] * lift[0] + turned[1] * lift[1])
    adjacent6, opposite6 = vec3.dot(axis5, hand[:, 1, None, None]), -vec3.dot(axis5, hand[:, 2, None, None])
    pair_opposite, pair_adjacent = jnp.stack([opposite5, opposite6]), jnp.stack([adjacent5, adjacent6])
    opposite = [merge_leading(s_opposite, 1), merge_leading(pair_opposite, 1), r.sin_half[None]]
    adjacent = [merge_leading(s_adjacent, 1), merge_leading(pair_adjacent, 1), r.cos_half[None]]
    return jnp.concatenate(opposite), jnp.concatenate(adjacent), sine2


@fused_separately
def _arctan2(opposite: Array, adjacent: Array) -> Array:
    return arctan2(opposite, adjacent)


@fused_separately
def _solutions(arm: OuterJointArm, g: OuterJointConstants, angles: Array, parameter: Array) -> tuple[Array, ...]:
    """Joint angles of shoulder, elbow, joints 5 and 6, and joint 7, fitted to the limits."""
    n = angles.shape[-1]
    spherical = both_solutions(angles[:12].reshape(3, 2, 2, n), g.inner.shoulder_delta)
    fitted = fit_to_limits(arm, _spherical_rows(), merge_leading(spherical, 1)).reshape(spherical.shape)
    pair = fit_to_limits(arm, (4,) * 4 + (5,) * 4, angles[12:20])
    elbow = wrap(g.inner.straight + _sides_of_elbow(angles) * (2.0 * angles[20]))
    outer = fit_to_limits(arm, (6,), wrap(principal(parameter))[None])
    return fitted, fit_to_limits(arm, (3, 3), elbow), pair.reshape(2, 2, 2, n), outer[0]


@fused_separately
def _within_splits(arm: OuterJointArm, g: OuterJointConstants, spherical: Array, sine2: Array) -> Array:
    """The shoulder's angles, its outer ones split within limits where it is aligned."""
    aligned = sine2 <= tolerances(sine2.dtype).aligned ** 2
    return split_within_limits(arm, 0, g.inner.shoulder_delta, spherical, aligned)


def _keep_out_room(
    arm: OuterJointArm,
    inner: OuterJointArm,
    g: OuterJointConstants,
    target: CheckedTarget,
    r: Reach,
    b: Bend,
    roots: Roots,
) -> Array:
    """Least distance of the elbow to the half-spaces, in arm lengths, negative inside, ``(root bit, elbow bit, n)``."""
    if not arm.keep_out.offset.shape[0]:
        return jnp.ones((2, 2, r.n.shape[-1]), r.n.dtype)
    return _elbow_room(arm, inner, g, target, r, b, roots)


@fused_separately
def _reach_room(g: OuterJointConstants, w: Array) -> Array:
    """Room to full stretch and to the inner end of the reach, squared distances in arm lengths, ``(n,)``."""
    full, folded = g.inner.upper + g.inner.fore, g.inner.upper - g.inner.fore
    distance2 = vec3.dot(w, w) - g.inner.skew * g.inner.skew
    return jnp.minimum(full * full - distance2, distance2 - folded * folded) / (4.0 * g.inner.upper * g.inner.fore)


@fused_separately
def _elbow_room(
    arm: OuterJointArm,
    inner: OuterJointArm,
    g: OuterJointConstants,
    target: CheckedTarget,
    r: Reach,
    b: Bend,
    roots: Roots,
) -> Array:
    along, toward, beside = into_plane(b, _sides_of_elbow(b.sin), g.upper_arm[:, None])
    e, a = roots.frame
    parts = along + 0.0 * e, toward * e - beside * a, toward * a + beside * e
    frame = jnp.stack([r.n, roots.across, roots.aside], axis=1)[:, :, None, None]
    to_base = vec3.transpose(g.inner.to_shoulder_frame)[:, :, None, None]
    elbow = vec3.matvec(to_base, vec3.matvec(frame, jnp.stack(parts)))
    elbow = inner.shoulder[:, None, None, None] + elbow
    if arm.mirrored:
        elbow = target.position[:, None, None] + vec3.matvec(target.directions[:, :, None, None], elbow)
    room = arm.keep_out.offset[:, None, None, None] - jnp.tensordot(arm.keep_out.normal, elbow, axes=1)
    return jnp.min(room, axis=0) / arm.length


@fused_separately
def _classify(
    arm: OuterJointArm,
    inner: OuterJointArm,
    target: CheckedTarget,
    r: Reach,
    b: Bend,
    roots: Roots,
    solutions: tuple[Array, ...],
    sine2: Array,
    elbow_room: Array,
    reach_room: Array,
) -> OuterJointBranches:
    """Classify every branch; ``inner`` has the joints in the order of the solutions."""
    spherical, elbow, pair, outer = solutions
    n = outer.shape[-1]
    spherical_inside = within_limits(inner, _spherical_rows(), merge_leading(spherical, 1)).reshape(spherical.shape)
    pair_inside = within_limits(inner, (4,) * 4 + (5,) * 4, merge_leading(pair, 1)).reshape(2, 2, 2, n)
    elbow_inside = within_limits(inner, (3, 3), elbow)
    others = jnp.all(pair_inside, axis=0) & elbow_inside & within_limits(inner, (6,), outer[None])[0]
    tol = tolerances(outer.dtype)
    near2 = tol.near_singular**2
    near = (b.sin < tol.near_singular) | (sine2 < near2) | (roots.apart2 < near2) | r.centered
    status = jnp.zeros(near.shape, jnp.int32)
    for condition, reason in (
        (near, Status.NEAR_SINGULAR),
        (elbow_room < -tol.singular, Status.KEEP_OUT),
        (roots.outside, Status.ORIENTATION),
        (r.out_of_reach, Status.OUT_OF_REACH),
        (target.invalid, Status.INVALID_TARGET),
        (target.nonfinite, Status.NONFINITE_INPUT),
    ):
        status = jnp.where(condition, jnp.int32(reason), status)
    room = jnp.minimum(jnp.minimum(elbow_room, reach_room), roots.apart2)
    return OuterJointBranches(
        spherical, elbow, pair, outer, jnp.all(spherical_inside, axis=1), others, status, room, arm.outer_joint
    )


def _spherical_rows() -> tuple[int, ...]:
    """The joint of every row of the shoulder's angles ``(bit, 3, root bit, elbow bit, n)``, flattened."""
    return tuple(j for _ in range(2) for j in range(3) for _ in range(4))


def _sides_of_elbow(like: Array) -> Array:
    """+1 and -1 for elbow bit 0 and 1, ``(2, 1)``."""
    return jnp.array([[1.0], [-1.0]], like.dtype)


def _sides_of_root(like: Array) -> Array:
    """+1 and -1 for root bit 0 and 1, ``(2, 1, 1)``."""
    return jnp.array([[[1.0]], [[-1.0]]], like.dtype)
