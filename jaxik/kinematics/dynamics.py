"""Rigid-body dynamics: the torques that hold or move an arm.

Recursive Newton-Euler in frames that lie parallel to the base at zero joint angles, with origins in the arm's stations:
shoulder, elbow and wrist. In these frames a joint's axis, a link's lever and its inertia are the arm's own numbers, and
only two offsets between frames are not zero, upper arm and forearm (three if an outer joint is offset).

Each pass is a ``lax.scan`` over the joints with the batch last: one joint's step is compiled, not seven.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.kinematics.forward import JOINT_ANGLES
from jaxik.numerics import to_batch_first, to_batch_last, vec3
from jaxik.targets import as_array, as_floats, check_joints, cross_matrix


def gravity_torque(arm: Arm | ArmModel, q: Float[ArrayLike, "*batch joint"]) -> Float[Array, "*batch joint"]:
    """Return the joint torques that hold the arm at rest against gravity.

    It costs a fraction of :func:`inverse_dynamics`: only the moment of the masses beyond each joint is carried.

    Args:
        arm: The arm.
        q: Joint angles, ``(*batch, n_joints)`` [rad].

    Returns:
        Torques the motors apply, ``(*batch, n_joints)`` [N m]; zero for an arm without masses.

    Raises:
        ValueError: If the last axis of ``q`` is not the arm's number of joints, or ``arm`` is not an arm.

    **Differentiability**: smooth everywhere in ``q`` and in every array of the arm.

    Example:
        >>> import jaxik
        >>> bool(abs(gravity_torque(jaxik.presets.iiwa14(), jnp.zeros(7))).max() < 1)  # upright, it nearly balances
        True
    """
    return _gravity_torque(as_arm(arm, any_class=True), as_array(JOINT_ANGLES, q))


@jax.jit
def _gravity_torque(arm: Arm, q: ArrayLike) -> Array:
    (q,) = as_floats(q)
    check_joints(arm, q)
    arm, batch = arm.astype(q.dtype), q.shape[:-1]
    angles = to_batch_last(q, batch, 1)
    body, turns = _bodies(arm), (cross_matrix(arm.axes), jnp.sin(angles), jnp.cos(angles))
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
    """Return an upper bound on the gravity torque of each joint over all postures, ``(joint,)`` [N m].

    It is the torque of the arm stretched out level, and also bounds the derivatives of gravity torques of any order:
    each turns the moment of the masses beyond the last joint involved once more about a unit axis.
    """
    moment = jnp.linalg.norm(_mass_moments(_bodies(arm)), axis=-1)
    return jnp.linalg.norm(arm.gravity) * jnp.cumsum(moment[::-1])[::-1]


def inverse_dynamics(
    arm: Arm | ArmModel,
    q: Float[ArrayLike, "*#batch joint"],
    qd: Float[ArrayLike, "*#batch joint"],
    qdd: Float[ArrayLike, "*#batch joint"],
) -> Float[Array, "*batch joint"]:
    """Return the joint torques of a motion: inertia, centrifugal and Coriolis forces, and gravity.

    Rotors, gears and friction are no part of the arm's data and are left out.

    Args:
        arm: The arm.
        q: Joint angles, ``(*batch, n_joints)`` [rad].
        qd: Joint velocities, likewise; the batch axes broadcast [rad/s].
        qdd: Joint accelerations [rad/s²].

    Returns:
        Torques the motors apply, ``(*batch, n_joints)`` [N m]; zero for an arm without masses.

    Raises:
        ValueError: If a last axis is not the arm's number of joints, or ``arm`` is not an arm.

    **Differentiability**: smooth everywhere in ``q``, ``qd``, ``qdd`` and in every array of the arm.

    References:
        J. Luh, M. Walker, R. Paul, "On-line computational scheme for mechanical manipulators", 1980; here with the
        gravity as an upward acceleration of the base, and forces in the frames described above.
    """
    named = (JOINT_ANGLES, q), ("joint velocities qd", qd), ("joint accelerations qdd", qdd)
    return _inverse_dynamics(as_arm(arm, any_class=True), *(as_array(name, value) for name, value in named))


@jax.jit
def _inverse_dynamics(arm: Arm, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
    q, qd, qdd = as_floats(q, qd, qdd)
    for values in (q, qd, qdd):
        check_joints(arm, values)
    arm, batch = arm.astype(q.dtype), jnp.broadcast_shapes(q.shape, qd.shape, qdd.shape)[:-1]
    motion = tuple(to_batch_last(values, batch, 1) for values in (q, qd, qdd))
    return to_batch_first(_newton_euler(arm, *motion), batch)


def mass_matrix(arm: Arm | ArmModel, q: Float[ArrayLike, "*batch joint"]) -> Float[Array, "*batch joint joint"]:
    """Return the joint-space inertia M(q): torque = M(q) qdd for an arm at rest and without gravity.

    Column by column from :func:`inverse_dynamics`, at seven times its cost.

    Args:
        arm: The arm.
        q: Joint angles, ``(*batch, n_joints)`` [rad].

    Returns:
        Symmetric matrices, ``(*batch, n_joints, n_joints)`` [kg m²].

    Raises:
        ValueError: If the last axis of ``q`` is not the arm's number of joints, or ``arm`` is not an arm.

    **Differentiability**: smooth everywhere in ``q`` and in every array of the arm.
    """
    return _mass_matrix(as_arm(arm, any_class=True), as_array(JOINT_ANGLES, q))


@jax.jit
def _mass_matrix(arm: Arm, q: ArrayLike) -> Array:
    (q,) = as_floats(q)
    check_joints(arm, q)
    weightless = dataclasses.replace(arm, gravity=jnp.zeros_like(arm.gravity))
    units = jnp.eye(arm.n_joints, dtype=q.dtype)
    return _inverse_dynamics(weightless, q[..., None, :], jnp.zeros_like(q)[..., None, :], units)


class _Bodies(NamedTuple):
    """The links in their own frames.

    Attributes:
        mass: ``(joint,)`` [kg].
        inertia: Inertia about the center of mass, ``(joint, 3, 3)`` [kg m²].
        lever: Vector from the frame's origin to the center of mass, ``(joint, 3)`` [m].
        offset: Vector from the previous frame's origin to this one's, ``(joint, 3)`` [m]; zero for the first.
        lever_cross: Cross product with the lever as a matrix, ``(joint, 3, 3)``.
        offset_cross: Cross product with the offset, likewise.
    """

    mass: Array
    inertia: Array
    lever: Array
    offset: Array
    lever_cross: Array
    offset_cross: Array


def _bodies(arm: Arm) -> _Bodies:
    origin = jnp.stack([arm.stations[station] for station in arm.station_of_joint])
    links = arm.links
    lever, offset = links.center_of_mass - origin, jnp.diff(origin, axis=0, prepend=origin[:1])
    return _Bodies(links.mass, links.inertia, lever, offset, cross_matrix(lever), cross_matrix(offset))


def _mass_moments(body: _Bodies) -> Array:
    """First moments of mass about each frame's origin, ``(joint, 3)`` [kg m].

    Each counts its own link, and the mass of all links beyond as if it lay in the next frame's origin.
    """
    beyond = jnp.cumsum(body.mass[::-1])[::-1] - body.mass
    next_offset = jnp.concatenate([body.offset[1:], jnp.zeros_like(body.offset[:1])])
    return body.mass[:, None] * body.lever + beyond[:, None] * next_offset


def _newton_euler(arm: Arm, q: Array, qd: Array, qdd: Array) -> Array:
    """Return torques ``(joint, n)`` for angles, velocities and accelerations ``(joint, n)``."""
    body, turns = _bodies(arm), (cross_matrix(arm.axes), jnp.sin(q), jnp.cos(q))

    def outward(motion: Array, joint: tuple) -> tuple[Array, Array]:
        """Return the frame's angular velocity and accelerations, and the force and moment on its link."""
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
        """Return the force and moment that a joint passes to the previous frame, about that frame's origin."""
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
    """Return the acceleration of a point at lever r in a turning frame: alpha × r + omega × (omega × r)."""
    return omega * (lever @ omega) - lever[:, None] * jnp.sum(omega**2, axis=0) - lever_cross @ alpha


def _turned(axis_cross: Array, sin: Array, cos: Array, v: Array) -> Array:
    """Turn vectors ``(..., 3, n)`` about a unit axis given as its cross product (Rodrigues)."""
    across = axis_cross @ v
    return v + sin * across + (1 - cos) * (axis_cross @ across)
