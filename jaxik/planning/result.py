"""The result of a plan: the trajectory and its energy, or the reason why there is none."""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np

from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.errors import UnreachableError
from jaxik.planning.clearance_along import ClearanceAlong, clearance_along
from jaxik.planning.path_deviation import path_deviation
from jaxik.planning.status import PlanStatus
from jaxik.trajectories import Limits, Trajectory

if TYPE_CHECKING:
    from typing import Self


@dataclass(frozen=True)
class Plan:
    """The least-energy motion found for a path; a value of the host.

    Attributes:
        trajectory: The motion; None where there is none: a plan never jumps silently.
        swivel: Swivel at every waypoint, ``(K,)`` [rad].
        branch: Branch at every waypoint, ``(K,)``.
        energy: Energy of the motion, in the energy's unit; infinite without a motion.
        lower_bound: Certified lower bound on the energy of any motion along this path, or None. With start or end
            postures off the path it is a bound on the energy with the approaches, less ``approach_energy``.
        gap: Largest possible improvement by another motion, as a fraction of energy and approach energy; None without
            a certificate.
        status: Outcome.
        problems: Reasons for a failure, one sentence each, with waypoints, times and numbers.
        parts: Unweighted value of each energy term.
        energy_name: Name of the energy.
        energy_unit: Its unit.
        energy_before_refinement: Energy of the searched motion before the refinement.
        seconds: Wall time of each stage [s], compilation included.
        reachable_prefix: Number of first waypoints found to plan by themselves, ``path[:n]``; K in a plan that is OK.
        arm: The arm it was planned for.
        energy_fn: The energy that was minimized.
        approach_energy: Energy of the motions from the start posture and to the end posture.
    """

    trajectory: Trajectory | None
    swivel: np.ndarray
    branch: np.ndarray
    energy: float
    lower_bound: float | None
    gap: float | None
    status: PlanStatus
    problems: tuple[str, ...] = field(default=())
    parts: dict[str, float] = field(default_factory=dict)
    energy_name: str = ""
    energy_unit: str = ""
    energy_before_refinement: float = float("inf")
    seconds: dict[str, float] = field(default_factory=dict)
    reachable_prefix: int = 0
    arm: Arm | None = None
    energy_fn: Energy | None = None
    approach_energy: float = 0.0

    @property
    def ok(self) -> bool:
        """True if there is a trajectory to play."""
        return self.status == PlanStatus.OK

    @property
    def cost(self) -> float:
        """Energy of the motion and its approaches, which is what was minimized."""
        return self.energy + self.approach_energy

    def raise_if_invalid(self) -> "Self":
        """Return the plan itself, so that calls chain.

        Raises:
            UnreachableError: There is no motion; with the problems.
        """
        if not self.ok:
            raise UnreachableError("; ".join((f"no plan: {self.status.message}", *self.problems)))
        return self

    def path_deviation(self) -> np.ndarray:
        """Return the path deviation: the distance of the tool point from the straight line between two waypoints.

        Joints move linearly from posture to posture. The deviation falls with the square of the distance between
        waypoints: where it is too large, plan a path that has more of them.

        Returns:
            Largest distance in every step, ``(K - 1,)`` [m].

        Raises:
            UnreachableError: There is no motion.
        """
        trajectory = self.raise_if_invalid().trajectory
        if trajectory is None or self.arm is None:
            raise ValueError("only a plan made by jaxik.plan knows its arm")
        return path_deviation(self.arm, trajectory.q)

    def clearance(self) -> ClearanceAlong:
        """Return the distances from obstacles, and of the body from itself, at and between the waypoints.

        Between waypoints the joints move linearly, and so do moving obstacles. Where the bound is negative the motion
        may touch something there: plan with a larger ``clearance``, or a path that has more waypoints.

        Raises:
            UnreachableError: There is no motion.
            ValueError: The arm has no body.
        """
        trajectory = self.raise_if_invalid().trajectory
        if trajectory is None or self.arm is None or self.arm.surroundings is None:
            raise ValueError("only a plan made by jaxik.plan for an arm with a body (jaxik.with_body) has a clearance")
        return clearance_along(self.arm, np.asarray(trajectory.q))

    def retimed(self, *, acceleration: Limits, velocity: Limits | None = None) -> "Plan":
        """Return the planned postures in the shortest time from rest to rest within limits, and their energy.

        The elbow is not planned again: it was best for the times of the path. The certificate held for those, so the
        result has no bound.

        Args:
            acceleration: Largest joint accelerations, a number or ``(joint,)`` [rad/s²]; no preset knows its arm's.
            velocity: Largest joint speeds, likewise [rad/s]; None for the arm's limits.

        Returns:
            A plan with new times, energy and parts; see :meth:`jaxik.Trajectory.retimed`.

        Raises:
            UnreachableError: There is no motion to retime.
            ValueError: A limit is not positive, or not one per joint.
        """
        trajectory = self.raise_if_invalid().trajectory
        if trajectory is None or self.arm is None or self.energy_fn is None:
            raise ValueError("only a plan made by jaxik.plan can be retimed; use plan.trajectory.retimed")
        speeds = np.asarray(self.arm.velocity_limit, float) if velocity is None else velocity
        trajectory = trajectory.retimed(velocity=speeds, acceleration=acceleration)
        dtype = self.arm.axes.dtype
        motion = jnp.asarray(trajectory.q, dtype), jnp.asarray(trajectory.time, dtype)
        return replace(
            self,
            trajectory=trajectory,
            energy=float(self.energy_fn(self.arm, *motion)),
            parts={name: float(value) for name, value in self.energy_fn.parts(self.arm, *motion).items()},
            lower_bound=None,
            gap=None,
        )

    def report(self) -> str:
        """Return a summary of the plan in a few lines of text."""
        lines = [f"{self.status.name}: {self.status.message}", *(f"  {problem}" for problem in self.problems)]
        if self.trajectory is not None:
            lines.append(
                f"energy: {self.energy:.6g} {self.energy_unit} ({self.energy_name}); "
                f"{self.energy_before_refinement:.6g} before refinement"
            )
            lines += [f"  {name}: {value:.6g}" for name, value in self.parts.items()]
            if self.lower_bound is None:
                lines.append("lower bound: none, so no statement about how much better a motion could be")
            else:
                lines.append(
                    f"certificate: no motion costs less than {self.lower_bound:.6g}; gap {100 * (self.gap or 0):.2f} %"
                )
            if self.arm is not None:
                lines.append(f"between waypoints: at most {1e3 * self.path_deviation().max():.2g} mm of path deviation")
                lines += [] if self.arm.surroundings is None else [_clearance_text(self.clearance())]
            changes = np.flatnonzero(np.diff(self.branch))
            branches = "throughout" if not len(changes) else f"then {len(changes)} changes"
            circle = self.arm is None or self.arm.kinematic_class == "S-R-S"
            name = "swivel" if circle else "redundancy parameter"
            lines.append(f"branch {int(self.branch[0])} {branches}; {name} {_span(self.swivel)}")
        lines.append("time: " + ", ".join(f"{name} {value:.2f} s" for name, value in self.seconds.items()))
        return "\n".join(lines)


def _clearance_text(found: ClearanceAlong) -> str:
    least, between = 1e3 * found.at_waypoints.min(), 1e3 * found.between.min(initial=np.inf)
    if not np.isfinite(least):
        return "clearance: nothing to meet"
    return f"clearance: {least:.1f} mm at the waypoints ({found.closest}), at least {between:.1f} mm between them"


def listed(index: np.ndarray, time: np.ndarray) -> str:
    """Waypoints as text, runs drawn together: ``"3 (0.1 s), 7 to 9 (0.3 s to 0.4 s)"``; at most six runs."""
    runs = np.split(index, np.flatnonzero(np.diff(index) > 1) + 1)
    texts = [
        f"{r[0]} ({time[r[0]]:.3f} s)"
        if len(r) == 1
        else f"{r[0]} to {r[-1]} ({time[r[0]]:.3f} s to {time[r[-1]]:.3f} s)"
        for r in runs[:6]
    ]
    return ", ".join(texts) + (f" and {len(runs) - 6} more places" if len(runs) > 6 else "")


def _span(swivel: np.ndarray) -> str:
    low, high = np.degrees([swivel.min(), swivel.max()])
    return f"between {low:.1f}° and {high:.1f}°"
