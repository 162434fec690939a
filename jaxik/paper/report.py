"""Effect of the errata on the tip of the hand, and the worked example as a table."""

import math
import textwrap

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxik.arm import presets
from jaxik.ik import IKSolution, solve_ik
from jaxik.paper import formulas
from jaxik.paper.steps import FOREARM, HAND, SWIVEL, TIP, UPPER_ARM, WRIST, Step, worked_example
from jaxik.targets import Pointing

PRINTED_ROLL_DEG = 114.11


def solve_example(swivel: ArrayLike = SWIVEL) -> IKSolution:
    """Solve the worked example by :func:`jaxik.solve_ik` on the paper's arm, in JAX's default float type.

    Args:
        swivel: Swivel, the paper's t, ``(*batch,)`` [rad].

    Returns:
        All eight branches; only branch 0 is within the paper's servo ranges.

    Example:
        >>> q = solve_example().q[0]
        >>> [round(float(angle), 2) for angle in jnp.degrees(q)]
        [9.74, 120.0, 70.53, 60.0, 51.59, 31.4]
    """
    swivel = jnp.asarray(swivel, float)
    target = Pointing(jnp.asarray(TIP, float), jnp.asarray(np.subtract(TIP, WRIST), float))
    return solve_ik(presets.paper_arm().arm, target, swivel)


def solved_miss() -> float:
    """Return the distance of the tip from the target for the joint angles of :func:`solve_example`.

    Returns:
        The distance in the paper's unitless length; a few eps of JAX's default float type times the arm's length of 7.
    """
    q = np.asarray(solve_example().raise_if_invalid().q[0], float)
    return float(np.linalg.norm(formulas.chain(q, UPPER_ARM, FOREARM, HAND).tip - TIP))


def printed_roll_misses(roll_deg: float = PRINTED_ROLL_DEG) -> dict[tuple[int, int], float]:
    """Return the distances of the tip from the target for a given forearm roll, with all other angles exact.

    Since the paper states neither the sign nor the zero position of the roll, both signs and four zero positions a
    quarter turn apart are tried. The flexion of the hand is chosen to come nearest to the target, without limits.

    Args:
        roll_deg: Forearm roll [deg]; the printed value by default.

    Returns:
        Distance by sign and offset [deg]; the length of the hand is 1.

    Example:
        >>> round(min(printed_roll_misses().values()), 2)
        0.13
    """
    solved = _exact_angles()
    return {
        (sign, offset): _nearest_miss(solved, math.radians(sign * roll_deg + offset))
        for sign in (1, -1)
        for offset in (0, 90, 180, 270)
    }


def printed_roll_miss(roll_deg: float = PRINTED_ROLL_DEG) -> float:
    """Return the smallest of :func:`printed_roll_misses`.

    Args:
        roll_deg: Forearm roll [deg].

    Returns:
        Distance of the tip from the target; the length of the hand is 1.
    """
    return min(printed_roll_misses(roll_deg).values())


def table(steps: tuple[Step, ...] | None = None) -> str:
    """Return the worked example as text: printed and exact numbers, errata as footnotes, and errors at the tip.

    Args:
        steps: Steps to list; all of the worked example by default.

    Returns:
        Lines of at most 120 characters.
    """
    steps = worked_example() if steps is None else steps
    rows = [("eq.", "quantity", "printed", "exact", "")]
    notes = []
    for step in steps:
        mark = ""
        if step.erratum:
            notes.append(f"[{len(notes) + 1}] ({step.equation}) {step.erratum}")
            mark = f"[{len(notes)}]"
        unit = f" {step.unit}" if step.unit else ""
        rows.append((
            step.equation,
            step.name,
            ", ".join(f"{x:.{step.digits}f}" for x in step.printed) + unit,
            ", ".join(f"{x + 0.0:.6g}" for x in step.exact) + unit,
            mark,
        ))  # fmt: skip
    width = [max(len(row[column]) for row in rows) for column in range(5)]
    lines = ["  ".join(text.ljust(w) for text, w in zip(row, width, strict=True)).rstrip() for row in rows]
    verdict = (
        "Distance of the tip from the target",
        f"  with the printed roll, smallest over all signs and offsets: {printed_roll_miss():.3f}",
        f"  with the joint angles of jaxik.solve_ik in {jnp.result_type(float).name}: {solved_miss():.1e}",
    )
    notes = (line for note in notes for line in textwrap.wrap(note, 120, subsequent_indent="     "))
    return "\n".join((*lines, "", *notes, "", *verdict))


def _exact_angles() -> np.ndarray:
    """Joint angles of the example by the corrected formulas in float64, independent of the solver."""
    wrist, tip = np.array(WRIST), np.array(TIP)
    circle = formulas.elbow_circle(wrist, UPPER_ARM, FOREARM)
    elbow = circle.point(SWIVEL)
    from_vertical, azimuth = formulas.shoulder_angles(elbow)
    upper, forearm = elbow / UPPER_ARM, (wrist - elbow) / FOREARM
    sideways = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])  # the second axis after the first rotation
    roll = math.atan2(forearm @ sideways, forearm @ np.cross(sideways, upper))
    flexion = math.acos(upper @ forearm)
    hand = math.pi - formulas.interior_wrist_angle(elbow, wrist, tip)
    return np.array([azimuth, math.pi - from_vertical, roll, flexion, formulas.forearm_roll(elbow, wrist, tip), hand])


def _nearest_miss(q: np.ndarray, roll: float) -> float:
    """Distance of the tip from the target at a given roll and the best flexion."""
    wrist, tips = np.array(WRIST), []
    for flexion in (0.0, math.pi / 2):
        angles = np.array([*q[:4], roll, flexion])
        tips.append(formulas.chain(angles, UPPER_ARM, FOREARM, HAND).tip)
    along, across = (t - wrist for t in tips)  # orthogonal directions in the plane of flexion, of the hand's length
    wanted = np.array(TIP) - wrist
    best = math.atan2(wanted @ across, wanted @ along)
    return float(np.linalg.norm(math.cos(best) * along + math.sin(best) * across - wanted))
