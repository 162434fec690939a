"""How a real arm differs from its model: lengths, mount, joint zeros and joint scales, and the arm that has them."""

from dataclasses import dataclass, fields, replace

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxik.arm import Arm
from jaxik.numerics import vec3


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class KinematicErrors:
    """Deviations from a nominal arm; all zero is the nominal arm.

    Attributes:
        length: Relative change of upper arm, forearm and hand, ``(3,)``.
        shift: Of the shoulder, ``(3,)`` [m].
        turn: Of the whole arm about the shoulder, as a rotation vector in the base frame, ``(3,)`` [rad].
        zero: Joint angle where the joint reads zero, ``(joint,)`` [rad].
        scale: Relative change of the angle for a reading: angle = (1 + scale) reading + zero, ``(joint,)``.
    """

    length: Float[Array, "3"]
    shift: Float[Array, "3"]
    turn: Float[Array, "3"]
    zero: Float[Array, "joint"]
    scale: Float[Array, "joint"]

    @classmethod
    def none(cls, arm: Arm) -> "KinematicErrors":
        """No deviation."""
        three, joints = jnp.zeros_like(arm.shoulder), jnp.zeros_like(arm.lower)
        return cls(three, three, three, joints, joints)

    def flat(self) -> Float[Array, "parameter"]:
        """All numbers in a row, in the order of the fields."""
        return jnp.concatenate([getattr(self, f.name) for f in fields(self)])

    def like(self, flat: Float[Array, "parameter"]) -> "KinematicErrors":
        """The inverse of :meth:`flat`; the shapes are this one's."""
        shapes = [getattr(self, f.name).shape[0] for f in fields(self)]
        starts = [sum(shapes[:i]) for i in range(len(shapes))]
        return KinematicErrors(*(flat[start : start + n] for start, n in zip(starts, shapes, strict=True)))


def names_of(joint_names: tuple[str, ...]) -> tuple[str, ...]:
    """What to call each number of :meth:`KinematicErrors.flat`."""
    return (
        *(f"length of the {part}" for part in ("upper arm", "forearm", "hand")),
        *(f"shoulder {axis}" for axis in "xyz"),
        *(f"mount's turn about {axis}" for axis in "xyz"),
        *(f"zero of {joint}" for joint in joint_names),
        *(f"scale of {joint}" for joint in joint_names),
    )


def deviating_arm(arm: Arm, errors: KinematicErrors) -> Arm:
    """The arm with the deviations built in: its angles are ``(1 + scale) reading``, its zero posture that of reading 0.

    Zeros turn what lies behind a joint about its axis, which keeps every right angle and common point of the class.
    Joint ranges and speeds stay those of the readings; gravity and keep-out stay in the base frame.

    Args:
        arm: The nominal arm.
        errors: Its deviations.

    Returns:
        An arm of the same class, with limits and velocity limits in its own angles.

    **Differentiability**: smooth in everything.
    """
    turn = rotation_matrix(errors.turn)
    shoulder = arm.shoulder + errors.shift
    upper, fore, hand = (
        (1.0 + factor) * part
        for factor, part in zip(
            errors.length,
            (arm.elbow - arm.shoulder, arm.wrist - arm.elbow, arm.tool_position - arm.wrist),
            strict=True,
        )
    )
    carried, axes, com, inertia = turn, [], [], []
    # Each link's frame origin in the nominal arm and in this one; the elbow and wrist join as their joints turn.
    old, new = arm.shoulder, shoulder
    elbow = wrist = shoulder
    for joint in range(arm.n_joints):
        if joint == 3:
            elbow = shoulder + carried @ upper
            old, new = arm.elbow, elbow
        elif joint == 4:
            wrist = elbow + carried @ fore
            old, new = arm.wrist, wrist
        axes.append(carried @ arm.axes[joint])
        carried = carried @ rotation_matrix(arm.axes[joint] * errors.zero[joint])
        com.append(new + carried @ (arm.links.center_of_mass[joint] - old))
        inertia.append(carried @ arm.links.inertia[joint] @ carried.T)
    factor = 1.0 + errors.scale
    return replace(
        arm,
        axes=jnp.stack(axes),
        shoulder=shoulder,
        elbow=elbow,
        wrist=wrist,
        tool_position=wrist + carried @ hand,
        tool_rotation=carried @ arm.tool_rotation,
        lower=arm.lower * factor,
        upper=arm.upper * factor,
        velocity_limit=arm.velocity_limit * factor,
        links=replace(arm.links, center_of_mass=jnp.stack(com), inertia=jnp.stack(inertia)),
        reference=type(arm.reference)(*(turn @ v for v in arm.reference.vectors())),  # pyright: ignore
    )


def rotation_matrix(vector: Array) -> Array:
    """Rotation matrix of a rotation vector ``(3,)``, smooth at zero (Rodrigues with sinc)."""
    square = vec3.dot(vector, vector)
    small = square < float(jnp.finfo(vector.dtype).eps)
    angle = jnp.sqrt(jnp.where(small, 1.0, square))
    sinc = jnp.where(small, 1.0 - square / 6, jnp.sin(angle) / angle)
    half = jnp.where(small, 0.5 - square / 24, (1.0 - jnp.cos(angle)) / angle**2)
    x, y, z = vector
    zero = jnp.zeros_like(x)
    skew = jnp.stack([jnp.stack([zero, -z, y]), jnp.stack([z, zero, -x]), jnp.stack([-y, x, zero])])
    return jnp.eye(3, dtype=vector.dtype) + sinc * skew + half * skew @ skew
