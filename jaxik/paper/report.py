"""What the errata cost at the tip of the hand, and the whole walk as a table."""

import math
import textwrap

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxik.arm.presets import paper_arm
from jaxik.ik import IKSolution, solve_ik
from jaxik.paper import formulas
from jaxik.paper.steps import FOREARM, HAND, SWIVEL, TIP, UPPER_ARM, WRIST, Step, worked_example
from jaxik.targets import Pointing

PRINTED_ROLL_DEG = 114.11


def solve_example(swivel: ArrayLike = SWIVEL) -> IKSolution:
    """The worked example solved by :func:`jaxik.solve_ik` on the paper's arm, in JAX's default float type.

    Args:
        swivel: The paper's t [rad], scalar or ``(*batch,)``.

    Returns:
        All eight branches; inside the paper's servo ranges only branch 0.

    Example:
        >>> q = solve_example().q[0]
        >>> [round(float(angle), 2) for angle in jnp.degrees(q)]
        [9.74, 120.0, 70.53, 60.0, 51.59, 31.4]
    """
    swivel = jnp.asarray(swivel, float)
    target = Pointing(jnp.asarray(TIP, float), jnp.asarray(np.subtract(TIP, WRIST), float))
    return solve_ik(paper_arm().arm, target, swivel)


def solved_miss() -> float:
    """Distance from the example's tip to where the solved joint angles put it, by :func:`jaxik.paper.chain`.

    Returns:
        Unitless length; a few eps of JAX's default float type times the arm's length of 7.
    """
    q = np.asarray(solve_example().raise_if_invalid().q[0], float)
    return float(np.linalg.norm(formulas.chain(q, UPPER_ARM, FOREARM, HAND)[2] - TIP))


def printed_roll_misses(roll_deg: float = PRINTED_ROLL_DEG) -> dict[tuple[int, int], float]:
    """How far the tip stays from the target with a given wrist roll, everything else being exact.

    The roll is tried with both signs and from every zero position a quarter turn apart, since the paper states neither;
    of all flexions of the hand, without limits, the one that comes nearest counts.

    Args:
        roll_deg: The roll [deg], by default as the paper prints it.

    Returns:
        From (sign, offset in degrees) to the tip's distance from the target; the hand's length is 1.

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
    """The least of :func:`printed_roll_misses`.

    Args:
        roll_deg: The roll [deg].

    Returns:
        Distance of the tip from the target; the hand's length is 1.
    """
    return min(printed_roll_misses(roll_deg).values())


def table(steps: tuple[Step, ...] | None = None) -> str:
    """The walk as plain text: printed and exact numbers, the errata as footnotes, and both misses.

    Args:
        steps: What to list; by default the whole worked example.

    Returns:
        Lines of at most 120 characters.
    """
    steps = worked_example() if steps is None else steps
    rows = [("eq.", "what", "printed", "exact", "")]
    notes = []
    for step in steps:
        mark = ""
        if step.erratum:
            notes.append(f"[{len(notes) + 1}] ({step.equation}) {step.erratum}")
            mark = f"[{len(notes)}]"
        unit = f" {step.unit}" if step.unit else ""
        rows.append((
            step.equation,
            step.what,
            ", ".join(f"{x:.{step.digits}f}" for x in step.printed) + unit,
            ", ".join(f"{x + 0.0:.6g}" for x in step.exact) + unit,
            mark,
        ))  # fmt: skip
    width = [max(len(row[column]) for row in rows) for column in range(5)]
    lines = ["  ".join(text.ljust(w) for text, w in zip(row, width, strict=True)).rstrip() for row in rows]
    verdict = (
        "Tip's distance from the target",
        f"  with the printed roll, best of all signs and offsets: {printed_roll_miss():.3f}",
        f"  with the angles of jaxik.solve_ik in {jnp.result_type(float).name}: {solved_miss():.1e}",
    )
    notes = (line for note in notes for line in textwrap.wrap(note, 120, subsequent_indent="     "))
    return "\n".join((*lines, "", *notes, "", *verdict))


def _exact_angles() -> np.ndarray:
    """Joint angles of the example by the corrected formulas, float64, apart from the solver."""
    wrist, tip = np.array(WRIST), np.array(TIP)
    circle = formulas.elbow_circle(wrist, UPPER_ARM, FOREARM)
    elbow = circle.point(SWIVEL)
    from_vertical, azimuth = formulas.shoulder_angles(elbow)
    upper, forearm = elbow / UPPER_ARM, (wrist - elbow) / FOREARM
    sideways = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])  # the second axis, once the first has turned
    roll = math.atan2(forearm @ sideways, forearm @ np.cross(sideways, upper))
    flexion = math.acos(upper @ forearm)
    hand = math.pi - formulas.interior_wrist_angle(elbow, wrist, tip)
    return np.array([azimuth, math.pi - from_vertical, roll, flexion, formulas.forearm_roll(elbow, wrist, tip), hand])


def _nearest_miss(q: np.ndarray, roll: float) -> float:
    """Tip's distance from the target at a roll and the best flexion."""
    wrist, tips = np.array(WRIST), []
    for flexion in (0.0, math.pi / 2):
        angles = np.array([*q[:4], roll, flexion])
        tips.append(formulas.chain(angles, UPPER_ARM, FOREARM, HAND)[2])
    along, across = (t - wrist for t in tips)  # two orthogonal directions of that plane, of the hand's length
    wanted = np.array(TIP) - wrist
    best = math.atan2(wanted @ across, wanted @ along)
    return float(np.linalg.norm(math.cos(best) * along + math.sin(best) * across - wanted))
