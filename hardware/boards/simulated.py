"""The simulated board: the firmware's protocol to a model of it, in plain Python, without any package or hardware.

It lives by its clock and catches up at every call. With a :class:`hardware.clock.VirtualClock` a minute of motion takes
a fraction of a second, and every run gives the same log.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hardware import protocol
from hardware.board import Waypoint
from hardware.boards.firmware_board import FirmwareBoard
from hardware.channels import CHANNELS, family
from hardware.clock import Clock, VirtualClock
from hardware.errors import BoardError
from hardware.joint_map import JointMap
from hardware.simulation import MAX_PAYLOAD, BoardModel, ServoFrame
from hardware.transport import MemoryTransport

_SIGNED_ZERO = 0x8000  # for bus servos, whose positions are signed


class SimulatedBoard(FirmwareBoard):
    """A board with modeled servos: those that the calibration's channels name, or ideal ones if a joint has none.

    Args:
        like: Kind of board whose channels and numbers it takes, such as ``"arduino"``; empty for any that fits.
        clock: Clock that the board lives by; None for a :class:`hardware.clock.VirtualClock` of its own.
        pose: Joint angles that the servos stand at, ``(joint,)`` [rad]; None for their safe pose.
        stop_within_s: Silence within which the arm must be at rest [s].
        release_after_s: Silence after which the servos are released [s].
        stuck: Names of joints that do not move, as a fault to test with.
        unplugged_at_s: Time at which the link dies, as a fault to test with [s]; None for never.

    Attributes:
        model: Model of firmware and servos.
    """

    def __init__(
        self,
        like: str = "",
        *,
        clock: Clock | None = None,
        pose: Sequence[float] | None = None,
        stop_within_s: float = 0.3,
        release_after_s: float = 2.0,
        stuck: Sequence[str] = (),
        unplugged_at_s: float | None = None,
    ) -> None:
        clock = VirtualClock() if clock is None else clock
        self._like = like
        self._pose = None if pose is None else np.array(pose, float)
        self._stuck = tuple(stuck)
        self.model = BoardModel(self._stand, self._which_stuck)
        super().__init__(
            "simulated",
            MemoryTransport(self.model, clock, unplugged_at_s),
            clock,
            stop_within_s=stop_within_s,
            release_after_s=release_after_s,
            max_payload=MAX_PAYLOAD,
        )

    @property
    def log(self) -> deque[ServoFrame]:
        """Latest servo frames, of ten minutes at most."""
        return self.model.log

    def configure(self, joints: JointMap) -> int:
        """See :class:`hardware.Board`."""
        if self._pose is not None and self._pose.shape != (len(joints.names),):
            raise BoardError(
                f"the simulated servos stand at {len(self._pose)} angles; the calibration has {len(joints.names)}"
            )
        self._about = joints
        return super().configure(joints)

    def _assign(self, joints: JointMap) -> list[int]:
        """Return the Arduino's channels if the calibration names those, else ideal ones; refuse what no board takes."""
        joints.check(self._like)
        self._zero = 0
        if self._like == "arduino":
            return super()._assign(joints)
        first = {family(joint.channel): joint for joint in reversed(joints.joints)}
        if len(first) > 1:
            names = " and ".join(f"{joint.name} with {joint.channel!r}" for joint in list(first.values())[:2])
            raise BoardError(f"no board has all channels of the calibration: {names}; {CHANNELS}")
        if "an Arduino" in first:
            return super()._assign(joints)
        if any(joint.raw_low < 0 for joint in joints.joints):
            self._zero = _SIGNED_ZERO
        return list(range(protocol.IDEAL, protocol.IDEAL + len(joints.joints)))

    def send(self, waypoints: Sequence[Waypoint]) -> None:
        """See :class:`hardware.Board`."""
        super().send([replace(point, raw=tuple(raw + self._zero for raw in point.raw)) for point in waypoints])

    def move(self, raw: Sequence[int]) -> None:
        """See :class:`hardware.Board`."""
        super().move([int(value) + self._zero for value in raw])

    def _values(self, payload: bytes) -> tuple[np.ndarray, np.ndarray]:
        commanded, measured = super()._values(payload)
        return commanded - self._zero, measured - self._zero

    def _stand(self, count: int) -> list[float]:
        pose = self._about.column("safe") if self._pose is None else self._pose
        return (self._about.to_raw(pose) + self._zero).astype(float).tolist()

    def _which_stuck(self, count: int) -> list[bool]:
        return [name in self._stuck for name in self._about.names]
