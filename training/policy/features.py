"""Features of a path for the policy's network: the closed form itself, turned so that the present swivel is zero.

Turned so, they depend neither on the swivel's reference nor on the branch number: the entries of the branch's own
joints, their slopes in the swivel, the motion of the path, and the room to the limits.
"""

import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm
from jaxik.numerics import fused_separately, principal, sincos
from jaxik.planning.fast import Candidate, PathBatch, steps

_ROOM = 0.5  # distance from a limit beyond which it is far [rad]
_STEP = 0.05  # a Gauss-Newton step of usual size [rad]
_ELBOW_ROOM = 0.2  # distance of the elbow from its keep-out beyond which it is far [arm lengths]


@fused_separately
def path_features(batch: PathBatch, candidate: Candidate) -> Array:
    """Return the features ``(features, K, B)`` of the best candidates of B paths, numbers of size about one."""
    arm, motion, swivel, q = batch.arm, candidate.motion, candidate.swivel, candidate.q
    root = jnp.sqrt(batch.weights)[:, None, None]
    rate, start = 1.0 / jnp.diff(batch.time, axis=0), batch.start
    mean = jnp.mean(rate, axis=0)
    moved, across = root * steps(q), root * candidate.slope
    size = jnp.sqrt(jnp.mean(jnp.sum(moved**2, axis=0) * rate, axis=0) / mean + 1e-8)
    none = jnp.zeros_like(moved[:, :1])
    after = jnp.concatenate([moved * (rate / mean), none], axis=1)
    approach = root * batch.approach(q)[:, None] * (start.rate / mean)
    before = jnp.concatenate([approach, moved * (rate / mean)], axis=1)
    next_slope = jnp.concatenate([across[:, 1:], none], axis=1)
    limits = jnp.concatenate([arm.upper[:, None, None] - q, q - arm.lower[:, None, None]])
    single = [
        jnp.sin(motion.elbow),
        jnp.cos(motion.elbow),
        jnp.arcsinh(jnp.sum(across * after, axis=0) / size),
        jnp.arcsinh(jnp.sum(across * before, axis=0) / size),
        jnp.log1p(jnp.sum(across**2, axis=0)),
        jnp.arcsinh(jnp.sum(across * next_slope, axis=0)),
        jnp.broadcast_to(jnp.log(size), swivel.shape),
        jnp.arcsinh(candidate.step / _STEP),
        jnp.concatenate([jnp.broadcast_to(jnp.arcsinh(start.rate / mean), swivel[:1].shape), 0.0 * swivel[1:]]),
    ]
    return jnp.concatenate(
        [
            _turned_entries(candidate),
            jnp.stack(single),
            jnp.arcsinh(across),
            jnp.clip(limits / _ROOM, -1.0, 1.0),
            jnp.clip(motion.keep_out_distance(swivel) / (_ELBOW_ROOM * arm.length), -1.0, 1.0),
        ]
    )


def feature_count(arm: Arm) -> int:
    """Return the number of features."""
    return 24 + (6 if arm.n_joints == 7 else 0) + 9 + 3 * arm.n_joints + len(arm.keep_out.offset)


def _turned_entries(candidate: Candidate) -> Array:
    """Entries of shoulder and wrist as functions of the angle from the present swivel, in the branch's solutions."""
    motion = candidate.motion
    sin, cos = sincos(principal(candidate.swivel))
    features = []
    for first, sign in ((0, motion.shoulder_sign), (3, motion.wrist_sign)):
        opposite, adjacent = motion.sides[:, first : first + 3]
        ones = jnp.ones_like(sign)
        # x and y of the first angle, cosine of the middle one (the same in both solutions), x and y of the third.
        rows = [(adjacent[0], sign), (opposite[0], sign), (adjacent[1], ones)]
        rows += [(adjacent[2], sign), (opposite[2], sign)] if len(opposite) == 3 else []
        for (a, b, c), factor in rows:
            features += [a * factor, (b * cos + c * sin) * factor, (c * cos - b * sin) * factor]
    return jnp.stack(features)
