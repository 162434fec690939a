"""Consent to move joints whose calibration nobody has measured."""

from collections.abc import Callable

from hardware.errors import CalibrationError
from hardware.joint_map import ESTIMATES, JointMap


def estimated(joints: JointMap) -> str:
    """Return the joints with estimates, and what of them was not measured if it is not all; empty if there is none.

    Args:
        joints: Calibration of the joints that are about to move.
    """
    names = []
    for joint in joints.joints:
        if missing := joint.estimates():
            names.append(joint.name if missing == ESTIMATES else f"{joint.name} ({', '.join(missing)})")
    return ", ".join(names)


def ask_consent(joints: JointMap, board: str, say: Callable[[str], None], ask: Callable[[str], str] | None) -> None:
    """Say which joints would move by estimates and, for a real board, ask if they may.

    Args:
        joints: Calibration of the joints that are about to move.
        board: Address of the board.
        say: Function that shows a line.
        ask: Function that shows a prompt and returns a line; None if nobody is there to ask.

    Raises:
        CalibrationError: They may not.
    """
    names = estimated(joints)
    if not names:
        return
    say(f"not measured, estimates: {names}")
    if board.partition(":")[0] == "simulated":
        return
    if ask is None:
        raise CalibrationError(
            f"{board} would move joints by estimates: {names}; measure them with `jaxik calibrate servos`, or add "
            "--estimates to play all the same, slowly and with a hand on the switch"
        )
    if ask("move them all the same? [y/N] ").strip().lower() not in ("y", "yes"):
        raise CalibrationError("nothing was moved; measure the joints with `jaxik calibrate servos`")
