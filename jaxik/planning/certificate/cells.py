"""Cells: short pieces of swivel at a waypoint, on which every joint angle is nearly a straight line.

On a cell with swivel ψ = middle + half u, u in [-1, 1], joint j is center_j + slope_j u within ± error_j, for certain:
the error is bounded by the joint's second derivative, which closed form bounds on the whole cell. Cells are made so
short that the joints move little on them. Near a singular posture, where a joint turns fast in the swivel, they are
short in swivel and no longer than elsewhere in joint space.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.numerics import compiled_sooner
from jaxik.redundancy import SelfMotion, SwivelArcs

CHUNK = 8192  # cells per call of the compiled enclosure
_COARSE = 0.2  # rad of swivel; the first cells
_SHORTEST = 1e-9  # rad; a joint that is not straight on so short a cell counts as unknown
_ALIGNED = 64.0  # eps; sine of a middle angle that counts as none
_LARGEST = 1.0  # rad; an error beyond it says as little as none


class Cells(NamedTuple):
    """N cells, ordered by layer.

    Attributes:
        layer: Waypoint of each cell, ``(N,)``.
        branch: Branch of each cell, ``(N,)``.
        middle: Middle of its swivels, ``(N,)`` [rad].
        half: Half the length of its swivels, ``(N,)`` [rad].
        center: Joint angles of the line at the middle, ``(joint, N)`` [rad].
        slope: Change of the line from the middle to an end, ``(joint, N)`` [rad].
        error: Largest distance from the line, ``(joint, N)`` [rad]; infinite where nothing is known.
    """

    layer: np.ndarray
    branch: np.ndarray
    middle: np.ndarray
    half: np.ndarray
    center: np.ndarray
    slope: np.ndarray
    error: np.ndarray

    def at(self, index: np.ndarray) -> "Cells":
        """Pick some of the cells."""
        return Cells(*(x[..., index] for x in self))

    @property
    def radius(self) -> np.ndarray:
        """Largest distance of each joint from its center, ``(joint, N)`` [rad]."""
        return np.abs(self.slope) + self.error


@compiled_sooner
def _enclose(motion: SelfMotion, layer: Array, branch: Array, middle: Array, half: Array) -> Array:
    """Center, slope and error of cells, ``(3, joint, N)``."""
    dtype = motion.elbow.dtype
    middle, half = middle.astype(dtype), half.astype(dtype)
    taken = motion.at(layer).branch(branch)
    r = taken.rates(middle)
    trig = jnp.sin(middle), jnp.cos(middle)
    count = taken.sides.shape[1]
    errors = []
    for first, joints in ((0, 3), (3, count - 3)):
        opposite, adjacent = taken.sides[:, first : first + joints]
        entries = [adjacent[0], opposite[0], adjacent[1], *([adjacent[2], opposite[2]] if joints == 3 else [])]
        errors.append(_curvature_changes(jnp.stack(entries), *trig, half))
    shoulder, wrist = errors
    change = jnp.concatenate([shoulder, jnp.zeros_like(half)[None], wrist])
    change = jnp.pad(change, ((0, r.q.shape[0] - change.shape[0]), (0, 0)))
    # Half of a parabola's height is taken off its error by moving the line into its middle.
    shift = r.second * half**2 / 4
    error = jnp.abs(shift) + change * half**2 / 2
    # Rounding of the angles themselves: much where they turn fast, next to singular postures.
    error = error + 16 * jnp.finfo(error.dtype).eps * (1.0 + jnp.abs(r.first))
    known = jnp.isfinite(r.first * half) & (error < _LARGEST)
    rows = r.q + shift, r.first * half, error
    return jnp.stack([jnp.where(known, row, unknown) for row, unknown in zip(rows, (0.0, 0.0, jnp.inf), strict=True)])


def _curvature_changes(entries: Array, sin: Array, cos: Array, half: Array) -> Array:
    """Bound the change of the second derivatives of a spherical joint's angles within the cell, ``(3 or 2, N)``.

    With v = a + b cos + c sin its entries, ρ² = v0² + v1² and N = v0 v1' - v1 v0', which is again a sinusoid,
    the outer angles have φ'' = N'/ρ² - N (ρ²)'/ρ⁴ and the middle one θ'' = -z''/ρ - z z'²/ρ³.
    """
    a, b, c = entries[:, 0], entries[:, 1], entries[:, 2]
    v, dv, ddv = a + b * cos + c * sin, c * cos - b * sin, -(b * cos + c * sin)
    reach = jnp.sqrt(b * b + c * c)  # largest |v'| and |v''| anywhere
    most = jnp.abs(dv) + reach * half  # largest |v'| on the cell

    def outer(x: int, y: int) -> tuple[Array, Array]:
        constant = b[x] * c[y] - c[x] * b[y]
        n_cos, n_sin = a[x] * c[y] - a[y] * c[x], a[y] * b[x] - a[x] * b[y]
        n, dn = constant + n_cos * cos + n_sin * sin, n_sin * cos - n_cos * sin
        swing = jnp.hypot(n_cos, n_sin)
        change_dn = swing * half
        change_n = jnp.abs(dn) * half + swing * half**2 / 2
        speed = jnp.hypot(most[x], most[y])
        rho = jnp.hypot(v[x], v[y])
        rho = jnp.where(rho > _ALIGNED * jnp.finfo(rho.dtype).eps, rho, 0.0)  # any split, not the one computed
        least, longest = jnp.maximum(rho - speed * half, 0.0), rho + speed * half
        p, dp = rho * rho, 2 * (v[x] * dv[x] + v[y] * dv[y])
        bend = 2 * (speed**2 + longest * jnp.hypot(reach[x], reach[y]))  # largest |(ρ²)''|
        change_dp = bend * half
        change_p = jnp.abs(dp) * half + bend * half**2 / 2
        change_p4 = change_p * (p + longest * longest)
        first, second = dn / p, n * dp / (p * p)
        change = (change_dn + jnp.abs(first) * change_p) / least**2
        product = jnp.abs(n) * change_dp + jnp.abs(dp) * change_n + change_n * change_dp
        return change + (product + jnp.abs(second) * change_p4) / least**4, rho

    first, rho = outer(0, 1)
    z, dz, ddz = v[2], dv[2], ddv[2]
    speed = jnp.hypot(most[0], most[1])
    least, longest = jnp.maximum(rho - speed * half, 0.0), rho + speed * half
    change_rho = speed * half
    change = (reach[2] * half + jnp.abs(ddz / rho) * change_rho) / least
    change_dz2 = reach[2] * half * (jnp.abs(dz) + most[2])
    product = most[2] * half * most[2] ** 2 + jnp.abs(z) * change_dz2
    cubed = jnp.abs(z * dz * dz / rho**3) * change_rho * (rho * rho + rho * longest + longest * longest)
    middle = change + (product + cubed) / least**3
    rows = [first, middle]
    if entries.shape[0] == 5:
        rows.append(outer(3, 4)[0])
    return jnp.stack(rows)


class Enclosure(NamedTuple):
    """Encloses the joint angles of a self-motion on cells of its waypoints.

    Attributes:
        motion: The self-motion, rows ``(K,)``. All of it, so that one program serves proofs with any waypoints.
        index: Row of each layer, ``(layers,)``; None for all rows.
    """

    motion: SelfMotion
    index: np.ndarray | None = None

    def __call__(self, layer: np.ndarray, branch: np.ndarray, middle: np.ndarray, half: np.ndarray) -> Cells:
        """Return any number of cells, in calls of one size."""
        count = len(layer)
        out = np.empty((3, self.motion.arm.n_joints, count))
        for begin in range(0, count, CHUNK):
            part = slice(begin, min(begin + CHUNK, count))
            pad = (0, begin + CHUNK - part.stop)
            waypoint = layer if self.index is None else self.index[layer]
            rows = [np.pad(x[part], pad, mode="edge") for x in (waypoint, branch, middle, half)]
            got = _enclose(self.motion, *rows)
            out[..., part] = np.asarray(got)[..., : part.stop - begin]
        return Cells(layer, branch, middle, half, *out)


def cover(enclose: Enclosure, arcs: SwivelArcs, length: float) -> Cells:
    """Cover all feasible swivels of all branches by cells on which the joints move by at most ``length`` [rad]."""
    layer, branch, arc = np.nonzero(np.asarray(arcs.valid))
    start, end = (np.asarray(x, float)[layer, branch, arc] for x in (arcs.start, arcs.end))
    pieces = np.maximum(np.ceil((end - start) / _COARSE).astype(int), 1)
    which = np.repeat(np.arange(len(layer)), pieces)
    piece = np.arange(len(which)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    half = ((end - start) / pieces)[which] / 2
    cells = enclose(layer[which], branch[which], start[which] + (2 * piece + 1) * half, half)
    done = []
    while len(cells.layer):
        rough = ((cells.radius**2).sum(axis=0) > (length / 2) ** 2) & (cells.half > _SHORTEST)
        done.append(cells.at(~rough))
        cells = split(enclose, cells.at(rough))
    joined = Cells(*(np.concatenate(parts, axis=-1) for parts in zip(*done, strict=True)))
    return joined.at(np.argsort(joined.layer, kind="stable"))


def same_ends(cells: Cells) -> Cells:
    """Return cells with those of the first layer in the place of those of the last, for a closed path."""
    last = cells.layer[-1]
    ends = cells.at(cells.layer == 0)
    ends = ends._replace(layer=np.full_like(ends.layer, last))
    return Cells(*(np.concatenate(x, axis=-1) for x in zip(cells.at(cells.layer < last), ends, strict=True)))


def split(enclose: Enclosure, cells: Cells) -> Cells:
    """Halve every cell, the halves beside each other."""
    half = np.repeat(cells.half / 2, 2)
    middle = np.repeat(cells.middle, 2) + np.tile([-1.0, 1.0], len(cells.layer)) * half
    return enclose(np.repeat(cells.layer, 2), np.repeat(cells.branch, 2), middle, half)
