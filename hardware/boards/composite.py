"""Several boards as one: they share a trajectory's joints and start at one moment of the host's clock.

In the calibration, each channel begins with the kind of its board: ``"meccanoid:5"``, ``"arduino:D8/3"``.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import TracebackType

import numpy as np

from hardware.board import Board, BoardStatus, Fault, Waypoint
from hardware.boards.servo_reading import ReportsServos, ServoReading
from hardware.clock import Clock
from hardware.errors import BoardError, HardwareError
from hardware.joint_map import JointMap


@dataclass
class _Part:
    """One board and the places of its joints among all."""

    board: Board
    latency_s: float
    places: tuple[int, ...] = ()

    def pick(self, raw: Sequence[int]) -> tuple[int, ...]:
        """Return the values of this board's joints."""
        return tuple(raw[j] for j in self.places)


class CompositeBoard:
    """Several boards that play together; a fault or a stop of one stops all.

    Args:
        boards: Boards by kind, as the calibration's channels name them; they share one clock.
        latency_s: Delay of a board's goals behind the clock, by kind [s]; it starts earlier by as much.

    Raises:
        BoardError: The clocks differ, or a latency names a board that is not among them.
    """

    def __init__(self, boards: Mapping[str, Board], latency_s: Mapping[str, float] | None = None) -> None:
        latency_s = latency_s or {}
        clocks = {id(board.clock): board.clock for board in boards.values()}
        if len(clocks) != 1:
            raise BoardError("boards that play together need one clock; give each the same one")
        unknown = sorted(latency_s.keys() - boards.keys())
        if unknown:
            raise BoardError(f"no board of kind {unknown[0]!r} here; there are {', '.join(boards)}")
        self.name = " + ".join(board.name for board in boards.values())
        self.clock: Clock = next(iter(clocks.values()))
        self.queue_depth = 0
        self.readback_s = max(board.readback_s for board in boards.values())
        self.poll_s = min(board.poll_s for board in boards.values())
        self._all = {kind: _Part(board, latency_s.get(kind, 0.0)) for kind, board in boards.items()}
        self._parts: list[_Part] = []  # those that have joints
        self._count = 0

    def configure(self, joints: JointMap) -> int:
        """See :class:`hardware.Board`."""
        split = [joint.channel.partition(":")[::2] for joint in joints.joints]
        for joint, (kind, _) in zip(joints.joints, split, strict=True):
            if kind not in self._all:
                known = " or ".join(f"{name}:" for name in self._all)
                raise BoardError(
                    f"{joint.name} needs a channel that begins with its board, {known}; got {joint.channel!r}"
                )
        self._parts, self._count, echoed = [], len(joints.joints), True
        for kind, part in self._all.items():
            part.places = tuple(j for j, (owner, _) in enumerate(split) if owner == kind)
            if part.places:
                rows = tuple(replace(joints.joints[j], channel=split[j][1]) for j in part.places)
                own = JointMap(joints.robot, rows)
                echoed &= part.board.configure(own) == own.crc
                self._parts.append(part)
        self.queue_depth = min(part.board.queue_depth for part in self._parts)
        return joints.crc if echoed else joints.crc ^ 0xFFFF

    def enable(self) -> None:
        """See :class:`hardware.Board`; all boards are enabled, or none."""
        try:
            for part in self._parts:
                part.board.enable()
        except HardwareError:
            self._everywhere("release")
            raise

    def send(self, waypoints: Sequence[Waypoint]) -> None:
        """See :class:`hardware.Board`."""
        for part in self._parts:
            part.board.send([replace(point, raw=part.pick(point.raw)) for point in waypoints])

    def start(self, delay_us: int) -> None:
        """See :class:`hardware.Board`."""
        slowest = max((part.board.start_lead_s for part in self._parts), default=0.0)
        lead = max(1e-6 * delay_us, slowest) + max(part.latency_s for part in self._parts)
        self.start_at(self.clock.now() + lead)

    def start_at(self, host_s: float) -> None:
        """See :class:`hardware.Board`; a board with a latency starts earlier by as much."""
        try:
            for part in self._parts:
                part.board.start_at(host_s - part.latency_s)
        except HardwareError:
            self._everywhere("stop")
            raise

    @property
    def start_lead_s(self) -> float:
        """See :class:`hardware.Board` [s]."""
        return max((part.board.start_lead_s + part.latency_s for part in self._parts), default=0.0)

    def status(self) -> BoardStatus:
        """See :class:`hardware.Board`; a fault of one board stops the others."""
        try:
            statuses = [part.board.status() for part in self._parts]
        except HardwareError:
            self._everywhere("stop")
            raise
        commanded, measured = np.full(self._count, math.nan), np.full(self._count, math.nan)
        for part, status in zip(self._parts, statuses, strict=True):
            commanded[list(part.places)], measured[list(part.places)] = status.commanded, status.measured
        faulty = [i for i, status in enumerate(statuses) if status.fault is not Fault.NONE]
        if faulty:
            self._everywhere("stop", but=self._parts[faulty[0]])
        first = faulty[0] if faulty else 0
        return BoardStatus(
            time_us=statuses[0].time_us,
            motion_us=min(status.motion_us for status in statuses),
            state=max(status.state for status in statuses),
            fault=statuses[first].fault,
            free=min(status.free for status in statuses),
            commanded=commanded,
            measured=measured,
            done=all(status.done for status in statuses),
            joint=self._parts[first].places[statuses[first].joint] if faulty else 0,
        )

    def readings(self) -> dict[int, ServoReading]:
        """See :class:`hardware.boards.servo_reading.ReportsServos`."""
        return {
            part.places[i]: reading
            for part in self._all.values()
            if part.places and isinstance(part.board, ReportsServos)
            for i, reading in part.board.readings().items()
        }

    def stop(self) -> None:
        """See :class:`hardware.Board`."""
        self._everywhere("stop", complain=True)

    def clear_fault(self) -> None:
        """See :class:`hardware.Board`."""
        self._everywhere("clear_fault", complain=True)

    @property
    def without_watchdog(self) -> tuple[str, ...]:
        """See :class:`hardware.Board`."""
        return tuple(name for part in self._all.values() for name in part.board.without_watchdog)

    def move(self, raw: Sequence[int]) -> None:
        """See :class:`hardware.Board`."""
        for part in self._parts:
            part.board.move(part.pick(raw))

    def limp(self, joints: Collection[int]) -> None:
        """See :class:`hardware.Board`."""
        for part in self._parts:
            part.board.limp([i for i, j in enumerate(part.places) if j in joints])

    def release(self) -> None:
        """See :class:`hardware.Board`."""
        self._everywhere("release", complain=True)

    def close(self) -> None:
        """See :class:`hardware.Board`."""
        for part in self._all.values():
            part.board.close()

    def __enter__(self) -> "CompositeBoard":
        """Return the board itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def _everywhere(self, action: str, but: _Part | None = None, complain: bool = False) -> None:
        """Call a method of every board, also after one has failed.

        Args:
            action: Name of the method.
            but: Board to leave out.
            complain: True to raise the first failure in the end.
        """
        first: HardwareError | None = None
        for part in self._parts:
            if part is but:
                continue
            try:
                getattr(part.board, action)()
            except HardwareError as error:
                first = first or error
        if first is not None and complain:
            raise first
