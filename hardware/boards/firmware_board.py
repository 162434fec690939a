"""A board that runs our firmware, real or modeled, behind any transport."""

import struct
from collections.abc import Collection, Sequence
from types import TracebackType

import numpy as np

from hardware import protocol
from hardware.board import BoardStatus, Fault, State, Waypoint
from hardware.boards.wire_records import wire_record
from hardware.clock import Clock
from hardware.errors import BoardError, LinkError
from hardware.frames import MAX_PAYLOAD, crc16
from hardware.joint_map import JointMap
from hardware.link import Link
from hardware.motion_time import MotionTime
from hardware.protocol import SMART, Message, StatusHeader
from hardware.transport import Transport

_DISCOVERY_S = 4.0  # four modules take two questions each; a packet goes out every 45 ms and asks every fourth module
_DISCOVERY_POLL_S = 0.02
_READBACK_S = 0.25  # one of four modules is asked every 45 ms, and the link adds its latency
_FIRST_SAMPLES = 16  # of round trip and clock


class FirmwareBoard:
    """Host's side of the firmware's protocol.

    Args:
        name: Name in reports and errors.
        transport: Stream of bytes to the board.
        clock: Clock of the host.
        stop_within_s: Silence within which the arm must be at rest [s]; 0.3 on a wire, 0.5 over Bluetooth.
        release_after_s: Silence after which the servos are released [s].
        max_payload: Longest payload of a message [bytes].

    Attributes:
        link: Connection to the board.
        hello: The board's answer to the first message.

    Raises:
        LinkError: The board does not answer.
    """

    without_watchdog: tuple[str, ...] = ()
    poll_s = 0.04  # two servo frames: often enough to keep a queue filled and to stop soon

    def __init__(
        self,
        name: str,
        transport: Transport,
        clock: Clock,
        *,
        stop_within_s: float = 0.3,
        release_after_s: float = 2.0,
        max_payload: int = MAX_PAYLOAD,
    ) -> None:
        self.name, self.clock, self.queue_depth, self.readback_s = name, clock, 0, _READBACK_S
        self._transport, self._max_payload = transport, max_payload
        self._silence_ms = round(1e3 * stop_within_s), round(1e3 * release_after_s)
        self._channels: list[int] = []
        self._zero = 0  # raw value 0 in the board's numbers, which are unsigned
        self._joints: JointMap | None = None
        self._motion_time = MotionTime()
        self._open = True
        self.link = Link(transport, clock, max_payload)
        try:
            self.hello = self.link.hello()
            for _ in range(_FIRST_SAMPLES):
                self.link.ask()
        except BaseException:
            transport.close()
            raise

    def configure(self, joints: JointMap) -> int:
        """See :class:`hardware.Board`; waits until servos with read-back have been found."""
        self._channels = self._assign(joints)
        records = [
            wire_record(joint.shifted(self._zero), channel)
            for joint, channel in zip(joints.joints, self._channels, strict=True)
        ]
        self._tell(Message.RELEASE)
        messages = [(Message.CONFIG, payload) for payload in protocol.config_payloads(records, self._max_payload)]
        packed = b"".join(record.pack() for record in records)
        commit = protocol.commit_payload(joints.crc, crc16(packed), *self._silence_ms)
        code = self.link.deliver([*messages, (Message.COMMIT, commit)])
        if code:
            status, _ = self.link.ask()
            raise BoardError(f"the board refuses the calibration: {_describe(code, status.fault_joint, joints)}")
        self._joints = joints
        status = self._await_readback()
        self.queue_depth = status.free
        return status.calibration

    def _assign(self, joints: JointMap) -> list[int]:
        """Return the channel of every joint."""
        channels = []
        for joint in joints.joints:
            channel = protocol.parse_channel(joint.channel)
            if channel is None:
                raise BoardError(
                    f"{joint.name} needs a channel of this board, D2 to D7 or D8/1 to D9/4; got {joint.channel!r}: "
                    "say in the calibration where each servo is plugged in"
                )
            channels.append(channel)
        joints.check("arduino")
        return channels

    def _await_readback(self) -> StatusHeader:
        """Wait until every smart servo has reported its position, or until the time for it is over."""
        deadline = self.clock.now() + _DISCOVERY_S
        while True:
            status, payload = self.link.ask()
            _, measured = self._values(payload)
            smart = np.array([channel >= SMART for channel in self._channels])
            if not (smart & np.isnan(measured)).any() or self.clock.now() >= deadline:
                return status
            self.clock.sleep(_DISCOVERY_POLL_S)

    def enable(self) -> None:
        """See :class:`hardware.Board`."""
        joints = self._configured()
        code = self.link.deliver([(Message.ENABLE, joints.crc.to_bytes(2, "little"))])
        if code:
            status, _ = self.link.ask()
            raise BoardError(f"the board will not drive the servos: {_describe(code, status.fault_joint, joints)}")

    def send(self, waypoints: Sequence[Waypoint]) -> None:
        """See :class:`hardware.Board`."""
        self._configured()
        layout = "<I" + protocol.value_format(self._channels)
        rows = [self._motion_time.pack(layout, point, self.link.fit) for point in waypoints]
        each = (self._max_payload - 3) // len(rows[0]) if rows else 1
        messages = []
        for at in range(0, len(rows), each):
            batch = waypoints[at : at + each]
            head = (batch[0].index % 2**16).to_bytes(2, "little") + bytes((batch[-1].last,))
            messages.append((Message.WAYPOINTS, head + b"".join(rows[at : at + each])))
        self.link.deliver(messages)

    def start(self, delay_us: int) -> None:
        """See :class:`hardware.Board`; a slow link gets a longer delay, because a late start is a fault."""
        self.start_at(self.clock.now() + (max(1e-6 * delay_us, self.start_lead_s) if delay_us else 0.01))

    @property
    def start_lead_s(self) -> float:
        """See :class:`hardware.Board` [s]; leaves time for a second try."""
        return 2.5 * self.link.timeout_s

    def start_at(self, host_s: float) -> None:
        """See :class:`hardware.Board`."""
        start_us = self._motion_time.begin(host_s, self.link.fit)
        code = self.link.deliver([(Message.START, start_us.to_bytes(4, "little"))])
        if code:
            status, _ = self.link.ask()
            raise BoardError(f"the board cannot start: it is {State(status.state).message}, fault {Fault(code).name}")

    def status(self) -> BoardStatus:
        """See :class:`hardware.Board`."""
        joints = self._configured()
        status, payload = self.link.ask()
        if not status.configured:
            raise LinkError("the board has restarted and knows no calibration; is its supply strong enough?")
        commanded, measured = self._values(payload)
        state = State(status.state)
        return BoardStatus(
            time_us=status.time_us,
            motion_us=status.motion_us,
            state=state,
            fault=Fault(status.fault),
            free=status.free,
            commanded=commanded,
            measured=np.where(joints.column("readback"), measured, np.nan),
            done=status.done and state is not State.PLAYING,
            joint=status.fault_joint,
            supply_v=status.vcc_mv / 1000 if status.vcc_mv else float("nan"),
        )

    def _values(self, payload: bytes) -> tuple[np.ndarray, np.ndarray]:
        """Return commanded and measured raw values of a status; nan without read-back, all nan at a wrong length."""
        layout = protocol.status_values(self._channels)
        if len(payload) != protocol.STATUS_BYTES + layout.size:
            return np.full(len(self._channels), np.nan), np.full(len(self._channels), np.nan)
        values = iter(layout.unpack_from(payload, protocol.STATUS_BYTES))
        pairs = [(next(values), (next(values) or np.nan) if channel >= SMART else np.nan) for channel in self._channels]
        commanded, measured = np.array(pairs, float).reshape(-1, 2).T
        return commanded, measured

    def stop(self) -> None:
        """See :class:`hardware.Board`."""
        self._tell(Message.STOP)
        self._motion_time = MotionTime()

    def clear_fault(self) -> None:
        """See :class:`hardware.Board`."""
        self._tell(Message.CLEAR)
        self._motion_time = MotionTime()

    def move(self, raw: Sequence[int]) -> None:
        """See :class:`hardware.Board`."""
        joints = self._configured()
        layout = protocol.value_format(self._channels)
        code = self.link.deliver([(Message.SETPOINT, struct.pack("<" + layout, *map(int, raw)))])
        if code:
            status, _ = self.link.ask()
            raise BoardError(f"the board does not move there: {_describe(code, status.fault_joint, joints)}")

    def limp(self, joints: Collection[int]) -> None:
        """See :class:`hardware.Board`."""
        names = self._configured().names
        hobby = [names[j] for j in joints if self._channels[j] < SMART]
        if hobby:
            raise BoardError(f"only smart servos can be taught by hand; {', '.join(hobby)} have no read-back")
        mask = sum(1 << j for j in joints)
        self.link.deliver([(Message.LIMP, mask.to_bytes(2, "little"))])

    def release(self) -> None:
        """See :class:`hardware.Board`."""
        self._tell(Message.RELEASE)

    def close(self) -> None:
        """See :class:`hardware.Board`."""
        if not self._open:
            return
        self._open = False
        try:
            self._tell(Message.RELEASE)
        except LinkError:
            pass  # a board that hears nothing releases by itself
        finally:
            self._transport.close()

    def __enter__(self) -> "FirmwareBoard":
        """Return the board itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def _tell(self, message: Message) -> None:
        self.link.deliver([(message, b"")])

    def _configured(self) -> JointMap:
        if self._joints is None:
            raise BoardError("the board moves nothing before it has been configured")
        return self._joints


def _describe(code: int, joint: int, joints: JointMap) -> str:
    """Return a fault code in words; codes of a newer firmware count as STATE."""
    fault = Fault(code) if code < len(Fault) else Fault.STATE
    return fault.describe(joint, joints.names)
