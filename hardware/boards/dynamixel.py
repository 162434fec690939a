"""Dynamixel X servos on a USB adapter, through dynamixel-sdk; protocol 2.0."""

from collections.abc import Sequence

from hardware.boards.sdk_bus import SdkBoard
from hardware.boards.servo_series import Register, ServoSeries
from hardware.clock import Clock
from hardware.transport import Transport

_SIGN, _TWO_TO_32 = 0x8000_0000, 0x1_0000_0000  # positions are 32 bits, two's complement
_TURN = 4096
_ONE_TURN_MODE = 3
_HOMING_OFFSET = Register(20, 4)


def _parse(packet: Sequence[int]) -> tuple[int, int, bytes]:
    """Return number, error byte and data of a status packet."""
    return packet[4], packet[8], bytes(packet[9 : (packet[5] | packet[6] << 8) + 5])


def _decode(content: int) -> int:
    """Return a signed number from its 32 bits."""
    return content - _TWO_TO_32 if content & _SIGN else content


DYNAMIXEL = ServoSeries(
    kind="dynamixel",
    bauds=(57_600, 1_000_000, 115_200, 2_000_000, 3_000_000, 4_000_000, 9600),
    ids=range(253),
    torque=Register(64, 1),
    goal=Register(116, 4),
    position=Register(132, 4),
    mode=Register(11, 1),
    position_modes=(_ONE_TURN_MODE, 4, 5),
    turning_modes=(4, 5),
    mode_names={
        0: "current",
        1: "velocity",
        3: "position",
        4: "extended position",
        5: "current and position",
        16: "PWM",
    },
    limits=(Register(52, 4), Register(48, 4)),
    voltage=Register(144, 2),
    temperature=Register(146, 1),
    alerts=Register(70, 1),
    alert_names={
        0: "input voltage",
        1: "hall sensor",
        2: "overheating",
        3: "encoder",
        4: "electrical shock",
        5: "overload",
    },
    alert_mask=0x80,
    model=Register(0, 2),
    models={
        1000: "XH430-W350",
        1010: "XH430-W210",
        1020: "XM430-W350",
        1030: "XM430-W210",
        1060: "XL430-W250",
        1070: "XC430-W150",
        1120: "XM540-W270",
        1130: "XM540-W150",
        1190: "XL330-M077",
        1200: "XL330-M288",
    },
    remedy="free the joint, check the supply, and switch the servo's power off and on",
    sdk="dynamixel_sdk",
    package="dynamixel-sdk",
    protocol=2.0,
    call_all=(0, 0, 0, 0, 0xFE, 3, 0, 1, 0, 0),
    parse=_parse,
    decode=_decode,
    encode=lambda raw: raw % _TWO_TO_32,
    whole_range=(-1_048_575, 1_048_575),
    watchdog=Register(98, 1),
    watchdog_value=100,  # of 20 ms: servos stop by themselves after two seconds of silence from the host
    options=(False,),  # not the fast forms of the packets
)


class DynamixelBoard(SdkBoard):
    """A chain of Dynamixel X servos; a joint's channel is its servo's ID, raw values are 4096 per turn.

    In position mode a servo counts within one turn from the moment it is driven, and so does the board; in the extended
    modes it counts turns, and the joint angle does too.

    Args:
        port: Serial port, such as ``/dev/ttyUSB0`` or ``COM3``; no other program may have it open.
        baud: Bits per second, as the servos are set: 57600 from the factory; :func:`hardware.scan` finds it.
        clock: Clock of the host; None for the computer's.
        transport: Transport to use instead of the port, for tests.

    Raises:
        BoardError: The package is missing, or the port cannot be opened.
    """

    def __init__(
        self,
        port: str = "",
        *,
        baud: int = DYNAMIXEL.bauds[0],
        clock: Clock | None = None,
        transport: Transport | None = None,
    ) -> None:
        super().__init__(DYNAMIXEL, port, baud, clock, transport)
        self._zeros: dict[int, int] = {}  # of the servos in position mode

    def _note_counting(self, modes: dict[int, int]) -> None:
        turning = [i for i, mode in modes.items() if mode == _ONE_TURN_MODE]
        offsets = self._values(turning, _HOMING_OFFSET)
        self._zeros = {i: _decode(offsets[i]) for i in turning}

    def _count(self, servo: int, raw: int) -> int:
        """Return a position as the servo will count it once driven, however many turns it was turned while limp."""
        zero = self._zeros.get(servo)
        return raw if zero is None or servo in self._driven else zero + (raw - zero) % _TURN
