"""Feetech STS (Waveshare ST) servos on a USB adapter, through feetech-servo-sdk."""

from collections.abc import Sequence

from hardware.boards.host_timed_board import bus_id
from hardware.boards.sdk_bus import SdkBoard
from hardware.clock import Clock
from hardware.errors import BoardError
from hardware.joint_map import JointCalibration

# Control table of the STS series.
_TORQUE, _GOAL, _POSITION = 40, 42, 56


class FeetechBoard(SdkBoard):
    """A chain of Feetech STS servos; a joint's channel is its servo's ID, raw values are 4096 per turn.

    These servos have no watchdog: they hold the last goal when the host falls silent.

    Args:
        port: Serial port, such as ``/dev/ttyACM0`` or ``COM3``.
        baud: Bits per second, as the servos are set: 1000000 from the factory.
        clock: Clock of the host; None for the computer's.

    Raises:
        BoardError: The package is missing, or the port cannot be opened.
    """

    def __init__(self, port: str, *, baud: int = 1_000_000, clock: Clock | None = None) -> None:
        try:
            import scservo_sdk as sdk
        except ImportError as error:
            raise BoardError("Feetech servos need feetech-servo-sdk: pip install feetech-servo-sdk") from error
        super().__init__("feetech", sdk, 0, port, baud, clock)

    def _servo_id(self, joint: JointCalibration) -> int:
        return bus_id(joint, 0, 253)

    def _prepare(self, ids: Sequence[int]) -> None:
        self._drive_surely(ids, False)
        self._group(ids, _POSITION, _GOAL, 2)

    def _read(self, ids: Sequence[int]) -> list[int] | None:
        if self._guard(self._reader.txRxPacket) != self._sdk.COMM_SUCCESS:
            return None
        return [self._reader.getData(i, _POSITION, 2) for i in ids]

    def _drive(self, ids: Sequence[int], on: bool) -> bool:
        done = [self._write1(i, _TORQUE, int(on)) for i in ids]  # every servo, even after a failure
        return all(done)
