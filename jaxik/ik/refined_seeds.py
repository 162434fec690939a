"""Seeds for arms solved by refinement: the eight solutions of the nearest member, kept apart where they meet.

Where the member does not reach a target that the arm itself does, its closed form ends at a stretched elbow or at two
roots that meet, and all of its branches coincide: seeds there would lose most of the solutions. So the elbow keeps a
bend, the roots a distance, and the spherical joint an angle.
"""

import jax.numpy as jnp
from jax import Array

from jaxik.arm import OuterJointArm, reversed_arm
from jaxik.ik.elbow_circle import Reach, reach
from jaxik.ik.outer_joint_constants import OuterJointConstants, outer_joint_constants
from jaxik.ik.outer_joint_form import Roots, from_tip, outer_joint_angles, outer_joint_roots, outer_wrist_and_hand
from jaxik.ik.target_checks import CheckedTarget
from jaxik.ik.zyz import both_solutions
from jaxik.numerics import arctan2, fused_separately, merge_leading, principal, wrap

APART = 0.15
"""Least sine and cosine of half an angle at which two branches meet. Between 0.1 and 0.2 every arm measured does well;
without it a sixth of the solutions is lost on arms with offsets of 50 mm (docs/arms.md)."""


def refined_seeds(member: OuterJointArm, target: CheckedTarget) -> Array:
    """Return the joint angles of eight seeds, ``(8, 7, n)`` [rad], the outer joint at the parameter.

    Args:
        member: The nearest member.
        target: Targets without bad rows.
    """
    inner, seen = (reversed_arm(member), from_tip(target)) if member.mirrored else (member, target)
    g = outer_joint_constants(inner)
    w, hand = outer_wrist_and_hand(g, seen)
    r, roots, b = outer_joint_roots(g, _in_reach(g, w), hand)
    opposite, adjacent, _ = outer_joint_angles(g, r, b, hand, _apart(roots))
    return _assembled(member, g, arctan2(opposite, adjacent), target.swivel)


@fused_separately
def _in_reach(g: OuterJointConstants, w: Array) -> Array:
    """The wrist moved along its ray to where the elbow is bent, neither stretched nor folded."""
    r: Reach = reach(g.inner, w)
    sin2 = jnp.clip(r.sin_half * r.sin_half, APART**2, 1.0 - APART**2)
    full = g.inner.upper + g.inner.fore
    distance2 = full * full + g.inner.skew * g.inner.skew - 4.0 * g.inner.upper * g.inner.fore * sin2
    return r.n * jnp.sqrt(distance2)


@fused_separately
def _apart(roots: Roots) -> Roots:
    """The roots turned away from one another about the line from shoulder to wrist."""
    side = jnp.array([[[1.0]], [[-1.0]]], roots.cos.dtype)
    first, second = roots.frame
    toward, beside = roots.cos * first + side * roots.sin * second, side * roots.sin * first - roots.cos * second
    sin2_half = jnp.clip(0.5 * (1.0 - roots.cos), APART**2, 1.0 - APART**2)
    cos, sin = 1.0 - 2.0 * sin2_half, 2.0 * jnp.sqrt(sin2_half * (1.0 - sin2_half))
    frame = jnp.stack([cos * toward + side * sin * beside, side * sin * toward - cos * beside])
    return roots._replace(cos=cos, sin=sin, frame=frame)


@fused_separately
def _assembled(member: OuterJointArm, g: OuterJointConstants, angles: Array, parameter: Array) -> Array:
    n = angles.shape[-1]
    delta = g.inner.shoulder_delta
    spherical = both_solutions(angles[:12].reshape(3, 2, 2, n), jnp.zeros_like(delta))
    middle = spherical[:, 1]
    away = jnp.clip(jnp.abs(middle), APART, jnp.pi - APART)
    spherical = spherical.at[:, 1].set(jnp.where(middle < 0.0, -away, away) - delta)
    bit = jnp.array([[1.0], [-1.0]], angles.dtype)
    elbow = wrap(g.inner.straight + bit * (2.0 * angles[20]))
    parts = (
        jnp.swapaxes(spherical, 2, 3),
        elbow[None, None, :, None],
        jnp.swapaxes(angles[12:20].reshape(2, 2, 2, n), 1, 2)[None],
        principal(parameter)[None, None, None, None],
    )
    parts = [jnp.broadcast_to(p, (2, p.shape[1], 2, 2, n)) for p in parts]
    q = jnp.concatenate(parts if member.outer_joint else [p[:, ::-1] for p in parts[::-1]], axis=1)
    # Branch numbers are shoulder, elbow, wrist; here the bits are spherical joint, elbow, root.
    order = (0, 2, 3, 1, 4) if member.outer_joint else (3, 2, 0, 1, 4)
    return merge_leading(jnp.transpose(q, order), 2)
