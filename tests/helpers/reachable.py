"""Random targets that an arm is known to reach inside its limits and outside its keep-out."""

import dataclasses

import jax.numpy as jnp
import numpy as np

import jaxik
from jaxik.arm.arm import Arm
from jaxik.ik import arm_constants
from jaxik.targets.targets import Target


def tightened(arm: Arm, seed: int, fraction: float = 0.15) -> Arm:
    """The arm with every range narrowed to a fraction of itself, around a posture its own limits allow."""
    rng = np.random.default_rng(seed)
    lower, upper = np.asarray(arm.lower), np.asarray(arm.upper)
    while True:
        middle = rng.uniform(lower, upper)
        if outside_keep_out(arm, middle):
            break
    half = 0.5 * fraction * (upper - lower)
    return dataclasses.replace(
        arm,
        lower=jnp.asarray(np.maximum(lower, middle - half)),
        upper=jnp.asarray(np.minimum(upper, middle + half)),
    )


def outside_keep_out(arm: Arm, q: np.ndarray) -> np.ndarray:
    """Whether the elbow keeps out of every half-space."""
    elbow = np.asarray(jaxik.joint_positions(arm, q))[..., 1, :]
    return np.all(elbow @ np.asarray(arm.keep_out.normal).T <= np.asarray(arm.keep_out.offset), axis=-1)


def postures(arm: Arm, count: int, seed: int) -> np.ndarray:
    """Random joint vectors within the limits whose elbow keeps out, ``(count, n_joints)``."""
    rng = np.random.default_rng(seed)
    lower, upper = np.maximum(np.asarray(arm.lower), -7.0), np.minimum(np.asarray(arm.upper), 7.0)
    found = np.zeros((0, arm.n_joints))
    while len(found) < count:
        q = rng.uniform(lower, upper, (2 * count, arm.n_joints))
        found = np.concatenate([found, q[outside_keep_out(arm, q)]])
    return found[:count]


def target_of(arm: Arm, q: np.ndarray) -> Target:
    """The target a posture is on: a pose for seven joints, a pointing for six."""
    pose = jaxik.forward_kinematics(arm, q)
    return pose if arm.n_joints == 7 else jaxik.Pointing(pose.position, pose.rotation[..., 2])


def aligned_postures(arm, joints, straight, count, seed=0):
    """Feasible postures with middle joints at 0 (shoulder 1, wrist 5), and the elbow straight or not."""
    rng, g = np.random.default_rng(seed), arm_constants(arm)
    low, high = np.maximum(arm.lower, -3), np.minimum(arm.upper, 3)
    q = rng.uniform(low, high, (count, arm.n_joints))
    for joint in joints:
        q[:, joint] = -float((g.shoulder_delta if joint == 1 else g.wrist_delta)[0])
    if straight:
        q[:, 3] = float(g.straight[0])
    q = q[np.all((q >= arm.lower) & (q <= arm.upper), axis=1) & outside_keep_out(arm, q)]
    return np.resize(q, (count, arm.n_joints)) if len(q) else q  # one size, one program
