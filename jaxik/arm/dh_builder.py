"""Arms from the rows of a Denavit-Hartenberg table."""

from typing import Any, Literal

import numpy as np

from jaxik.arm.arm import Arm
from jaxik.arm.axes_builder import arm_from_axes
from jaxik.arm.builder import Numbers, checked_array


def arm_from_dh(
    rows: Numbers,
    *,
    convention: Literal["standard", "modified"],
    base: Numbers | None = None,
    tool: Numbers | None = None,
    **options: Any,
) -> Arm:
    """Build an arm from Denavit-Hartenberg parameters, one row ``a, alpha, d, theta`` per joint.

    Link i follows joint i by Rz(theta + q) Tz(d) Tx(a) Rx(alpha) in the standard convention, and by Rx(alpha) Tx(a)
    Rz(theta + q) Tz(d) in the modified one (Craig's), where ``a`` and ``alpha`` are those of the link before. Tables
    rarely say which they are: in a modified one the first ``a`` and ``alpha`` are usually zero, in a standard one the
    last.

    Args:
        rows: Parameters ``(7, 4)`` or ``(6, 4)``: a [m], alpha [rad], d [m], theta [rad], the joint's zero.
        convention: ``"standard"`` or ``"modified"``.
        base: Frame of the table's first row in the arm's base frame, ``(4, 4)``; default the same frame.
        tool: Frame of the tool in the last row's frame, ``(4, 4)``; default the same frame.
        **options: Limits, masses, tolerance and the rest as for :func:`jaxik.arm_from_axes`.

    Returns:
        The arm, of the class that its axes have.

    Raises:
        ArmClassError: As :func:`jaxik.arm_from_axes`.
        ValueError: A wrong shape or convention, or as :func:`jaxik.arm_from_axes`.

    Example:
        >>> half = np.pi / 2
        >>> lengths, turns = (0.34, 0, 0.4, 0, 0.4, 0, 0.126), (-half, half, half, -half, -half, half, 0)
        >>> iiwa = [(0, alpha, d, 0) for d, alpha in zip(lengths, turns)]
        >>> arm_from_dh(iiwa, convention="standard").kinematic_class
        'S-R-S'
    """
    rows = checked_array("rows", rows, (None, 4))
    if convention not in ("standard", "modified"):
        raise ValueError(f'expected convention "standard" or "modified", got {convention!r:.40}')
    frame = np.eye(4) if base is None else checked_array("base", base, (4, 4))
    axes, points = [], []
    for a, alpha, d, theta in rows:
        link = _along_x(a, alpha)
        if convention == "modified":
            frame = frame @ link
        axes.append(frame[:3, 2])
        points.append(frame[:3, 3])
        frame = frame @ _along_z(d, theta)
        if convention == "standard":
            frame = frame @ link
    if tool is not None:
        frame = frame @ checked_array("tool", tool, (4, 4))
    return arm_from_axes(np.stack(axes), np.stack(points), frame[:3, 3], frame[:3, :3], **options)


def _along_x(length: float, angle: float) -> np.ndarray:
    c, s = _exact(np.cos(angle)), _exact(np.sin(angle))
    return np.array([[1, 0, 0, length], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


def _along_z(length: float, angle: float) -> np.ndarray:
    c, s = _exact(np.cos(angle)), _exact(np.sin(angle))
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, length], [0, 0, 0, 1]])


def _exact(value: float) -> float:
    """Sines and cosines of right angles without the rounding of pi."""
    return float(np.round(value)) if abs(value - np.round(value)) < 1e-15 else float(value)
