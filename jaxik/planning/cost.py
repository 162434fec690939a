"""The cost of a path's swivels: value, gradient and banded Hessian for the refinement."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.numerics import shortest, unwrap
from jaxik.planning.newton import Band
from jaxik.planning.problem import EndPosture, PlanningProblem
from jaxik.redundancy import BranchMotion, ParameterBranch, PostureCharts

AnyBranchMotion = BranchMotion | ParameterBranch | PostureCharts

_SPEED_MARGIN = 0.98  # the penalty on joint speeds sets in here, so that the limit itself is kept
_SPEED_PENALTY = 1e2  # against an energy scaled to one
_LIMIT_PENALTY = 1e2  # likewise, per rad²
_LEAST_SCALE = 1e-12  # of a motion that costs nothing


class PathCost(NamedTuple):
    """The objective of one path in given branches, a function of its variables: the swivels ``(K,)``.

    On a closed path the last swivel follows from the first. It is no variable then, and neither are those of waypoints
    that pad a path: the objective does not depend on their places.

    The energy is differentiated in the joint angles, where it is a few lines of algebra, and the joint angles in the
    swivel, each waypoint by itself. The band of the Hessian comes from as many Hessian-vector products as it is wide
    (Curtis, Powell and Reid, "On the estimation of sparse Jacobian matrices", 1974).

    Attributes:
        problem: The path.
        motion: Its self-motion in the branches taken.
        scale: Size of the energy, ``()``: the value is one for it.
        limits: Factor of the squared violation of joint limits, ``()``: zero where arcs keep them.
        begin: Energies of the initial guess, of the motion and its approaches, ``()`` each.
        winding: Last swivel of a closed path less its first, ``()`` [rad]: full turns. None for an open path.
    """

    problem: PlanningProblem
    motion: AnyBranchMotion
    scale: Array
    limits: Array
    begin: tuple[Array, Array]
    winding: Array | None = None

    def swivels(self, x: Array) -> Array:
        """Swivels ``(K,)`` [rad] from the variables; behind the last waypoint its own."""
        swivel = x if self.winding is None else jnp.where(self.problem.from_last(), x[0] + self.winding, x)
        return self.problem.padded(swivel)

    def joints(self, swivel: Array) -> Array:
        """Joint angles ``(K, joint)`` [rad], without jumps of a full turn in turning joints."""
        return self.problem.padded(unwrap(self.motion.angles(swivel).T, self.problem.arm.turning))

    def energies(self, q: Array) -> tuple[Array, Array]:
        """Energy of the motion, and of the approaches from the start and to the end posture."""
        weights = self.problem.energy.motion_weights(self.problem.arm)
        approaches = [approach_energy(end, q[row], weights, self.problem) for row, end in self.problem.end_postures]
        return self.problem.energy(self.problem.arm, q, self.problem.time), sum(approaches, jnp.zeros((), q.dtype))

    def value(self, q: Array) -> Array:
        """Both energies relative to the scale, and a penalty on joints near their speed limits."""
        limit = self.problem.arm.velocity_limit
        speed = jnp.abs(jnp.diff(q, axis=0)) / (self.problem.durations[:, None] * limit)
        excess = jnp.maximum(speed - _SPEED_MARGIN, 0.0)
        arm = self.problem.arm
        outside = jnp.where(arm.turning, 0.0, jnp.maximum(jnp.maximum(arm.lower - q, q - arm.upper), 0.0))
        outside = jnp.where(self.problem.counted[:, None], outside, 0.0)
        penalty = _SPEED_PENALTY * jnp.sum(excess**2) + self.limits * jnp.sum(outside**2)
        return sum(self.energies(q)) / self.scale + penalty

    def slopes(self, x: Array) -> tuple[Array, Array]:
        """Joint angles ``(K, joint)`` [rad] and their first derivatives in the swivels."""
        q, first = self.motion.slopes(self.swivels(x))
        return unwrap(q.T, self.problem.arm.turning), first.T

    def gradient(self, q: Array, first: Array) -> Array:
        """Gradient of the value in the variables, from :meth:`slopes`."""
        gradient = jnp.sum(jax.grad(self.value)(q) * first, axis=-1)
        return gradient if self.winding is None else _closed_gradient(gradient, self.problem.last)

    def __call__(self, x: Array) -> tuple[Array, Array, Band]:
        """Value, gradient and Hessian in the variables."""
        swivel = self.swivels(x)
        rates = self.motion.rates(swivel)
        q, first = unwrap(rates.q.T, self.problem.arm.turning), rates.first.T
        value, by_joint = jax.value_and_grad(self.value)(q)
        gradient = jnp.sum(by_joint * first, axis=-1)
        # A step couples two waypoints, a velocity or acceleration three.
        width = 1 if self.problem.energy.separable else 2
        colors, index = 2 * width + 1, jnp.arange(len(swivel))
        seeds = (index % colors == jnp.arange(colors)[:, None]).astype(q.dtype)[..., None] * first
        products = jax.vmap(lambda seed: jax.jvp(jax.grad(self.value), (q,), (seed,))[1])(seeds)
        products = jnp.sum(products * first, axis=-1)
        diagonals = [
            jnp.where(index + d < len(index), products[(index + d) % colors, index], 0.0) for d in range(width + 1)
        ]
        diagonals[0] = diagonals[0] + jnp.sum(by_joint * rates.second.T, axis=-1)
        if self.winding is None:
            return value, gradient, Band(tuple(diagonals))
        last = self.problem.last
        return value, _closed_gradient(gradient, last), _closed_band(diagonals, last)


def path_cost(problem: PlanningProblem, branch: Array, swivel: Array, soft: Array | bool = False) -> PathCost:
    """Return the cost in branches ``(K,)``, scaled so that it is one for swivels ``(K,)``.

    Args:
        problem: The path.
        branch: Branches, ``(K,)``.
        swivel: Swivels, ``(K,)`` [rad].
        soft: True where waypoints without an arc are to come as near to their limits as they can.
    """
    turns = None
    if problem.closed is not None:
        turns = jax.lax.stop_gradient(2 * jnp.pi * jnp.round((swivel[-1] - swivel[0]) / (2 * jnp.pi)))
    motion = problem.motion.branch(branch)
    return cost_from(problem, motion, unwrap(motion.angles(swivel).T, problem.arm.turning), soft, turns)


def cost_from(
    problem: PlanningProblem,
    motion: AnyBranchMotion,
    q: Array,
    soft: Array | bool = False,
    winding: Array | None = None,
) -> PathCost:
    """Return the cost along self-motions with a coordinate per waypoint, scaled so that it is one at ``(K, joint)``."""
    one = jnp.ones((), q.dtype)
    cost = PathCost(problem, motion, one, jnp.where(soft, _LIMIT_PENALTY, 0.0).astype(q.dtype), (one, one), winding)
    begin = cost.energies(problem.padded(q))
    return cost._replace(scale=jax.lax.stop_gradient(jnp.maximum(sum(begin), _LEAST_SCALE)), begin=begin)


def _closed_gradient(gradient: Array, last: Array) -> Array:
    """A gradient ``(K,)`` where the last swivel follows the first."""
    return gradient.at[last].set(0.0).at[0].add(gradient[last])


def _closed_band(diagonals: list[Array], last: Array) -> Band:
    """A band of K variables where the last one follows the first: without it, and with a border."""
    main, *others = diagonals
    index = jnp.arange(len(main))
    main, border = main.at[last].set(0.0).at[0].add(main[last]), jnp.zeros_like(main)
    inside = []
    for d, entry in enumerate(others, start=1):
        coupled = jnp.where(index + d == last, entry, 0.0)
        border = border + jnp.where(index > 0, coupled, 0.0)
        main = main.at[0].add(2 * coupled[0])  # so few waypoints that the first is the last one's neighbor
        inside.append(jnp.where(index + d >= last, 0.0, entry))
    return Band((main, *inside), border)


def approach_energy(end: EndPosture, q: Array, weights: Array, problem: PlanningProblem) -> Array:
    """Return Σ_j w_j Δq_j² / time of the motion between an end posture and ``(*batch, joint)``: ``(*batch,)``."""
    step = shortest(q - end.q, problem.arm.turning)
    return jnp.sum(weights * step**2, axis=-1) / end.time
