"""ssik: analytical solver in C++ behind Python; the prebuilt arm, as its manual advises (a URDF is slower)."""

from typing import Any

import numpy as np
import ssik
from ssik.prebuilt.kuka import iiwa14_ik

from benchmarks.peers.peer import Peer, padded
from benchmarks.shared_arm import SharedArm


class All(Peer):
    """Everything that it samples within limits."""

    name, package = "ssik solve", "ssik"
    returns = "up to 128 solutions within limits: 16 sampled swivels x 8 branches"
    chunk = 250
    batched = False
    seeded = False
    options: dict[str, Any] = {}  # noqa: RUF012

    def __init__(self, shared: SharedArm) -> None:
        super().__init__(shared)
        q = np.linspace(-1, 1, 7)
        assert np.allclose(iiwa14_ik.fk(q), shared.forward(q[None])[0], atol=1e-12), "another arm of the same name"

    def solve(self, poses: np.ndarray, seeds: np.ndarray) -> Any:
        if self.seeded:
            return [iiwa14_ik.solve(pose, q_seed=seed, **self.options) for pose, seed in zip(poses, seeds, strict=True)]
        return [iiwa14_ik.solve(pose, **self.options) for pose in poses]

    def answers(self, result: Any) -> tuple[np.ndarray, np.ndarray]:
        return padded([np.array([s.q for s in solutions]) for solutions in result], 7)


class AnyLimits(All):
    """Without limits."""

    name = "ssik, limits ignored"
    returns = "128 solutions: 16 sampled swivels x 8 branches"
    keeps_limits = False
    options = {"respect_limits": False}  # noqa: RUF012


class First(All):
    """One solution."""

    name = "ssik, max_solutions=1"
    returns = "one solution within limits"
    options = {"max_solutions": 1}  # noqa: RUF012


class Seeded(All):
    """The solution nearest to a posture, among the sampled ones."""

    name = "ssik, nearest to a seed"
    returns = "the sampled solution within limits nearest to a given posture"
    seeded = True
    options = {"max_solutions": 1}  # noqa: RUF012


class Refined(All):
    """With its refinement."""

    name = "ssik, refined"
    returns = "as solve, refined by Levenberg-Marquardt"
    chunk = 50
    options = {"allow_refinement": True}  # noqa: RUF012


class Arcs(Peer):
    """Feasible arcs of its self-motion charts, found by a refined grid and bisection."""

    name, package = "ssik in_limits", "ssik"
    returns = "feasible swivels of every chart, by grid and bisection"
    chunk = 10

    def __init__(self, shared: SharedArm) -> None:
        super().__init__(shared)
        self.arm = ssik.Manipulator.from_prebuilt("iiwa14")

    def arcs(self, poses: np.ndarray) -> Any:
        return [[chart.in_limits() for chart in self.arm.self_motion(pose).charts] for pose in poses]

    def widths(self, result: Any) -> np.ndarray:
        widths = np.zeros((len(result), 8))
        for row, charts in zip(widths, result, strict=True):
            row[: len(charts)] = [sum(end - start for start, end in arcs) for arcs in charts]
        return np.sort(widths, axis=-1)


class SolvePath(Arcs):
    """Tracks of the branch of the start posture."""

    name = "ssik solve_path"
    returns = "the branch of the start, continued"

    def follow(self, poses: np.ndarray, time: np.ndarray, start: np.ndarray) -> np.ndarray:
        track = self.arm.solve_path(poses, q0=start)
        if track.stopped_at is not None:
            raise RuntimeError(f"stopped at pose {track.stopped_at}")
        return np.array([step.q for step in next(iter(track.tracks.values()))])


class Tracker(Arcs):
    """Its streaming solver."""

    name = "ssik Tracker"
    returns = "next posture per target"

    def follow(self, poses: np.ndarray, time: np.ndarray, start: np.ndarray) -> np.ndarray:
        tracker = self.arm.tracker(start, max_joint_speed=self.shared.speed, t0=float(time[0]) - 1.0)
        return np.array([tracker.update(pose, float(t)).q for pose, t in zip(poses, time, strict=True)])


IK = (All, AnyLimits, First, Seeded, Refined)
ARCS = (Arcs,)
PATHS = (SolvePath, Tracker)
