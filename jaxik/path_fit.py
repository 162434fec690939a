"""Placing a path in an arm's reach.

1. Candidate placements: where on a shell around the shoulder, which way the drawing faces, how the hand is held, how large.
2. Each candidate is judged on a few waypoints: the share of swivels that one and the same branch can take, at its worst
   waypoint. A path is followed without changing branch where a single branch serves it throughout.
3. The largest scale at which the best candidate serves every waypoint, with some room for the elbow, wins.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxik.arm import Arm
from jaxik.errors import UnreachableError
from jaxik.ik import solve_ik
from jaxik.path import Path, Placement, as_pointing
from jaxik.targets import Pose, Target

_SCALES = 0.85 ** np.arange(16)  # from full size down to a twelfth; steps small enough to lose little size
_JUDGED = 16  # waypoints looked at per candidate
_SWIVELS = 36  # 10 degrees: room narrower than that is no room to plan in
_ROOM = 2.5 / _SWIVELS  # a placement with less than about 25 degrees of free swivel at its worst waypoint is not taken
_TRIED = 8  # best candidates that are checked at every waypoint before the scale shrinks


def fit_path(path: Path, arm: Arm, *, scale: float | None = None) -> Path:
    """The path moved, turned and, where it must be, made smaller, so that the arm can follow it.

    The drawing stays upright (against the arm's gravity) and only turns about the vertical; the same input always gives the
    same placement. For an arm with six posed joints poses become pointing targets: the roll of the tool is left free.

    Args:
        path: K poses or pointing targets.
        arm: The arm.
        scale: Only this factor on lengths; None for the largest up to 1 that fits.

    Returns:
        The path in the arm's base frame; ``.placement`` holds the transform, ``.placement.describe()`` says it in words.

    Raises:
        UnreachableError: No placement serves every waypoint with one branch.
        ValueError: Not a path.
    """
    dtype = arm.axes.dtype
    path = path.checked().astype(dtype)
    target = as_pointing(path.target) if arm.n_joints == 6 else path.target
    picked = np.unique(np.linspace(0, len(path) - 1, _JUDGED).round().astype(int))
    picked = np.concatenate([picked, np.repeat(picked[-1:], _JUDGED - len(picked))])  # one shape, one compilation
    judged = jax.tree.map(lambda x: x[picked], target)
    candidates = _candidates(arm, np.asarray(path.target.position))
    best = 0.0
    for factor in _SCALES if scale is None else (scale,):
        placements = candidates(float(factor))
        room = np.asarray(_room(arm, judged, placements))
        best = max(best, float(room.max()))
        order = np.argsort(-room, kind="stable")[:_TRIED]
        for i in order[room[order] >= _ROOM]:
            placement = jax.tree.map(lambda x, i=i: x[i], placements)
            placed = place(target, placement)
            if _serves(arm, placed):
                return Path(placed, path.time_s, placement)
    tried = f"scales {_SCALES[0]:.2f} to {_SCALES[-1]:.2f}" if scale is None else f"scale {scale:.3g}"
    raise UnreachableError(
        f"no placement of the path at {tried} leaves one branch {360 * _ROOM:.0f}° of swivel at every waypoint (best: "
        f"{360 * best:.0f}°); make the path smaller or turn the hand less"
    )


def place(target: Target, placement: Placement) -> Target:
    """A target moved by a placement."""
    p = placement.translation + placement.scale * _apply(placement.rotation, target.position)
    if isinstance(target, Pose):
        return Pose(p, placement.rotation @ target.rotation @ placement.tool)
    # A direction alone carries no frame for the tool's own turn: where the path points along z the hand takes tool's z.
    return type(target)(p, _apply(placement.rotation @ placement.tool, target.direction))


def _apply(rotation: Array, vectors: Array) -> Array:
    return jnp.einsum("ij,...j->...i", rotation, vectors)


def _candidates(arm: Arm, position: np.ndarray):
    """Function of the scale that returns stacked placements."""
    up = -np.asarray(arm.gravity, float)
    up = up / np.linalg.norm(up) if np.linalg.norm(up) > 0 else np.array([0.0, 0.0, 1.0])
    across = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    across /= np.linalg.norm(across)
    upright = np.stack([np.cross(across, up), across, up], -1)  # maps z to up
    shoulder, reach = np.asarray(arm.shoulder, float), float(arm.length)
    center = (position.min(0) + position.max(0)) / 2
    entries = []
    for yaw, radius, height, facing, tool in itertools.product(
        np.radians(np.arange(0, 360, 30)), (0.45, 0.6, 0.75), np.radians((-50, -25, 0, 25)), (0, 45, -45), _HANDS
    ):
        turn = upright @ _about_z(yaw)
        where = shoulder + reach * radius * turn @ np.array([np.cos(height), 0.0, np.sin(height)])
        rotation = upright @ _about_z(yaw + np.radians(facing))
        entries.append((rotation, where, tool))
    dtype = arm.axes.dtype
    rotation, where, tool = (jnp.asarray(np.stack(x), dtype) for x in zip(*entries, strict=True))
    middle = jnp.asarray(center, dtype)

    def at(scale: float) -> Placement:
        factor = jnp.full(len(entries), scale, dtype)
        return Placement(factor, rotation, where - scale * _apply(rotation, middle), tool)

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


@jax.jit
def _room(arm: Arm, target: Target, placements: Placement) -> Float[Array, "candidate"]:
    """Share of swivels left to the best branch at its worst waypoint."""

    def one(placement: Placement) -> Array:
        return jnp.max(jnp.min(_shares(arm, place(target, placement)), axis=0))

    return jax.lax.map(one, placements, batch_size=64)


@jax.jit
def _serves(arm: Arm, target: Target) -> Array:
    """Whether one branch has a free swivel at every waypoint."""
    return jnp.any(jnp.all(_shares(arm, target) > 0, axis=0))


def _shares(arm: Arm, target: Target) -> Float[Array, "waypoint branch"]:
    """Share of sampled swivels that each branch can take."""
    spread = jax.tree.map(lambda x: x[:, None], target)
    swivel = jnp.asarray(np.linspace(-np.pi, np.pi, _SWIVELS, endpoint=False), arm.axes.dtype)
    return jnp.mean(solve_ik(arm, spread, swivel).status == 0, axis=1, dtype=swivel.dtype)
