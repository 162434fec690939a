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

    The fields of :class:`Arm` keep their meaning, with ``wrist`` the point where axes 5 and 6 meet if joint 7 is the
    outer one, and ``shoulder`` that of axes 2 and 3 if it is joint 1. The swivel reference takes no part.

    Attributes:
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
