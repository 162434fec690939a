"""What the policy's network sees of a path: the closed form itself, turned so that the present swivel is zero.

Seen so, nothing depends on where the swivel counts from, or on which of the eight branches it is: the entries of the
branch's own joints, their slopes in the swivel, how the path moves them, and their room.
"""

import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm
from jaxik.numerics import fused_separately, sincos
from jaxik.planning.fast.coarse_costs import Start
from jaxik.planning.fast.path_batch import BranchCharts, near, steps

_ROOM = 0.5  # distance from a limit beyond which it is far [rad]
_STEP = 0.05  # a linear step of usual size [rad]
_ELBOW_ROOM = 0.2  # the same of the elbow and its keep-out, in arm lengths


@fused_separately
def path_features(
    arm: Arm,
    charts: BranchCharts,
    swivel: Array,
    joints: tuple[Array, Array],
    step: Array,
    time: Array,
    weight: Array,
    start: Start,
) -> Array:
    """Features ``(features, K, B)`` of B paths at swivels ``(K, B)``.

    Args:
        arm: The arm.
        charts: Its joints along the paths.
        swivel: Where the elbow is now.
        joints: Joint angles there and their slopes in the swivel, ``(joint, K, B)`` each.
        step: What one linear step would add to the swivel, ``(K, B)`` [rad].
        time: ``(K, B)`` [s].
        weight: Of the joints' motion, ``(joint,)``.
        start: Where the arms come from.

    Returns:
        Numbers of size about one.
    """
    q, slope = joints
    sin, cos = sincos(near(swivel))
    root = jnp.sqrt(weight)[:, None, None]
    rate = 1.0 / jnp.diff(time, axis=0)
    mean = jnp.mean(rate, axis=0)
    way, across = root * steps(q), root * slope
    size = jnp.sqrt(jnp.mean(jnp.sum(way**2, axis=0) * rate, axis=0) / mean + 1e-8)
    none = jnp.zeros_like(way[:, :1])
    ahead = jnp.concatenate([way * (rate / mean), none], axis=1)
    coming = root * near(q[:, :1] - start.q[:, None]) * (start.rate / mean)
    behind = jnp.concatenate([coming, way * (rate / mean)], axis=1)
    following = jnp.concatenate([across[:, 1:], none], axis=1)
    limits = jnp.concatenate([arm.upper[:, None, None] - q, q - arm.lower[:, None, None]])
    single = [
        jnp.sin(charts.elbow),
        jnp.cos(charts.elbow),
        jnp.arcsinh(jnp.sum(across * ahead, axis=0) / size),
        jnp.arcsinh(jnp.sum(across * behind, axis=0) / size),
        jnp.log1p(jnp.sum(across**2, axis=0)),
        jnp.arcsinh(jnp.sum(across * following, axis=0)),
        jnp.broadcast_to(jnp.log(size), swivel.shape),
        jnp.arcsinh(step / _STEP),
        jnp.concatenate([jnp.broadcast_to(jnp.arcsinh(start.rate / mean), swivel[:1].shape), 0.0 * swivel[1:]]),
    ]
    return jnp.concatenate(
        [
            _turned(charts.shoulder, charts.shoulder_sign, sin, cos),
            _turned(charts.wrist, charts.wrist_sign, sin, cos),
            jnp.stack(single),
            jnp.arcsinh(across),
            jnp.clip(limits / _ROOM, -1.0, 1.0),
            jnp.clip(charts.room(swivel) / (_ELBOW_ROOM * arm.length), -1.0, 1.0),
        ]
    )


def feature_count(arm: Arm) -> int:
    """How many features there are."""
    return 24 + (6 if arm.n_joints == 7 else 0) + 9 + 3 * arm.n_joints + len(arm.keep_out.offset)


def _turned(entries: Array, sign: Array, sin: Array, cos: Array) -> Array:
    """Coefficients in the angle from the present swivel, with the signs of the branch's own joints."""
    a, b, c = entries[:, 0], entries[:, 1], entries[:, 2]
    ones = jnp.ones_like(sign)
    # The middle angle's cosine is the same in both solutions.
    signs = jnp.stack([sign, sign, ones, sign, sign][: len(entries)])
    turned = jnp.stack([a, b * cos + c * sin, c * cos - b * sin], axis=1) * signs[:, None]
    return turned.reshape(-1, *sin.shape)
