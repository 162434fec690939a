"""The one interface that every board speaks to the player."""

import enum
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, runtime_checkable

import numpy as np

from hardware.clock import Clock
from hardware.joint_map import JointMap


class State(enum.Enum):
    """What a board is doing."""

    DETACHED = "detached: no servo is driven"
    HOLDING = "holding still"
    PLAYING = "playing waypoints"


class Fault(enum.Enum):
    """Why a board stopped by itself; it holds, and plays nothing until it is configured again."""

    NONE = "none"
    LATE = "a waypoint arrived after its time"
    UNDERRUN = "the queue ran empty before the last waypoint"
    RANGE = "a waypoint lies outside a servo's range"
    RATE = "a waypoint asks a servo to move faster than its limit"
    ORDER = "waypoints came out of order or beyond the free places in the queue"
    SILENCE = "nothing was heard from the host for too long"
    CONFIG = "the configuration is incomplete, implausible or another one than asked for"
    STATE = "a command came that does not fit what the board was doing"
    SERVO = "a smart servo does not answer; is its plug in, and is the supply on?"
    LENGTH = "a message made no sense: it came garbled, or host and firmware are of different versions"

    @property
    def code(self) -> int:
        """Its number on the wire."""
        return list(Fault).index(self)


@dataclass(frozen=True)
class Waypoint:
    """A posture at a time.

    Attributes:
        index: Number in the motion, from 0 without gaps.
        time_us: Microseconds after the motion's start.
        raw: One raw value per servo.
        last: Whether the motion ends here.
    """

    index: int
    time_us: int
    raw: tuple[int, ...]
    last: bool = False


@dataclass(frozen=True)
class DeviceStatus:
    """What a board says of itself.

    Attributes:
        time_us: Its own clock.
        motion_us: Time since the motion's start; negative before.
        state: What it is doing.
        fault: Why it stopped, if it did.
        free: Free places in its queue.
        commanded: Raw value commanded to each servo, ``(joint,)``.
        measured: Raw value each servo reports, ``(joint,)``; nan where a servo reports nothing.
        done: Whether the last waypoint has been reached.
        joint: Place of the joint a fault is about, if it is about one.
        supply_v: Supply voltage; nan where the board does not measure it.
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
class Device(Protocol):
    """A board with servos. Usable in a ``with`` statement, which releases the servos and closes the link."""

    name: str
    clock: Clock
    queue_depth: int
    readback_s: float  # how old a measured value may be
    poll_s: float  # how often to ask for its status while something moves

    def configure(self, joints: JointMap) -> int:
        """Sends the calibration; returns the CRC the board computed of it."""
        ...

    def enable(self) -> None:
        """Drives the servos where they are."""
        ...

    def send(self, waypoints: Sequence[Waypoint]) -> None:
        """Queues waypoints; at most :attr:`DeviceStatus.free` of them."""
        ...

    def start(self, delay_us: int) -> None:
        """Starts the queued motion after a delay."""
        ...

    def start_at(self, host_s: float) -> None:
        """Starts the queued motion at a moment of the clock, which several boards can share."""
        ...

    @property
    def start_lead_s(self) -> float:
        """How long ahead of it a start must be told [s]."""
        ...

    def status(self) -> DeviceStatus:
        """Where things stand."""
        ...

    def stop(self) -> None:
        """Ends the motion now and holds; the queue is dropped."""
        ...

    def move(self, raw: Sequence[int]) -> None:
        """Goes to a posture as fast as the calibration's rates allow; for jogging, while holding."""
        ...

    def limp(self, joints: Collection[int]) -> None:
        """Lets these joints, by place, be moved by hand while the others hold; those left out hold where they are.

        Raises:
            BoardError: A joint among them has no read-back or cannot go limp.
        """
        ...

    def release(self) -> None:
        """Stops driving the servos."""
        ...

    def close(self) -> None:
        """Releases and ends the link; harmless when repeated."""
        ...

    def __enter__(self) -> "Device":
        """The device itself."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Closes."""
        ...
