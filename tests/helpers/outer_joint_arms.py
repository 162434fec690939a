"""Arms with an outer joint for tests: those of the recorded file, and random members of both classes."""

import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from jaxik.arm import Arm, OuterJointArm, arm_from_axes

RECORDED = ("franka_fer", "franka_fr3", "franka_fr3v2", "xarm7_erd", "pr2_right", "tiago", "iiwa14_rosindustrial")


def recorded_arm(data_dir: Path, name: str) -> Arm:
    """An arm of arms.json, whose right angles may be printed with five digits."""
    content = json.loads((data_dir / "arms" / "arms.json").read_text(encoding="utf-8"))[name]
    lower, upper, _ = zip(*content["limits"], strict=True)
    tool = np.array(content["tool"])
    return arm_from_axes(
        content["axes"],
        content["points"],
        tool[:3, 3],
        tool[:3, :3],
        lower=[-np.inf if x is None else x for x in lower],
        upper=[np.inf if x is None else x for x in upper],
        tolerance=1e-5,
    )


def random_outer_joint_arm(seed: int, *, mirrored: bool = False, right_angles: bool = False) -> OuterJointArm:
    """A random member of a class, without limits; the two axes meet at any angle."""
    rng = np.random.default_rng(seed)
    a2 = _unit(rng.normal(size=3))
    a1, a3 = (_unit(np.cross(a2, rng.normal(size=3))) for _ in range(2))
    a4, a5, a7 = (_unit(rng.normal(size=3)) for _ in range(3))
    a6 = _unit(np.cross(a5, rng.normal(size=3)) + (0.0 if right_angles else 0.4) * a5)
    shoulder, elbow, wrist = np.cumsum(rng.uniform(0.2, 0.4, (3, 3)) * rng.choice([-1, 1], (3, 3)), axis=0)
    outer = wrist + 0.1 * rng.normal(size=3)
    axes, points = [a1, a2, a3, a4, a5, a6, a7], [shoulder] * 3 + [elbow] + [wrist] * 2 + [outer]
    if mirrored:
        axes, points = axes[::-1], points[::-1]
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    tool = points[-1] + 0.1 * rng.normal(size=3)
    arm = arm_from_axes(axes, points, tool, rotation)
    assert isinstance(arm, OuterJointArm)
    return arm


def postures(arm: Arm, seed: int, count: int) -> jnp.ndarray:
    """Random joint angles within the limits, at most half a turn from zero, ``(count, 7)``."""
    lower, upper = np.maximum(np.asarray(arm.lower), -np.pi), np.minimum(np.asarray(arm.upper), np.pi)
    return jnp.asarray(np.random.default_rng(seed).uniform(lower, upper, (count, 7)))


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)
