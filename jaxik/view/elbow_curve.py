"""The elbow's curve over the redundancy parameter, sampled, and what blocks each part of it."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from jaxik.arm import Arm
from jaxik.ik import Status
from jaxik.kinematics import joint_positions
from jaxik.obstacles import World, clearance

SAMPLES = 121  # of the curve: steps of 3 degrees; finer ones are not visible
FREE, ITSELF, LIMITS, UNSOLVED = -1, -2, -3, -4
"""Numbers below zero of :attr:`ElbowCurve.blocker`; from zero on they are obstacles, spheres before half-spaces."""


@dataclass(frozen=True)
class ElbowCurve:
    """The elbow of one branch at every sampled parameter.

    Attributes:
        parameter: Redundancy parameters in ascending order, ``(N,)`` [rad].
        points: Elbow positions, ``(N, 3)`` [m].
        blocker: Blocker of each sample, ``(N,)``: the number of an obstacle, or FREE, ITSELF, LIMITS or UNSOLVED.
    """

    parameter: np.ndarray
    points: np.ndarray
    blocker: np.ndarray

    def where(self, chosen: np.ndarray) -> np.ndarray:
        """Return the pieces ``(M, 2, 3)`` [m] between neighboring samples that are both chosen ``(N,)``; M may be 0."""
        return np.stack([self.points[:-1], self.points[1:]], axis=1)[chosen[:-1] & chosen[1:]]

    def free_intervals(self) -> tuple[tuple[float, float], ...]:
        """Return the intervals of free samples [rad]."""
        return tuple((first, last) for code, first, last in self.runs() if code == FREE)

    def runs(self) -> list[tuple[int, float, float]]:
        """Return runs of samples with one blocker: its number, and the first and last parameter [rad]."""
        ends = np.flatnonzero(np.diff(self.blocker)) + 1
        pieces = zip(np.split(self.parameter, ends), np.split(self.blocker, ends), strict=True)
        return [(int(codes[0]), float(at[0]), float(at[-1])) for at, codes in pieces]

    def blocked_by(self, world: World | None = None) -> list[str]:
        """Return the obstacles of a world that block a part of the curve, with the parameters, as text."""
        runs: dict[int, list[str]] = {}
        for code, first, last in self.runs():
            if code >= 0 or code == ITSELF:
                runs.setdefault(code, []).append(f"{np.degrees(first):.0f}° to {np.degrees(last):.0f}°")
        return [
            f"{'the arm itself' if code == ITSELF else obstacle_name(code, world)} ({', '.join(parts)})"
            for code, parts in sorted(runs.items())
        ]


def obstacle_name(number: int, world: World | None) -> str:
    """Return the name of an obstacle by its number among spheres and half-spaces, as :class:`jaxik.Clearance` says."""
    spheres = number + 1 if world is None else world.radii.shape[-1]
    return f"obstacle {number}" if number < spheres else f"half-space {number - spheres}"


def parameter_range(arm: Arm) -> tuple[float, float]:
    """Return the range of the redundancy parameter [rad]: a turn, or what the limits of an outer joint leave of it."""
    joint = getattr(arm, "outer_joint", None)
    if joint is None:
        return -np.pi, np.pi
    return max(-np.pi, float(arm.lower[joint])), min(np.pi, float(arm.upper[joint]))


def sampled_elbow(arm: Arm, world: World | None, q: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Return elbow, counterpart of the closest pair and its distance of postures ``(N, joint)``, for ``jit``."""
    elbow = joint_positions(arm, q)[:, 1]
    if arm.surroundings is None:
        return elbow, jnp.zeros(len(q), jnp.int32), jnp.zeros(len(q), q.dtype)
    found = clearance(arm, q, world)
    return elbow, found.other, found.distance


def blockers(arm: Arm, world: World | None, status: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return what blocks samples, from their statuses ``(N,)`` and the counterparts of their closest pairs ``(N,)``."""
    code = np.where(status <= Status.NEAR_SINGULAR, FREE, np.where(status < Status.ORIENTATION, LIMITS, UNSOLVED))
    if arm.surroundings is None:
        return code
    meets, item = status == Status.COLLISION, other - len(arm.surroundings.body.link)
    if world is not None:  # half-spaces follow the padding of the spheres
        item = np.where(item >= (padded := world.padded().radii.shape[-1]), item - padded + world.radii.shape[-1], item)
    return np.where(meets, np.where(item < 0, ITSELF, item), code)
