"""References of the swivel angle: two ways to choose its zero on the elbow's circle, as data of the arm.

A reference gives, for the unit vector n from shoulder to wrist, the zero direction r on the circle and b, the direction
at +90 degrees. No continuous choice exists on the whole sphere of n (hairy ball theorem), so each has a singular set;
put it where the wrist never goes.
"""

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxik.numerics import Tolerances, vec3


def _kind(name: str) -> Any:
    """Return a field that is constant in the class and part of its tree structure.

    JAX 0.10 takes the tree structures of two dataclasses with the same number of fields for equal. Without this mark
    the program compiled for one reference would now and then run for the other.
    """
    return field(default=name, repr=False, metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PaperReference:
    """The paper's basis, eqs. (21)-(27): r = axis × n, b = r × n, both normalized.

    With the axis along z, r = (-n_y, n_x, 0), and the swivel is exactly the paper's t in eq. (37). The reference is
    singular for a wrist anywhere on the line through the shoulder along ``axis``, which includes an arm hanging down.

    Attributes:
        axis: Unit vector in the base frame, ``(3,)``.
        fallback: Unit vector across the axis, ``(3,)``; projected onto the circle's plane it is r on the singular line.
        kind: Mark of the class, ``"paper"``.
    """

    axis: Float[Array, "3"]
    fallback: Float[Array, "3"]
    kind: str = _kind("paper")

    def vectors(self) -> tuple[Array, Array]:
        """Return the two unit vectors that define the reference, the singular direction first."""
        return self.axis, self.fallback

    @property
    def sense(self) -> float:
        """Sense of rotation about n in which the swivel grows: -1, left-handed."""
        return -1.0

    def zero_direction(self, n: Array, tol: Tolerances) -> tuple[Array, Array]:
        """Return the zero direction of the swivel, and the squared sine of n to the singular line.

        Args:
            n: Unit vectors from shoulder to wrist, ``(3, ...)``.
            tol: Thresholds of the dtype.

        Returns:
            Unit vectors r, ``(3, ...)``, and the squared sines, ``(...)``.
        """
        # n less the nearer end of the axis has the same product and keeps its digits near the line, where r has to be
        # perpendicular to n to rounding too.
        end = jnp.where(vec3.dot(self.axis, n) < 0.0, -1.0, 1.0).astype(n.dtype) * self.axis
        raw = vec3.cross(self.axis, n - end)
        size2 = vec3.dot(raw, raw)
        singular = size2 <= tol.singular**2
        instead = vec3.project_out(self.fallback, n)
        # A bound, not a placeholder: see clipped_sqrt.
        unit = [v / jnp.sqrt(jnp.maximum(vec3.dot(v, v), tol.singular**2)) for v in (instead, raw)]
        return jnp.where(singular, *unit), size2


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class StereographicReference:
    """Elias and Wen's reference: k = (n - pole) × zero, r = k × n normalized, b = n × r.

    It is computed as the reflection of ``zero`` in the plane that exchanges ``pole`` and n, the same vector with less
    cancellation near the pole: r = zero - 2 m (m·zero) / (m·m) with m = n - pole. The reference is singular for
    n = pole only, a half-line.

    Attributes:
        pole: Unit vector e_t, ``(3,)``, the direction in which the wrist never lies.
        zero: Unit vector e_r perpendicular to it, ``(3,)``.
        kind: Mark of the class, ``"stereographic"``.

    References:
        A. Elias and J. T. Wen, "Redundancy parameterization and inverse kinematics of 7-DOF revolute manipulators",
        2024, with the sense of rotation about n fixed here as right-handed.
    """

    pole: Float[Array, "3"]
    zero: Float[Array, "3"]
    kind: str = _kind("stereographic")

    def vectors(self) -> tuple[Array, Array]:
        """Return the two unit vectors that define the reference, the singular direction first."""
        return self.pole, self.zero

    @property
    def sense(self) -> float:
        """Sense of rotation about n in which the swivel grows: +1, right-handed."""
        return 1.0

    def zero_direction(self, n: Array, tol: Tolerances) -> tuple[Array, Array]:
        """Return the zero direction of the swivel, and the squared chord from the pole to n.

        Args:
            n: Unit vectors from shoulder to wrist, ``(3, ...)``.
            tol: Thresholds of the dtype.

        Returns:
            Unit vectors r, ``(3, ...)``, and the squared chords, ``(...)``.
        """
        # The mirror plane contains n + pole. Near the pole the part of m along it is all rounding, which would tilt r
        # out of the circle's plane; the correction matters only there, so 4 stands for |n + pole|².
        m, total = n - self.pole, n + self.pole
        m = m - (0.25 * vec3.dot(m, total)) * total
        size2 = vec3.dot(m, m)
        singular = size2 <= tol.singular**2
        factor = 2.0 * vec3.dot(m, self.zero) / jnp.where(singular, 1.0, size2)
        r = jnp.where(singular, vec3.project_out(self.zero, n), self.zero - factor * m)
        return r, size2


SwivelReference = PaperReference | StereographicReference
