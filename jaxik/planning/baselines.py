"""Energies of simpler ways to choose the elbow on the same path: the yardsticks of a plan."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.energy import Energy
from jaxik.ik import BRANCHES
from jaxik.numerics import compiled_sooner, shortest, unwrap
from jaxik.paths import Path
from jaxik.planning.padding import padded_problem, padded_size
from jaxik.planning.problem import PlanningProblem
from jaxik.planning.refinement import refine

_GRID = 720  # swivels that the greedy motion chooses from: half a degree


class Baselines(NamedTuple):
    """Energies of simpler motions, in the energy's unit; infinite where such a motion breaks limits or speeds.

    Attributes:
        fixed: The swivel held at pi, as in the paper's example, in its best branch.
        constant: The best constant swivel of 720, in its best branch.
        greedy: From waypoint to waypoint to the nearest posture, from the best start.
        local: The nearest local minimum from the swivel held at pi, in its best branch.
    """

    fixed: float
    constant: float
    greedy: float
    local: float


def baselines(arm: Arm | ArmModel, path: Path, *, energy: Energy | None = None) -> Baselines:
    """Return the energies of simpler motions along a path, for comparison with :func:`jaxik.plan`.

    Args:
        arm: The arm.
        path: The path in the arm's base frame.
        energy: Energy to count; None for :func:`jaxik.energy.joint_motion`.

    Returns:
        Their energies.

    Raises:
        ValueError: Not a path.
    """
    arm = as_arm(arm, any_class=True, closed_form=True, instead="compare with solve_nearest from waypoint to waypoint")
    path = path.checked().astype(arm.axes.dtype)
    size = padded_size(len(path)) if energy is None or energy.paddable else len(path)
    return Baselines(*(float(x) for x in _energies(arm, padded_problem(arm, path, size, energy))))


@compiled_sooner
def _energies(arm: Arm, problem: PlanningProblem) -> tuple[Array, ...]:
    motion, time, dtype = problem.motion, problem.time, problem.time.dtype
    held = jnp.full(time.shape, jnp.pi, dtype)

    def energy_of(q: Array, inside: Array) -> Array:
        """Energy of ``(K, joint)``, infinite where it leaves its arcs or is too fast."""
        q = unwrap(q, arm.turning)
        slow = jnp.all(jnp.abs(jnp.diff(q, axis=0)) <= 1.000001 * arm.velocity_limit * problem.durations[:, None])
        return jnp.where(jnp.all(inside) & slow, problem.energy(arm, q, time), jnp.inf)

    def constant(swivel: Array, branch: Array) -> Array:
        swivel = jnp.full(time.shape, swivel)
        return energy_of(motion.branch(branch).angles(swivel).T, problem.arcs.contains(swivel)[:, branch])

    def local(branch: Array) -> Array:
        end = refine(problem, held, jnp.full(time.shape, branch))
        return energy_of(end.cost.joints(end.swivel), jnp.isfinite(end.guess.swivel))

    branches = jnp.arange(BRANCHES)
    grid = jnp.linspace(-jnp.pi, jnp.pi, _GRID, endpoint=False, dtype=dtype)
    each = lax.map(lambda s: jax.vmap(lambda b: constant(s, b))(branches), grid)
    at_pi = jax.vmap(lambda b: constant(jnp.asarray(jnp.pi, dtype), b))(branches)
    greedy = lax.map(lambda b: energy_of(*_greedy(problem, grid, b)), branches)
    return at_pi.min(), each.min(), greedy.min(), lax.map(local, branches).min()


def _greedy(problem: PlanningProblem, grid: Array, branch: Array) -> tuple[Array, Array]:
    """The greedy motion from the middle of a branch's swivels: postures ``(K, joint)``, and where it exists."""
    arm, motion, count = problem.arm, problem.motion, len(problem.time)
    allowed = jax.vmap(problem.arcs.contains)(jnp.broadcast_to(grid[:, None], (len(grid), count)))  # (grid, K, 8)
    here = jnp.argsort(allowed[:, 0, branch], stable=True)[-1 - jnp.sum(allowed[:, 0, branch]) // 2]
    first = motion.at(jnp.arange(1)).branch(branch).angles(grid[here, None])[:, 0]

    def go(q: Array, k: Array) -> tuple[Array, tuple[Array, Array]]:
        states = motion.at(k[None]).branch(jnp.arange(BRANCHES)[:, None]).angles(grid[:, None, None])[..., 0]
        step = shortest(states - q[:, None, None], arm.turning[:, None, None])
        moved = jnp.where(allowed[:, k], jnp.sum(step**2, axis=0), jnp.inf)
        best = jnp.argmin(moved)
        q = states.reshape(len(q), -1)[:, best]
        return q, (q, jnp.isfinite(moved.reshape(-1)[best]))

    _, (rest, found) = lax.scan(go, first, jnp.arange(1, count))
    return jnp.concatenate([first[None], rest]), jnp.append(found, allowed[here, 0, branch])
