"""Targets of the comparison: random postures within limits, and the cases in which solvers fail."""

import numpy as np

from benchmarks.shared_arm import SharedArm

HARD = ("straight elbow", "near straight", "aligned", "unreachable")


def random_postures(shared: SharedArm, count: int, seed: int = 0) -> np.ndarray:
    """Return joint angles uniform within limits, ``(count, joint)`` [rad]."""
    return np.random.default_rng(seed).uniform(shared.lower, shared.upper, (count, len(shared.lower)))


def poses_of(shared: SharedArm, kind: str, count: int, seed: int = 0) -> np.ndarray:
    """Return target poses ``(count, 4, 4)`` of a kind: "random" or one of ``HARD``.

    straight elbow: joint 4 at zero. near straight: 1e-7 to 1e-2 rad from it. aligned: joint 2 or joint 6 at zero, in
    turn. unreachable: a random pose with the wrist 1 µm to 1 m beyond the length of the arm.
    """
    rng = np.random.default_rng([seed, sum(kind.encode())])
    q = random_postures(shared, count, seed + 1)
    if kind == "straight elbow":
        q[:, 3] = 0.0
    elif kind == "near straight":
        q[:, 3] = 10 ** rng.uniform(-7, -2, count) * rng.choice([-1, 1], count)
    elif kind == "aligned":
        q[np.arange(count), np.where(np.arange(count) % 2, 1, 5)] = 0.0
    poses = shared.forward(q)
    if kind == "unreachable":
        shoulder, elbow, wrist = shared.points[0], shared.points[3], shared.points[6]
        reach = np.linalg.norm(elbow - shoulder) + np.linalg.norm(wrist - elbow)
        to_wrist = np.einsum("nij,j->ni", poses[:, :3, :3], shared.tool[:3, 3] - wrist)
        way = poses[:, :3, 3] - to_wrist - shoulder
        farther = reach + 10 ** rng.uniform(-6, 0, count)
        poses[:, :3, 3] = shoulder + way * (farther / np.linalg.norm(way, axis=1))[:, None] + to_wrist
    return poses
