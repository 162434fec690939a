"""Many paths at once: what the fast planner, and the policies that correct it, work on.

Arrays end in ``(K, B)``, waypoints and paths, so that one pass of vector code serves all waypoints of all paths.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.arm import Arm
from jaxik.numerics import fused_separately, principal, shortest
from jaxik.redundancy import BranchMotion, SelfMotion, self_motion
from jaxik.targets import Target

EXCESS = 20.0  # relative cost of one radian of mean excess over a joint's range: 1 % for 0.03 degrees


class StartPostures(NamedTuple):
    """Postures that the arms come from.

    Attributes:
        q: Joint angles, ``(joint, B)`` [rad].
        rate: One over the time for the approach to the first waypoint, ``(B,)`` [1/s]; zero where there is none.
    """

    q: Array
    rate: Array


class PathBatch(NamedTuple):
    """B paths of K waypoints and the joint motion to minimize along them.

    Attributes:
        motion: Self-motion of the targets, rows ``(K, B)``.
        time: Times, ``(K, B)`` [s].
        weights: Weights of the joints' squared motion, ``(joint,)``.
        start: Postures that the arms come from.
    """

    motion: SelfMotion
    time: Array
    weights: Array
    start: StartPostures

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.motion.arm

    def waypoints(self, index: np.ndarray) -> "PathBatch":
        """Pick waypoints, the first included."""
        return self._replace(motion=self.motion.at(index, slice(None)), time=self.time[index])

    def path(self, row: Array) -> "PathBatch":
        """Pick one path, as a batch of one."""
        start = StartPostures(self.start.q[:, row, None], self.start.rate[row, None])
        return self._replace(motion=self.motion.at(row[None]), time=self.time[:, row, None], start=start)

    def approach(self, q: Array) -> Array:
        """Joint motion from the start postures to joint angles ``(joint, K, B)``: ``(joint, B)`` [rad]."""
        return shortest(q[:, 0] - self.start.q, self.arm.turning[:, None])

    def energy(self, q: Array) -> Array:
        """Σ w Δq² / dt of joint angles ``(joint, K, B)``, approaches included: ``(B,)``."""
        rate = 1.0 / jnp.diff(self.time, axis=0)
        moved = jnp.sum(self.weights[:, None] * jnp.sum(steps(q) ** 2 * rate, axis=1), axis=0)
        approach = jnp.sum(self.weights[:, None] * self.approach(q) ** 2, axis=0) * self.start.rate
        return moved + approach

    def too_fast(self, q: Array) -> Array:
        """True where a joint exceeds its speed limit, or a time is nan, ``(B,)``."""
        limit = self.arm.velocity_limit[:, None, None] * jnp.diff(self.time, axis=0)
        step = shortest(jnp.diff(q, axis=1), self.arm.turning[:, None, None])
        return ~jnp.all(jnp.abs(step) <= limit, axis=(0, 1))

    def cost(self, motion: BranchMotion, q: Array, swivel: Array) -> Array:
        """Energy, raised by the mean excess over limits and keep-out, ``(B,)``."""
        return _cost(self, motion, q, swivel)


class SwivelPath(NamedTuple):
    """A way to move the elbows along the paths.

    Attributes:
        swivel: Swivels, ``(K, B)`` [rad].
        branch: Branches, ``(K, B)``.
    """

    swivel: Array
    branch: Array


Correction = Callable[..., Array]
"""Function of a :class:`PathBatch` and its :class:`Candidate` that returns better swivels, ``(K, B)`` [rad]."""


def path_batch(arm: Arm, target: Target, time: Array, weights: Array, start: StartPostures) -> PathBatch:
    """Return B paths of K targets and times, leading axes ``(B, K)``, in the arm's dtype."""
    waypoints_first = jax.tree.map(lambda x: jnp.swapaxes(x, 0, 1), target)
    return PathBatch(self_motion(arm, waypoints_first), time.T, weights, start)


def no_start(arm: Arm, count: int) -> StartPostures:
    """Return the start postures of arms that come from nowhere."""
    return StartPostures(jnp.zeros((arm.n_joints, count), arm.axes.dtype), jnp.zeros(count, arm.axes.dtype))


def steps(q: Array) -> Array:
    """Joint motion of every step, the shorter way round, ``(joint, K - 1, B)`` [rad].

    A joint that cannot turn round would have to leave its range to take that way, which raises the cost.
    """
    return principal(jnp.diff(q, axis=1))


@fused_separately
def _cost(batch: PathBatch, motion: BranchMotion, q: Array, swivel: Array) -> Array:
    return batch.energy(q) * (1.0 + EXCESS * jnp.mean(motion.excess(q, swivel), axis=0))
