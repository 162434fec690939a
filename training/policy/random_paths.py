"""Random paths to learn from, made on the device: a path depends on nothing but the seed and its row number.

A path goes through a random posture in the joint ranges; around that posture's tool pose the tool moves and turns along
a few random sine waves.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, PRNGKeyArray

from jaxik.arm import Arm
from jaxik.kinematics import forward_kinematics
from jaxik.paths import Path
from jaxik.redundancy import swivel_arcs
from jaxik.targets import Pointing, Pose, Target, matrix_from_rotation_vector

WAVES = 4  # sine waves per coordinate, of up to two periods along the path
REACH = 0.3  # largest amplitude of the tool's motion, in arm lengths
TURN = 0.7  # largest amplitude of its turning [rad]
SPEED = 0.25  # of the tool on average, in arm lengths and radians per second: every preset's joints are fast enough
ROOM = 0.5  # swivel that one branch keeps at every judged waypoint of a followable path [rad]
JUDGED = 8  # waypoints at which a path is judged


@partial(jax.jit, static_argnames="waypoints")
def random_paths(key: PRNGKeyArray, arm: Arm, rows: Int[Array, "path"], waypoints: int) -> Path:
    """Return the paths with some numbers of a seed's endless list; the arm can follow about half of them.

    Args:
        key: The seed, as a JAX key.
        arm: The arm that is to follow them; the paths have its dtype.
        rows: Their numbers, ``(n,)``.
        waypoints: Waypoints of each, K.

    Returns:
        A path with leading axes ``(n, K)``.

    **Differentiability**: none intended.
    """
    return jax.vmap(lambda row: _path(jax.random.fold_in(key, row), arm, waypoints))(rows)


@jax.jit
def followable(arm: Arm, paths: Path) -> Bool[Array, "path"]:
    """Return whether a single branch can follow each path with half a radian of swivel to spare.

    Args:
        arm: The arm.
        paths: With leading axes ``(n, K)``.

    Returns:
        ``(n,)``.
    """
    waypoints = paths.time.shape[-1]
    judged = jnp.linspace(0, waypoints - 1, min(JUDGED, waypoints)).round().astype(int)
    room = swivel_arcs(arm, jax.tree.map(lambda x: x[:, judged], paths.target)).width
    return jnp.any(jnp.min(room, axis=1) > ROOM, axis=-1)


def _path(key: PRNGKeyArray, arm: Arm, waypoints: int) -> Path:
    dtype = arm.axes.dtype
    posture, size, turn, shape = jax.random.split(key, 4)
    middle = (arm.upper + arm.lower) / 2
    half = jnp.minimum((arm.upper - arm.lower) / 2, jnp.pi)
    q = middle + 0.9 * half * jax.random.uniform(posture, middle.shape, dtype, -1.0, 1.0)
    pose = forward_kinematics(arm, q)
    wave = _waves(shape, waypoints, dtype)
    reach = REACH * arm.length * jax.random.uniform(size, (), dtype)
    vector = TURN * jax.random.uniform(turn, (), dtype) * wave[:, 3:]
    position = pose.position + reach * wave[:, :3]
    rotation = matrix_from_rotation_vector(vector) @ pose.rotation
    way = jnp.linalg.norm(jnp.diff(position, axis=0), axis=-1) / arm.length
    way = way + jnp.linalg.norm(jnp.diff(vector, axis=0), axis=-1)
    step = jnp.maximum(jnp.sum(way) / SPEED, 0.1) / (waypoints - 1)
    target: Target = Pose(position, rotation) if arm.n_joints == 7 else Pointing(position, rotation[:, :, 2])
    return Path(target, step * jnp.arange(waypoints).astype(dtype))


def _waves(key: PRNGKeyArray, waypoints: int, dtype: jnp.dtype) -> Array:
    """Six coordinates of size about 1 that are zero in the middle, ``(K, 6)``."""
    amplitude, phase, rate = jax.random.split(key, 3)
    number = jnp.arange(1, WAVES + 1).astype(dtype)[:, None]
    a = jax.random.normal(amplitude, (WAVES, 6), dtype) / number
    f = number / 2 * jax.random.uniform(rate, (WAVES, 6), dtype, 0.5, 1.0)
    p = jax.random.uniform(phase, (WAVES, 6), dtype, -jnp.pi, jnp.pi)
    time = jnp.linspace(-0.5, 0.5, waypoints, dtype=dtype)[:, None, None]
    return jnp.sum(a * (jnp.sin(2 * jnp.pi * f * time + p) - jnp.sin(p)), axis=1) / 1.5
