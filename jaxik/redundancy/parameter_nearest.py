"""The nearest posture on target of arms whose redundancy parameter is no swivel, and its derivative."""

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm
from jaxik.ik import Status, replace_bad_rows
from jaxik.numerics import tolerances
from jaxik.obstacles import least_room, meets
from jaxik.redundancy.nearness import stacked, within_a_turn
from jaxik.redundancy.posture_search import Found, Wanted, nearest_in_stages
from jaxik.redundancy.swivel import swivel_of
from jaxik.redundancy.tangent import error_and_columns, tangent
from jaxik.targets import Pose, Target

Columns = tuple[Array, ...]


def has_swivel(arm: Arm) -> bool:
    """Test for an S-R-S arm, whose redundancy parameter is the angle of the elbow on its circle."""
    return type(arm) is Arm


def check_nearest(arm: Arm, target: Target) -> None:
    """Raise an error for what only S-R-S arms can do."""
    if has_swivel(arm):
        return
    if not isinstance(target, Pose):
        raise ValueError(
            f"a {arm.kinematic_class} arm has no closed form for pointing targets, whose roll is free: expected a "
            "jaxik.Pose, got a Pointing"
        )


def nearest_by_parameter(arm: Arm, weights: Array, position: Array, directions: Array, q_now: Array) -> Columns:
    """Return the fields of :class:`jaxik.NearestSolution` for targets and postures with the batch last.

    So has the world about the arm's body, if it has one.
    """
    finite = jnp.all(jnp.isfinite(q_now), axis=0)
    now = jnp.where(finite, q_now, 0.0)
    checked = replace_bad_rows(arm, position, directions, jnp.zeros_like(position[0]))
    wanted = Wanted(checked.position, checked.directions, now, weights)
    lower, upper = arm.lower[:, None], arm.upper[:, None]
    limits = within_a_turn(now, weights, lower, upper)
    # Within limits; with a body, within limits but in collision; regardless of limits.
    stages = (limits,) if arm.surroundings is None else (limits, limits)
    keeps = (True, *(False for _ in stages))
    found = nearest_in_stages(*jax.lax.stop_gradient((arm, wanted, *stacked(*stages))), keeps)
    q = _implicit(arm, *wanted, found.q)
    bad = checked.invalid | checked.nonfinite | ~finite
    lost = found.stage == len(keeps)
    # A bad row, or a target out of reach, is no reason to move.
    stay = jnp.clip(jax.lax.stop_gradient(now), lower, upper)
    q = jnp.where(bad | lost, stay, q)
    swivel, branch = swivel_of(arm, q.T)
    moved = jnp.sum(weights[:, None] * (q - now) ** 2, axis=0)
    inside = jnp.all((found.q >= lower) & (found.q <= upper), axis=0)
    status = _status(found, inside, len(keeps))
    if arm.surroundings is not None:
        collides = (found.stage == 1) & inside & meets(arm, found.q, arm.surroundings.world)
        status = jnp.where(collides, jnp.int32(Status.COLLISION), status)
    status = jnp.where(checked.invalid, jnp.int32(Status.INVALID_TARGET), status)
    status = jnp.where(checked.nonfinite | ~finite, jnp.int32(Status.NONFINITE_INPUT), status)
    return q, status, swivel, branch, moved


def _status(found: Found, inside: Array, stages: int) -> Array:
    """:class:`Status` of the postures found: in all ranges; in reach only, within limits or not; none."""
    reasons = jnp.where(inside, jnp.int32(Status.KEEP_OUT), jnp.int32(Status.LIMITS))
    status = jnp.where(found.stage == 0, jnp.int32(Status.OK), reasons)
    return jnp.where(found.stage == stages, jnp.int32(Status.OUT_OF_REACH), status)


@jax.custom_jvp
def _implicit(arm: Arm, position: Array, directions: Array, q_now: Array, weights: Array, q: Array) -> Array:
    """The same joint angles, with the derivative that keeps them the nearest (implicit function theorem)."""
    del arm, position, directions, q_now, weights
    return q


@_implicit.defjvp
def _implicit_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    """One step of Newton's method on the conditions of a minimum under the six equations of the pose.

    Where a limit ends the interval, its joint moves with the limit, and the pose determines the others. Where an
    obstacle does, the distance from it takes the place of the limit.
    """
    *given, q = primals
    arm, position, directions, q_now, weights = given
    arm_rate, *rates = tangents[:-1]
    joints = len(q)
    (_, columns), held = error_and_columns(arm, position, directions, q), _held(arm, weights, q_now, q)
    touches = jnp.zeros(q.shape[1:], bool)
    if arm.surroundings is not None:
        touches, by_touch = _touching(arm, position, directions, q_now, weights, q)
        held = jnp.where(touches, by_touch, held)
    free = jnp.where(held, 0.0, 1.0).astype(q.dtype)
    pull = free * weights[:, None] * (q - q_now)
    gram = jnp.einsum("ain,bin,in->nab", columns, columns, free)
    multiplier = -jnp.linalg.solve(gram, jnp.einsum("ain,in->na", columns, pull)[..., None])[..., 0].T

    def conditions(given: tuple, q: Array, multiplier: Array) -> Array:
        arm, position, directions, q_now, weights = given
        error, columns = error_and_columns(arm, position, directions, q)
        steady = weights[:, None] * (q - q_now) + jnp.einsum("ain,an->in", columns, multiplier)
        lower, upper = arm.lower[:, None], arm.upper[:, None]
        beyond = q - jnp.where(q - lower < upper - q, lower, upper)
        if arm.surroundings is not None:
            beyond = jnp.where(touches, least_room(arm, q, arm.surroundings.world) / arm.length, beyond)
        return jnp.concatenate([jnp.where(held, beyond, steady), error])

    both = jnp.concatenate([q, multiplier])
    seeds = jnp.broadcast_to(jnp.eye(len(both), dtype=q.dtype)[..., None], (len(both), *both.shape))

    def moved(x: Array) -> Array:
        return conditions(tuple(given), x[:joints], x[joints:])

    matrix = jax.vmap(lambda seed: jax.jvp(moved, (both,), (seed,))[1])(seeds)
    _, rate = jax.jvp(lambda *g: conditions(g, q, multiplier), tuple(given), (arm_rate, *rates))
    system = jax.lax.stop_gradient(jnp.moveaxis(matrix, (0, 1, 2), (2, 1, 0)))
    inverse = jnp.linalg.inv(system)
    # Without a minimum, as out of reach, there is no derivative.
    inverse = jnp.where(jnp.all(jnp.isfinite(inverse), axis=(1, 2), keepdims=True), inverse, 0.0)
    return q, -jnp.einsum("nij,jn->in", inverse, rate)[:joints]


def _touching(
    arm: Arm, position: Array, directions: Array, q_now: Array, weights: Array, q: Array
) -> tuple[Array, Array]:
    """Test whether an obstacle keeps the motion from falling further, ``(n,)``; and a mask of the most moved joint."""
    along = tangent(arm, position, directions, q).direction
    size = jnp.abs(along)
    slope = jnp.abs(jnp.sum(weights[:, None] * (q - q_now) * along, axis=0))
    slack = tolerances(q.dtype).near_singular
    touches = (jnp.abs(least_room(arm, q, arm.surroundings.world)) <= slack * arm.length) & (slope > slack)
    return touches, size == jnp.max(size, axis=0)


def _held(arm: Arm, weights: Array, q_now: Array, q: Array) -> Array:
    """The joint, if any, whose limit keeps the motion from falling further, as a mask ``(joint, n)``."""
    at_limit = (q <= arm.lower[:, None]) | (q >= arm.upper[:, None])
    pull = jnp.abs(weights[:, None] * (q - q_now))
    first = jnp.argmax(jnp.where(at_limit, pull, -1.0), axis=0)
    return at_limit & (jnp.arange(len(q))[:, None] == first)
