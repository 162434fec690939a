"""The interface between the player and every board: what a board does, and the status it reports."""

import enum
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, runtime_checkable

import numpy as np

from hardware.clock import Clock
from hardware.joint_map import JointMap


class State(enum.IntEnum):
    """Activity of a board; the numbers are the firmware's."""

    DETACHED = 0
    HOLDING = 1
    PLAYING = 2

    @property
    def message(self) -> str:
        """The activity in words."""
        return _STATES[self]


_STATES = {
    State.DETACHED: "detached: no servo is driven",
    State.HOLDING: "holding still",
    State.PLAYING: "playing waypoints",
}


class Fault(enum.IntEnum):
    """Reason why a board stopped by itself; the numbers are the firmware's.

    A board with a fault holds, and plays nothing until it is configured again or the fault is cleared.
    """

    NONE = 0
    LATE = 1
    UNDERRUN = 2
    RANGE = 3
    RATE = 4
    ORDER = 5
    SILENCE = 6
    CONFIG = 7
    STATE = 8
    SERVO = 9
    LENGTH = 10

    @property
    def message(self) -> str:
        """One clause: what happened and, where it helps, what to check."""
        return _FAULTS[self]

    def describe(self, joint: int, names: Sequence[str]) -> str:
        """Return the message, with the joint's name for faults about one joint.

        Args:
            joint: Place of the joint that the board reported with the fault.
            names: Joint names in order.
        """
        about = self in (Fault.RANGE, Fault.RATE, Fault.SERVO) and joint < len(names)
        return f"{names[joint]}: {self.message}" if about else self.message


_FAULTS = {
    Fault.NONE: "none",
    Fault.LATE: "a waypoint arrived after its time",
    Fault.UNDERRUN: "the queue ran empty before the last waypoint",
    Fault.RANGE: "a waypoint lies outside a servo's range",
    Fault.RATE: "a waypoint asks a servo to move faster than its limit",
    Fault.ORDER: "waypoints came out of order or beyond the free places in the queue",
    Fault.SILENCE: "nothing was heard from the host for too long",
    Fault.CONFIG: "the configuration is incomplete, implausible or another one than asked for",
    Fault.STATE: "a command came that does not fit what the board was doing",
    Fault.SERVO: "a smart servo does not answer; is its plug in, and is the supply on?",
    Fault.LENGTH: "a message made no sense: it came garbled, or host and firmware are of different versions",
}


@dataclass(frozen=True)
class Waypoint:
    """A posture at a time, as a board queues it.

    Attributes:
        index: Number of the waypoint in its motion, from 0 without gaps.
        time_us: Time since the motion's start [µs].
        raw: One raw value per servo.
        last: True for the waypoint that ends the motion.
    """

    index: int
    time_us: int
    raw: tuple[int, ...]
    last: bool = False


@dataclass(frozen=True)
class BoardStatus:
    """Status of a board.

    Attributes:
        time_us: The board's own clock [µs].
        motion_us: Time since the motion's start [µs], negative before; it may wrap as a 32-bit number does.
        state: Present activity.
        fault: Reason of the last stop by itself; ``Fault.NONE`` if there was none.
        free: Free places in the waypoint queue.
        commanded: Raw value commanded to each servo, ``(joint,)``.
        measured: Raw value that each servo reports, ``(joint,)``; nan for a servo that reports none.
        done: True once the last waypoint has been reached.
        joint: Place of the joint that the fault is about, for faults about one joint.
        supply_v: Supply voltage [V]; nan for a board that does not measure it.
    """

    time_us: int
    motion_us: int
    state: State
    fault: Fault
    free: int
    commanded: np.ndarray
    measured: np.ndarray
    done: bool
    joint: int = 0
    supply_v: float = float("nan")


@runtime_checkable
class Board(Protocol):
    """A servo board. As a context manager it releases the servos and closes the link at the end.

    Attributes:
        name: Name in reports and errors, usually its address.
        clock: Clock that the board and its host share.
        queue_depth: Waypoints that fit into the queue; known once configured.
        readback_s: Greatest age of a measured value [s].
        poll_s: Period at which to ask for the status while something moves [s].
        without_watchdog: Names of the boards, here or among those joined here, whose servos stay driven if the computer
            or the program dies.
    """

    name: str
    clock: Clock
    queue_depth: int
    readback_s: float
    poll_s: float

    @property
    def without_watchdog(self) -> tuple[str, ...]:
        """See the attributes."""
        ...

    def configure(self, joints: JointMap) -> int:
        """Send the calibration, which also clears a fault.

        Args:
            joints: Joints in playing order, with their servos.

        Returns:
            The calibration's CRC as the board holds it, to be compared with :attr:`JointMap.crc`.

        Raises:
            BoardError: A channel does not exist on this board, or the board refuses the calibration.
        """
        ...

    def enable(self) -> None:
        """Drive the servos, each where it is.

        Raises:
            BoardError: The board is not configured, has a fault, or misses a servo.
        """
        ...

    def send(self, waypoints: Sequence[Waypoint]) -> None:
        """Queue waypoints.

        Args:
            waypoints: The next ones in order, at most :attr:`BoardStatus.free`; more are ``Fault.ORDER``.
        """
        ...

    def start(self, delay_us: int) -> None:
        """Start the queued motion after a delay.

        Args:
            delay_us: Time until the motion's zero [µs]; a slow link extends it.

        Raises:
            BoardError: Nothing is queued, the board is not holding, or it has a fault.
        """
        ...

    def start_at(self, host_s: float) -> None:
        """Start the queued motion at a moment of :attr:`clock`, which several boards can share.

        Args:
            host_s: Host time of the motion's zero [s].

        Raises:
            BoardError: As for :meth:`start`.
        """
        ...

    @property
    def start_lead_s(self) -> float:
        """Least time between a start command and the motion's zero [s]."""
        ...

    def status(self) -> BoardStatus:
        """Return the present status.

        Raises:
            LinkError: The board stopped answering or has restarted.
        """
        ...

    def stop(self) -> None:
        """End the motion at once, hold, and drop the queue."""
        ...

    def clear_fault(self) -> None:
        """Forget a fault and drop the queue, as before lowering the arm; the servos hold on, and may move again."""
        ...

    def move(self, raw: Sequence[int]) -> None:
        """Go to a posture as fast as the calibration's rates allow, for jogging.

        Args:
            raw: One raw value per servo.

        Raises:
            BoardError: The board is not holding, has a fault, or a value is out of range.
        """
        ...

    def limp(self, joints: Collection[int]) -> None:
        """Let some joints be moved by hand while the others hold.

        Args:
            joints: Places of the joints to go limp; all others hold where they are.

        Raises:
            BoardError: A joint among them has no read-back or cannot go limp.
        """
        ...

    def release(self) -> None:
        """Stop driving the servos."""
        ...

    def close(self) -> None:
        """Release the servos and close the link; a second call does nothing."""
        ...

    def __enter__(self) -> "Board":
        """Return the board itself."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        ...
