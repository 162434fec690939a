"""The self-motion of targets: every joint angle as a function of the swivel alone.

At a fixed target every entry of the shoulder's and wrist's ZYZ matrix is a + b cos(psi) + c sin(psi), and every joint
angle is the direction of a plane vector of two such entries. All that does not depend on the swivel is computed once
per target and handed on: to the feasible arcs, the nearest posture, the planners and the energy map. A posture then
takes a few sines and polynomials, a small part of a call of :func:`jaxik.solve_ik`.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxik.arm import Arm, fit_to_limits, within_limits
from jaxik.ik import (
    ArmConstants,
    Bend,
    CheckedTarget,
    Reach,
    Status,
    arm_constants,
    branch_bits,
    elbow_angle,
    elbow_slack,
    into_plane,
    out_of_plane,
    replace_bad_rows,
    target_columns,
    usable_circle,
    wrist_and_hand,
)
from jaxik.numerics import arctan2, fused_separately, principal, tolerances, vec3
from jaxik.obstacles import FreeSwivels, World, columns_of
from jaxik.redundancy.branch_motion import BranchMotion, near_range
from jaxik.redundancy.sinusoid import values
from jaxik.redundancy.swept_body import swept_free_swivels
from jaxik.targets import Target

_SIDES = ((1.0,), (-1.0,))  # of the elbow, by its bit
# Rows of a spherical joint's entries that are opposite and adjacent side of its angles. Of the middle angle only the
# cosine is known: it stands in both places.
_OPPOSITE, _ADJACENT = np.array([1, 2, 4]), np.array([0, 2, 3])


class SphericalJoint(NamedTuple):
    """Three joints whose axes meet in a point, as functions of the swivel.

    Attributes:
        entries: (a, b, c) of x and y of the first angle, cosine of the middle one, x and y of the third,
            ``(5, 3, elbow bit, *rows)``; ``(3, 3, ...)`` without the third angle. They belong to the solution with a
            non-negative sine of the middle angle; in the other one x and y have opposite signs.
        turn: (a, b, c) of the cosine and sine of the sum of its outer angles where it is aligned, both negative and of
            their difference where the middle angle is half a turn, ``(2, 3, elbow bit, *rows)``; ``(0, ...)`` without
            the third angle.
        first: Index of its first joint.
        delta: Middle angle less the joint's own, ``()`` [rad].
    """

    entries: Array
    turn: Array
    first: int
    delta: Array

    @property
    def angles(self) -> int:
        """Number of its angles that a target asks for, 3 or 2."""
        return (self.entries.shape[0] + 1) // 2

    def aligned_turn(self, sin: Array, cos: Array) -> tuple[Array, Array]:
        """Pole and turn where the joint is aligned at swivels ``(..., elbow bit, n)``: turn = first + pole * third.

        The pole is 1 where the middle angle is 0, and -1 where it is half a turn.
        """
        (z,) = values(self.entries[2:3], sin, cos)
        pole = jnp.where(z > 0.0, 1.0, -1.0).astype(z.dtype)
        along, aside = values(self.turn, sin, cos)
        return pole, arctan2(pole * aside, pole * along)


class SelfMotion(NamedTuple):
    """Coefficients (a, b, c) of a + b cos(psi) + c sin(psi) for targets whose axes come last, called rows.

    Attributes:
        arm: The arm.
        shoulder: Entries of the shoulder, see :class:`SphericalJoint`, ``(5, 3, elbow bit, *rows)``.
        wrist: Entries of the wrist, ``(5 or 3, 3, elbow bit, *rows)``.
        shoulder_turn: Turn of an aligned shoulder, see :class:`SphericalJoint`, ``(2, 3, elbow bit, *rows)``.
        wrist_turn: Turn of an aligned wrist, ``(2 or 0, 3, elbow bit, *rows)``.
        elbow: Joint 4, ``(elbow bit, *rows)`` [rad].
        keep_out: Distance of the elbow to each half-space, negative is forbidden, ``(half_spaces, 3, *rows)`` [m].
        elbow_inside: True where joint 4 is within its limits, ``(elbow bit, *rows)``.
        status: :class:`jaxik.Status` of the target alone, ``(*rows,)``: OK, OUT_OF_REACH, INVALID_TARGET or
            NONFINITE_INPUT; the rest is finite whatever it is.
        shoulder_delta: Middle angle of the shoulder less joint 2, ``()`` [rad].
        wrist_delta: Middle angle of the wrist less joint 6, ``()`` [rad].
        free: Swivels at which the arm's body is free of the world and itself; None without a body.
    """

    arm: Arm
    shoulder: Array
    wrist: Array
    shoulder_turn: Array
    wrist_turn: Array
    elbow: Array
    keep_out: Array
    elbow_inside: Array
    status: Array
    shoulder_delta: Array
    wrist_delta: Array
    free: FreeSwivels | None = None

    @property
    def solvable(self) -> Array:
        """True where the target is proper and within reach, ``(*rows,)``."""
        return self.status == Status.OK

    def map_rows(self, f: Callable[[Array], Any]) -> "SelfMotion":
        """Apply a function of the trailing axes to all that belongs to targets."""
        names = (
            "shoulder", "wrist", "shoulder_turn", "wrist_turn", "elbow", "keep_out", "elbow_inside", "status",
        )  # fmt: skip
        free = None if self.free is None else FreeSwivels(*map(f, self.free))
        return self._replace(free=free, **{name: f(getattr(self, name)) for name in names})

    def at(self, *index: Any) -> "SelfMotion":
        """Pick targets: an index for each of the last axes."""
        return self.map_rows(lambda x: x[(..., *index)])

    def clear_of_keep_out(self, sin: Array, cos: Array) -> Array:
        """Test whether the elbow is outside its keep-out or on its border, at swivels of given sine and cosine."""
        clear = jnp.ones((), bool)
        if not self.keep_out.shape[0]:
            return clear
        g = arm_constants(self.arm)
        slack = elbow_slack(g, jnp.abs(jnp.sin(self.elbow - g.straight)))
        for a, b, c in self.keep_out:
            clear = clear & (a + b * cos + c * sin >= -slack)
        return clear

    def clear_of_obstacles(self, swivel: Array) -> Array | bool:
        """Test whether the body is free at swivels ``(..., elbow bit, *rows)``; True without a body."""
        if self.free is None:
            return True
        return self.free.contain(principal(swivel), tolerances(swivel.dtype).singular)

    def spherical_joints(self) -> tuple[SphericalJoint, SphericalJoint]:
        """Shoulder and wrist."""
        return (
            SphericalJoint(self.shoulder, self.shoulder_turn, 0, self.shoulder_delta),
            SphericalJoint(self.wrist, self.wrist_turn, 4, self.wrist_delta),
        )

    def branch(self, branch: ArrayLike) -> BranchMotion:
        """Self-motion in branches ``(*more, *rows)`` that broadcast against the rows."""
        bits = branch_bits(branch)
        lift = (1,) * (bits.elbow.ndim - self.status.ndim)

        def of_elbow(x: Array, axis: int) -> Array:
            zero, one = (jnp.take(x, i, axis=axis) for i in (0, 1))
            shape = (*zero.shape[:axis], *lift, *zero.shape[axis:])
            return jnp.where(bits.elbow, one.reshape(shape), zero.reshape(shape))

        entries = [of_elbow(x, 2) for x in (self.shoulder, self.wrist)]
        rows = [jnp.concatenate([e[side[: (len(e) + 1) // 2]] for e in entries]) for side in (_OPPOSITE, _ADJACENT)]
        one = jnp.ones((), self.elbow.dtype)
        shoulder_sign, wrist_sign = (jnp.where(bit, -one, one) for bit in (bits.shoulder, bits.wrist))
        keep_out = self.keep_out.reshape(*self.keep_out.shape[:2], *lift, *self.status.shape)
        return BranchMotion(
            arm=self.arm,
            sides=jnp.stack(rows),
            elbow=of_elbow(self.elbow, 0),
            keep_out=keep_out,
            shoulder_sign=shoulder_sign,
            wrist_sign=wrist_sign,
            shoulder_delta=self.shoulder_delta,
            wrist_delta=self.wrist_delta,
            free=None if self.free is None else FreeSwivels(*(of_elbow(x, 1) for x in self.free)),
        )

    def other_offsets(self) -> Array:
        """Offsets of the other solutions of shoulder and wrist, ``(joint,)`` [rad].

        The other solution has outer joints ``q + offset`` and middle ones ``-q + offset``.
        """
        rows = [jnp.zeros_like(self.shoulder_delta)] * self.arm.n_joints
        for joint in self.spherical_joints():
            for place in range(joint.angles):
                rows[joint.first + place] = -2.0 * joint.delta if place == 1 else jnp.full_like(joint.delta, jnp.pi)
        return jnp.stack(rows)

    def other_solution(self, q: Array) -> Array:
        """Joint angles ``(joint, ...)`` with shoulder and wrist in their other solutions, each near its range [rad]."""
        offsets = self.other_offsets().reshape(-1, *(1,) * (q.ndim - 1))
        middle = jnp.isin(jnp.arange(len(q)), np.array([1, 5])).reshape(offsets.shape)
        return near_range(self.arm, offsets + jnp.where(middle, -q, q))


def self_motion(arm: Arm, target: Target) -> SelfMotion:
    """Return the self-motion of targets of the arm's dtype; their batch axes become the rows."""
    batch = target.position.shape[:-1]
    position, directions, _ = target_columns(target, jnp.zeros((), target.position.dtype), batch)
    world = None if arm.surroundings is None else columns_of(arm.surroundings.world, batch)
    flat = self_motion_of_columns(arm, position, directions, world)
    return flat if len(batch) == 1 else flat.map_rows(lambda x: x.reshape(*x.shape[:-1], *batch))


def self_motion_of_columns(arm: Arm, position: Array, directions: Array, world: World | None = None) -> SelfMotion:
    """Return the self-motion of targets with the batch last, ``(3, n)`` and ``(3, 3 or 1, n)``, of one float dtype.

    The arm of the result is without surroundings, which are in its free swivels.

    Args:
        arm: The arm.
        position: Tool points.
        directions: Rotations or pointing directions.
        world: World of the arm's body with its rows last; None for the arm's own, the same for all rows.
    """
    g = arm_constants(arm)
    target = replace_bad_rows(arm, position, directions, jnp.zeros_like(position[0]))
    w, hand = wrist_and_hand(g, target)
    r, zero, _, b = usable_circle(g, w)
    shoulder, wrist, turns, keep_out = _coefficients(arm, g, r.n, zero, b, hand)
    elbow = fit_to_limits(arm, (3, 3), elbow_angle(g, r))
    inside = within_limits(arm, (3, 3), elbow)
    status = _target_status(target, r)
    deltas = g.shoulder_delta[0], g.wrist_delta[0]
    motion = SelfMotion(arm, shoulder, wrist, *turns, elbow, keep_out, inside, status, *deltas)
    if arm.surroundings is None:
        return motion
    world = columns_of(arm.surroundings.world, ()) if world is None else world
    free = swept_free_swivels(arm, world, g, target, r.n, zero, b, elbow)
    return motion._replace(arm=replace(arm, surroundings=None), free=free)


@fused_separately
def _target_status(target: CheckedTarget, r: Reach) -> Array:
    """Status of the target alone, ``(n,)``."""
    status = jnp.where(r.out_of_reach, jnp.int32(Status.OUT_OF_REACH), jnp.int32(Status.OK))
    status = jnp.where(target.invalid, jnp.int32(Status.INVALID_TARGET), status)
    return jnp.where(target.nonfinite, jnp.int32(Status.NONFINITE_INPUT), status)


@fused_separately
def _coefficients(
    arm: Arm, g: ArmConstants, n: Array, zero: Array, b: Bend, hand: Array
) -> tuple[Array, Array, tuple[Array, Array], Array]:
    side = jnp.array(_SIDES, n.dtype)
    sense = g.reference.sense
    quarter = sense * vec3.cross(n, zero)
    # e = cos r + sin b and n × e = sense (cos b - sin r): constant, cosine and sine parts of the frame [n, e, n × e].
    parts = (
        jnp.stack([n, jnp.zeros_like(n), jnp.zeros_like(n)], axis=1),
        jnp.stack([jnp.zeros_like(n), zero, sense * quarter], axis=1),
        jnp.stack([jnp.zeros_like(n), quarter, -sense * zero], axis=1),
    )
    seen = into_plane(b, side, g.shoulder_from_elbow[:, :, None])
    of_shoulder = [vec3.matmul(p[:, :, None], seen) for p in parts]

    def wrist_matrix(part: Array) -> Array:
        x, y, z = out_of_plane(b, side, vec3.matmul(vec3.transpose(part), hand)[:, :, None])
        unbent = jnp.stack([b.cos * x + side * b.sin * y, b.cos * y - side * b.sin * x, z])
        return vec3.matmul(g.wrist_from_elbow[:, :, None], unbent)

    of_wrist = [wrist_matrix(p) for p in parts]
    shoulder, wrist = (jnp.stack([_entries(m) for m in each], axis=1) for each in (of_shoulder, of_wrist))
    shoulder_turn, wrist_turn = (jnp.stack([_turn(m) for m in each], axis=1) for each in (of_shoulder, of_wrist))
    normal = vec3.matmul(g.to_shoulder_frame[..., 0], arm.keep_out.normal.T)[..., None]
    room = arm.keep_out.offset - arm.keep_out.normal @ arm.shoulder
    along, across = g.upper * b.cos_base, g.upper * b.sin_base
    keep_out = jnp.stack(
        [
            room[:, None] - along * vec3.dot(normal, n[:, None]),
            -across * vec3.dot(normal, zero[:, None]),
            -across * vec3.dot(normal, quarter[:, None]),
        ],
        axis=1,
    )
    return shoulder, wrist, (shoulder_turn, wrist_turn), keep_out


def _entries(m: Array) -> Array:
    """Plane vectors of the three angles, from a ZYZ matrix or its last column alone."""
    first_and_middle = [m[0, -1], m[1, -1], m[2, -1]]
    third = [-m[2, 0], m[2, 1]] if m.shape[1] == 3 else []
    return jnp.stack(first_and_middle + third)


def _turn(m: Array) -> Array:
    """First column of a ZYZ matrix, of which the turn of an aligned joint is read."""
    return m[:2, 0] if m.shape[1] == 3 else m[:0, 0]
