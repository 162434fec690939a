"""Placement of a path in an arm's reach.

1. Candidate placements: positions on a shell around the shoulder, orientations of the drawing and of the hand, scales.
2. Each candidate is judged on a few waypoints: by the fraction of swivels that a single branch can take at its worst
   waypoint. A path is followed without a change of branch where a single branch serves it throughout.
3. The largest scale at which candidates serve every waypoint, with some room for the elbow and no joint too fast, wins;
   among its candidates the one with the least joint motion.
4. Where joints are too fast at every scale, the path's clock is slowed.

Arms without a swivel take a hundred times as long to judge a target. Of these only the candidates are judged that most
of the arm's postures are near to (:mod:`jaxik.planning.capability`), and the largest scale at which some serve every
waypoint wins at once, its clock slowed where need be: what turns the hand too fast is no smaller in a smaller drawing.
"""

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.errors import UnreachableError
from jaxik.numerics import compiled_sooner
from jaxik.obstacles import World, in_world, moves
from jaxik.paths import Path, Placement
from jaxik.planning.capability import postures_near
from jaxik.planning.lattice import best_routes, make_lattice, whole_circle
from jaxik.planning.padding import padded_problem
from jaxik.planning.postures.lattice import posture_routes
from jaxik.planning.problem import PlanningProblem, in_joint_space
from jaxik.planning.swivel_grid import feasible_shares
from jaxik.redundancy import has_swivel
from jaxik.targets import Pointing, Pose, Target

_SCALES = 0.85 ** np.arange(16)  # from full size down to a twelfth; steps small enough to lose little size
_JUDGED = 8  # waypoints per candidate
_SWIVELS = 24  # 15 degrees: room narrower than that is no room to plan in
_ROOM = 2.0 / _SWIVELS  # a placement with less than 30 degrees of free swivel at its worst waypoint is not taken
_SEARCHED = 64  # waypoints at which a candidate's joint speeds are judged
_SPEED_SHARE = 0.7  # of the joints' speed limits; the rest is for the motion between those waypoints
_TRIED = 10  # best candidates that are checked at every waypoint before the scale shrinks
_CLOCKS = 1.25 ** np.arange(11)  # the path's clock, slowed up to nine times

_POOLS = 24, 128  # for arms without a swivel: candidates judged at every scale, then where none fits at any


def fit_path(arm: Arm | ArmModel, path: Path, *, scale: float | None = None, world: World | None = None) -> Path:
    """Move and turn a path and, where necessary, shrink it, so that the arm can follow it.

    The drawing stays upright (against the arm's gravity) and only turns about the vertical; the same input always
    gives the same placement. For an arm with six posed joints poses become pointing targets: the roll of the tool is
    left free.

    Args:
        arm: The arm.
        path: K poses or pointing targets.
        scale: Only this factor on lengths; None for the largest up to 1 that fits.
        world: Obstacles at rest, for an arm with a body (:func:`jaxik.with_body`), which every waypoint keeps clear of.

    Returns:
        The path in the arm's base frame; ``.placement`` holds the transform, ``.placement.describe()`` its text.

    Raises:
        UnreachableError: No placement serves every waypoint with one branch.
        ValueError: Not a path; a world that moves, or for an arm without a body.
    """
    arm = in_world(as_arm(arm, any_class=True), world)
    if moves(arm):
        raise ValueError(f"a path is placed in a world at rest; got one with batch axes {arm.surroundings.world.batch}")
    path = jax.tree.map(np.asarray, path.checked().astype(arm.axes.dtype))
    scales = _SCALES if scale is None else (scale,)
    candidates, best, slow = _candidates(arm, path), 0.0, None
    for pool in _pools(arm, path, candidates):
        for factor in scales:
            room, served = _served(arm, path, candidates(float(factor)), pool)
            best = max(best, room)
            if placed := _best(arm, served):
                return jax.tree.map(jnp.asarray, placed)
            slow = slow or (served[0] if served else None)
    if slow is not None:  # in reach, but too fast at every scale; where no clock will do, the plan reports why
        return jax.tree.map(jnp.asarray, _Pace(arm, slow).slowed()[-1])
    tried = f"scales {_SCALES[0]:.2f} to {_SCALES[-1]:.2f}" if scale is None else f"scale {scale:.3g}"
    raise UnreachableError(
        f"no placement at {tried} keeps {360 * _ROOM:.0f}° of feasible swivel in a single branch at every waypoint "
        f"(best: {360 * best:.0f}°); make the path smaller or turn the hand less"
    )


def _pools(arm: Arm, path: Path, candidates: Callable[[float], Placement]) -> list[Any]:
    """Candidates to judge at all scales, then others where none of them fits."""
    if has_swivel(arm):
        return [slice(None)]
    few, position = jax.tree.map(lambda x: x[_spaced(len(path), 3)], path.target), np.asarray(path.target.position)
    middle = np.broadcast_to((position.min(0) + position.max(0)) / 2, few.position.shape)
    near = postures_near(arm, place(arm, replace(few, position=middle), candidates(1.0))).min(axis=-1)
    order = np.argsort(-near, kind="stable")
    return [order[low:high] for low, high in zip((0, *_POOLS), _POOLS, strict=False)]


def _served(arm: Arm, path: Path, placements: Placement, pool: Any) -> tuple[float, list[Path]]:
    """The most room found, and the path in the best placements of a pool that serve every waypoint."""
    placements = jax.tree.map(lambda x: x[pool], placements)
    room = _room(arm, jax.tree.map(lambda x: x[_spaced(len(path), _JUDGED)], path.target), placements)
    order = np.argsort(-room, kind="stable")
    if not has_swivel(arm):  # the best of each orientation of the hand, whose motions differ most
        hands = placements.tool[order].reshape(len(order), -1)
        order = order[np.sort(np.unique(hands, axis=0, return_index=True)[1])]
    served = []
    for i in order[:_TRIED][room[order[:_TRIED]] >= _ROOM]:
        placement = jax.tree.map(lambda x, i=i: x[i], placements)
        placed = Path(place(arm, path.target, placement), path.time, placement)
        if not has_swivel(arm) or _serves(arm, placed):
            served.append(placed)
    return float(room.max(initial=0.0)), served


def _serves(arm: Arm, path: Path) -> bool:
    """Test whether a single branch serves every waypoint."""
    return bool(feasible_shares(arm, path.target, _SWIVELS).min(axis=0).max() > 0)


def _best(arm: Arm, served: list[Path]) -> Path | None:
    """The path among placements at one scale that no joint is too fast on, or least slowed, with the least motion."""
    if has_swivel(arm):
        motion, placed = min(((_Pace(arm, path).motion(), path) for path in served), key=_first, default=(np.inf, None))
        return placed if np.isfinite(motion) else None
    slowed = sorted((_Pace(arm, path).slowed() for path in served), key=lambda entry: entry[:2])
    return next((path for _, motion, path in slowed if np.isfinite(motion) and _serves(arm, path)), None)


def _first(entry: tuple[float, Path]) -> float:
    return entry[0]


def place(arm: Arm, target: Target, placement: Placement) -> Target:
    """Return targets moved by placements, as targets that the arm takes.

    Args:
        arm: The arm; with six posed joints poses become pointing targets.
        target: K targets.
        placement: The transforms ``(*batch,)``, as host arrays.

    Returns:
        The same targets in the arm's base frame, ``(*batch, K)``, as host arrays.
    """
    scale, turn = np.asarray(placement.scale)[..., None, None], placement.rotation[..., None, :, :]
    p = placement.translation[..., None, :] + scale * _apply(turn, target.position)
    if isinstance(target, Pointing):  # its direction is the hand's: the placement's tool rotation does not apply
        return Pointing(p, _apply(turn, target.direction))
    pose = Pose(p, turn @ target.rotation @ placement.tool[..., None, :, :])
    return pose.pointing() if arm.n_joints == 6 else pose


def _apply(rotation: Any, vectors: Any) -> Any:
    return (rotation @ vectors[..., None])[..., 0]


def _candidates(arm: Arm, path: Path) -> Callable[[float], Placement]:
    """Return a function of the scale that returns stacked placements."""
    position = np.asarray(path.target.position)
    hands = (np.eye(3),) if isinstance(path.target, Pointing) else _HANDS
    up = -np.asarray(arm.gravity, float)
    up = up / np.linalg.norm(up) if np.linalg.norm(up) > 0 else np.array([0.0, 0.0, 1.0])
    across = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    across /= np.linalg.norm(across)
    upright = np.stack([np.cross(across, up), across, up], -1)  # maps z to up
    shoulder, reach = np.asarray(arm.shoulder, float), float(arm.length)
    center = (position.min(0) + position.max(0)) / 2
    entries = []
    for yaw, radius, height, facing, tool in itertools.product(
        np.radians(np.arange(0, 360, 45)), (0.45, 0.6, 0.75), np.radians((-50, -25, 0, 25)), (0, 45, -45), hands
    ):
        turn = upright @ _about_z(yaw)
        where = shoulder + reach * radius * turn @ np.array([np.cos(height), 0.0, np.sin(height)])
        rotation = upright @ _about_z(yaw + np.radians(facing))
        entries.append((rotation, where, tool))
    dtype = arm.axes.dtype
    rotation, where, tool = (np.stack(x).astype(dtype) for x in zip(*entries, strict=True))
    middle = center.astype(dtype)

    def at(scale: float) -> Placement:
        moved = (where - scale * _apply(rotation, middle)).astype(dtype)
        rows: Any = np.full(len(entries), scale, dtype), rotation, moved, tool, np.ones(len(entries), dtype)
        return Placement(*rows)

    return at


def _about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _hand(pitch_deg: float) -> np.ndarray:
    """Tool frame whose z points ahead (x), dipped by a pitch, and whose y stays level."""
    c, s = np.cos(np.radians(pitch_deg)), np.sin(np.radians(pitch_deg))
    z = np.array([c, 0.0, -s])
    y = np.array([0.0, 1.0, 0.0])
    return np.stack([np.cross(y, z), y, z], -1)


_HANDS = tuple(_hand(pitch) for pitch in (0.0, 45.0, 90.0))  # ahead, dipped, straight down


def _room(arm: Arm, target: Target, placements: Placement) -> np.ndarray:
    """Fraction of swivels that the best branch can take at its worst waypoint, ``(candidate,)``."""
    placed = place(arm, target, placements)
    count = placed.position.shape[:2]
    distance = np.linalg.norm(placed.position - np.asarray(arm.shoulder), axis=-1)
    far = distance.max(axis=-1) > float(arm.length)
    near = np.flatnonzero(~far)
    room = np.zeros(count[0])
    if len(near):
        flat = jax.tree.map(lambda x: x[near].reshape(-1, *x.shape[2:]), placed)
        room[near] = feasible_shares(arm, flat, _SWIVELS).reshape(len(near), count[1], -1).min(axis=1).max(axis=-1)
    return room


class _Pace:
    """Joint speeds of a coarse reading of a path."""

    def __init__(self, arm: Arm, path: Path) -> None:
        index = _spaced(len(path), _SEARCHED)
        few = jax.tree.map(lambda x: x[index], Path(path.target, path.time))
        self._path, self._problem = path, padded_problem(arm, few, _SEARCHED)

    def motion(self, clock: float = 1.0) -> float:
        """Least joint motion along the path on a slower clock, infinite where joints would be too fast."""
        time = np.asarray(clock * self._problem.time, self._problem.time.dtype)
        least = float(_lattice_motion(self._problem._replace(time=time)))
        return float(f"{least:.5g}")  # placements that differ by a symmetry tie: the first wins

    def slowed(self) -> tuple[float, float, Path]:
        """The fastest clock that no joint is too fast on, the motion, and the path on it; where none will do, as is."""
        if np.isfinite(motion := self.motion()):
            return 1.0, motion, self._path
        fast, slow, least = 0, len(_CLOCKS) - 1, self.motion(_CLOCKS[-1])
        if not np.isfinite(least):
            return 1.0, np.inf, self._path
        while slow - fast > 1:
            middle = (fast + slow) // 2
            if np.isfinite(motion := self.motion(_CLOCKS[middle])):
                slow, least = middle, motion
            else:
                fast = middle
        clock, path = np.asarray(_CLOCKS[slow], self._path.time.dtype), self._path
        placement = path.placement and replace(path.placement, clock=clock)
        return float(clock), least, replace(path, time=clock * path.time, placement=placement)


@compiled_sooner
def _lattice_motion(problem: PlanningProblem) -> Array:
    arm, dtype = problem.arm, problem.time.dtype
    if in_joint_space(arm):
        slower = replace(arm, velocity_limit=_SPEED_SHARE * arm.velocity_limit)
        return posture_routes(problem._replace(motion=problem.motion._replace(arm=slower))).cost.min()
    center = whole_circle(arm, problem.time)
    lattice = make_lattice(problem.motion, problem.arcs, center, jnp.asarray(2 * jnp.pi, dtype))
    node, weights = jnp.zeros(lattice.swivel.shape, dtype), jnp.ones_like(arm.velocity_limit)
    limit = jnp.asarray(_SPEED_SHARE, dtype) * arm.velocity_limit
    return best_routes(lattice, node, None, problem.durations, weights, limit, arm.turning).cost.min()


def _spaced(total: int, count: int) -> np.ndarray:
    """At most ``count`` of the waypoints, evenly spaced."""
    return np.unique(np.linspace(0, total - 1, min(count, total)).round().astype(int))
