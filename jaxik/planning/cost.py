"""The cost of a path's swivels: value, gradient and banded Hessian for the refinement."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.numerics import shortest, unwrap
from jaxik.planning.newton import Band
from jaxik.planning.problem import EndPosture, PlanningProblem
from jaxik.redundancy import BranchMotion

_SPEED_MARGIN = 0.98  # the penalty on joint speeds sets in here, so that the limit itself is kept
_SPEED_PENALTY = 1e2  # against an energy scaled to one
_LIMIT_PENALTY = 1e2  # likewise, per rad²
_LEAST_SCALE = 1e-12  # of a motion that costs nothing


class PathCost(NamedTuple):
    """The objective of one path in given branches, a function of its variables: the swivels ``(K,)``.

    On a closed path the last swivel follows from the first, and ``(K - 1,)`` are variables.

    The energy is differentiated in the joint angles, where it is a few lines of algebra, and the joint angles in the
    swivel, each waypoint by itself. The band of the Hessian comes from as many Hessian-vector products as it is wide
    (Curtis, Powell and Reid, "On the estimation of sparse Jacobian matrices", 1974).

    Attributes:
        problem: The path.
        motion: Its self-motion in the branches taken.
        scale: Size of the energy, ``()``: the value is one for it.
        limits: Factor of the squared violation of joint limits, ``()``: zero where arcs keep them.
        winding: Last swivel of a closed path less its first, ``()`` [rad]: full turns. None for an open path.
    """

    problem: PlanningProblem
    motion: BranchMotion
    scale: Array
    limits: Array
    winding: Array | None = None

    def variables(self, swivel: Array) -> Array:
        """The variables among the swivels ``(K,)``, or among what else belongs to these."""
        return swivel if self.winding is None else swivel[:-1]

    def swivels(self, x: Array) -> Array:
        """Swivels ``(K,)`` [rad] from the variables."""
        return x if self.winding is None else jnp.append(x, x[0] + self.winding)

    def joints(self, swivel: Array) -> Array:
        """Joint angles ``(K, joint)`` [rad], without jumps of a full turn in turning joints."""
        return unwrap(self.motion.angles(swivel).T, self.problem.arm.turning)

    def energies(self, q: Array) -> tuple[Array, Array]:
        """Energy of the motion, and of the approaches from the start and to the end posture."""
        weights = self.problem.energy.motion_weights(self.problem.arm)
        approaches = [approach_energy(end, q[row], weights, self.problem) for row, end in self.problem.end_postures]
        return self.problem.energy(self.problem.arm, q, self.problem.time), sum(approaches, jnp.zeros((), q.dtype))

    def value(self, q: Array) -> Array:
        """Both energies relative to the scale, and a penalty on joints near their speed limits."""
        limit = self.problem.arm.velocity_limit
        speed = jnp.abs(jnp.diff(q, axis=0)) / (jnp.diff(self.problem.time)[:, None] * limit)
        excess = jnp.maximum(speed - _SPEED_MARGIN, 0.0)
        arm = self.problem.arm
        outside = jnp.where(arm.turning, 0.0, jnp.maximum(jnp.maximum(arm.lower - q, q - arm.upper), 0.0))
        penalty = _SPEED_PENALTY * jnp.sum(excess**2) + self.limits * jnp.sum(outside**2)
        return sum(self.energies(q)) / self.scale + penalty

    def gradient(self, x: Array) -> Array:
        """Gradient of the value in the variables."""
        q, first = self.motion.slopes(self.swivels(x))
        by_joint = jax.grad(self.value)(unwrap(q.T, self.problem.arm.turning))
        gradient = jnp.sum(by_joint * first.T, axis=-1)
        return gradient if self.winding is None else _closed_gradient(gradient)

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
        return value, _closed_gradient(gradient), _closed_band(diagonals)


def path_cost(problem: PlanningProblem, branch: Array, swivel: Array, soft: Array | bool = False) -> PathCost:
    """Return the cost in branches ``(K,)``, scaled so that it is one for swivels ``(K,)``.

    Args:
        problem: The path.
        branch: Branches, ``(K,)``.
        swivel: Swivels, ``(K,)`` [rad].
        soft: True where waypoints without an arc are to come as near to their limits as they can.
    """
    limits = jnp.where(soft, _LIMIT_PENALTY, 0.0).astype(swivel.dtype)
    turns = None
    if problem.closed is not None:
        turns = jax.lax.stop_gradient(2 * jnp.pi * jnp.round((swivel[-1] - swivel[0]) / (2 * jnp.pi)))
    cost = PathCost(problem, problem.motion.branch(branch), jnp.ones((), swivel.dtype), limits, turns)
    scale = jnp.maximum(sum(cost.energies(cost.joints(swivel))), _LEAST_SCALE)
    return cost._replace(scale=jax.lax.stop_gradient(scale))


def _closed_gradient(gradient: Array) -> Array:
    """A gradient ``(K,)`` where the last variable is the first: ``(K - 1,)``."""
    return gradient[:-1].at[0].add(gradient[-1])


def _closed_band(diagonals: list[Array]) -> Band:
    """A band of K variables where the last one is the first: K - 1 variables, with a border."""
    main, *others = diagonals
    main, border = main[:-1].at[0].add(main[-1]), jnp.zeros_like(main[:-1])
    inside = []
    for d, entry in enumerate(others, start=1):
        row = len(main) - d  # of the entry in the last column
        if row > 0:
            border = border.at[row].add(entry[row])
        elif row == 0:  # twice on the diagonal: so few waypoints that the first is the last one's neighbor
            main = main.at[0].add(2 * entry[0])
        inside.append(entry[:-1].at[row:].set(0.0) if row >= 0 else jnp.zeros_like(main))
    return Band((main, *inside), border)


def approach_energy(end: EndPosture, q: Array, weights: Array, problem: PlanningProblem) -> Array:
    """Return Σ_j w_j Δq_j² / time of the motion between an end posture and ``(*batch, joint)``: ``(*batch,)``."""
    step = shortest(q - end.q, problem.arm.turning)
    return jnp.sum(weights * step**2, axis=-1) / end.time
