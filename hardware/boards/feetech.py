"""Feetech STS (Waveshare ST) servos on a USB adapter, through feetech-servo-sdk."""

from collections.abc import Sequence

from hardware.boards.sdk_bus import SdkBoard
from hardware.boards.servo_series import Register, ServoSeries
from hardware.clock import Clock
from hardware.transport import Transport

_SIGN = 0x8000  # positions are a sign and a magnitude


def _parse(packet: Sequence[int]) -> tuple[int, int, bytes]:
    """Return number, error byte and data of a status packet."""
    return packet[2], packet[4], bytes(packet[5 : packet[3] + 3])


FEETECH = ServoSeries(
    kind="feetech",
    bauds=(1_000_000, 115_200, 500_000, 250_000, 128_000, 57_600, 38_400, 19_200),
    ids=range(254),
    torque=Register(40, 1),
    goal=Register(42, 2),
    position=Register(56, 2),
    mode=Register(33, 1),
    position_modes=(0,),
    turning_modes=(),  # with both limits at zero it counts turns
    mode_names={0: "position", 1: "velocity", 2: "PWM", 3: "step"},
    limits=(Register(9, 2), Register(11, 2)),
    voltage=Register(62, 1),
    temperature=Register(63, 1),
    alerts=Register(65, 1),
    alert_names={0: "voltage", 1: "sensor", 2: "overheating", 3: "overcurrent", 4: "angle", 5: "overload"},
    alert_mask=0x3F,
    model=Register(3, 2),
    models={777: "STS3215", 2825: "STS3250", 11272: "SM8512BL"},
    remedy="let it rest and free the joint; its alert ends by itself",
    sdk="scservo_sdk",
    package="feetech-servo-sdk",
    protocol=0,
    call_all=(0, 0, 0xFE, 2, 1, 0),
    parse=_parse,
    decode=lambda content: -(content & ~_SIGN) if content & _SIGN else content,
    encode=lambda raw: -raw | _SIGN if raw < 0 else raw,
    whole_range=(-30_719, 30_719),
)

_TORQUE_OFF = bytes((0xFF, 0xFF, 0xFE, 4, 3, 40, 0, 0xFF - (0xFE + 4 + 3 + 40) % 256))  # a write to all servos


class FeetechBoard(SdkBoard):
    """A chain of Feetech STS servos; a joint's channel is its servo's ID, raw values are 4096 per turn.

    These servos have no watchdog: they hold the last goal when the host falls silent. On Linux and macOS a process
    beside this one releases them if the program dies.

    Args:
        port: Serial port, such as ``/dev/ttyACM0`` or ``COM3``; no other program may have it open.
        baud: Bits per second, as the servos are set: 1000000 from the factory; :func:`hardware.scan` finds it.
        clock: Clock of the host; None for the computer's.
        transport: Transport to use instead of the port, for tests.

    Raises:
        BoardError: The package is missing, or the port cannot be opened.
    """

    def __init__(
        self,
        port: str = "",
        *,
        baud: int = FEETECH.bauds[0],
        clock: Clock | None = None,
        transport: Transport | None = None,
    ) -> None:
        super().__init__(FEETECH, port, baud, clock, transport)

    def _farewell(self) -> tuple[int | None, bytes]:
        return getattr(self._line, "descriptor", None), _TORQUE_OFF
