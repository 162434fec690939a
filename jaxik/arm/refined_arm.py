"""Seven-joint arms of no class: solved by refinement, from the solutions of a nearby arm with an outer joint.

The redundancy parameter is the angle of an outermost joint, 7 or 1, as for the nearby arm, whose closed form gives the
seeds at the same angle. Newton's method brings them onto the arm itself, with that joint held.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any

import jax
from jax import Array
from jaxtyping import Float

from jaxik.arm.arm import Arm
from jaxik.arm.outer_joint_arm import OUTER_JOINT_CLASSES, OuterJointArm

SLOTS = 16
"""Solutions per target: the most that six turning joints can have with the seventh held."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class RefinedArm(Arm):
    """A seven-joint arm of any axes, solved by refinement; the angle of joint 7 or 1 is the redundancy parameter.

    :func:`jaxik.arm_from_axes` and :func:`jaxik.load_urdf` return one for a chain that is in no class. Its kinematics
    are those of the chain, and so are residual, status and derivatives of what is solved. Shoulder, elbow and wrist
    are those of the nearest member of a class, which gives the seeds and takes no part in derivatives.

    Attributes:
        axes: Unit joint axes, ``(7, 3)``.
        shoulder: Shoulder of the nearest member, ``(3,)`` [m].
        elbow: Its elbow, ``(3,)`` [m].
        wrist: Its wrist, ``(3,)`` [m].
        tool_position: Tool point at zero joint angles, ``(3,)`` [m].
        tool_rotation: Tool frame at zero joint angles, ``(3, 3)``.
        lower: Lower joint limits, ``(7,)`` [rad].
        upper: Upper joint limits, ``(7,)`` [rad].
        velocity_limit: Largest joint speeds, ``(7,)`` [rad/s].
        torque_limit: Largest joint torques, ``(7,)`` [N m].
        links: Mass data.
        motors: Motor data.
        gravity: Gravity in the base frame, ``(3,)`` [m/s²].
        keep_out: Half-spaces that the point on axis 4 must stay in.
        reference: Zero of the swivel angle, which takes no part in the solution of these arms.
        surroundings: The body of the arm and the world about it, set by :func:`jaxik.with_body`; None for none.
        points: Point on each axis, that nearest to the member's shoulder, elbow, wrist or outer joint, ``(7, 3)`` [m].
        member_axes: Unit joint axes of the nearest member, ``(7, 3)``.
        outer: Point on the outer joint's axis of the nearest member, ``(3,)`` [m].
        outer_joint: Index of the joint whose angle is the redundancy parameter, 6 or 0.
    """

    points: Float[Array, "7 3"]
    member_axes: Float[Array, "7 3"]
    outer: Float[Array, "3"]
    outer_joint: int = dataclasses.field(metadata={"static": True})

    @property
    def kinematic_class(self) -> str:
        """Name of the class: ``"near U-R wrist"`` or ``"near R-U shoulder"``."""
        return f"near {OUTER_JOINT_CLASSES[self.outer_joint]}"

    @property
    def closed_form(self) -> bool:
        """False: solutions are found by refinement."""
        return False

    @property
    def stations(self) -> tuple[Array, ...]:
        """Points from base to tip that the joints carry along, one per axis and the tool point, ``(3,)`` each [m]."""
        return *self.points, self.tool_position

    @property
    def station_of_joint(self) -> tuple[int, ...]:
        """Index of the station that lies on each joint's axis."""
        return tuple(range(7))

    @property
    def member(self) -> OuterJointArm:
        """The nearest arm with a closed form."""
        shared: dict[str, Any] = {field.name: getattr(self, field.name) for field in dataclasses.fields(OuterJointArm)}
        shared["axes"] = self.member_axes
        return OuterJointArm(**shared)
