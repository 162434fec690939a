"""Arms from plain numbers: every check, then arrays in JAX's default float type."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxik.arm.arm import Arm, HalfSpaces, LinkInertia, Motors
from jaxik.arm.arm_classes import Geometry
from jaxik.arm.outer_joint_arm import OuterJointArm
from jaxik.arm.outer_joint_class import OuterJointGeometry
from jaxik.arm.refined_arm import RefinedArm
from jaxik.arm.refined_class import RefinedGeometry
from jaxik.arm.srs_class import ArmGeometry, exact_member, unit_vectors
from jaxik.arm.swivel_reference import PaperReference, StereographicReference, SwivelReference

Numbers = float | int | Sequence | np.ndarray | jax.Array

CONTINUOUS = 200 * np.pi
"""Limits stored for an unlimited joint [rad]: a hundred turns either way.

They are finite, so that files, sliders and gradients need no special case; a range wider than one turn never excludes a
solution.
"""

UNLIMITED = 1e6
"""Limit stored for an unlimited velocity [rad/s] or torque [N m]: finite for the same reason, beyond every motor."""


def make_arm(
    axes: Numbers,
    shoulder: Numbers,
    elbow: Numbers,
    wrist: Numbers,
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
    """Build an arm of the S-R-S class, checked; outside ``jit``, since it checks values.

    All geometry is given at zero joint angles in the base frame. Axes 1 and 2, 2 and 3, 5 and 6, 6 and 7 must be
    perpendicular (1 and 3, or 5 and 7, need not be parallel); the elbow axis may have any direction and any offset.
    With six joints the tool's roll is no joint: the tool's z axis must be perpendicular to axis 6 and pass through the
    wrist and the tool point. Deviations up to ``tolerance`` are rounded to the nearest exact arm.

    Args:
        axes: Unit joint axes, ``(7, 3)`` or ``(6, 3)``; joints turn right-handed about them.
        shoulder: Point where axes 1-3 meet, ``(3,)`` [m].
        elbow: Any point on axis 4, ``(3,)`` [m]; the arm keeps the one nearest to the shoulder.
        wrist: Point where axes 5-7 meet, ``(3,)`` [m].
        tool_position: Tool point, ``(3,)`` [m].
        tool_rotation: Tool frame, ``(3, 3)``, its z axis the pointing direction. Without one it is the base frame's for
            seven joints, or where the tool point is the wrist; else z points from the wrist to the tool and y lies
            along axis 6.
        lower: Lower joint limits, a number or one per joint [rad]; -inf, with +inf above, for a joint without limits,
            which is also the default.
        upper: Upper joint limits, likewise [rad].
        velocity_limit: Largest joint speeds, a number or one per joint [rad/s]; default none, stored as 1e6.
        torque_limit: Largest joint torques, a number or one per joint [N m]; default none, stored as 1e6.
        links: Mass data; default massless, so that energies count motion only.
        motors: Motor data; default 1 ohm and 1 N m/A, which makes the copper loss the squared torque.
        gravity: Gravity in the base frame, ``(3,)`` [m/s²]; default for a base with z up, the value simulators use.
        keep_out: Half-spaces the elbow must stay in; default none.
        reference: Zero of the swivel angle; default a :class:`jaxik.StereographicReference` whose singular half-line
            is opposite to the wrist at zero joint angles, which are usually in the middle of the workspace, and whose
            zero is the side to which the elbow goes when joint 4 alone turns forward.
        tolerance: Largest deviation from the class taken for rounding: angles [rad], lengths relative to the arm's.
            1e-9 is far above float64 rounding and far below machining errors, so a wrong number is refused.

    Returns:
        The arm, in float64 if JAX has 64-bit types enabled, else float32.

    Raises:
        ArmClassError: If the arm is no member of the class; says which condition fails and by how many mm or degrees.
        ValueError: If a shape is wrong, a number is not finite, a limit is empty, or a mass or inertia is impossible.

    Example:
        >>> z, y = [0, 0, 1], [0, 1, 0]
        >>> arm = make_arm([z, y, z, y, z, y], [0, 0, 0], [0, 0, 3], [0, 0, 6], [0, 0, 7])
        >>> arm.n_joints
        6
    """
    axes = checked_array("axes", axes, (None, 3))
    named = {"shoulder": shoulder, "elbow": elbow, "wrist": wrist, "tool_position": tool_position}
    points = {name: checked_array(name, value, (3,)) for name, value in named.items()}
    rotation = (
        _default_tool_rotation(axes, points, tolerance)
        if tool_rotation is None
        else checked_array("tool_rotation", tool_rotation, (3, 3))
    )
    geometry = exact_member(ArmGeometry(axes, **points, tool_rotation=rotation), tolerance)
    return arm_of_geometry(
        geometry,
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


def arm_of_geometry(
    geometry: Geometry,
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
) -> Arm:
    """Return the arm of an exact member of a class, the rest as for :func:`make_arm`, checked."""
    n = len(geometry.axes)
    low, high = _limits(lower, upper, n)
    numbers: dict[str, Any] = {k: floats(v) for k, v in geometry._asdict().items() if k != "outer_joint"}
    if not isinstance(geometry, ArmGeometry):
        numbers["outer_joint"] = geometry.outer_joint
    return _CLASSES[type(geometry)](
        **numbers,
        lower=floats(low),
        upper=floats(high),
        velocity_limit=floats(_positive("velocity_limit", velocity_limit, n)),
        torque_limit=floats(_positive("torque_limit", torque_limit, n)),
        links=_links(links, n),
        motors=_motors(motors, n),
        gravity=floats(checked_array("gravity", gravity, (3,))),
        keep_out=_keep_out(keep_out),
        reference=default_reference(geometry) if reference is None else _reference(reference),
    )


_CLASSES = {ArmGeometry: Arm, OuterJointGeometry: OuterJointArm, RefinedGeometry: RefinedArm}


def floats(value: Numbers) -> jax.Array:
    """Return an array in JAX's default float type, from numbers that were checked in float64."""
    return jnp.asarray(np.asarray(value, np.float64), dtype=float)


def default_reference(geometry: Geometry) -> StereographicReference:
    """Return the swivel reference for an arm that comes without one (see :func:`make_arm`)."""
    reach = geometry.wrist - geometry.shoulder
    distance = np.linalg.norm(reach)
    # An arm folded onto its shoulder at zero angles has no direction to oppose: take its first axis.
    pole = -reach / distance if distance > 1e-3 * geometry.length else -geometry.axes[0]
    side = np.cross(geometry.axes[3], pole)
    if np.linalg.norm(side) < 1e-3:
        side = np.cross(geometry.axes[1] if abs(geometry.axes[1] @ pole) < 0.9 else geometry.axes[0], pole)
    return StereographicReference(pole=floats(pole), zero=floats(side / np.linalg.norm(side)))


def checked_array(name: str, value: Numbers, shape: tuple[int | None, ...]) -> np.ndarray:
    """Return finite float64 numbers of a shape, None for any length."""
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be numbers of shape {_shape_text(shape)}, got {value!r}") from None
    if array.ndim != len(shape) or any(w is not None and g != w for g, w in zip(array.shape, shape, strict=True)):
        raise ValueError(f"{name} must have shape {_shape_text(shape)}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite, got {array.tolist()}")
    return array


def _shape_text(shape: tuple[int | None, ...]) -> str:
    return "(" + ", ".join("joint" if s is None else str(s) for s in shape) + ("," if len(shape) == 1 else "") + ")"


def _per_joint(name: str, value: Numbers, n: int) -> np.ndarray:
    array = np.array(value, np.float64)
    if array.shape not in ((), (n,)):
        raise ValueError(f"{name} must be a number or one per joint, shape ({n},), got shape {array.shape}")
    return np.broadcast_to(array, (n,)).copy()


def _limits(lower: Numbers | None, upper: Numbers | None, n: int) -> tuple[np.ndarray, np.ndarray]:
    low = _per_joint("lower", -np.inf if lower is None else lower, n)
    high = _per_joint("upper", np.inf if upper is None else upper, n)
    free = (low == -np.inf) & (high == np.inf)
    low[free], high[free] = -CONTINUOUS, CONTINUOUS
    for i in range(n):
        if not (np.isfinite(low[i]) and np.isfinite(high[i])):
            raise ValueError(
                f"joint {i + 1} has limits [{low[i]}, {high[i]}]: give two numbers, or -inf and inf for none"
            )
        if not low[i] < high[i]:
            raise ValueError(
                f"joint {i + 1} has an empty range: lower {low[i]:.9g} is not below upper {high[i]:.9g} rad"
            )
    return low, high


def _positive(name: str, value: Numbers | None, n: int) -> np.ndarray:
    array = _per_joint(name, np.inf if value is None else value, n)
    array[array == np.inf] = UNLIMITED
    if not (np.isfinite(array) & (array > 0)).all():
        raise ValueError(f"{name} must be positive, got {array.tolist()}")
    return array


def _links(links: LinkInertia | None, n: int) -> LinkInertia:
    if links is None:
        return LinkInertia(floats(np.zeros(n)), floats(np.zeros((n, 3))), floats(np.zeros((n, 3, 3))))
    mass = checked_array("links.mass", links.mass, (n,))
    inertia = checked_array("links.inertia", links.inertia, (n, 3, 3))
    if (mass < 0).any():
        raise ValueError(f"links.mass must not be negative, got {mass.tolist()}")
    # 1e-5: relative error of a matrix rotated in float32; 1e-12 kg m² is negligible.
    for i, matrix in enumerate(inertia):
        slack = 1e-12 + 1e-5 * np.abs(matrix).max()
        if np.abs(matrix - matrix.T).max() > slack or np.linalg.eigvalsh(matrix).min() < -slack:
            raise ValueError(f"links.inertia of link {i + 1} is not symmetric with eigenvalues >= 0: {matrix.tolist()}")
    return LinkInertia(
        floats(mass), floats(checked_array("links.center_of_mass", links.center_of_mass, (n, 3))), floats(inertia)
    )


def _motors(motors: Motors | None, n: int) -> Motors:
    if motors is None:
        return Motors(floats(np.ones(n)), floats(np.ones(n)))
    return Motors(
        floats(_positive("motors.resistance", motors.resistance, n)),
        floats(_positive("motors.torque_constant", motors.torque_constant, n)),
    )


def _keep_out(keep_out: HalfSpaces | None) -> HalfSpaces:
    if keep_out is None:
        return HalfSpaces(floats(np.zeros((0, 3))), floats(np.zeros(0)))
    normal = checked_array("keep_out.normal", keep_out.normal, (None, 3))
    offset = checked_array("keep_out.offset", keep_out.offset, (len(normal),))
    return HalfSpaces(floats(unit_vectors(normal, "keep_out.normal")), floats(offset))


def _reference(reference: SwivelReference) -> SwivelReference:
    """Return the reference with its two vectors made unit and perpendicular to rounding."""
    names = ("axis", "fallback") if isinstance(reference, PaperReference) else ("pole", "zero")
    pair = np.stack([checked_array(f"reference.{k}", v, (3,)) for k, v in zip(names, reference.vectors(), strict=True)])
    first, second = unit_vectors(pair, "reference vector")
    if not abs(first @ second) <= 2e-6:  # both vectors rounded to six digits
        raise ValueError(
            f"reference.{names[1]} must be perpendicular to .{names[0]}: their product is {first @ second:.3g}"
        )
    second = second - first * (first @ second)
    return type(reference)(floats(first), floats(second / np.linalg.norm(second)))


def _default_tool_rotation(axes: np.ndarray, points: dict[str, np.ndarray], tolerance: float) -> np.ndarray:
    """Return the identity for seven joints; for six, z from wrist to tool, if they are apart, and y along axis 6."""
    shoulder, elbow, wrist, tool = points.values()
    hand, arm = tool - wrist, np.linalg.norm(elbow - shoulder) + np.linalg.norm(wrist - elbow)
    if len(axes) != 6 or np.linalg.norm(hand) <= tolerance * arm:
        return np.eye(3)
    z = hand / np.linalg.norm(hand)
    y = axes[5] - z * (axes[5] @ z)
    if np.linalg.norm(y) < 1e-6:  # hand along axis 6: the class check refuses the arm, whatever y is
        return np.eye(3)
    y /= np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z], axis=1)
