"""Least values of quadratic functions on the interval [-1, 1] and the square [-1, 1]²: exact, by cases."""

from typing import NamedTuple

import numpy as np


class Parabola(NamedTuple):
    """value + slope u + curve u² with u in [-1, 1]; arrays of one shape."""

    value: np.ndarray
    slope: np.ndarray
    curve: np.ndarray

    def minimum(self) -> np.ndarray:
        """Least value."""
        ends = self.value + self.curve - np.abs(self.slope)
        with np.errstate(divide="ignore", invalid="ignore"):
            bottom = self.value - self.slope * self.slope / (4 * self.curve)
        return np.where(self.curve > 0.5 * np.abs(self.slope), bottom, ends)

    def plus(self, other: "Parabola") -> "Parabola":
        """The sum."""
        return Parabola(*(a + b for a, b in zip(self, other, strict=True)))

    def negated(self) -> "Parabola":
        """The same with opposite sign."""
        return Parabola(*(-x for x in self))

    def at(self, index: np.ndarray) -> "Parabola":
        """Pick some of them."""
        return Parabola(*(x[index] for x in self))


class Quadratic2(NamedTuple):
    """constant + a u + b w + aa u² + bb w² + 2 ab u w with (u, w) in [-1, 1]²; arrays of one shape."""

    constant: np.ndarray
    a: np.ndarray
    b: np.ndarray
    aa: np.ndarray
    bb: np.ndarray
    ab: np.ndarray

    def swapped(self) -> "Quadratic2":
        """Exchange u and w."""
        return Quadratic2(self.constant, self.b, self.a, self.bb, self.aa, self.ab)

    def at(self, index: np.ndarray) -> "Quadratic2":
        """Pick some of them."""
        return Quadratic2(*(x[index] for x in self))

    def plus_u(self, f: Parabola) -> "Quadratic2":
        """Add a function of u."""
        return self._replace(constant=self.constant + f.value, a=self.a + f.slope, aa=self.aa + f.curve)

    def plus_w(self, f: Parabola) -> "Quadratic2":
        """Add a function of w."""
        return self._replace(constant=self.constant + f.value, b=self.b + f.slope, bb=self.bb + f.curve)

    def along_w(self, u: float) -> Parabola:
        """The function of w at one u."""
        return Parabola(self.constant + u * self.a + u * u * self.aa, self.b + 2 * u * self.ab, self.bb)

    def minimum(self) -> np.ndarray:
        """Least value.

        It is on one of the four edges, or inside where the Hessian is positive definite and the gradient vanishes.
        """
        swapped = self.swapped()
        edges = [f.along_w(side).minimum() for f in (self, swapped) for side in (-1.0, 1.0)]
        best = np.minimum(np.minimum(edges[0], edges[1]), np.minimum(edges[2], edges[3]))
        det = 2 * (self.aa * self.bb - self.ab * self.ab)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = (self.ab * self.b - self.bb * self.a) / det
            w = (self.ab * self.a - self.aa * self.b) / det
            inside = (det > 0) & (self.aa > 0) & (np.abs(u) <= 1) & (np.abs(w) <= 1)
            bottom = self.constant + 0.5 * (self.a * u + self.b * w)
        return np.where(inside, np.minimum(best, bottom), best)
