"""Arms whose outermost joint is offset: one spherical joint, an elbow, and two axes that meet at the other end.

The U-R wrist has its outer joint, joint 7, beyond the point where axes 5 and 6 meet: Franka, xArm 7. The R-U shoulder
is its mirror image: joint 1 lies before the point where axes 2 and 3 meet: PR2, Fetch, TIAGo, TALOS. Once the outer
joint's angle is given the other six are found in closed form, so that angle is the arm's redundancy parameter.
"""

import dataclasses
from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from jaxik.arm.arm import Arm, HalfSpaces

OUTER_JOINT_CLASSES = {6: "U-R wrist", 0: "R-U shoulder"}
"""Names of the classes by the index of the outer joint."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class OuterJointArm(Arm):
    """An arm whose outermost joint, 7 or 1, is offset from its two neighbors; its angle is the redundancy parameter.

    Build one with :func:`jaxik.arm_from_axes`, a preset such as :func:`jaxik.presets.franka_fr3`, or
    :func:`jaxik.load_urdf`.

    Attributes:
        axes: Unit joint axes, ``(7, 3)``.
        shoulder: Point S where axes 1-3 meet, axes 2 and 3 if joint 1 is the outer one, ``(3,)`` [m].
        elbow: Point E on axis 4 nearest to S, ``(3,)`` [m].
        wrist: Point W where axes 5-7 meet, axes 5 and 6 if joint 7 is the outer one, ``(3,)`` [m].
        tool_position: Tool point at zero joint angles, ``(3,)`` [m].
        tool_rotation: Tool frame at zero joint angles, ``(3, 3)``.
        lower: Lower joint limits, ``(7,)`` [rad].
        upper: Upper joint limits, ``(7,)`` [rad].
        velocity_limit: Largest joint speeds, ``(7,)`` [rad/s].
        torque_limit: Largest joint torques, ``(7,)`` [N m].
        links: Mass data.
        motors: Motor data.
        gravity: Gravity in the base frame, ``(3,)`` [m/s²].
        keep_out: Half-spaces the elbow must stay in.
        reference: Zero of the swivel angle, which takes no part in the closed form of these classes.
        surroundings: The body of the arm and the world about it, set by :func:`jaxik.with_body`; None for none.
        outer: Point on the outer joint's axis, ``(3,)`` [m].
        outer_joint: Index of the outer joint, 6 (U-R wrist) or 0 (R-U shoulder).
    """

    outer: Float[Array, "3"]
    # Part of the tree structure: it selects the formulas.
    outer_joint: int = dataclasses.field(metadata={"static": True})

    @property
    def kinematic_class(self) -> str:
        """Name of the class: ``"U-R wrist"`` or ``"R-U shoulder"``."""
        return OUTER_JOINT_CLASSES[self.outer_joint]

    @property
    def mirrored(self) -> bool:
        """True for the R-U shoulder, the mirror image of the U-R wrist."""
        return self.outer_joint == 0

    @property
    def stations(self) -> tuple[Array, ...]:
        """Points from base to tip that the joints carry along, the tool point last, ``(3,)`` each [m]."""
        shoulder, elbow, wrist, tool = super().stations
        if self.mirrored:
            return self.outer, shoulder, elbow, wrist, tool
        return shoulder, elbow, wrist, self.outer, tool

    @property
    def station_of_joint(self) -> tuple[int, ...]:
        """Index of the station that lies on each joint's axis."""
        return (0, 1, 1, 2, 3, 3, 3) if self.mirrored else (0, 0, 0, 1, 2, 2, 3)


def reversed_arm(arm: OuterJointArm) -> OuterJointArm:
    """Return the arm read from tip to base: the other class, with the tool frame as base frame and the base as tool.

    A posture q of the arm, in reverse order, is the posture of the reversed one whose tool pose is the inverse of the
    arm's. Masses, motors, gravity and keep-out stay behind: they take no part in the closed form.
    """
    turn, origin = arm.tool_rotation.T, arm.tool_position

    def point(p: Array) -> Array:
        return turn @ (p - origin)

    none = jnp.zeros_like(arm.lower[:0])
    return dataclasses.replace(
        arm,
        axes=-(arm.axes @ arm.tool_rotation)[::-1],
        shoulder=point(arm.wrist),
        elbow=point(arm.elbow),
        wrist=point(arm.shoulder),
        outer=point(arm.outer),
        tool_position=-turn @ origin,
        tool_rotation=turn,
        keep_out=HalfSpaces(jnp.zeros((0, 3), none.dtype), none),
        outer_joint=6 - arm.outer_joint,
        **{name: getattr(arm, name)[::-1] for name in ("lower", "upper", "velocity_limit", "torque_limit")},
    )
