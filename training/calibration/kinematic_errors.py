"""Deviations of a real arm from its model: lengths, mount, joint zeros and joint scales."""

from dataclasses import dataclass, fields, replace

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxik.arm import Arm
from jaxik.targets import matrix_from_rotation_vector


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class KinematicErrors:
    """Deviations from a nominal arm; zeros give the nominal arm.

    Attributes:
        length: Relative change of upper arm, forearm and hand, ``(3,)``.
        shift: Displacement of the shoulder, ``(3,)`` [m].
        turn: Rotation of the whole arm about the shoulder, a rotation vector in the base frame, ``(3,)`` [rad].
        zero: Joint angle at reading zero, ``(joint,)`` [rad].
        scale: Relative error of the reading, as in angle = (1 + scale) reading + zero, ``(joint,)``.
    """

    length: Float[Array, "3"]
    shift: Float[Array, "3"]
    turn: Float[Array, "3"]
    zero: Float[Array, "joint"]
    scale: Float[Array, "joint"]

    @classmethod
    def none(cls, arm: Arm) -> "KinematicErrors":
        """Return zero deviations.

        Args:
            arm: The arm, for shapes and dtype.
        """
        three, joints = jnp.zeros_like(arm.shoulder), jnp.zeros_like(arm.lower)
        return cls(three, three, three, joints, joints)

    def flat(self) -> Float[Array, "parameter"]:
        """Return all numbers as one array ``(parameter,)``, in the order of the fields."""
        return jnp.concatenate([getattr(self, f.name) for f in fields(self)])

    def like(self, flat: Float[Array, "parameter"]) -> "KinematicErrors":
        """Return deviations of the same shapes from the array of :meth:`flat`.

        Args:
            flat: All numbers, ``(parameter,)``.
        """
        shapes = [getattr(self, f.name).shape[0] for f in fields(self)]
        starts = [sum(shapes[:i]) for i in range(len(shapes))]
        return KinematicErrors(*(flat[start : start + n] for start, n in zip(starts, shapes, strict=True)))


def names_of(joint_names: tuple[str, ...]) -> tuple[str, ...]:
    """Return a name for each number of :meth:`KinematicErrors.flat`."""
    return (
        *(f"length of the {part}" for part in ("upper arm", "forearm", "hand")),
        *(f"shoulder {axis}" for axis in "xyz"),
        *(f"rotation of the mount about {axis}" for axis in "xyz"),
        *(f"zero of {joint}" for joint in joint_names),
        *(f"scale of {joint}" for joint in joint_names),
    )


def deviating_arm(arm: Arm, errors: KinematicErrors) -> Arm:
    """Return the arm with the deviations built in: its joint angles are ``(1 + scale) reading``.

    Its zero posture is that of reading zero. A joint zero rotates the links after the joint about its axis, which keeps
    all right angles and intersections of axes. Ranges and velocity limits are those of the readings; gravity and
    keep-out stay in the base frame.

    Args:
        arm: The nominal arm.
        errors: Deviations from the nominal arm.

    Returns:
        An arm of the same kinematic class, with limits in its own joint angles.

    **Differentiability**: smooth in everything.
    """
    turn = matrix_from_rotation_vector(errors.turn)
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
    # Origin of the current link in the nominal and in the new arm: shoulder, elbow from joint 4, wrist from joint 5.
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
        carried = carried @ matrix_from_rotation_vector(arm.axes[joint] * errors.zero[joint])
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
