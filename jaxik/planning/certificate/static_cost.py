"""Least static cost of a cell: Taylor's polynomial at its middle, less a bound of the remainder."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.numerics import compiled_sooner
from jaxik.planning.certificate.cells import CHUNK, Cells
from jaxik.planning.certificate.quadratic import Parabola

_ROUNDING = 1e-6  # of the value and its terms: single precision with room


class StaticCost(NamedTuple):
    """The static cost of postures, a function of the place in each cell.

    Attributes:
        arm: The arm.
        energy: The energy, of which ``rest_rate`` is bounded.
        seconds: Time that each layer's postures last, ``(layers,)`` [s].
    """

    arm: Arm
    energy: Energy
    seconds: np.ndarray

    def __call__(self, cells: Cells) -> Parabola:
        """Parabolas below the cost; zero where nothing better is known."""
        count = len(cells.layer)
        if not self.energy.at_rest:
            return Parabola(*np.zeros((3, count)))
        out = np.empty((3, count))
        for begin in range(0, count, CHUNK):
            part = slice(begin, min(begin + CHUNK, count))
            pad = (0, 0), (0, begin + CHUNK - part.stop)
            rows = [np.pad(x[:, part], pad, mode="edge") for x in (cells.center, cells.slope, cells.error)]
            out[:, part] = np.asarray(_below(self.arm, self.energy, *rows))[:, : part.stop - begin]
        with np.errstate(invalid="ignore"):
            known = np.isfinite(out).all(axis=0) & (Parabola(*out).minimum() > 0)
        return Parabola(*np.where(known, out, 0.0) * self.seconds[cells.layer])


@compiled_sooner
def _below(arm: Arm, energy: Energy, center: Array, slope: Array, error: Array) -> Array:
    """Value, slope and curve of parabolas in u below the cost on center + slope u ± error, ``(3, cells)``.

    Along the straight line the third derivative is bounded, and |u|³ ≤ u². Off it the gradient is, by its value in the
    middle and the second derivatives.
    """
    dtype = arm.axes.dtype
    bounds = energy.derivative_bounds(arm)
    if bounds is None:
        raise ValueError(f"no bound of {energy} is known; it needs to be Energy.provable")
    second, third = bounds
    q, along, off = (x.astype(dtype).T for x in (center, slope, error))
    rate = lambda q: energy.rest_rate(arm, q)  # noqa: E731
    line = lambda u: rate(q + u * along)  # noqa: E731
    zero, one = jnp.zeros((), dtype), jnp.ones((), dtype)
    value, first, bend = _taylor(line, zero, one)
    gradient = jnp.abs(jax.grad(lambda q: jnp.sum(rate(q)))(q))
    size = jnp.abs(along)
    cubic = jnp.einsum("ijk,ni,nj,nk->n", third.astype(dtype), size, size, size)
    loss = jnp.sum(off * (gradient + (size + off) @ second.astype(dtype)), axis=-1)
    rounding = _ROUNDING * (jnp.abs(value) + jnp.abs(first) + jnp.abs(bend))
    return jnp.stack([value - loss - rounding, first, bend / 2 - cubic / 6])


def _taylor(f, at: Array, one: Array) -> tuple[Array, Array, Array]:
    """Value, first and second derivative of a function of a number."""
    slope = lambda u: jax.jvp(f, (u,), (one,))  # noqa: E731
    (value, first), (_, second) = jax.jvp(slope, (at,), (one,))
    return value, first, second
