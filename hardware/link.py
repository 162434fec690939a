"""Reliable messages over a transport that may lose, garble or delay them: go-back-N with acknowledgments.

Up to a window of frames is in flight. The board executes them strictly in sequence, and every answer says which frame
it expects next. After a gap, or without an answer, sending resumes from that frame.
"""

from collections import deque
from collections.abc import Sequence

from hardware.clock import Clock
from hardware.clock_fit import ClockFit
from hardware.errors import BoardError, LinkError
from hardware.frames import FRAME_BYTES, MAX_PAYLOAD, VERSION, Decoder, Frame, encode
from hardware.protocol import Hello, Message, StatusHeader, unpack_hello, unpack_status
from hardware.transport import Transport

WINDOW = 8
_TRIES = 8  # before giving up, and no sooner than after
_PATIENCE_S = 1.0
_LEAST_TIMEOUT_S = 0.02
_FIRST_ROUND_TRIP_S = 0.1  # assumed until one has been measured
_POLL_S = 0.001
_HEARTBEAT_S = 0.06  # longest silence of ours while an answer is awaited: the board would take more for a dead host
_REMEMBERED = 64  # pings whose answers may still come
_SMOOTHING = 0.2
_SILENT = (
    "the board does not answer; likely causes: it has no power, the wrong port or baud rate, RX and TX not crossed, "
    "or other firmware on it"
)


class Link:
    """Connection to one board behind a transport.

    Args:
        transport: Stream of bytes to the board.
        clock: Clock of the host.
        max_payload: Longest payload to accept [bytes].

    Attributes:
        fit: Fit of the board's clock, from every status received.
        resent: Number of times that something had to be sent again.
    """

    def __init__(self, transport: Transport, clock: Clock, max_payload: int = MAX_PAYLOAD) -> None:
        self.fit = ClockFit()
        self.resent = 0
        self._transport, self._clock = transport, clock
        self._decoder = Decoder(max_payload)
        self._inbox: deque[Frame] = deque()
        self._next = 0  # sequence number of the next frame
        self._echo = 0
        self._written_s = clock.now()
        self._asked: dict[int, float] = {}
        self._round_trip_s: float | None = None

    @property
    def timeout_s(self) -> float:
        """Time to wait for an answer before asking again [s]."""
        usual = _FIRST_ROUND_TRIP_S if self._round_trip_s is None else self._round_trip_s
        return max(_LEAST_TIMEOUT_S, 4 * usual)

    def hello(self) -> Hello:
        """Exchange versions and agree on the sequence.

        Raises:
            LinkError: The board does not answer.
            BoardError: The firmware has another version.
        """
        for _ in range(_TRIES):
            sequence, self._next = self._next, (self._next + 1) % 256
            self._write(b"\0" + encode(Frame(sequence, Message.HELLO, b"")))
            for frame in self._answers(self._clock.now() + max(0.25, self.timeout_s)):
                if frame.type == Message.HELLO_REPLY:
                    hello = unpack_hello(frame.payload)
                    if hello is None:
                        raise BoardError(
                            f"the board's firmware has another protocol version than the host's {VERSION}; flash the "
                            "firmware of this package"
                        )
                    if frame.sequence == self._next:
                        return hello
        raise LinkError(_SILENT)

    def ask(self) -> tuple[StatusHeader, bytes]:
        """Return the board's status: header and whole payload. Its time is also a sample for :attr:`fit`.

        Raises:
            LinkError: The board does not answer.
        """
        tries, began = 0, self._clock.now()
        while tries < _TRIES or self._clock.now() < began + _PATIENCE_S:
            tries += 1
            echo = self._ping()
            for frame in self._answers(self._clock.now() + self.timeout_s):
                status = unpack_status(frame.payload) if frame.type == Message.STATUS else None
                if status is not None and echo <= status.echo <= self._echo:
                    return status, frame.payload
            self.resent += 1
        raise LinkError(_SILENT)

    def _ping(self) -> int:
        """Ask for the status without waiting; return the number that the answer will echo."""
        self._echo += 1
        self._asked[self._echo] = self._clock.now()
        self._asked.pop(self._echo - _REMEMBERED, None)
        self._write(b"\0" + encode(Frame(self._next, Message.PING, self._echo.to_bytes(4, "little"))))
        return self._echo

    def _write(self, data: bytes) -> None:
        self._written_s = self._clock.now()
        self._transport.write(data)

    def _sample(self, frame: Frame) -> None:
        """Update clock fit and round trip from a status, allowing for questions being shorter than answers."""
        status = unpack_status(frame.payload)
        asked_s = self._asked.pop(status.echo, None) if status is not None else None
        if status is None or asked_s is None:
            return
        now, byte_s = self._clock.now(), self._transport.byte_s
        to_s, back_s = (5 + FRAME_BYTES) * byte_s, (len(frame.payload) + FRAME_BYTES) * byte_s
        self.fit.add(asked_s + to_s, now - back_s, status.time_us)
        took, usual = now - asked_s, self._round_trip_s
        self._round_trip_s = took if usual is None else usual + _SMOOTHING * (took - usual)

    def deliver(self, messages: Sequence[tuple[Message, bytes]]) -> int:
        """Send messages and wait until the board has executed all of them.

        Args:
            messages: Type and payload of each.

        Returns:
            Code of the first :class:`hardware.board.Fault` that the board answered with, or 0.

        Raises:
            LinkError: Several tries brought no progress, or the board has restarted.
        """
        first, done, sent, tries, code, progress_s = self._next, 0, 0, 0, 0, self._clock.now()
        went_back = -1  # every frame behind a gap reports it; going back once is enough
        self._next = (first + len(messages)) % 256
        while done < len(messages):
            while sent < min(len(messages), done + WINDOW):
                self._write(encode(Frame((first + sent) % 256, *messages[sent])))
                sent += 1
            progressed = False
            for frame in self._answers(self._clock.now() + self.timeout_s):
                if frame.type not in (Message.ACK, Message.NAK, Message.STATUS):
                    continue
                ahead = (frame.sequence - first - done) % 256
                if frame.type == Message.ACK and len(frame.payload) == 1 and ahead <= WINDOW:
                    code = code or frame.payload[0]
                if 0 < ahead <= sent - done:
                    done, tries, progress_s, progressed = done + ahead, 0, self._clock.now(), True
                elif 2 * WINDOW < ahead < 256 - 8 * WINDOW:
                    raise LinkError("the board has restarted during the motion; is its supply strong enough?")
                if frame.type == Message.NAK and went_back != done:
                    went_back = sent = done
                    self.resent += 1
                    progressed = True
                if progressed:
                    break
            if not progressed:
                tries += 1
                if tries >= _TRIES and self._clock.now() >= progress_s + _PATIENCE_S:
                    raise LinkError(_SILENT)
                went_back, sent = -1, done
                self.resent += 1
                self._ping()  # short, so likely to arrive; its answer says which frame the board expects
        return code

    def _answers(self, deadline_s: float):
        """Yield frames as they come, until a deadline."""
        while True:
            while self._inbox:
                yield self._inbox.popleft()
            data = self._transport.read()
            if data:
                for frame in self._decoder.feed(data):
                    self._inbox.append(frame)
                    if frame.type == Message.STATUS:
                        self._sample(frame)
            elif self._clock.now() >= deadline_s:
                return
            elif self._clock.now() - self._written_s >= _HEARTBEAT_S:
                self._ping()
            else:
                self._clock.sleep(_POLL_S)
