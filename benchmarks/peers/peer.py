"""The interface of a peer."""

from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any, ClassVar

import numpy as np

from benchmarks.shared_arm import SharedArm

TOLERANCE = 1e-6  # asked of every iterative solver, [m] and [rad]


@dataclass(frozen=True)
class PeerError:
    """Why a peer has no figures: its name, the step that failed, and the message."""

    name: str
    step: str
    message: str


class Peer:
    """A solver with the arm it was built for.

    Built from the shared arm; :meth:`solve` is what is timed, :meth:`answers` unpacks its result and is not. A peer of
    ``ARCS`` has :meth:`arcs`, one of ``PATHS`` has :meth:`follow` in its place.

    Attributes:
        name: Name in tables.
        package: Distribution whose version is recorded.
        returns: What a call returns, in words.
        own_arm: Name of another arm, for a library that cannot solve the shared one; it then has ``poses`` and
            ``forward`` of its own.
        keeps_limits: Whether its answers are meant to be within the limits.
        chunk: Poses per timed call; None for all of them, in one call.
        batched: Whether a call solves its poses together; otherwise its result is a list, one entry per pose.
    """

    name: ClassVar[str]
    package: ClassVar[str]
    returns: ClassVar[str] = ""
    own_arm: ClassVar[str | None] = None
    keeps_limits: ClassVar[bool] = True
    chunk: ClassVar[int | None] = None
    batched: ClassVar[bool] = True

    def __init__(self, shared: SharedArm) -> None:
        self.shared = shared

    @classmethod
    def version(cls) -> str:
        """Return the version of the package."""
        try:
            return version(cls.package)
        except PackageNotFoundError:
            return "not installed"

    def solve(self, poses: np.ndarray, seeds: np.ndarray) -> Any:
        """Solve poses ``(n, 4, 4)``; seeds ``(n, joint)`` are random postures within limits."""
        raise NotImplementedError

    def answers(self, result: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return joint angles ``(n, m, joint)`` and which of them are claimed as solutions ``(n, m)``."""
        raise NotImplementedError

    def poses(self, kind: str, count: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Return poses ``(count, 4, 4)`` and postures that reach them, for a peer with its own arm."""
        raise NotImplementedError

    def forward(self, q: np.ndarray) -> np.ndarray:
        """Return tool poses ``(n, 4, 4)``, for a peer with its own arm."""
        return self.shared.forward(q)

    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Return lower and upper joint limits."""
        return self.shared.lower, self.shared.upper

    def arcs(self, poses: np.ndarray) -> Any:
        """Return feasible swivels of poses, in the peer's own form."""
        raise NotImplementedError

    def widths(self, result: Any) -> np.ndarray:
        """Return the total feasible swivel of every branch, ascending, ``(n, 8)`` [rad]."""
        raise NotImplementedError

    def follow(self, poses: np.ndarray, time: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Return joint angles ``(k, joint)`` along poses ``(k, 4, 4)``, from a start posture on the first one."""
        raise NotImplementedError


class Iterative(Peer):
    """A solver that descends from a posture; restarted at random postures where it does not arrive."""

    returns = "one solution within limits"
    batched = False
    restarts = 3

    def __init__(self, shared: SharedArm) -> None:
        super().__init__(shared)
        self.rng = np.random.default_rng(0)

    def descend(self, pose: np.ndarray, q: np.ndarray) -> np.ndarray | None:
        """Return the posture on a pose that the steps from q end in, or None."""
        raise NotImplementedError

    def solve(self, poses: np.ndarray, seeds: np.ndarray) -> Any:
        return [self._restarted(pose, seed) for pose, seed in zip(poses, seeds, strict=True)]

    def _restarted(self, pose: np.ndarray, q: np.ndarray) -> np.ndarray:
        for _ in range(self.restarts):
            found = self.descend(pose, q)
            if found is not None:
                return found[None]
            q = self.rng.uniform(self.shared.lower, self.shared.upper)
        return np.empty((0, len(q)))

    def answers(self, result: Any) -> tuple[np.ndarray, np.ndarray]:
        return padded(result, len(self.shared.lower))

    def follow(self, poses: np.ndarray, time: np.ndarray, start: np.ndarray) -> np.ndarray:
        q = [start]
        for k, pose in enumerate(poses):
            found = self.descend(pose, q[-1])
            if found is None:
                raise RuntimeError(f"no posture within limits found at pose {k}")
            q.append(found)
        return np.array(q[1:])


def padded(lists: list[np.ndarray], joints: int) -> tuple[np.ndarray, np.ndarray]:
    """Return lists of postures as one array ``(n, m, joint)`` and which rows are real ``(n, m)``."""
    most = max(1, max((len(rows) for rows in lists), default=1))
    q, real = np.zeros((len(lists), most, joints)), np.zeros((len(lists), most), bool)
    for i, rows in enumerate(lists):
        if len(rows):
            q[i, : len(rows)], real[i, : len(rows)] = rows, True
    return q, real
