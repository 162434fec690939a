"""An Arduino with our firmware behind a serial port."""

from hardware.boards.firmware_board import FirmwareBoard
from hardware.clock import Clock, WallClock
from hardware.transport import SerialTransport

_BOOT_S = 2.0  # opening the port resets many boards, and the boot loader then waits


class ArduinoBoard(FirmwareBoard):
    """An Arduino Pro Mini, Nano or Uno (ATmega328P) with our firmware.

    Args:
        port: Serial port, such as ``/dev/ttyUSB0``, ``/dev/rfcomm0`` or ``COM3``.
        baud: Bits per second, as the firmware was built: 115200 on a wire, 57600 through a Bluetooth module.
        bluetooth: True for a radio link, which may stall: the arm then rests within 0.5 s of silence, not 0.3 s.
        clock: Clock of the host; None for the computer's.

    Raises:
        BoardError: The port cannot be opened; with likely causes and the ports that exist.
        LinkError: The board does not answer.
    """

    def __init__(self, port: str, *, baud: int = 115_200, bluetooth: bool = False, clock: Clock | None = None) -> None:
        clock = WallClock() if clock is None else clock
        transport = SerialTransport(port, baud)
        clock.sleep(_BOOT_S)
        super().__init__(f"arduino:{port}", transport, clock, stop_within_s=0.5 if bluetooth else 0.3)
