"""Bounds on the self-motion over an interval of swivels: how far the joints turn, and how their rates change.

With s the sine and z the cosine of a spherical joint's middle angle, its outer angles turn at N / s² and its middle one
at -z' / s, where z and N are sinusoids of the swivel. A sinusoid f stays within |f'| h + |f''| h² / 2 of its value at
the center of an interval of half-width h, since its higher derivatives are no larger; the rest is interval arithmetic.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik.numerics import clipped_sqrt, fused_separately
from jaxik.redundancy.branch_motion import BranchMotion, by_joint, side_values

_HUGE = 1e8  # where a singular posture lies in the interval nothing is bounded; its fourth power is a float32


class Enclosure(NamedTuple):
    """Derivatives of the joint angles at the center of an interval of swivels, and bounds over the interval.

    Attributes:
        first: First derivatives at the center, ``(joint, *rows)``.
        second: Second derivatives there, ``(joint, *rows)`` [1/rad].
        least: Smallest size of the first derivatives over the interval, ``(joint, *rows)``.
        most: Their largest size, ``(joint, *rows)``.
        spread: Largest distance of the second derivatives from those at the center, ``(joint, *rows)`` [1/rad].
        sine: Largest sine of a middle angle over the interval, of shoulder or wrist, whichever is less, ``(*rows,)``.
    """

    first: Array
    second: Array
    least: Array
    most: Array
    spread: Array
    sine: Array


def enclose(m: BranchMotion, sin: Array, cos: Array, half: Array) -> Enclosure:
    """Return derivatives and bounds for centers of given sine and cosine, ``(*more, *rows)`` each."""
    *bounds, sine = _enclose(m, sin, cos, half)
    first, second, least, most, spread = (by_joint(m, x) for x in bounds)
    return Enclosure(first, second, least, most, spread, sine)


def largest_rates(m: BranchMotion, sin: Array, cos: Array, half: Array) -> Array:
    """Return ``most`` alone, ``(joint, *rows)``."""
    return by_joint(m, _largest_rates(m, sin, cos, half))


class _Bounded(NamedTuple):
    """A quantity at the center, and the largest distance from it over the interval."""

    at: Array
    off: Array

    @property
    def top(self) -> Array:
        return jnp.abs(self.at) + self.off

    @property
    def bottom(self) -> Array:
        return jnp.maximum(jnp.abs(self.at) - self.off, 0.0)

    def __mul__(self, other: "_Bounded") -> "_Bounded":
        at = self.at * other.at
        return _Bounded(at, self.top * other.top - jnp.abs(at))

    def __add__(self, other: "_Bounded") -> "_Bounded":
        return _Bounded(self.at + other.at, self.off + other.off)


def alignment(dtype: jnp.dtype) -> float:
    """Return the sine of a middle angle below which the swivel no longer resolves the outer angles."""
    return 8 * float(jnp.finfo(dtype).eps) ** 0.5


def _sinusoid(value: Array, slope: Array, bend: Array, h: Array) -> _Bounded:
    return _Bounded(value, jnp.abs(slope) * h + 0.5 * jnp.abs(bend) * h * h)


class _SphericalBounds(NamedTuple):
    """Parts of the rates of one spherical joint; the first is the largest sine of its middle angle."""

    sine: Array
    inverse: _Bounded
    turns: list[tuple[_Bounded, _Bounded]]
    z: _Bounded
    dz: _Bounded
    ddz: _Bounded
    sign: Array


def _parts(m: BranchMotion, sin: Array, cos: Array, h: Array) -> list[_SphericalBounds]:
    """Bounds of 1 / s, of N and N', and of z with its derivatives, for both spherical joints."""
    eps = 8 * float(jnp.finfo(sin.dtype).eps)
    (y, x), (dy, dx), (ddy, ddx) = side_values(m, sin, cos)
    parts = []
    for first, sign in ((0, m.shoulder_sign), (3, m.wrist_sign)):
        s = clipped_sqrt(x[first] ** 2 + y[first] ** 2)
        off = jnp.sqrt(dx[first] ** 2 + dy[first] ** 2) * h
        off = off + 0.5 * jnp.sqrt(ddx[first] ** 2 + ddy[first] ** 2) * h * h + eps
        near = jnp.where(s > off, 1.0 / jnp.where(s > off, s - off, 1.0), _HUGE)
        at = 1.0 / jnp.maximum(s, 1.0 / _HUGE)
        turns = []
        for a in (first, first + 2):
            if a < len(y):
                n, dn, ddn = x[a] * dy[a] - y[a] * dx[a], x[a] * ddy[a] - y[a] * ddx[a], dx[a] * ddy[a] - dy[a] * ddx[a]
                rounding = eps * (jnp.abs(x[a] * dy[a]) + jnp.abs(y[a] * dx[a]))
                rate, change = _sinusoid(n, dn, ddn - n, h), _sinusoid(dn, ddn - n, dn, h)
                turns.append((rate + _Bounded(jnp.zeros_like(n), rounding), change))
        mid = first + 1
        z, dz, ddz = (
            _sinusoid(*values, h)
            for values in (
                (y[mid], dy[mid], ddy[mid]),
                (dy[mid], ddy[mid], dy[mid]),
                (ddy[mid], dy[mid], ddy[mid]),
            )
        )
        parts.append(_SphericalBounds(s + off, _Bounded(at, jnp.maximum(near - at, 0.0)), turns, z, dz, ddz, sign))
    return parts


@fused_separately
def _largest_rates(m: BranchMotion, sin: Array, cos: Array, h: Array) -> Array:
    rows = []
    for p in _parts(m, sin, cos, h):
        outer = [n.top * p.inverse.top * p.inverse.top for n, _ in p.turns]
        rows += [outer[0], p.dz.top * p.inverse.top, *outer[1:]]
    return jnp.stack(rows)


@fused_separately
def _enclose(m: BranchMotion, sin: Array, cos: Array, h: Array) -> tuple[Array, ...]:
    """The same for the angles that turn with the swivel, ``(angle, ...)``."""
    rows, parts = [], _parts(m, sin, cos, h)
    for p in parts:
        inverse2 = p.inverse * p.inverse
        two = _Bounded(jnp.full_like(h, 2.0), jnp.zeros_like(h))
        outer = [(n * inverse2, dn * inverse2 + two * (n * p.z * p.dz) * (inverse2 * inverse2)) for n, dn in p.turns]
        sign = _Bounded(-p.sign, jnp.zeros_like(p.sign))
        middle = sign * p.dz * p.inverse, sign * (p.ddz + p.z * p.dz * p.dz * inverse2) * p.inverse
        rows += [outer[0], middle, *outer[1:]]
    columns = [(f.at, g.at, f.bottom, f.top, g.off) for f, g in rows]
    sine = jnp.minimum(parts[0].sine, parts[1].sine)
    return *(jnp.stack(jnp.broadcast_arrays(*column)) for column in zip(*columns, strict=True)), sine
