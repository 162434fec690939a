"""The real board: our firmware on an ATmega328P behind a serial port."""

from hardware.boards.firmware_board import FramedBoard
from hardware.clock import Clock, WallClock
from hardware.transport import SerialTransport

_BOOT_S = 2.0  # opening the port of many boards resets them, and the boot loader waits


class ArduinoBoard(FramedBoard):
    """An Arduino Pro Mini, Nano or Uno with our firmware.

    Args:
        port: Serial port, such as ``/dev/ttyUSB0``, ``/dev/rfcomm0`` or ``COM3``.
        baud: As the firmware was built: 115200 on a wire, 57600 through a Bluetooth module.
        bluetooth: Whether a radio lies between, which may stall: the arm then rests within 0.5 s of silence, not 0.3.
        clock: Whose time; None for the computer's.

    Raises:
        BoardError: The port cannot be opened; with likely causes and the ports there are.
        LinkError: Nobody answers.
    """

    def __init__(self, port: str, *, baud: int = 115_200, bluetooth: bool = False, clock: Clock | None = None) -> None:
        clock = WallClock() if clock is None else clock
        transport = SerialTransport(port, baud)
        clock.sleep(_BOOT_S)
        super().__init__(f"arduino:{port}", transport, clock, stop_within_s=0.5 if bluetooth else 0.3)
