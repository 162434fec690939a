"""What the viewer shows of an arm at a target: a value worked out from the state alone, before anything is drawn.

One compiled call solves all eight branches and their feasible arcs; the rest is a few products on the host.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np

from jaxik.arm import Arm, ArmModel
from jaxik.arm.presets import paper_arm
from jaxik.ik import Status, solve_ik
from jaxik.paper.report import solve_example
from jaxik.paper.steps import SWIVEL
from jaxik.redundancy import swivel_arcs, swivel_of
from jaxik.targets import Pointing, Pose, Target
from jaxik.view.skeleton import Skeleton, circle_through

_STEP = np.radians(3.0)  # of a drawn arc: finer is not seen
_START = (0.55, 0.65, 0.5, 0.25, 0.5, 0.7, 0.5)  # of each joint's range: an elbow bent, nothing near a limit


@dataclass(frozen=True)
class ArmState:
    """What a person has set.

    Attributes:
        model: The arm.
        position: Of the handle, ``(3,)`` [m].
        rotation: Of the handle, ``(3, 3)``; an arm without a rolling hand takes its z axis alone.
        swivel: [rad].
        branch: 0 to 7.
    """

    model: ArmModel
    position: np.ndarray
    rotation: np.ndarray
    swivel: float
    branch: int

    @classmethod
    def start(cls, model: ArmModel) -> "ArmState":
        """A posture to begin with: the paper's example on the paper's arm, else an elbow bent amid the ranges."""
        if model.name == paper_arm().name:
            q, swivel, branch = np.asarray(solve_example().q[0], float), SWIVEL, 0
        else:
            lower, upper = (np.clip(np.asarray(x, float), -np.pi, np.pi) for x in (model.arm.lower, model.arm.upper))
            q = lower + np.array(_START[: len(lower)]) * (upper - lower)
            swivel, branch = (float(x) for x in swivel_of(model.arm, jnp.asarray(q, float)))
        skeleton = Skeleton.of(model.arm)
        turns, _ = skeleton.motions(q)
        rotation = turns[-1] @ np.asarray(model.arm.tool_rotation, float)
        return cls(model, skeleton.posture(q)[3], rotation, float(swivel), int(branch))

    @property
    def target(self) -> Target:
        """What the arm is asked for."""
        position, rotation = jnp.asarray(self.position, float), jnp.asarray(self.rotation, float)
        if self.model.arm.n_joints < 7:
            return Pointing(position, rotation[:, 2])
        return Pose(position, rotation)


@dataclass(frozen=True)
class ArmScene:
    """What is to be seen.

    Attributes:
        state: What it follows from.
        q: Joint angles of every branch, ``(8, joint)`` [rad].
        status: :class:`jaxik.Status` of every branch, ``(8,)``.
        arcs: Feasible swivels of every branch, ``(start, end)`` pairs [rad].
        points: Shoulder, elbow, wrist and tool of the chosen branch, ``(4, 3)`` [m].
        skeleton: The arm's.
    """

    state: ArmState
    q: np.ndarray
    status: np.ndarray
    arcs: tuple[tuple[tuple[float, float], ...], ...]
    points: np.ndarray
    skeleton: Skeleton

    @property
    def joints(self) -> np.ndarray:
        """Joint angles of the chosen branch, ``(joint,)`` [rad]."""
        return self.q[self.state.branch]

    @property
    def chosen(self) -> Status:
        """Status of the chosen branch."""
        return Status(int(self.status[self.state.branch]))

    @cached_property
    def usable(self) -> tuple[int, ...]:
        """Branches that a robot can take at this swivel."""
        return tuple(np.flatnonzero(self.status <= Status.NEAR_SINGULAR).tolist())

    @property
    def spheres(self) -> tuple[tuple[np.ndarray, float], tuple[np.ndarray, float]]:
        """The paper's two spheres, on both of which the elbow lies: (center, radius) about shoulder and wrist [m]."""
        shoulder, elbow, wrist, _ = self.points
        return (shoulder, float(np.linalg.norm(elbow - shoulder))), (wrist, float(np.linalg.norm(elbow - wrist)))

    def on_circle(self, swivels: np.ndarray) -> np.ndarray:
        """Where the elbow would be at swivels ``(N,)`` [rad]: ``(N, 3)`` [m]."""
        turns = self.state.model.arm.reference.sense * (swivels - self.state.swivel)
        shoulder, elbow, wrist = self.points[:3]
        return circle_through(shoulder, elbow, wrist, turns)

    def circle(self) -> np.ndarray:
        """The whole circle as line segments ``(N, 2, 3)`` [m]."""
        return _segments(self.on_circle(_along(-np.pi, np.pi)))

    def feasible(self) -> np.ndarray:
        """The chosen branch's arcs as line segments ``(N, 2, 3)`` [m]; none is an array of length 0."""
        pieces = [_segments(self.on_circle(_along(*arc))) for arc in self.arcs[self.state.branch]]
        return np.concatenate(pieces) if pieces else np.zeros((0, 2, 3))

    def words(self) -> str:
        """The state in words: one line on the branch, one on what else there is."""
        branch, arcs = self.state.branch, self.arcs[self.state.branch]
        lines = [f"**{self.chosen.name}**: {self.chosen.message}."]
        if self.chosen == Status.LIMITS:
            lines.append(f"Beyond its range: {', '.join(self._beyond())}.")
        if self.chosen >= Status.OUT_OF_REACH:
            return "\n\n".join(lines)
        room = ", ".join(f"{np.degrees(a):.0f}° to {np.degrees(b):.0f}°" for a, b in arcs) or "none"
        others = ", ".join(str(b) for b in self.usable if b != branch) or "none"
        lines.append(f"Feasible swivels of branch {branch}: {room}. Other branches usable at this swivel: {others}.")
        return "\n\n".join(lines)

    def _beyond(self) -> list[str]:
        arm, names = self.state.model.arm, self.state.model.joint_names
        q, lower, upper = (np.degrees(np.asarray(x, float)) for x in (self.joints, arm.lower, arm.upper))
        out = np.flatnonzero((q < lower - 1e-6) | (q > upper + 1e-6))
        return [f"{names[j]} at {q[j]:.0f}° of {lower[j]:.0f}° to {upper[j]:.0f}°" for j in out]

    def nearest_feasible(self) -> ArmState:
        """The state at the feasible swivel nearest to the present one, in this branch if it has any, else in another.

        The same state where no branch has a feasible swivel.
        """
        order = [self.state.branch, *(b for b in range(8) if b != self.state.branch)]
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
    """Solves a state: all branches, their arcs, and where the chosen one puts the arm.

    Args:
        state: What a person has set.

    Returns:
        What is to be seen.
    """
    arm, dtype = state.model.arm, jnp.result_type(float)
    out = jax.device_get(_looked_at(arm.astype(dtype), state.target, np.asarray(state.swivel, dtype)))
    q, status, start, end, valid = out
    arcs = tuple(
        tuple((float(a), float(b)) for a, b, there in zip(*rows, strict=True) if there)
        for rows in zip(start, end, valid, strict=True)
    )
    skeleton = Skeleton.of(arm)
    return ArmScene(state, np.asarray(q, float), status, arcs, skeleton.posture(q[state.branch]), skeleton)


@jax.jit
def _looked_at(arm: Arm, target: Target, swivel: jax.Array) -> tuple[jax.Array, ...]:
    """Everything that needs compiling, in one call: a call costs more than this arithmetic."""
    solution, arcs = solve_ik(arm, target, swivel), swivel_arcs(arm, target)
    return solution.q, solution.status, arcs.start, arcs.end, arcs.valid


def _along(start: float, end: float) -> np.ndarray:
    """Swivels from one end of an arc to the other, at least two."""
    return np.linspace(start, end, max(2, int(np.ceil((end - start) / _STEP)) + 1))


def _segments(points: np.ndarray) -> np.ndarray:
    return np.stack([points[:-1], points[1:]], axis=1)


def _gap(swivel: float, start: float, end: float) -> float:
    """How far to turn to come into an arc; 0 inside."""
    ahead = (start - swivel) % (2 * np.pi)
    behind = (swivel - end) % (2 * np.pi)
    inside = (swivel - start) % (2 * np.pi) <= end - start
    return 0.0 if inside else (ahead if ahead <= behind else -behind)
