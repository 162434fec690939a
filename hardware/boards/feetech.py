"""Feetech STS (Waveshare ST) servos on a USB adapter, through feetech-servo-sdk."""

from collections.abc import Sequence
from typing import Any

from hardware.boards.streamed import StreamedBoard, bus_id
from hardware.clock import Clock
from hardware.errors import BoardError, LinkError
from hardware.joint_map import JointCalibration

# Control table of the STS series.
_TORQUE, _GOAL, _POSITION = 40, 42, 56


class FeetechBoard(StreamedBoard):
    """A chain of Feetech STS servos; a joint's channel is its servo's ID, raw values are 4096 a turn.

    These servos have no watchdog: they hold the last goal when the host falls silent.

    Args:
        port: Serial port, such as ``/dev/ttyACM0`` or ``COM3``.
        baud: Bits a second, as the servos are set: 1000000 from the factory.
        clock: Whose time; None for the computer's.

    Raises:
        BoardError: The package is missing, or the port cannot be opened.
    """

    def __init__(self, port: str, *, baud: int = 1_000_000, clock: Clock | None = None) -> None:
        try:
            import scservo_sdk as sdk
        except ImportError as error:
            raise BoardError("Feetech servos need feetech-servo-sdk: pip install feetech-servo-sdk") from error
        super().__init__(f"feetech:{port}", clock)
        self._sdk: Any = sdk
        self._port = sdk.PortHandler(port)
        self._packets: Any = sdk.PacketHandler(0)
        try:
            opened = self._port.openPort() and self._port.setBaudRate(baud)
        except OSError as error:
            raise BoardError(f"{port} cannot be opened: {error}; is the adapter plugged in?") from error
        if not opened:
            raise BoardError(f"{port} cannot be opened at {baud} baud")

    def _id(self, joint: JointCalibration) -> int:
        return bus_id(joint, 0, 253)

    def _prepare(self, ids: Sequence[int]) -> None:
        self._surely(ids, False)
        self._reader = self._sdk.GroupSyncRead(self._port, self._packets, _POSITION, 2)
        self._writer = self._sdk.GroupSyncWrite(self._port, self._packets, _GOAL, 2)
        for i in ids:
            self._reader.addParam(i)

    def _write(self, ids: Sequence[int], raw: Sequence[int]) -> None:
        self._writer.clearParam()
        for i, value in zip(ids, raw, strict=True):
            self._writer.addParam(i, list(int(value).to_bytes(2, "little")))
        self._guard(self._writer.txPacket)

    def _read(self, ids: Sequence[int]) -> list[int] | None:
        if self._guard(self._reader.txRxPacket) != self._sdk.COMM_SUCCESS:
            return None
        return [self._reader.getData(i, _POSITION, 2) for i in ids]

    def _drive(self, ids: Sequence[int], on: bool) -> bool:
        def switch(servo: int) -> bool:
            answer = self._guard(lambda: self._packets.write1ByteTxRx(self._port, servo, _TORQUE, int(on)))
            return isinstance(answer, tuple) and answer[0] == self._sdk.COMM_SUCCESS

        done = [switch(i) for i in ids]  # each, also after one has failed
        return all(done)

    def _hang_up(self) -> None:
        self._port.closePort()

    def _guard(self, action: Any) -> Any:
        try:
            return action()
        except OSError as error:
            raise LinkError(f"{self.name}: the port is gone ({error})") from error
        except IndexError:  # the SDK trips over a cut reply
            return self._sdk.COMM_RX_CORRUPT
