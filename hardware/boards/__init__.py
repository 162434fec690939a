"""Boards by address: ``connect("simulated")``, ``connect("arduino:/dev/ttyUSB0")`` and others behind a port."""

import re
from collections.abc import Mapping
from contextlib import ExitStack
from difflib import get_close_matches
from importlib import import_module
from typing import Any

from hardware.board import Board
from hardware.boards.composite import CompositeBoard
from hardware.boards.firmware_board import FirmwareBoard
from hardware.boards.host_timed_board import HostTimedBoard, bus_id
from hardware.boards.simulated import SimulatedBoard
from hardware.clock import WallClock
from hardware.errors import BoardError

# Kind: module, class, and True if it needs a port. A board's module, and its package with it, is loaded when asked for.
_BOARDS = {
    "arduino": ("arduino", "ArduinoBoard", True),
    "dynamixel": ("dynamixel", "DynamixelBoard", True),
    "feetech": ("feetech", "FeetechBoard", True),
    "maestro": ("maestro", "MaestroBoard", True),
    "meccanoid": ("meccanoid", "MeccanoidBoard", True),
    "simulated": ("simulated", "SimulatedBoard", False),
}
_WITH_RATE = ("arduino", "dynamixel", "feetech")


def connect(address: str = "simulated", **options: Any) -> Board:
    """Open a board.

    Args:
        address: ``"kind"`` or ``"kind:port"``, such as ``"simulated"`` or ``"arduino:/dev/ttyUSB0"``;
            ``"simulated:arduino"`` is simulated and takes only what an Arduino takes. A rate other than the board's
            usual one follows the port: ``"feetech:/dev/ttyUSB0@115200"``. Boards that play together are joined by a
            plus: ``"meccanoid:AA:BB:CC:DD:EE:FF+arduino:/dev/ttyUSB0"``.
        **options: Keyword arguments of the board's class; several boards take only ``latency_s``, per kind.

    Returns:
        The board, to be used in a ``with`` statement.

    Raises:
        BoardError: There is no such kind of board; with those there are. Or it cannot be opened; with likely causes.
        LinkError: The board does not answer.
    """
    if "+" in address:
        return _connect_several(address.split("+"), **options)
    kind, port = parse_address(address)
    port, at, rate = port.rpartition("@") if re.fullmatch(r".+@\d+", port) else (port, "", "")
    if at:
        options["baud"] = int(rate)
    if "baud" in options and kind not in _WITH_RATE:
        raise BoardError(f"the board {kind!r} has no rate to set; {', '.join(_WITH_RATE)} have one")
    module, name, _ = _BOARDS[kind]
    return getattr(import_module(f"{__name__}.{module}"), name)(*([port] if port else []), **options)


def parse_address(address: str) -> tuple[str, str]:
    """Return the kind of one board and its port, which may be empty.

    Args:
        address: ``"kind"`` or ``"kind:port"``; ``"simulated:KIND"`` is a simulated one that takes what that kind takes.

    Raises:
        BoardError: There is no such kind of board, or it needs a port.
    """
    kind, colon, port = address.partition(":")
    if kind not in _BOARDS:
        near = get_close_matches(kind.lower(), _BOARDS, 1)
        meant = f"; did you mean {near[0] + colon + port}?" if near else ";"
        raise BoardError(f"no board of kind {kind!r}{meant} there are {', '.join(_BOARDS)}")
    if _BOARDS[kind][2] and not port:
        raise BoardError(f"the board {kind!r} needs a port, such as {kind}:/dev/ttyUSB0 or {kind}:COM3")
    if kind == "simulated" and port and (port not in _BOARDS or port == kind):
        others = ", ".join(f"{kind}:{other}" for other in _BOARDS if other != kind)
        raise BoardError(f"the board {kind!r} has no port; expected {kind} alone, or as another board: {others}")
    return kind, port


def parse_addresses(address: str) -> dict[str, str]:
    """Return the ports of one board, or of several joined by a plus, by their kinds; raise as :func:`parse_address`."""
    return dict(map(parse_address, address.split("+")))


def _connect_several(addresses: list[str], latency_s: Mapping[str, float] | None = None) -> Board:
    """Open boards that play together, on one clock; if one fails, those already open are closed."""
    clock, boards = WallClock(), {}
    with ExitStack() as opened:
        for address in addresses:
            boards[address.partition(":")[0]] = opened.enter_context(connect(address, clock=clock))
        whole = CompositeBoard(boards, latency_s)
        opened.pop_all()
    return whole


__all__ = [
    "CompositeBoard",
    "FirmwareBoard",
    "HostTimedBoard",
    "SimulatedBoard",
    "bus_id",
    "connect",
    "parse_addresses",
]
