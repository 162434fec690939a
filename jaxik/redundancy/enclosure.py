"""Enclosures of the self-motion's rates over an interval of swivels, by interval arithmetic.

With s the sine and z the cosine of a spherical joint's middle angle, its outer angles turn at N / s² and its middle one
at -z' / s, where z and N are sinusoids of the swivel, whose range over an interval has a closed form.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik.numerics import clipped_sqrt, fused_separately
from jaxik.redundancy.branch_motion import BranchMotion, by_joint, side_values

_HUGE = 1e8  # where a singular posture lies in the interval nothing is bounded; its fourth power is a float32
_ROUNDING = 16  # eps: error of a sinusoid of size 1


def alignment(dtype: jnp.dtype) -> float:
    """Return the sine of a middle angle below which the swivel no longer resolves the outer angles."""
    return 8 * float(jnp.finfo(dtype).eps) ** 0.5


class Interval(NamedTuple):
    """The numbers from ``low`` to ``high``, element by element."""

    low: Array
    high: Array

    def __add__(self, other: "Interval") -> "Interval":
        return Interval(self.low + other.low, self.high + other.high)

    def __mul__(self, other: "Interval") -> "Interval":
        a, b, c, d = self.low * other.low, self.low * other.high, self.high * other.low, self.high * other.high
        return Interval(
            jnp.minimum(jnp.minimum(a, b), jnp.minimum(c, d)), jnp.maximum(jnp.maximum(a, b), jnp.maximum(c, d))
        )

    def times_positive(self, other: "Interval") -> "Interval":
        """Multiply by an interval without negative numbers."""
        low = self.low * jnp.where(self.low >= 0.0, other.low, other.high)
        return Interval(low, self.high * jnp.where(self.high >= 0.0, other.high, other.low))

    def scaled(self, factor: Array) -> "Interval":
        """Multiply by a number of either sign."""
        a, b = self.low * factor, self.high * factor
        return Interval(jnp.minimum(a, b), jnp.maximum(a, b))

    @property
    def squared(self) -> "Interval":
        """The squares."""
        least = jnp.maximum(jnp.maximum(self.low, -self.high), 0.0)
        most = jnp.maximum(-self.low, self.high)
        return Interval(least * least, most * most)


class Enclosure(NamedTuple):
    """Ranges of the derivatives of the joint angles over an interval of swivels.

    Attributes:
        first: Of the first derivatives, ``(joint, *rows)``.
        second: Of the second derivatives, ``(joint, *rows)`` [1/rad].
        beyond: Distance an angle may turn farther than to its ends, by rounding, ``(joint, *rows)`` [rad].
        sine: Range of the sines of both middle angles, ``(*rows,)``: the least of either, the lesser of the largest.
    """

    first: Interval
    second: Interval
    beyond: Array
    sine: Interval


def enclose(m: BranchMotion, sin: Array, cos: Array, half_sin: Array, half_cos: Array) -> Enclosure:
    """Return ranges about centers of given sine and cosine, for half-widths of given sine and cosine, ``(*rows,)``.

    No alignment may lie inside an interval, only at its ends.
    """
    *ranges, beyond, least, most = _enclose(m, sin, cos, half_sin, half_cos)
    first_low, first_high, second_low, second_high = (by_joint(m, x) for x in ranges)
    first, second = Interval(first_low, first_high), Interval(second_low, second_high)
    return Enclosure(first, second, by_joint(m, beyond), Interval(least, most))


def _range(value: Array, slope: Array, bend: Array, sin: Array, cos: Array) -> Interval:
    """Range of a sinusoid from its value and derivatives at the center, for a half-width of at most half a turn."""
    mean, swing = value + bend, -bend
    middle, aside = mean + swing * cos, jnp.abs(slope * sin)
    amplitude = jnp.sqrt(swing * swing + slope * slope)
    low = jnp.where(-swing >= amplitude * cos, mean - amplitude, middle - aside)
    high = jnp.where(swing >= amplitude * cos, mean + amplitude, middle + aside)
    rounding = _ROUNDING * float(jnp.finfo(value.dtype).eps) * (jnp.abs(mean) + amplitude)
    return Interval(low - rounding, high + rounding)


@fused_separately
def _enclose(m: BranchMotion, sin: Array, cos: Array, half_sin: Array, half_cos: Array) -> tuple[Array, ...]:
    eps = float(jnp.finfo(sin.dtype).eps)
    (y, x), (dy, dx), (ddy, ddx) = side_values(m, sin, cos)

    def span(value: Array, slope: Array, bend: Array) -> Interval:
        return _range(value, slope, bend, half_sin, half_cos)

    rows, beyond, sines = [], [], []
    for first, sign in ((0, m.shoulder_sign), (3, m.wrist_sign)):
        mid = first + 1
        z = span(y[mid], dy[mid], ddy[mid])
        dz, ddz = span(dy[mid], ddy[mid], -dy[mid]), span(ddy[mid], -dy[mid], -ddy[mid])
        # The sine is least at an end, where it is taken from x and y, which keep its digits.
        ends = []
        for side in (-1.0, 1.0):
            x_end, y_end = (
                v[first] + dd[first] - dd[first] * half_cos + side * d[first] * half_sin
                for v, d, dd in ((x, dx, ddx), (y, dy, ddy))
            )
            ends.append(x_end * x_end + y_end * y_end)
        least, most = jnp.minimum(*ends), jnp.maximum(*ends)
        least = clipped_sqrt(least) - _ROUNDING * eps
        most = jnp.where((z.low <= 0.0) & (z.high >= 0.0), 1.0, clipped_sqrt(most) + _ROUNDING * eps)
        inverse = Interval(1.0 / most, jnp.where(least > 1.0 / _HUGE, 1.0 / jnp.where(least > 0.0, least, 1.0), _HUGE))
        inverse2 = Interval(inverse.low * inverse.low, inverse.high * inverse.high)
        inverse4 = Interval(inverse2.low * inverse2.low, inverse2.high * inverse2.high)
        turning = z * dz
        for a in (first, mid, first + 2):
            if a == mid:
                bend = ddz + (z * dz.squared).times_positive(inverse2)
                rows.append([v.times_positive(inverse).scaled(-sign) for v in (dz, bend)])
                beyond.append(jnp.full_like(sin, _ROUNDING * eps))
            elif a < len(y):
                n, dn, ddn = x[a] * dy[a] - y[a] * dx[a], x[a] * ddy[a] - y[a] * ddx[a], dx[a] * ddy[a] - dy[a] * ddx[a]
                rate, change = span(n, dn, ddn - n), span(dn, ddn - n, -dn)
                rounding = 4 * eps * (jnp.abs(x[a] * dy[a]) + jnp.abs(y[a] * dx[a]))
                rate = rate + Interval(-rounding, rounding)
                second = change.times_positive(inverse2) + (rate * turning).times_positive(inverse4).scaled(
                    jnp.full((), 2.0, sin.dtype)
                )
                rows.append([rate.times_positive(inverse2), second])
                beyond.append(_ROUNDING * eps * (1.0 + 4.0 * half_sin * inverse2.high))
        sines.append((least, most))
    columns = [(f.low, f.high, g.low, g.high) for f, g in rows]
    ranges = [jnp.stack(jnp.broadcast_arrays(*column)) for column in zip(*columns, strict=True)]
    return *ranges, jnp.stack(beyond), *(jnp.minimum(*both) for both in zip(*sines, strict=True))
