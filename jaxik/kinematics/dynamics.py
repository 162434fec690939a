"""Rigid-body dynamics: the torques that hold or move an arm, and what its hand carries.

Recursive Newton-Euler in frames that lie parallel to the base at zero joint angles, with origins in shoulder, elbow and
wrist. In them a joint's axis, a link's lever and its inertia are the arm's own numbers, and only two offsets between
frames are not zero: upper arm and forearm.

Each pass is a ``lax.scan`` over the joints with the batch last: one joint's step is compiled, not seven.
"""

import dataclasses
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm, ArmModel, LinkInertia
from jaxik.numerics import to_batch_first, to_batch_last, vec3
from jaxik.targets import as_floats, check_joints

AnyArm = TypeVar("AnyArm", Arm, ArmModel)


@jax.jit
def gravity_torque(arm: Arm, q: Float[ArrayLike, "*batch joint"]) -> Float[Array, "*batch joint"]:
    """Joint torques that hold the arm at rest against gravity.

    A fraction of the cost of :func:`inverse_dynamics`: only the moment of the masses beyond each joint is carried.

    Args:
        arm: The arm.
        q: Joint angles, ``(*batch, n_joints)`` [rad].

    Returns:
        Torques the motors apply, ``(*batch, n_joints)`` [N m]; zero for an arm without masses.

    Raises:
        ValueError: If the last axis of ``q`` is not the arm's number of joints.

    **Differentiability**: smooth everywhere in ``q`` and in every array of the arm.

    Example:
        >>> import jaxik
        >>> arm = jaxik.presets.iiwa14().arm
        >>> bool(abs(gravity_torque(arm, jnp.zeros(7))).max() < 1)  # upright, it nearly balances
        True
    """
    (q,) = as_floats(q)
    check_joints(arm, q)
    arm, batch = arm.astype(q.dtype), q.shape[:-1]
    angles = to_batch_last(q, batch, 1)
    body, turns = _bodies(arm), (_cross(arm.axes), jnp.sin(angles), jnp.cos(angles))
    moment = _mass_moments(body)

    def outward(pull: Array, turn: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        axis_cross, sin, cos = turn
        pull = _turned(axis_cross, -sin, cos, pull)
        return pull, pull

    def inward(carried: Array, joint: tuple) -> tuple[Array, Array]:
        (axis_cross, sin, cos), pull, own = joint
        carried = carried + own[:, None]
        return _turned(axis_cross, sin, cos, carried), -jnp.sum(pull * (axis_cross @ carried), axis=0)

    start = jnp.broadcast_to(arm.gravity[:, None], (3, angles.shape[1]))
    _, pull = lax.scan(outward, start, turns)
    _, torque = lax.scan(inward, jnp.zeros_like(start), (turns, pull, moment), reverse=True)
    return to_batch_first(torque, batch)


def largest_gravity_torque(arm: Arm) -> Float[Array, "joint"]:
    """What no posture needs more than to be held, ``(joint,)`` [N m]: the arm stretched out level.

    It bounds the derivatives of gravity torques of any order, too: each turns the moment of mass beyond the last of the
    joints involved once more about a unit axis.
    """
    moment = jnp.linalg.norm(_mass_moments(_bodies(arm)), axis=-1)
    return jnp.linalg.norm(arm.gravity) * jnp.cumsum(moment[::-1])[::-1]


@jax.jit
def inverse_dynamics(
    arm: Arm,
    q: Float[ArrayLike, "*#batch joint"],
    qd: Float[ArrayLike, "*#batch joint"],
    qdd: Float[ArrayLike, "*#batch joint"],
) -> Float[Array, "*batch joint"]:
    """Joint torques of a motion: inertia, centrifugal and Coriolis forces, and gravity.

    Rotors, gears and friction are no part of the arm's data and are left out.

    Args:
        arm: The arm.
        q: Joint angles, ``(*batch, n_joints)`` [rad].
        qd: Joint velocities, likewise; the batch axes broadcast [rad/s].
        qdd: Joint accelerations [rad/s²].

    Returns:
        Torques the motors apply, ``(*batch, n_joints)`` [N m]; zero for an arm without masses.

    Raises:
        ValueError: If a last axis is not the arm's number of joints.

    **Differentiability**: smooth everywhere in ``q``, ``qd``, ``qdd`` and in every array of the arm.

    References:
        J. Luh, M. Walker, R. Paul, "On-line computational scheme for mechanical manipulators", 1980; here with the
        gravity as an upward acceleration of the base, and forces in the frames described above.
    """
    q, qd, qdd = as_floats(q, qd, qdd)
    for values in (q, qd, qdd):
        check_joints(arm, values)
    arm, batch = arm.astype(q.dtype), jnp.broadcast_shapes(q.shape, qd.shape, qdd.shape)[:-1]
    motion = tuple(to_batch_last(values, batch, 1) for values in (q, qd, qdd))
    return to_batch_first(_newton_euler(arm, *motion), batch)


@jax.jit
def mass_matrix(arm: Arm, q: Float[ArrayLike, "*batch joint"]) -> Float[Array, "*batch joint joint"]:
    """The joint-space inertia M(q) with torque = M(q) qdd for an arm at rest and without gravity.

    Column by column from :func:`inverse_dynamics`: seven times its cost.

    Args:
        arm: The arm.
        q: Joint angles, ``(*batch, n_joints)`` [rad].

    Returns:
        Symmetric matrices, ``(*batch, n_joints, n_joints)`` [kg m²].

    Raises:
        ValueError: If the last axis of ``q`` is not the arm's number of joints.

    **Differentiability**: smooth everywhere in ``q`` and in every array of the arm.
    """
    (q,) = as_floats(q)
    check_joints(arm, q)
    weightless = dataclasses.replace(arm, gravity=jnp.zeros_like(arm.gravity))
    units = jnp.eye(arm.n_joints, dtype=q.dtype)
    return inverse_dynamics(weightless, q[..., None, :], jnp.zeros_like(q)[..., None, :], units)


def with_payload(
    arm: AnyArm,
    mass: Float[ArrayLike, ""],
    center_of_mass: Float[ArrayLike, "3"] | None = None,
    inertia: Float[ArrayLike, "3 3"] | None = None,
) -> AnyArm:
    """The arm with a load fixed to its hand.

    Args:
        arm: The arm, or the model that also knows its names.
        mass: [kg]; traced and negative values are the caller's business.
        center_of_mass: In the tool frame, ``(3,)`` [m]; None for the tool point.
        inertia: About the load's centre of mass along the tool's axes, ``(3, 3)`` [kg m²]; None for a point mass.

    Returns:
        The same kind of arm, whose last link is the hand and the load as one body.

    **Differentiability**: smooth in all arguments for a positive total mass.

    Example:
        >>> import jaxik
        >>> arm = with_payload(jaxik.presets.iiwa14(), 2.0).arm
        >>> round(float(arm.links.mass[-1]), 3)
        3.2
    """
    if isinstance(arm, ArmModel):
        loaded = with_payload(arm.arm, mass, center_of_mass, inertia)
        note = f"Carries a load of {float(jnp.asarray(mass)):g} kg in the hand."
        return dataclasses.replace(arm, arm=loaded, notes=(*arm.notes, note))
    links, dtype = arm.links, arm.axes.dtype
    load = jnp.asarray(mass, dtype)
    center = jnp.zeros(3, dtype) if center_of_mass is None else jnp.asarray(center_of_mass, dtype)
    own = jnp.zeros((3, 3), dtype) if inertia is None else jnp.asarray(inertia, dtype)
    center = arm.tool_position + arm.tool_rotation @ center
    own = arm.tool_rotation @ own @ arm.tool_rotation.T
    total = links.mass[-1] + load
    # Nothing added to nothing weighs nothing, wherever its centre is.
    share = jnp.where(total > 0, load / jnp.where(total > 0, total, 1.0), 0.0)
    apart = center - links.center_of_mass[-1]
    reduced = (
        links.mass[-1] * share
    )  # two bodies turn about their common centre like one of this mass at their distance
    spread = jnp.sum(apart**2) * jnp.eye(3, dtype=dtype) - jnp.outer(apart, apart)
    return dataclasses.replace(
        arm,
        links=LinkInertia(
            links.mass.at[-1].set(total),
            links.center_of_mass.at[-1].add(share * apart),
            links.inertia.at[-1].add(own + reduced * spread),
        ),
    )


class _Bodies(NamedTuple):
    """The links in their own frames.

    Attributes:
        mass: ``(joint,)`` [kg].
        inertia: About the centre of mass, ``(joint, 3, 3)`` [kg m²].
        lever: Frame origin to centre of mass, ``(joint, 3)`` [m].
        offset: Origin of the frame before to this one's, ``(joint, 3)`` [m]; none for the first.
        lever_cross: The lever's cross product as a matrix, ``(joint, 3, 3)``.
        offset_cross: The offset's.
    """

    mass: Array
    inertia: Array
    lever: Array
    offset: Array
    lever_cross: Array
    offset_cross: Array


def _bodies(arm: Arm) -> _Bodies:
    origin = jnp.stack([arm.shoulder] * 3 + [arm.elbow] + [arm.wrist] * (arm.n_joints - 4))
    links = arm.links
    lever, offset = links.center_of_mass - origin, jnp.diff(origin, axis=0, prepend=origin[:1])
    return _Bodies(links.mass, links.inertia, lever, offset, _cross(lever), _cross(offset))


def _mass_moments(body: _Bodies) -> Array:
    """Of each link, and of all beyond it as if at the next frame's origin, about its own frame, ``(joint, 3)``."""
    beyond = jnp.cumsum(body.mass[::-1])[::-1] - body.mass
    next_offset = jnp.concatenate([body.offset[1:], jnp.zeros_like(body.offset[:1])])
    return body.mass[:, None] * body.lever + beyond[:, None] * next_offset


def _newton_euler(arm: Arm, q: Array, qd: Array, qdd: Array) -> Array:
    """Torques ``(joint, n)`` of angles, velocities and accelerations ``(joint, n)``."""
    body, turns = _bodies(arm), (_cross(arm.axes), jnp.sin(q), jnp.cos(q))

    def outward(motion: Array, joint: tuple) -> tuple[Array, Array]:
        """Angular velocity, angular and linear acceleration of the frames; forces and moments on their links."""
        (turn, sin, cos), axis, speed, push, link = joint
        omega, alpha, acceleration = motion
        acceleration = acceleration + _swept(omega, alpha, link.offset, link.offset_cross)
        omega, alpha, acceleration = _turned(turn, -sin, cos, jnp.stack([omega, alpha, acceleration]))
        alpha = alpha + axis[:, None] * push - turn @ omega * speed
        omega = omega + axis[:, None] * speed
        force = link.mass * (acceleration + _swept(omega, alpha, link.lever, link.lever_cross))
        moment = link.inertia @ alpha + vec3.cross(omega, link.inertia @ omega) + link.lever_cross @ force
        return jnp.stack([omega, alpha, acceleration]), jnp.stack([force, moment])

    def inward(carried: Array, joint: tuple) -> tuple[Array, Array]:
        """Force and moment that a joint hands to the frame before, about that frame's origin."""
        (turn, sin, cos), axis, own, offset_cross = joint
        carried = carried + own
        force, moment = _turned(turn, sin, cos, carried)
        return jnp.stack([force, moment + offset_cross @ force]), axis @ carried[1]

    still = jnp.zeros((3, q.shape[1]), q.dtype)
    start = jnp.stack([still, still, still - arm.gravity[:, None]])
    _, own = lax.scan(outward, start, (turns, arm.axes, qd, qdd, body))
    _, torque = lax.scan(inward, jnp.stack([still, still]), (turns, arm.axes, own, body.offset_cross), reverse=True)
    return torque


def _swept(omega: Array, alpha: Array, lever: Array, lever_cross: Array) -> Array:
    """Acceleration of a point at a lever from a turning frame's origin: alpha × r + omega × (omega × r)."""
    return omega * (lever @ omega) - lever[:, None] * jnp.sum(omega**2, axis=0) - lever_cross @ alpha


def _turned(axis_cross: Array, sin: Array, cos: Array, v: Array) -> Array:
    """Vectors ``(..., 3, n)`` turned about a unit axis given as its cross product (Rodrigues)."""
    across = axis_cross @ v
    return v + sin * across + (1 - cos) * (axis_cross @ across)


def _cross(a: Array) -> Array:
    """Cross products with constant vectors ``(joint, 3)`` as matrices: one operation each to compile, and linear."""
    zero = jnp.zeros_like(a[:, 0])
    x, y, z = a.T
    return jnp.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
