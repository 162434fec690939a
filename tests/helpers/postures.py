"""Targets for the solver's tests: random, near and at singular postures, and motions through them."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxik import (
    Arm,
    HalfSpaces,
    PaperReference,
    Pointing,
    Pose,
    forward_kinematics,
    joint_positions,
    solve_ik,
    swivel_of,
)
from tests.helpers.arms import ALL_PRESETS, random_arm, random_rotation

FREE = 200 * np.pi


def quick(*names, slow=()):
    """Test parameters of which some wait for the whole suite: every new kind of arm is compiled anew, for seconds."""
    return [*names, *(pytest.param(name, marks=pytest.mark.slow) for name in slow)]


# Every kind of member: both numbers of joints, both references, offset and skew axes or straight links.
SAMPLE_ARMS = {
    "paper_arm": lambda: free(ALL_PRESETS["paper_arm"]().arm),
    "meccanoid_left": lambda: free(ALL_PRESETS["meccanoid_left"]().arm),
    "iiwa14": lambda: free(ALL_PRESETS["iiwa14"]().arm),
    "general_7": lambda: random_arm(11, reference="stereographic"),
    "general_7_paper": lambda: random_arm(12, reference="paper"),
    "general_6": lambda: random_arm(13, 6, reference="stereographic"),
    "straight_links_7": lambda: random_arm(14, offset=False, reference="paper"),
}


def free(arm: Arm) -> Arm:
    """The arm without limits and keep-out, so that the status speaks of geometry alone."""
    return dataclasses.replace(
        arm,
        lower=jnp.full_like(arm.lower, -FREE),
        upper=jnp.full_like(arm.upper, FREE),
        keep_out=HalfSpaces(arm.keep_out.normal[:0], arm.keep_out.offset[:0]),
    )


def target_of(arm: Arm, pose: Pose) -> Pose | Pointing:
    """What an arm is asked in order to reach a pose: a 6-joint one only points."""
    return pose if arm.n_joints == 7 else Pointing(pose.position, pose.rotation[..., 2])


def posed(arm: Arm, q) -> tuple[Pose | Pointing, jax.Array]:
    """Target and swivel of joint vectors: smooth functions of q that solve_ik inverts."""
    return target_of(arm, forward_kinematics(arm, q)), swivel_of(arm, q)[0]


def moved(target: Pose | Pointing, velocity, angular, time):
    """The target after moving for a time, to first order: position and orientation."""
    turn = time * jax.vmap(lambda w: jnp.cross(w, jnp.eye(3)).T)(jnp.asarray(angular))
    if isinstance(target, Pose):
        return Pose(target.position + time * velocity, target.rotation + turn @ target.rotation)
    return Pointing(
        target.position + time * velocity, target.direction + jnp.einsum("nij,nj->ni", turn, target.direction)
    )


def orientation_of(target: Pose | Pointing) -> np.ndarray:
    return np.asarray(target.rotation if isinstance(target, Pose) else target.direction)


def at_wrist(arm: Arm, n: np.ndarray, distance: np.ndarray, rotations: np.ndarray) -> Pose | Pointing:
    """Targets that put the wrist at a distance from the shoulder in directions n, hand turned by ``rotations``."""
    offset = np.asarray(arm.tool_rotation).T @ np.asarray(arm.tool_position - arm.wrist)
    position = np.asarray(arm.shoulder) + n * distance[:, None] + rotations @ offset
    return target_of(arm, Pose(jnp.asarray(position), jnp.asarray(rotations)))


def reach_limits(arm: Arm) -> tuple[float, float]:
    """Least and greatest distance from shoulder to wrist."""
    a4, u, v = (np.asarray(x, np.float64) for x in (arm.axes[3], arm.elbow - arm.shoulder, arm.wrist - arm.elbow))
    skew = (u + v) @ a4
    upper, fore = (np.linalg.norm(x - (x @ a4) * a4) for x in (u, v))
    return float(np.hypot(upper - fore, skew)), float(np.hypot(upper + fore, skew))


def middle_offsets(arm: Arm) -> tuple[jax.Array, jax.Array, jax.Array]:
    """delta of the shoulder triple, q4 at full stretch, delta of the wrist triple."""
    a1, a2, a3, a4, a5, a6 = arm.axes[:6]
    a7 = arm.axes[6] if arm.n_joints == 7 else arm.tool_rotation[:, 2]
    u, v = arm.elbow - arm.shoulder, arm.wrist - arm.elbow
    straight = jnp.arctan2(u @ jnp.cross(a4, v), u @ v - (u @ a4) * (v @ a4))
    shoulder, wrist = (jnp.arctan2(c @ jnp.cross(b, a), c @ a) for a, b, c in ((a1, a2, a3), (a5, a6, a7)))
    return shoulder, straight, wrist


def random_rotations(rng: np.random.Generator, count: int) -> np.ndarray:
    return np.stack([random_rotation(rng) for _ in range(count)])


def random_units(rng: np.random.Generator, count: int) -> np.ndarray:
    v = rng.normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def distances(arm: Arm, q: jax.Array) -> jax.Array:
    """How far postures are from each singular set: sines of elbow and triples and the reference's, ``(4, *batch)``."""
    shoulder, straight, wrist = middle_offsets(arm)
    points = joint_positions(arm, q)
    line = points[..., 2, :] - points[..., 0, :]
    n = line / jnp.linalg.norm(line, axis=-1, keepdims=True)
    first = arm.reference.vectors()[0]
    from_line = jnp.cross(first, n) if isinstance(arm.reference, PaperReference) else n - first
    sines = [jnp.sin(q[..., 3] - straight), jnp.sin(q[..., 1] + shoulder), jnp.sin(q[..., 5] + wrist)]
    return jnp.abs(jnp.stack([*sines, jnp.linalg.norm(from_line, axis=-1)]))


def turns_apart(a, b):
    """Difference of angles modulo a turn, in [0, pi]."""
    turn = jnp.asarray(2 * np.pi, jnp.result_type(a, b))
    off = (a - b) / turn
    return jnp.abs(off - jnp.round(off)) * turn


# By the code generator that readers have, whatever the test run's own is: last bits depend on it.
@functools.partial(jax.jit, compiler_options={"xla_cpu_use_fusion_emitters": True})
def value_and_gradients(arm, position, orientation, swivel, weights):
    """Solution, and gradients of a weighted sum of everything it says."""

    def loss(arm, position, orientation, swivel):
        make = Pose if orientation.ndim == 3 else Pointing
        sol = solve_ik(arm, make(position, orientation), swivel)
        return jnp.sum(sol.q * weights), sol

    (_, sol), gradients = jax.value_and_grad(loss, argnums=(0, 1, 2, 3), has_aux=True)(
        arm, position, orientation, swivel
    )
    return sol, gradients[0], gradients[1:]
