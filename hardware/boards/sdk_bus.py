"""Common part of the boards behind the two makers' SDKs: opening the port, reading and writing, and our own errors."""

from collections.abc import Callable, Sequence
from typing import Any

from hardware.boards.host_timed_board import HostTimedBoard
from hardware.clock import Clock
from hardware.errors import BoardError, LinkError


class SdkBoard(HostTimedBoard):
    """A chain of servos behind an SDK of the Dynamixel family, whose calls have the same names.

    Args:
        kind: Kind of the board, as in its address.
        sdk: Module of the SDK.
        protocol: Version of its packet handler.
        port: Serial port.
        baud: Bits per second.
        clock: Clock of the host; None for the computer's.

    Raises:
        BoardError: The port cannot be opened.
    """

    def __init__(self, kind: str, sdk: Any, protocol: int | float, port: str, baud: int, clock: Clock | None) -> None:
        super().__init__(f"{kind}:{port}", clock)
        self._sdk = sdk
        self._port = sdk.PortHandler(port)
        self._packets: Any = sdk.PacketHandler(protocol)
        try:
            opened = self._port.openPort() and self._port.setBaudRate(baud)
        except OSError as error:
            raise BoardError(f"{port} cannot be opened: {error}; is the adapter plugged in?") from error
        if not opened:
            raise BoardError(f"{port} cannot be opened at {baud} baud")

    def _group(self, ids: Sequence[int], position: int, goal: int, width: int) -> None:
        """Prepare to read and write all servos at once.

        Args:
            ids: Numbers of the servos.
            position: Address of the position in the control table.
            goal: Address of the goal in the control table.
            width: Length of both [bytes].
        """
        self._width = width
        self._reader = self._sdk.GroupSyncRead(self._port, self._packets, position, width)
        self._writer = self._sdk.GroupSyncWrite(self._port, self._packets, goal, width)
        for i in ids:
            self._reader.addParam(i)

    def _write(self, ids: Sequence[int], raw: Sequence[int]) -> None:
        self._writer.clearParam()
        for i, value in zip(ids, raw, strict=True):
            self._writer.addParam(i, list(int(value).to_bytes(self._width, "little")))
        self._guard(self._writer.txPacket)

    def _write1(self, servo: int, address: int, value: int) -> bool:
        answer = self._guard(lambda: self._packets.write1ByteTxRx(self._port, servo, address, value))
        return isinstance(answer, tuple) and answer[0] == self._sdk.COMM_SUCCESS

    def _disconnect(self) -> None:
        self._port.closePort()

    def _guard(self, action: Callable[[], Any]) -> Any:
        """Return an action's result, or COMM_RX_CORRUPT where the SDK fails on a truncated reply."""
        try:
            return action()
        except OSError as error:
            raise LinkError(f"{self.name}: the port is gone ({error})") from error
        except IndexError:
            return self._sdk.COMM_RX_CORRUPT
