"""Joint angles as bars within their ranges, for the panel."""

import numpy as np

from jaxik.arm import ArmModel


def joint_gauges(model: ArmModel, q: np.ndarray) -> str:
    """Return one bar per joint as HTML: the full width is the range, a mark shows the angle, red if out of range.

    Args:
        model: The arm.
        q: Joint angles, ``(joint,)`` [rad].
    """
    lower, upper = (
        np.degrees(np.clip(np.asarray(x, float), -np.pi, np.pi)) for x in (model.arm.lower, model.arm.upper)
    )
    rows = [
        _row(name, *numbers)
        for name, *numbers in zip(model.joint_names, np.round(np.degrees(q), 1), lower, upper, strict=True)
    ]
    return f"<div style='padding:0 .8em;font-size:12px'>{''.join(rows)}</div>"


def _row(name: str, angle: float, lower: float, upper: float) -> str:
    percent = 100 * (angle - lower) / (upper - lower)
    color = "#2a6f97" if -1e-6 <= percent <= 100 + 1e-6 else "#d1495b"
    mark = f"left:calc({min(max(percent, 0), 100):.1f}% - 2px);background:{color}"
    return (
        f"<div style='display:flex;justify-content:space-between'><span>{name}</span>"
        f"<span style='color:{color}'>{angle + 0.0:.1f}°</span></div>"
        "<div style='position:relative;height:5px;background:#e8eef3;border-radius:3px;margin-bottom:3px'>"
        f"<div style='position:absolute;top:-2px;width:4px;height:9px;border-radius:2px;{mark}'></div></div>"
    )
