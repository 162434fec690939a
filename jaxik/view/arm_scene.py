"""The scene of an arm at a target: everything the viewer draws, computed from the state alone.

One compiled call solves all branches at every swivel of a sampled turn, and finds their feasible arcs; the rest is
computed on the host. The swivel is the arm's redundancy parameter: the angle of an outer joint if it has one.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np

from jaxik.arm import Arm, ArmModel, presets
from jaxik.ik import Status, solve_ik
from jaxik.obstacles import World
from jaxik.paper import EXAMPLE, solve_example
from jaxik.redundancy import has_swivel, swivel_arcs, swivel_of
from jaxik.targets import Pointing, Pose, Target
from jaxik.view.elbow_curve import (
    FREE,
    SAMPLES,
    UNSOLVED,
    ElbowCurve,
    blockers,
    obstacle_name,
    parameter_range,
    sampled_elbow,
)
from jaxik.view.skeleton import Skeleton, circle_through

_STEP = np.radians(3.0)  # of a drawn arc; finer steps are not visible
_START = (0.55, 0.65, 0.5, 0.25, 0.5, 0.7, 0.5)  # fraction of each joint's range: bent elbow, far from the limits


@dataclass(frozen=True)
class ArmState:
    """The user's input.

    Attributes:
        model: The arm.
        position: Position of the handle, ``(3,)`` [m].
        rotation: Rotation of the handle, ``(3, 3)``; arms with six joints use its z axis only.
        swivel: Swivel, or angle of the outer joint [rad].
        branch: Branch, 0 to 7; a slot up to 15 for arms that are solved by refinement.
        world: Obstacles about an arm with a body, or None.
    """

    model: ArmModel
    position: np.ndarray
    rotation: np.ndarray
    swivel: float
    branch: int
    world: World | None = None

    @classmethod
    def start(cls, model: ArmModel, world: World | None = None) -> "ArmState":
        """Return the initial state: the paper's example for the paper's arm, else a posture with a bent elbow."""
        if model.name == presets.paper_arm().name:
            q, swivel, branch = np.asarray(solve_example().q[0], float), EXAMPLE.swivel, 0
        else:
            lower, upper = (np.clip(np.asarray(x, float), -np.pi, np.pi) for x in (model.arm.lower, model.arm.upper))
            q = lower + np.array(_START[: len(lower)]) * (upper - lower)
            swivel, branch = (float(x) for x in swivel_of(model.arm, jnp.asarray(q, float)))
        skeleton = Skeleton.of(model.arm)
        turns, _ = skeleton.motions(q)
        rotation = turns[-1] @ np.asarray(model.arm.tool_rotation, float)
        state = cls(model, skeleton.posture(q)[3], rotation, float(swivel), int(branch), world)
        if model.arm.closed_form:
            return state
        # Two solutions of such an arm may have the bits of one branch: take the slot of this posture.
        scene = arm_scene(state)
        off = np.where(scene.status <= Status.NEAR_SINGULAR, np.abs(scene.q - q).max(-1), np.inf)
        return replace(state, branch=int(np.argmin(off)))

    @property
    def parameter_name(self) -> str:
        """Name of the redundancy parameter: "swivel", or that of the outer joint."""
        joint = getattr(self.model.arm, "outer_joint", None)
        return "swivel" if joint is None else self.model.joint_names[joint]

    @property
    def target(self) -> Target:
        """Target of the arm: a pose, or a pointing for arms with six joints."""
        position, rotation = jnp.asarray(self.position, float), jnp.asarray(self.rotation, float)
        if self.model.arm.n_joints < 7:
            return Pointing(position, rotation[:, 2])
        return Pose(position, rotation)


@dataclass(frozen=True)
class ArmScene:
    """Everything that is drawn.

    Attributes:
        state: The input it is computed from.
        q: Joint angles of every branch, ``(8, joint)`` [rad]; 16 slots for arms that are solved by refinement.
        status: :class:`jaxik.Status` of every branch, ``(8,)`` or ``(16,)``.
        arcs: Feasible swivels of every branch, ``(start, end)`` pairs [rad]; sampled if the arm has no closed form.
        points: Shoulder, elbow, wrist and tool in the selected branch, ``(4, 3)`` [m].
        skeleton: Skeleton of the arm.
        curve: The elbow at every sampled swivel in the selected branch, and what blocks it.
        blocker: Blocker of the posture that is shown, as in :class:`ElbowCurve`.
        overlap: Depth to which it meets this obstacle [m].
    """

    state: ArmState
    q: np.ndarray
    status: np.ndarray
    arcs: tuple[tuple[tuple[float, float], ...], ...]
    points: np.ndarray
    skeleton: Skeleton
    curve: ElbowCurve
    blocker: int
    overlap: float

    @property
    def has_circle(self) -> bool:
        """True for S-R-S arms, whose elbow moves on a circle."""
        return has_swivel(self.state.model.arm)

    @property
    def joints(self) -> np.ndarray:
        """Joint angles of the selected branch, ``(joint,)`` [rad]."""
        return self.q[self.state.branch]

    @property
    def status_here(self) -> Status:
        """Status of the selected branch."""
        return Status(int(self.status[self.state.branch]))

    @cached_property
    def feasible_branches(self) -> tuple[int, ...]:
        """Branches that are feasible at this swivel."""
        return tuple(np.flatnonzero(self.status <= Status.NEAR_SINGULAR).tolist())

    @property
    def spheres(self) -> tuple[tuple[np.ndarray, float], tuple[np.ndarray, float]]:
        """Center and radius of the paper's two spheres, about shoulder and wrist [m]; the elbow lies on both."""
        shoulder, elbow, wrist, _ = self.points
        return (shoulder, float(np.linalg.norm(elbow - shoulder))), (wrist, float(np.linalg.norm(elbow - wrist)))

    def on_circle(self, swivels: np.ndarray) -> np.ndarray:
        """Return the elbow positions ``(N, 3)`` [m] at swivels ``(N,)`` [rad]."""
        turns = self.state.model.arm.reference.sense * (swivels - self.state.swivel)
        shoulder, elbow, wrist = self.points[:3]
        return circle_through(shoulder, elbow, wrist, turns)

    def circle(self) -> np.ndarray:
        """Return the elbow's circle, or another arm's curve, as line segments ``(N, 2, 3)`` [m]; N may be 0."""
        if self.has_circle:
            return _segments(self.on_circle(_along(-np.pi, np.pi)))
        return self.curve.where(self.curve.blocker != UNSOLVED)

    def feasible_arcs(self) -> np.ndarray:
        """Return the feasible arcs of the selected branch as line segments ``(N, 2, 3)`` [m]; N may be 0."""
        if not self.has_circle:
            return self.curve.where(self.curve.blocker == FREE)
        pieces = [_segments(self.on_circle(_along(*arc))) for arc in self.arcs[self.state.branch]]
        return np.concatenate(pieces) if pieces else np.zeros((0, 2, 3))

    def description(self) -> str:
        """Return the state as text: the status of the branch, its feasible swivels, and the other feasible branches."""
        name, about = self.state.parameter_name, "" if self.state.model.arm.closed_form else "about "
        branch, arcs = self.state.branch, self.arcs[self.state.branch]
        lines = [f"**{self.status_here.name}**: {self.status_here.message}."]
        if self.status_here == Status.LIMITS:
            lines.append(f"Outside the range: {', '.join(self._outside())}.")
        if self.status_here == Status.COLLISION:
            what = "itself" if self.blocker < 0 else obstacle_name(self.blocker, self.state.world)
            lines.append(f"It meets {what}, {1e3 * self.overlap:.0f} mm deep.")
        if self.has_circle and self.status_here >= Status.OUT_OF_REACH:
            return "\n\n".join(lines)
        intervals = ", ".join(f"{np.degrees(a):.0f}° to {np.degrees(b):.0f}°" for a, b in arcs) or "none"
        others = ", ".join(str(b) for b in self.feasible_branches if b != branch) or "none"
        feasible = "Feasible swivels" if name == "swivel" else f"Feasible angles of {name}"
        lines.append(f"{feasible} in branch {branch}: {about}{intervals}.")
        lines.append(f"Other feasible branches here: {others}.")
        if blocked := self.curve.blocked_by(self.state.world):
            lines.append(f"Blocked by {'; '.join(blocked)}.")
        return "\n\n".join(lines)

    def _outside(self) -> list[str]:
        arm, names = self.state.model.arm, self.state.model.joint_names
        q, lower, upper = (np.degrees(np.asarray(x, float)) for x in (self.joints, arm.lower, arm.upper))
        out = np.flatnonzero((q < lower - 1e-6) | (q > upper + 1e-6))
        return [f"{names[j]} at {q[j]:.0f}°, range {lower[j]:.0f}° to {upper[j]:.0f}°" for j in out]

    def nearest_feasible(self) -> ArmState:
        """Return the state at the nearest feasible swivel, in this branch if it has any, else in another.

        It is the same state if no branch has a feasible swivel.
        """
        order = [self.state.branch, *(b for b in range(len(self.q)) if b != self.state.branch)]
        for branches in (order[:1], order[1:]):
            found = [
                (abs(gap), b, self.state.swivel + gap)
                for b in branches
                for arc in self.arcs[b]
                for gap in (_gap(self.state.swivel, *arc),)
            ]
            if found:
                _, branch, swivel = min(found)
                return replace(self.state, branch=branch, swivel=float((swivel + np.pi) % (2 * np.pi) - np.pi))
        return self.state


def arm_scene(state: ArmState) -> ArmScene:
    """Compute the scene of a state: all branches, their arcs, and the posture in the selected branch.

    Args:
        state: The user's input.

    Returns:
        Everything that is drawn.
    """
    dtype = jnp.result_type(float)
    arm, world = state.model.arm.astype(dtype), state.world
    samples = np.linspace(*parameter_range(arm), SAMPLES)
    swivels = np.concatenate([[state.swivel], samples]).astype(dtype)
    out = jax.device_get(_solved(arm, state.target, world, swivels, np.int32(state.branch)))
    q, status, elbow, other, distance, intervals = out
    codes = blockers(arm, world, status[:, state.branch], other)
    skeleton = Skeleton.of(arm)
    scene = ArmScene(
        state,
        np.asarray(q, float),
        status[0],
        tuple(() for _ in q),
        skeleton.posture(q[state.branch]),
        skeleton,
        ElbowCurve(samples, np.asarray(elbow[1:], float), codes[1:]),
        int(codes[0]),
        max(0.0, -float(distance[0])),
    )
    if intervals is None:
        return replace(scene, arcs=tuple(_sampled(samples, status[1:, b]) for b in range(len(q))))
    arcs = tuple(
        tuple((float(a), float(b)) for a, b, ok in zip(*rows, strict=True) if ok)
        for rows in zip(*intervals, strict=True)
    )
    return replace(scene, arcs=arcs)


@jax.jit
def _solved(arm: Arm, target: Target, world: World | None, swivels: jax.Array, branch: jax.Array) -> tuple:
    """All compiled computations in a single call, since the overhead of a call exceeds the arithmetic."""
    solution = solve_ik(arm, target, swivels, world=world)
    elbow, other, distance = sampled_elbow(arm, world, jnp.take(solution.q, branch, axis=1))
    arcs = swivel_arcs(arm, target, world=world) if arm.closed_form else None
    intervals = None if arcs is None else (arcs.start, arcs.end, arcs.valid)
    return solution.q[0], solution.status, elbow, other, distance, intervals


def _sampled(samples: np.ndarray, status: np.ndarray) -> tuple[tuple[float, float], ...]:
    """Intervals of feasible samples."""
    curve = ElbowCurve(samples, np.zeros((len(samples), 3)), np.where(status <= Status.NEAR_SINGULAR, FREE, UNSOLVED))
    return curve.free_intervals()


def _along(start: float, end: float) -> np.ndarray:
    """At least two swivels from one end of an arc to the other."""
    return np.linspace(start, end, max(2, int(np.ceil((end - start) / _STEP)) + 1))


def _segments(points: np.ndarray) -> np.ndarray:
    return np.stack([points[:-1], points[1:]], axis=1)


def _gap(swivel: float, start: float, end: float) -> float:
    """Signed angle from a swivel to an arc [rad]; 0 inside the arc."""
    ahead = (start - swivel) % (2 * np.pi)
    behind = (swivel - end) % (2 * np.pi)
    inside = (swivel - start) % (2 * np.pi) <= end - start
    return 0.0 if inside else (ahead if ahead <= behind else -behind)
