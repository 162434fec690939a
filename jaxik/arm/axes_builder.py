"""Arms of any class from the axes of their joints."""

import numpy as np

from jaxik.arm.arm import Arm, HalfSpaces, LinkInertia, Motors
from jaxik.arm.arm_classes import arm_geometry
from jaxik.arm.builder import Numbers, arm_of_geometry, checked_array
from jaxik.arm.swivel_reference import SwivelReference


def arm_from_axes(
    axes: Numbers,
    points: Numbers,
    tool_position: Numbers,
    tool_rotation: Numbers | None = None,
    *,
    lower: Numbers | None = None,
    upper: Numbers | None = None,
    velocity_limit: Numbers | None = None,
    torque_limit: Numbers | None = None,
    links: LinkInertia | None = None,
    motors: Motors | None = None,
    gravity: Numbers = (0.0, 0.0, -9.81),
    keep_out: HalfSpaces | None = None,
    reference: SwivelReference | None = None,
    tolerance: float = 1e-9,
) -> Arm:
    """Build an arm from the axes of its joints; its class is found from them (:attr:`Arm.kinematic_class`).

    All geometry is given at zero joint angles in the base frame. A member of a class is solved in closed form: S-R-S
    (see :func:`jaxik.make_arm`), or an arm with an outer joint (:class:`jaxik.OuterJointArm`). Deviations up to
    ``tolerance`` are rounded to the nearest exact member; what the class leaves free stays as given. Seven joints that
    miss the classes by more are solved as they are, by refinement (:class:`jaxik.RefinedArm`).

    Args:
        axes: Unit joint axes, ``(7, 3)`` or ``(6, 3)``; joints turn right-handed about them.
        points: A point on each axis, same shape [m].
        tool_position: Tool point, ``(3,)`` [m].
        tool_rotation: Tool frame, ``(3, 3)``, its z axis the pointing direction; default the base frame's.
        lower: Lower joint limits, as for :func:`jaxik.make_arm` [rad].
        upper: Upper joint limits, likewise [rad].
        velocity_limit: Largest joint speeds, likewise [rad/s].
        torque_limit: Largest joint torques, likewise [N m].
        links: Mass data, likewise.
        motors: Motor data, likewise.
        gravity: Gravity in the base frame, ``(3,)`` [m/s²].
        keep_out: Half-spaces the elbow must stay in; default none.
        reference: Zero of the swivel angle, as for :func:`jaxik.make_arm`.
        tolerance: Largest deviation from a class taken for rounding: angles [rad], lengths relative to the arm's.

    Returns:
        The arm, in float64 if JAX has 64-bit types enabled, else float32.

    Raises:
        ArmClassError: The chain is far from every class, or has other than 7 joints and is no S-R-S arm with 6; says
            which conditions fail and by how many mm or degrees.
        ValueError: If a shape is wrong, a number is not finite, a limit is empty, or a mass or inertia is impossible.

    Example:
        >>> z, y = [0, 0, 1], [0, 1, 0]
        >>> points = [[0, 0, h] for h in (0, 0, 0, 0.3, 0.6, 0.6)]
        >>> arm_from_axes([z, y, z, y, z, y, z], [*points, [0.1, 0, 0.6]], [0.1, 0, 0.7]).kinematic_class
        'U-R wrist'
    """
    axes = checked_array("axes", axes, (None, 3))
    points = checked_array("points", points, (len(axes), 3))
    tool = np.eye(4)
    tool[:3, 3] = checked_array("tool_position", tool_position, (3,))
    if tool_rotation is not None:
        tool[:3, :3] = checked_array("tool_rotation", tool_rotation, (3, 3))
    return arm_of_geometry(
        arm_geometry(axes, points, tool, tolerance),
        lower=lower,
        upper=upper,
        velocity_limit=velocity_limit,
        torque_limit=torque_limit,
        links=links,
        motors=motors,
        gravity=gravity,
        keep_out=keep_out,
        reference=reference,
    )
