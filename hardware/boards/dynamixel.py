"""Dynamixel X servos on a USB adapter, through dynamixel-sdk; protocol 2.0."""

from collections.abc import Sequence

from hardware.boards.host_timed_board import bus_id
from hardware.boards.sdk_bus import SdkBoard
from hardware.clock import Clock
from hardware.errors import BoardError
from hardware.joint_map import JointCalibration

# Control table of the X series.
_WATCHDOG, _TORQUE, _GOAL, _POSITION = 98, 64, 116, 132
_WATCHDOG_UNITS = 100  # of 20 ms: servos stop by themselves after two seconds of silence from the host


class DynamixelBoard(SdkBoard):
    """A chain of Dynamixel X servos; a joint's channel is its servo's ID, raw values are 4096 per turn.

    Args:
        port: Serial port, such as ``/dev/ttyUSB0`` or ``COM3``.
        baud: Bits per second, as the servos are set: 57600 from the factory.
        clock: Clock of the host; None for the computer's.

    Raises:
        BoardError: The package is missing, or the port cannot be opened.
    """

    def __init__(self, port: str, *, baud: int = 57_600, clock: Clock | None = None) -> None:
        try:
            import dynamixel_sdk as sdk
        except ImportError as error:
            raise BoardError("Dynamixel servos need dynamixel-sdk: pip install dynamixel-sdk") from error
        super().__init__("dynamixel", sdk, 2.0, port, baud, clock)

    def _servo_id(self, joint: JointCalibration) -> int:
        return bus_id(joint, 0, 252)

    def _prepare(self, ids: Sequence[int]) -> None:
        self._drive_surely(ids, False)
        for i in ids:  # 0 clears a watchdog that has triggered
            self._write1(i, _WATCHDOG, 0)
            self._write1(i, _WATCHDOG, _WATCHDOG_UNITS)
        self._group(ids, _POSITION, _GOAL, 4)

    def _read(self, ids: Sequence[int]) -> list[int] | None:
        if self._guard(self._reader.txRxPacket) != self._sdk.COMM_SUCCESS:
            return None
        positions = self._guard(lambda: [self._reader.getData(i, _POSITION, 4) for i in ids])
        return positions if isinstance(positions, list) and max(positions) <= 0xFFFF else None

    def _drive(self, ids: Sequence[int], on: bool) -> bool:
        done = [self._write1(i, _TORQUE, int(on)) for i in ids]  # every servo, even after a failure
        return all(done)
