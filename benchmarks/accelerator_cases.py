"""Public functions of jaxik as cases of `benchmarks.accelerator`: calls, and what two devices have to agree on.

What is compared is free of the choices that rounding may make differently: angles as sines and cosines, and of ties
between postures the cost and not the posture.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxik

DT = 0.05  # of a step of `follow` [s]
NEAR = 0.05  # size of the motion asked of it [rad]
WAYPOINTS = 32  # of the paths of `plan_batch`


@dataclass(frozen=True)
class Rows:
    """Inputs, ``(n, ...)``: targets that random postures reach, swivels, and present postures not far from them."""

    target: jaxik.Pose
    swivel: Array
    q: Array
    q_now: Array

    def __len__(self) -> int:
        return len(self.swivel)

    def __getitem__(self, rows: slice) -> "Rows":
        return Rows(*(jax.tree.map(lambda x: x[rows], x) for x in (self.target, self.swivel, self.q, self.q_now)))

    def to(self, device: jax.Device) -> "Rows":
        """Return the same on a device."""
        return Rows(*jax.device_put((self.target, self.swivel, self.q, self.q_now), device))


@dataclass(frozen=True)
class Case:
    """A public function.

    Attributes:
        name: Its name.
        call: What users call: arm and rows to a result.
        compared: Arrays ``(n, ...)`` of a result that devices have to agree on, and which rows count.
        tolerance: Largest difference of a row, for float64 and float32.
        expensive: Whether a row costs so much that the large sizes are left out.
    """

    name: str
    call: Callable[[jaxik.Arm, Rows], object]
    compared: Callable[[object], tuple[tuple[Array, ...], Array]]
    tolerance: tuple[float, float] = (1e-8, 2e-2)
    expensive: bool = False


def make_rows(arm: jaxik.Arm, count: int, seed: int = 0) -> Rows:
    """Return rows on the default device, made there, in the dtype of the arm."""
    return Rows(*_rows(arm, count, jax.random.key(seed))).to(jax.devices()[0])


def _rows(arm, count, key):
    keys = jax.random.split(key, 3)
    dtype = arm.axes.dtype
    unit = jax.random.uniform(keys[0], (count, arm.n_joints), dtype, 0.02, 0.98)
    q = arm.lower + unit * (arm.upper - arm.lower)
    swivel = jax.random.uniform(keys[1], (count,), dtype, -np.pi, np.pi)
    moved = q + NEAR * jax.random.uniform(keys[2], q.shape, dtype, -1, 1)
    target = jaxik.forward_kinematics(arm, q)
    return target, swivel, q, jnp.clip(moved, arm.lower, arm.upper)


def _all(*arrays: Array) -> tuple[tuple[Array, ...], Array]:
    return arrays, jnp.ones(len(arrays[0]), bool)


def _circle(angle: Array) -> tuple[Array, Array]:
    return jnp.cos(angle), jnp.sin(angle)


def _solved(found: jaxik.IKSolution) -> tuple[tuple[Array, ...], Array]:
    # Away from singular postures; those are compared by what they leave.
    clear = (found.status != jaxik.Status.NEAR_SINGULAR)[..., None]
    angles = tuple(jnp.where(clear, x, 0) for x in _circle(found.q))
    return _all(*angles, found.residual.position, found.residual.rotation)


def _slope(arm: jaxik.Arm, rows: Rows) -> tuple[Array, Array, Array]:
    return _gradient(rows.target.position, rows.target.rotation, rows.swivel, arm)


@jax.jit
def _gradient(position: Array, rotation: Array, swivel: Array, arm: jaxik.Arm) -> tuple[Array, Array, Array]:
    def total(position, rotation, swivel):
        found = jaxik.solve_ik(arm, jaxik.Pose(position, rotation), swivel)
        return jnp.sum(jnp.where((found.status == jaxik.Status.OK)[..., None], jnp.sin(found.q), 0))

    return jax.grad(total, argnums=(0, 1, 2))(position, rotation, swivel)


def _relative(slopes: tuple[Array, Array, Array]) -> tuple[tuple[Array, ...], Array]:
    size = 1 + jnp.abs(slopes[2])
    flat = [x.reshape(len(x), -1) for x in slopes]
    # Near a singular posture the derivative is as large as the distance is small.
    return tuple(x / size[:, None] for x in flat), size < 1e3


def paths(rows: Rows) -> tuple[jaxik.Pose, np.ndarray]:
    """Return short paths ``(n, K)`` that begin at the targets: arcs of 5 cm without rotation, and their times."""
    turn = jnp.linspace(0, np.pi, WAYPOINTS, dtype=rows.swivel.dtype)
    shift = 0.025 * jnp.stack([1 - jnp.cos(turn), jnp.sin(turn), 0 * turn], axis=-1)
    position = rows.target.position[:, None] + shift
    rotation = jnp.broadcast_to(rows.target.rotation[:, None], (*position.shape[:2], 3, 3))
    return jaxik.Pose(position, rotation), np.linspace(0, 3, WAYPOINTS)


def _planned(motion: jaxik.BatchMotion) -> tuple[tuple[Array, ...], Array]:
    moved = jnp.sum(jnp.diff(motion.q, axis=-2) ** 2, axis=(-2, -1))
    return (moved,), motion.ok


CASES = (
    Case(
        "forward_kinematics",
        lambda arm, rows: jaxik.forward_kinematics(arm, rows.q),
        lambda pose: _all(pose.position, pose.rotation),
        (1e-12, 1e-5),
    ),
    Case("jacobian", lambda arm, rows: jaxik.jacobian(arm, rows.q), _all, (1e-12, 1e-5)),
    Case("solve_ik", lambda arm, rows: jaxik.solve_ik(arm, rows.target, rows.swivel), _solved),
    Case(
        "swivel_of",
        lambda arm, rows: jaxik.swivel_of(arm, rows.q),
        lambda found: _all(*_circle(found.swivel)),
    ),
    Case(
        "swivel_arcs",
        lambda arm, rows: jaxik.swivel_arcs(arm, rows.target),
        lambda arcs: _all(arcs.width),
    ),
    Case("gradient of solve_ik", _slope, _relative),
    Case(
        "solve_nearest",
        lambda arm, rows: jaxik.solve_nearest(arm, rows.target, rows.q_now),
        lambda found: ((found.motion,), found.ok),
        expensive=True,
    ),
    Case(
        "follow",
        lambda arm, rows: jaxik.follow(arm, rows.target, rows.q_now, DT),
        lambda step: _all(step.lag.position, step.lag.rotation),
        expensive=True,
    ),
    Case(
        "solve_closest",
        lambda arm, rows: jaxik.solve_closest(arm, rows.target, rows.q_now),
        lambda found: _all(found.cost),
        expensive=True,
    ),
    Case(
        "plan_batch",
        lambda arm, rows: jaxik.plan_batch(arm, *paths(rows)),
        _planned,
        (1e-3, 1e-3),  # in single precision whatever the dtype
        expensive=True,
    ),
)
