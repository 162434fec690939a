"""jaxik itself."""

from typing import Any

import jax
import numpy as np

import jaxik
from benchmarks.peers.peer import Peer


def _target(poses: np.ndarray) -> jaxik.Pose:
    return jaxik.Pose(jax.numpy.asarray(poses[:, :3, 3]), jax.numpy.asarray(poses[:, :3, :3]))


class SolveIk(Peer):
    """All eight branches at a swivel."""

    name, package = "jaxik solve_ik", "jaxik"
    returns = "all 8 branches at a swivel, status and residual of each"
    keeps_limits = False

    def solve(self, poses: np.ndarray, seeds: np.ndarray) -> Any:
        return jax.block_until_ready(jaxik.solve_ik(self.shared.arm, _target(poses), np.zeros(len(poses))))

    def answers(self, result: Any) -> tuple[np.ndarray, np.ndarray]:
        reached = {jaxik.Status.OK, jaxik.Status.NEAR_SINGULAR, jaxik.Status.LIMITS}
        return np.asarray(result.q), np.isin(np.asarray(result.status), [int(s) for s in reached])


class Nearest(Peer):
    """The nearest feasible posture."""

    name, package = "jaxik solve_nearest", "jaxik"
    returns = "the posture within limits nearest to a given one, over all branches and swivels; status"

    def solve(self, poses: np.ndarray, seeds: np.ndarray) -> Any:
        return jax.block_until_ready(jaxik.solve_nearest(self.shared.arm, _target(poses), seeds))

    def answers(self, result: Any) -> tuple[np.ndarray, np.ndarray]:
        return np.asarray(result.q)[:, None], np.asarray(result.ok)[:, None]


class Arcs(Peer):
    """Feasible arcs, exact."""

    name, package = "jaxik swivel_arcs", "jaxik"
    returns = "all feasible swivels of all 8 branches, closed form"

    def arcs(self, poses: np.ndarray) -> Any:
        return jax.block_until_ready(jaxik.swivel_arcs(self.shared.arm, _target(poses)))

    def widths(self, result: Any) -> np.ndarray:
        return np.sort(np.asarray(result.width), axis=-1)


class PlanFromStart(Peer):
    """The planner, from the given start posture, with its certificate."""

    name, package = "jaxik plan, same start", "jaxik"
    returns = "motion of least energy with a certified bound"
    from_start = True
    gap: float | None = 0.01

    def follow(self, poses: np.ndarray, time: np.ndarray, start: np.ndarray) -> np.ndarray:
        path = jaxik.Path(_target(poses), time)
        plan = jaxik.plan(self.shared.arm, path, start=start if self.from_start else None, gap=self.gap)
        if plan.trajectory is None:
            raise RuntimeError(plan.problems[0] if plan.problems else plan.status.name)
        return np.asarray(plan.trajectory.q)


class PlanFree(PlanFromStart):
    """The planner with a free start."""

    name = "jaxik plan, free start"
    from_start = False


class PlanUncertified(PlanFromStart):
    """The planner without a certificate."""

    name = "jaxik plan, no certificate"
    returns = "motion of least energy found"
    gap = None


class Follow(Peer):
    """The control-loop function, step by step under a scan."""

    name, package = "jaxik follow", "jaxik"
    returns = "next posture per target"

    def follow(self, poses: np.ndarray, time: np.ndarray, start: np.ndarray) -> np.ndarray:
        return np.asarray(_followed(self.shared.arm, _target(poses), np.diff(time, prepend=time[0] - 1.0), start))


@jax.jit
def _followed(arm: jaxik.Arm, target: jaxik.Pose, dt: np.ndarray, start: np.ndarray) -> jax.Array:
    def step(q, now):
        q = jaxik.follow(arm, now[0], q, now[1]).q
        return q, q

    return jax.lax.scan(step, start, (target, dt))[1]


IK = (SolveIk, Nearest)
ARCS = (Arcs,)
PATHS = (PlanFree, PlanFromStart, PlanUncertified, Follow)
