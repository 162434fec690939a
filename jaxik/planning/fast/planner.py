"""The fast planner: motions of many paths at once, in single precision, without a proof.

1. A coarse search finds the basins that a path may lead to, Gauss-Newton steps descend in them, knot by knot, and the
   best candidate goes on (:mod:`jaxik.planning.fast.candidates`).
2. A correction, if any, improves the candidate's swivels: the place of a learned policy.
3. Between the knots the swivel is interpolated: the tool stays on its target whatever the elbow does. Where motions
   may be judged by their joint motion, the corrected motion has to be better than the one without, and all
   waypoints take one more step.
4. Waypoints outside the exact feasible arcs are repaired (:mod:`jaxik.planning.fast.repair`).
"""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Bool, Float, Int

from jaxik import energy as energies
from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.energy import Energy, JointMotion
from jaxik.numerics import cores, on_one_cpu
from jaxik.obstacles import World, in_world, moves
from jaxik.planning.fast.branch_changes import interpolate
from jaxik.planning.fast.candidates import best_candidate, best_of
from jaxik.planning.fast.coarse_costs import CELLS
from jaxik.planning.fast.knots import KNOTS, knot_index, knots_for
from jaxik.planning.fast.path_batch import Correction, PathBatch, StartPostures, SwivelPath, no_start, path_batch
from jaxik.planning.fast.repair import STEPS, Repaired, repair
from jaxik.planning.status import PlanStatus, raise_unless_planned
from jaxik.targets import Pose, Target, TargetLike, as_target, check_target

if TYPE_CHECKING:
    from typing import Self

CANDIDATES = 6  # basins tried: with 4 the loss is a third larger, 8 gain little
AT_ONCE = 128  # paths per part: 1024, which leave the processor's cache, take six times longer per path
_SIZES = (1, 4, 16, 64)  # of parts of fewer


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class BatchMotion:
    """Motions of many paths, in single precision.

    Attributes:
        swivel: Swivels, ``(*batch, K)`` [rad], without jumps of a full turn.
        branch: Branches, ``(*batch, K)``; they change where the motion passes an aligned shoulder or wrist.
        q: Joint angles, ``(*batch, K, joint)`` [rad].
        status: :class:`jaxik.PlanStatus` as integers, ``(*batch,)``. UNREACHABLE: a target is out of reach, or no
            branch found serves the path; swivel and q are nan there.
    """

    swivel: Float[Array, "*batch waypoint"]
    branch: Int[Array, "*batch waypoint"]
    q: Float[Array, "*batch waypoint joint"]
    status: Int[Array, "*batch"]

    @property
    def ok(self) -> Bool[Array, "*batch"]:
        """True where the motion keeps to targets, limits and speeds."""
        return self.status == PlanStatus.OK

    @property
    def feasible(self) -> Bool[Array, "*batch"]:
        """True where every waypoint has a feasible swivel, at any speed."""
        return self.status != PlanStatus.UNREACHABLE

    def raise_if_invalid(self) -> "Self":
        """Return the motions themselves, so that calls chain; for use outside ``jit``.

        Raises:
            UnreachableError: A path has no motion; with its row and the reason.
        """
        raise_unless_planned(self.status)
        return self


def plan_batch(
    arm: Arm | ArmModel,
    target: TargetLike,
    time: Float[ArrayLike, "*batch waypoint"],
    *,
    energy: Energy | None = None,
    start: Float[ArrayLike, "*batch joint"] | None = None,
    approach_time: Float[ArrayLike, ""] = 1.0,
    correct: Correction | None = None,
    by_motion: bool | None = None,
    knots: int | None = None,
    candidates: int = CANDIDATES,
    world: World | None = None,
) -> BatchMotion:
    """Plan motions of little energy along many paths at once, within limits and keep-out and clear of obstacles.

    About a thousandth of the time of :func:`jaxik.plan` per path, without its optimality and its proof: good guesses
    for it (``plan(..., guess=(motion.swivel, motion.branch))``), motions in a control loop, and the base of learned
    policies.

    Args:
        arm: The arm.
        target: K targets per path, leading axes ``(*batch, K)``.
        time: Increasing times, ``(*batch, K)`` [s].
        energy: Energy to minimize; None for :func:`jaxik.energy.joint_motion`. Of another energy the planner sees the
            part that is joint motion, or plain joint motion where it has none.
        start: Postures that the arms come from, ``(*batch, joint)`` [rad].
        approach_time: Time for the approach from them [s].
        correct: Function of a :class:`jaxik.planning.fast.PathBatch` and its :class:`jaxik.planning.fast.Candidate`
            that returns better swivels at the knots, ``(K, B)`` [rad]: a pytree, such as a network's bound method, or a
            plain function.
        by_motion: True to judge motions by their joint motion: a correction is kept only where it lowers it, and
            repaired paths are refined. None: True where the energy is joint motion alone.
        knots: Waypoints at which the planner decides; None for one per 0.3 of the arm's length or radian of the longest
            path, rounded up to 16, 32, 64 or 128, and for 16 inside a ``jit`` of yours.
        candidates: Basins that are tried, at most 16: fewer are faster, more miss fewer good ones.
        world: Obstacles, for an arm with a body (:func:`jaxik.with_body`), which the waypoints keep clear of to single
            precision; batch axes that broadcast to ``(*batch, K)`` are one world per waypoint.

    Returns:
        The motions, in single precision. In real time take the first waypoint and plan again.

    Raises:
        ValueError: Shapes of target, time, start and world that do not fit together; a world for an arm without a body.

    **Differentiability**: none intended; see :func:`jaxik.least_energy_motion`.
    """
    arm, target = in_world(as_arm(arm), world), as_target(target)
    given = arm, target, time, energy, start, approach_time, correct
    traced = any(isinstance(x, Tracer) for x in jax.tree.leaves(given))
    arm = arm.astype(jnp.float32)
    batch = np.shape(time)[:-1]
    target = _checked(arm, target, np.shape(time), start, approach_time)
    if not 1 <= candidates <= CELLS or (knots is not None and knots < 1):
        raise ValueError(f"expected 1 to {CELLS} candidates and at least one knot; got {candidates} and {knots}")
    knots = (KNOTS if traced else knots_for(arm, target)) if knots is None else knots
    energy = energies.joint_motion() if energy is None else energy
    if by_motion is None:
        by_motion = all(isinstance(term, JointMotion) for term in energy.terms)
    options = _Options(min(knots, np.shape(time)[-1]), candidates, by_motion)
    if correct is not None and jax.tree_util.all_leaves([correct]):
        correct = jax.tree_util.Partial(correct)  # a plain function is no pytree
    rows = _rows(arm, target, time, start, approach_time)
    if moves(arm):
        arm = _in_world_of(arm, World())  # each part has the worlds of its paths
    planned = _in_parts(arm, motion_weights(arm, energy), correct, rows, options, traced)
    return jax.tree.map(lambda x: x.reshape(*batch, *x.shape[1:]), planned)


class _Options(NamedTuple):
    """Settings that a program is compiled for."""

    knots: int
    candidates: int
    by_motion: bool


class _Rows(NamedTuple):
    """Paths with flat leading axes: targets and times, start postures and rates of the approaches, moving worlds."""

    target: Target
    time: Array
    q: Array
    rate: Array
    world: World | None


def motion_weights(arm: Arm, energy: Energy) -> Array:
    """Return the weights of the joints' squared motion in an energy, ones where it has none, ``(joint,)``."""
    weights = energy.motion_weights(arm)
    return jnp.where(jnp.max(weights) > 0, weights, jnp.ones_like(weights)).astype(jnp.float32)


def _checked(
    arm: Arm, target: Target, time: tuple[int, ...], start: ArrayLike | None, approach_time: ArrayLike
) -> Target:
    """Return the target as arrays of one dtype, shapes checked."""
    target, _ = check_target(arm, target)
    turned = target.rotation.shape[:-2] if isinstance(target, Pose) else target.direction.shape[:-1]
    if not time or not target.position.shape[:-1] == turned == time:
        raise ValueError(
            f"expected time (*batch, K) and targets of the same leading axes; got {time}, positions "
            f"{target.position.shape} and orientations with {turned}"
        )
    if start is not None and np.shape(start) != (*time[:-1], arm.n_joints):
        raise ValueError(f"expected start of shape {(*time[:-1], arm.n_joints)}; got {np.shape(start)}")
    worlds = () if arm.surroundings is None else arm.surroundings.world.batch
    if len(worlds) > len(time) or any(a not in (1, b) for a, b in zip(worlds[::-1], time[::-1], strict=False)):
        raise ValueError(f"expected worlds whose axes broadcast to time's, {time}; got {worlds}")
    if np.shape(approach_time):
        raise ValueError(f"expected one approach_time for all paths; got shape {np.shape(approach_time)}")
    return target


def _rows(arm: Arm, target: Target, time: ArrayLike, start: ArrayLike | None, approach_time: ArrayLike) -> _Rows:
    """The paths in single precision with one leading axis."""
    leading = np.ndim(time) - 1
    count = math.prod(np.shape(time)[:-1])
    flat = lambda x: jnp.asarray(x, jnp.float32).reshape(count, *np.shape(x)[leading:])  # noqa: E731
    since: Any = time
    times = flat(since - since[..., :1])  # before rounding, which takes the steps of time stamps since 1970
    none, world = no_start(arm, len(times)), None
    if moves(arm):
        given = arm.surroundings.world
        spread = lambda x: jnp.broadcast_to(x, (*np.shape(time), *x.shape[len(given.batch) :]))  # noqa: E731
        world = jax.tree.map(lambda x: flat(spread(x)), given)
    if start is None:
        return _Rows(jax.tree.map(flat, target), times, none.q.T, none.rate, world)
    rate = jnp.ones(len(times), jnp.float32) / jnp.asarray(approach_time, jnp.float32)
    return _Rows(jax.tree.map(flat, target), times, flat(start), rate, world)


def _in_world_of(arm: Arm, world: World) -> Arm:
    return replace(arm, surroundings=replace(arm.surroundings, world=world))


def _in_parts(arm: Arm, weights: Array, correct: Any, rows: _Rows, options: _Options, traced: bool) -> BatchMotion:
    """Motions of all rows in parts of one size: each core works on parts of its own, or they take turns."""
    count = len(rows.time)
    if count == 0:
        q = jnp.zeros((*rows.time.shape, arm.n_joints), jnp.float32)
        return BatchMotion(rows.time, jnp.zeros(rows.time.shape, jnp.int32), q, jnp.zeros(0, jnp.int32))
    size = _part_size(count, traced)
    first = np.minimum(np.arange(0, count, size), count - size)  # the last part begins within the one before
    if not traced and on_one_cpu(rows):
        rows = jax.tree.map(np.asarray, rows)  # whose slices need no program

    def part(at: Any) -> BatchMotion:
        if isinstance(rows.time, np.ndarray):
            some = jax.tree.map(lambda x: x[at : at + size], rows)
        else:
            some = jax.tree.map(lambda x: jax.lax.dynamic_slice_in_dim(x, at, size), rows)
        return _part(arm, weights, correct, some, options=options)

    if traced:
        stacked = jax.lax.map(part, jnp.asarray(first))
        parts = [jax.tree.map(lambda x, i=i: x[i], stacked) for i in range(len(first))]
    else:
        with ThreadPoolExecutor(min(cores(), len(first))) as pool:
            parts = list(pool.map(lambda at: jax.block_until_ready(part(at)), first))
    if len(parts) == 1:
        return parts[0]
    last = jax.tree.map(lambda x: x[len(first) * size - count :], parts[-1])
    return jax.tree.map(lambda *x: jnp.concatenate(x), *parts[:-1], last)


def _part_size(count: int, traced: bool) -> int:
    """Return the number of paths per part.

    One of a few sizes, so that batches of any number of paths share their programs; a trace ends in a program of its
    own, whose parts are as large as they may be.
    """
    if traced:
        return min(AT_ONCE, count)
    return max(size for size in (*_SIZES, AT_ONCE) if size <= min(AT_ONCE, count))


@partial(jax.jit, static_argnames="options")
def _part(arm: Arm, weights: Array, correct: Any, rows: _Rows, *, options: _Options) -> BatchMotion:
    """Motions of some rows."""
    if rows.world is not None:
        arm = _in_world_of(arm, jax.tree.map(lambda x: jnp.swapaxes(x, 0, 1), rows.world))
    batch = path_batch(arm, rows.target, rows.time, weights, StartPostures(rows.q.T, rows.rate))
    planned = plan_paths(batch, correct, options)
    swivel, branch = planned.path
    status = jnp.where(batch.too_fast(planned.q), jnp.int32(PlanStatus.TOO_FAST), jnp.int32(PlanStatus.OK))
    status = jnp.where(planned.feasible, status, jnp.int32(PlanStatus.UNREACHABLE))
    return BatchMotion(swivel.T, branch.T, jnp.transpose(planned.q, (2, 1, 0)), status)


def plan_paths(batch: PathBatch, correct: Correction | None, options: _Options) -> Repaired:
    """Plan the paths of a batch at once."""
    index = knot_index(len(batch.time), options.knots)
    at_knots = batch.waypoints(index)
    candidate = best_candidate(at_knots, options.candidates)
    between = partial(interpolate, batch.motion, index)
    proposed = candidate.proposal if correct is None else correct(at_knots, candidate)
    if proposed.shape != candidate.swivel.shape:
        raise ValueError(f"expected correct to return swivels {candidate.swivel.shape}; got {proposed.shape}")
    path = between(SwivelPath(proposed, candidate.branch))
    if options.by_motion:
        alternatives = [between(candidate.one_branch)]
        if correct is not None:
            alternatives.insert(0, between(SwivelPath(candidate.proposal, candidate.branch)))
        path = best_of(batch, (path, *alternatives))

    def others(row: Array, number: Array) -> SwivelPath:
        """One more motion of a path: the best in one branch, then all candidates."""
        pick = lambda x, xs: jnp.concatenate([x[None], xs])[number, :, row, None]  # noqa: E731
        one = interpolate(batch.motion.at(row[None]), index, jax.tree.map(pick, candidate.one_branch, candidate.all))
        return SwivelPath(one.swivel[:, 0], one.branch[:, 0])

    return repair(batch, path, others, options.candidates + 1, STEPS if options.by_motion else 0)
