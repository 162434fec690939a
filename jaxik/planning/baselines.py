"""What simpler ways of choosing the elbow cost on the same path: the yardsticks of a plan."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxik import energy as energies
from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.paths import Path
from jaxik.planning.chart import Chart, make_chart, postures
from jaxik.planning.continuity import unwrap
from jaxik.planning.cost import Ends, PathCost
from jaxik.planning.initial_guess import into_arcs
from jaxik.planning.newton import newton_in_box
from jaxik.redundancy import SwivelArcs, swivel_arcs
from jaxik.targets import Target

_GRID = 720  # swivels that the greedy walk chooses from: half a degree
_ITERATIONS = 120


class Baselines(NamedTuple):
    """Energies of simpler motions, in the energy's unit; infinite where such a motion breaks limits or speeds.

    Attributes:
        fixed: The swivel held at pi, as in the paper's example, in its best branch.
        constant: The best swivel held all along, of 720, in its best branch.
        greedy: From waypoint to waypoint to the nearest posture, from the best start.
        local: The nearest minimum from the swivel held at pi, in its best branch.
    """

    fixed: float
    constant: float
    greedy: float
    local: float


def baselines(arm: Arm, path: Path, energy: Energy | None = None) -> Baselines:
    """What simpler motions cost on a path, for comparison with :func:`jaxik.plan`.

    Args:
        arm: The arm.
        path: The path in the arm's base frame.
        energy: What is counted; None for :func:`jaxik.energy.joint_motion`.

    Returns:
        Their energies.

    Raises:
        ValueError: Not a path.
    """
    path = path.checked().astype(arm.axes.dtype)
    energy = energies.joint_motion() if energy is None else energy
    return Baselines(*(float(x) for x in _energies(arm, path.target, path.time, energy)))


@jax.jit
def _energies(arm: Arm, target: Target, time: Array, energy: Energy) -> tuple[Array, ...]:
    dtype = time.dtype
    chart, arcs = make_chart(arm, target), swivel_arcs(arm, target)
    turning = arm.upper - arm.lower >= 2 * jnp.pi * (1 - 1e-6)
    branches = jnp.arange(8)
    held = jnp.full(time.shape, jnp.pi, dtype)

    def cost_of(q: Array, inside: Array) -> Array:
        """Energy of ``(K, joint)``, infinite where it leaves its arcs or is too fast."""
        q = unwrap(q, turning)
        slow = jnp.all(jnp.abs(jnp.diff(q, axis=0)) <= 1.000001 * arm.velocity_limit * jnp.diff(time)[:, None])
        return jnp.where(jnp.all(inside) & slow, energy(arm, q, time), jnp.inf)

    def constant(swivel: Array, branch: Array) -> Array:
        swivel = jnp.full(time.shape, swivel)
        return cost_of(postures(arm, chart, swivel, branch).T, arcs.contains(swivel)[:, branch])

    def local(branch: Array) -> Array:
        course = into_arcs(arcs, held, jnp.full(time.shape, branch))
        one = jnp.ones((), dtype)
        cost = PathCost(arm, chart, energy, time, Ends(None, None, one), course.branch, turning, one)
        scale = jnp.maximum(cost.spent(cost.joints(course.swivel))[0], 1e-12)
        end = newton_in_box(cost._replace(scale=scale), course.swivel, course.lower, course.upper, _ITERATIONS)
        return cost_of(cost.joints(end.x), jnp.isfinite(course.swivel))

    grid = jnp.linspace(-jnp.pi, jnp.pi, _GRID, endpoint=False, dtype=dtype)
    each = lax.map(lambda s: jax.vmap(lambda b: constant(s, b))(branches), grid)
    at_pi = jax.vmap(lambda b: constant(jnp.asarray(jnp.pi, dtype), b))(branches)
    walked = lax.map(lambda b: cost_of(*_walk(arm, chart, arcs, grid, turning, b)), branches)
    return at_pi.min(), each.min(), walked.min(), lax.map(local, branches).min()


def _walk(arm: Arm, chart: Chart, arcs: SwivelArcs, grid: Array, turning: Array, branch: Array) -> tuple[Array, Array]:
    """The greedy walk from the middle of a branch's feasible swivels: postures ``(K, joint)``, and where it got on."""
    allowed = jax.vmap(arcs.contains)(jnp.broadcast_to(grid[:, None], (_GRID, arcs.start.shape[0])))  # (grid, K, 8)
    here = jnp.argsort(allowed[:, 0, branch], stable=True)[-1 - jnp.sum(allowed[:, 0, branch]) // 2]
    first = postures(arm, chart.at(jnp.arange(1)), grid[here, None], branch)[:, 0]

    def go(q: Array, k: Array) -> tuple[Array, tuple[Array, Array]]:
        states = postures(arm, chart.at(k[None]), grid[:, None, None], jnp.arange(8)[:, None])[..., 0]
        step = states - q[:, None, None]
        step = step - jnp.where(turning, 2 * jnp.pi, 0.0)[:, None, None] * jnp.round(step / (2 * jnp.pi))
        motion = jnp.where(allowed[:, k], jnp.sum(step**2, axis=0), jnp.inf)
        best = jnp.argmin(motion)
        q = states.reshape(len(q), -1)[:, best]
        return q, (q, jnp.isfinite(motion.reshape(-1)[best]))

    _, (rest, found) = lax.scan(go, first, jnp.arange(1, arcs.start.shape[0]))
    return jnp.concatenate([first[None], rest]), jnp.append(found, allowed[here, 0, branch])
