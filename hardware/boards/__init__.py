"""Boards by address: ``connect("simulated")`` and, as they come, boards behind a port."""

from typing import Any

from hardware.boards.simulated import SimulatedBoard
from hardware.device import Device
from hardware.errors import BoardError

_BOARDS = {"simulated": SimulatedBoard}


def connect(address: str = "simulated", **options: Any) -> Device:
    """Opens a board.

    Args:
        address: ``"kind"`` or ``"kind:port"``; today ``"simulated"``.
        **options: For the board; see its class.

    Returns:
        The device, to be used in a ``with`` statement.

    Raises:
        BoardError: No such kind of board; with those there are.
    """
    kind, _, port = address.partition(":")
    if kind not in _BOARDS:
        raise BoardError(f"no board of kind {kind!r}; there are {', '.join(_BOARDS)}")
    if port:
        raise BoardError(f"the board {kind!r} has no port; write {kind!r} alone, not {address!r}")
    return _BOARDS[kind](**options)


__all__ = ["SimulatedBoard", "connect"]
