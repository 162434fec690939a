"""Newton's method in a box for sums whose terms couple a few neighbors only: the Hessian is a narrow band.

Every step is a few banded solves, whose cost grows with the path's length only. They find the least value of the
quadratic model in the box by a primal-dual active set (Hintermüller, Ito and Kunisch, "The primal-dual active set
strategy as a semismooth Newton method", 2002); a Levenberg-Marquardt term makes every step descend. Holding what is at
its bound and projecting the rest (Bertsekas, "Projected Newton methods", 1982) would release one waypoint per step
where many are held.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

_ARMIJO = 1e-4  # fraction of the predicted decrease that a step must reach
_GIVE_UP = 1e9  # damping, against the Hessian's own size, beyond which only rounding is left
_ACTIVE_SETS = 16  # per step, at most
_CONVERGED = 1e-13  # predicted decrease relative to the value: a further step could not show it


class Band(NamedTuple):
    """A symmetric band matrix, on request with a border: a first row and column beyond the band.

    Attributes:
        diagonals: Main diagonal and those above it, ``(n,)`` each: ``diagonals[d][i]`` is the entry (i, i + d), zero
            beyond the end.
        border: Entries (i, 0) and (0, i) to be added, ``(n,)``, zero at i = 0: those of a closed path, whose last
            waypoints are coupled to the first. None for none.
    """

    diagonals: tuple[Array, ...]
    border: Array | None = None

    def solve(self, b: Array) -> Array:
        """Solve band · x = b."""
        if self.border is not None:
            return _solve_bordered(self, self.border, b)
        if len(b) == 1:  # without neighbors: XLA loses the way to LAPACK's solver when it folds their constants
            return b / self.diagonals[0]
        return _solve_tridiagonal(self, b) if len(self.diagonals) == 2 else _solve_pentadiagonal(self, b)

    def times(self, x: Array) -> Array:
        """Multiply the band by x."""
        total = self.diagonals[0] * x
        for d, entry in enumerate(self.diagonals[1:], start=1):
            beside = entry[:-d] * x[d:]
            none = jnp.zeros(d, x.dtype)
            total = total + jnp.concatenate([beside, none]) + jnp.concatenate([none, entry[:-d] * x[:-d]])
        if self.border is not None:
            total = (total + self.border * x[0]).at[0].add(jnp.sum(self.border * x))
        return total


class Newton(NamedTuple):
    """State of a minimization.

    Attributes:
        x: Present variables, ``(n,)``.
        value: Value there, ``()``.
        gradient: Gradient there, ``(n,)``.
        hessian: Hessian there.
        damping: Levenberg-Marquardt term relative to the Hessian's size, ``()``.
        count: Number of evaluations behind the first one, ``()``.
        done: True at a local minimum, ``()``.
    """

    x: Array
    value: Array
    gradient: Array
    hessian: Band
    damping: Array
    count: Array
    done: Array


def newton_in_box(
    evaluate: Callable[[Array], tuple[Array, Array, Band]], x: Array, lower: Array, upper: Array, iterations: int
) -> Newton:
    """Minimize a smooth function over ``lower <= x <= upper`` from x inside.

    Args:
        evaluate: Value, gradient and Hessian, a band of one or two diagonals above the main one, at x ``(n,)``.
        x: Initial guess, ``(n,)``.
        lower: ``(n,)``, -inf where free.
        upper: ``(n,)``; equal to ``lower`` where x is to stay.
        iterations: At most so many evaluations behind the first one.

    Returns:
        The end, a local minimum unless ``done`` is false. Hessian and gradient belong to it.
    """

    def turn(s: Newton) -> Newton:
        # A negative curvature counts by its size: it asks for a large step too, and must not cancel the damping.
        size = jnp.abs(s.hessian.diagonals[0])
        # The mean is that of the variables that the function depends on.
        mean = jnp.sum(size) / jnp.maximum(jnp.sum(jnp.where(size > 0.0, 1.0, 0.0).astype(size.dtype)), 1.0)
        damping = s.damping * (size + mean)
        first = s.count < 0
        trial = jnp.where(first, s.x, jnp.clip(s.x + _model_step(s, damping, lower, upper), lower, upper))
        predicted = jnp.sum(s.gradient * (trial - s.x))
        f, g, h = evaluate(trial)
        rounding = _CONVERGED * jnp.abs(s.value)
        small = ~first & (predicted <= 0.0) & (-predicted <= rounding)
        # The last step is taken too, whose decrease rounding hides: it takes a small error to its square.
        decrease = (predicted < 0.0) & (f <= s.value + _ARMIJO * predicted)
        good = first | decrease | (small & (f <= s.value + rounding))
        lost = first & ~jnp.isfinite(f)  # no step leads from there, and others in a batch would wait
        after = Newton(trial, f, g, h, jnp.where(s.damping < 1e-6, 0.0, s.damping / 8.0), s.count + 1, small | lost)
        harder = jnp.maximum(8.0 * s.damping, 1e-3)
        before = s._replace(damping=harder, count=s.count + 1, done=small | (harder > _GIVE_UP))
        return jax.tree.map(lambda a, b: jnp.where(good, a, b), after, before)

    # The first turn evaluates x itself, so that the function is compiled once: it is most of the program.
    value, gradient, hessian = (
        jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), part) for part in jax.eval_shape(evaluate, x)
    )
    start = Newton(x, value, gradient, hessian, jnp.zeros_like(value), jnp.full((), -1, jnp.int32), jnp.zeros((), bool))
    return lax.while_loop(lambda s: ~s.done & (s.count < iterations), turn, start)


def _model_step(s: Newton, damping: Array, lower: Array, upper: Array) -> Array:
    """The step to the minimum of the quadratic model in the box, by a primal-dual active set.

    The bounds that hold are determined again from every solve, until nothing changes.
    """
    low, high = lower - s.x, upper - s.x

    def again(state: tuple[Array, ...]) -> tuple[Array, ...]:
        side, _, _, count = state  # of every variable: -1 at its lower bound, 1 at its upper one, 0 free
        held = side != 0
        fixed = jnp.where(side < 0, low, jnp.where(side > 0, high, 0.0))
        right = jnp.where(held, 0.0, -s.gradient - s.hessian.times(fixed))
        step = fixed + with_held(s.hessian, held, damping).solve(right)
        slope = s.gradient + s.hessian.times(step) + damping * step
        stays = jnp.where(side < 0, slope >= 0.0, slope <= 0.0)
        beyond = (step > high).astype(side.dtype) - (step < low).astype(side.dtype)
        after = jnp.where(held, jnp.where(stays, side, 0), beyond)
        return after, step, jnp.any(after != side), count + 1

    held = held_by_box(s.x, s.gradient, lower, upper)
    side = jnp.where(held, jnp.where(s.x <= lower, -1, 1), 0).astype(jnp.int8)
    state = side, jnp.zeros_like(s.x), jnp.asarray(True), jnp.zeros((), jnp.int32)
    return lax.while_loop(lambda t: t[2] & (t[3] < _ACTIVE_SETS), again, state)[1]


def held_by_box(x: Array, gradient: Array, lower: Array, upper: Array) -> Array:
    """Return the variables that a bound holds: those at it whose descent leads beyond."""
    return ((x <= lower) & (gradient >= 0.0)) | ((x >= upper) & (gradient <= 0.0))


def with_held(h: Band, held: Array, added: Array | float = 0.0) -> Band:
    """Return the band with ``added`` on its diagonal, and the identity's rows and columns for held variables."""
    main, *others = h.diagonals
    diagonals = [jnp.where(held, 1.0, main + added)]
    for d, entry in enumerate(others, start=1):
        either = held | jnp.concatenate([held[d:], jnp.ones(d, bool)])
        diagonals.append(jnp.where(either, 0.0, entry))
    return Band(tuple(diagonals), None if h.border is None else jnp.where(held | held[0], 0.0, h.border))


def _solve_bordered(h: Band, border: Array, b: Array) -> Array:
    """Eliminate all variables but the first by two band solves, which leave one equation (Schur complement)."""
    inner = Band(tuple(entry[1:] for entry in h.diagonals))
    column = border[1:]
    for d, entry in enumerate(h.diagonals[1:], start=1):
        column = column.at[d - 1].add(entry[0])
    y, z = jax.vmap(inner.solve)(jnp.stack([b[1:], column]))
    floor = jnp.finfo(b.dtype).eps * jnp.max(jnp.abs(h.diagonals[0]))
    pivot = h.diagonals[0][0] - column @ z
    pivot = jnp.where(pivot > floor, pivot, jnp.maximum(jnp.abs(pivot), floor))  # as in a pentadiagonal band
    first = (b[0] - column @ y) / pivot
    return jnp.concatenate([first[None], y - z * first])


def _solve_tridiagonal(h: Band, b: Array) -> Array:
    main, above = h.diagonals
    below = jnp.concatenate([jnp.zeros_like(above[:1]), above[:-1]])
    return lax.linalg.tridiagonal_solve(below, main, above, b[:, None])[:, 0]


def _solve_pentadiagonal(h: Band, b: Array) -> Array:
    """L D Lᵀ and two substitutions; a pivot that is not positive is replaced, which makes the step a descent still."""
    main, one, two = h.diagonals
    floor = jnp.finfo(b.dtype).eps * jnp.max(jnp.abs(main))

    zero = jnp.zeros((), b.dtype)

    def eliminate(carry: tuple[Array, ...], row: tuple[Array, ...]) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        # Row i needs: pivots of rows i-1, i-2, L[i, i-1], L[i, i-2], and y of both.
        pivot1, pivot2, near, far, y1, y2, next_far = carry
        a, b1, b2, r = row
        pivot = a - near * near * pivot1 - far * far * pivot2
        pivot = jnp.where(pivot > floor, pivot, jnp.maximum(jnp.abs(pivot), floor))
        y = r - near * y1 - far * y2
        below = (b1 - next_far * pivot1 * near) / pivot  # L[i + 1, i], with L[i + 1, i - 1] = next_far
        below2 = b2 / pivot  # L[i + 2, i]
        return (pivot, pivot1, below, next_far, y, y1, below2), (pivot, below, below2, y)

    start = (jnp.ones((), b.dtype), jnp.ones((), b.dtype), zero, zero, zero, zero, zero)
    _, (pivot, below, below2, y) = lax.scan(eliminate, start, (main, one, two, b))

    def back(carry: tuple[Array, Array], row: tuple[Array, ...]) -> tuple[tuple[Array, Array], Array]:
        x1, x2 = carry
        d, l1, l2, value = row
        x = value / d - l1 * x1 - l2 * x2
        return (x, x1), x

    return lax.scan(back, (zero, zero), (pivot, below, below2, y), reverse=True)[1]
