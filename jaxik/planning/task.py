"""What to plan, as arrays: shared by search and polish."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxik import energy as energies
from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.planning.chart import Chart
from jaxik.planning.cost import Ends, PathCost
from jaxik.planning.initial_guess import Course, into_arcs
from jaxik.redundancy import SwivelArcs, swivel_of
from jaxik.targets import Target


class Task(NamedTuple):
    """What to plan, in arrays of one dtype.

    Attributes:
        arm: The arm.
        time: ``(K,)`` [s].
        energy: What to make small.
        ends: Postures before and behind the path.
        first: Swivel and branch that the motion has to begin with, if any.
        last: Those it has to end with, if any.
    """

    arm: Arm
    time: Array
    energy: Energy
    ends: Ends
    first: tuple[Array, Array] | None
    last: tuple[Array, Array] | None

    @property
    def turning(self) -> Array:
        """Which joints turn without end, ``(joint,)``."""
        return self.arm.upper - self.arm.lower >= 2 * jnp.pi * (1 - 1e-6)

    def pins(self) -> list[tuple[int, Array, Array, Array]]:
        """Row, posture, swivel and branch of what the motion has to begin and end with."""
        held = ((0, self.ends.start, self.first), (-1, self.ends.end, self.last))
        return [(row, q, *at) for row, q, at in held if q is not None and at is not None]


def make_task(
    arm: Arm,
    target: Target,
    time: ArrayLike,
    energy: Energy | None,
    start: ArrayLike | None,
    end: ArrayLike | None,
    approach_time: ArrayLike,
    pinned: bool,
    end_pinned: bool,
) -> Task:
    """The task of :func:`least_energy_motion`'s arguments, in the dtype of the target."""
    dtype = target.position.dtype
    arm = arm.astype(dtype)
    before, behind = (None if x is None else jnp.asarray(x, dtype) for x in (start, end))
    ends = Ends(before, behind, jnp.asarray(approach_time, dtype))
    first = swivel_of(arm, ends.start) if pinned and ends.start is not None else None
    last = swivel_of(arm, ends.end) if end_pinned and ends.end is not None else None
    energy = energies.joint_motion() if energy is None else energy
    return Task(arm, jnp.asarray(time, dtype), energy, ends, first, last)


def cost_of(task: Task, chart: Chart, course: Course) -> PathCost:
    """What swivels in the course's branches cost, scaled by what its own do."""
    one = jnp.ones((), course.swivel.dtype)
    cost = PathCost(task.arm, chart, task.energy, task.time, task.ends, course.branch, task.turning, one)
    scale = jnp.maximum(sum(cost.spent(cost.joints(course.swivel))), 1e-12)
    return cost._replace(scale=jax.lax.stop_gradient(scale))


def pinned_course(task: Task, arcs: SwivelArcs, swivel: Array, branch: Array) -> Course:
    """Where the polish begins and what it keeps to, with what the motion has to begin and end with."""
    pins = task.pins()
    for row, _, _, pinned in pins:
        branch = branch.at[row].set(pinned)
    course = into_arcs(arcs, swivel, branch)
    begin, lower, upper = course.swivel, course.lower, course.upper
    for row, _, held, _ in pins:
        at = held + 2 * jnp.pi * jnp.round((swivel[row] - held) / (2 * jnp.pi))
        begin, lower, upper = (x.at[row].set(at) for x in (begin, lower, upper))
    return Course(begin, branch, lower, upper)
