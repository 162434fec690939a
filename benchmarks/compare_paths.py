"""Motions along whole paths against peers: energy, errors, violations, and time cold and warm.

python -m benchmarks.compare_paths [--paths reach wave hello.csv ...] [--peers jaxik casadi ...] [--rounds 2]
"""

import argparse
import os
from functools import partial

import jax
import numpy as np

import jaxik
from benchmarks.measure import interleaved, note, record, save, timed
from benchmarks.peers import FILES, Peer, PeerError, peers
from benchmarks.shared_arm import SharedArm, iiwa14

EXAMPLES = ("word", "figure-eight", "reach", "wave", "spiral")
QUICK = ("reach", "wave")


def run(which: tuple[str, ...] = QUICK, rounds: int = 2, files: tuple[str, ...] = FILES, waypoints: int = 0):
    """Return the record of all peers on all paths; paths are example paths or files, thinned to ``waypoints``."""
    shared = iiwa14()
    rows, errors, packages = [], [], []
    classes = []
    for found in peers("PATHS", files):
        if isinstance(found, PeerError):
            errors.append(found)
        else:
            classes.append(found)
            packages.append(found.package)
    for name in which:
        poses, time, start = path_of(shared, name, waypoints)
        calls, firsts = {}, {}
        for kind in classes:
            note(f"{name}: {kind.name}, first call")
            try:
                peer, building, _ = timed(partial(kind, shared))
                call = partial(peer.follow, poses, time, start)
                q, first, _ = timed(call)
                calls[peer.name], firsts[peer.name] = call, (peer, q, building + first)
            except Exception as error:  # a peer may fail in any way
                errors.append(PeerError(kind.name, name, f"{type(error).__name__}: {error}"))
        times = interleaved(calls, rounds, budget=120.0)
        for peer, q, first in firsts.values():
            rows.append(
                _row(peer, q, poses, time)
                | {
                    "path": os.path.splitext(os.path.basename(name))[0],
                    "cold_s": first,
                    "warm_s": float(times[peer.name][:, 0].min()),
                    "cores_used": float(times[peer.name][:, 1].sum() / times[peer.name][:, 0].sum()),
                    "off_start": float(np.abs(q[0] - start).max()),
                }
            )
    settings = {"rounds": rounds, "arm": shared.name, "energy": "joint motion, sum |dq|^2 / dt [rad^2/s]"}
    return record("paths", rows, errors, settings, packages)


def path_of(shared: SharedArm, name: str, waypoints: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return poses ``(k, 4, 4)``, times [s], and the start: the posture on the first pose nearest to mid-range."""
    path = jaxik.example_path(name) if name in EXAMPLES else jaxik.load_path(name)
    if isinstance(path.target, jaxik.Pointing):  # peers take poses: a rotation about the hand's axis is chosen for all
        path = jaxik.Path(_posed(path.target), path.time)
    path = jaxik.fit_path(shared.arm, path)
    keep = np.unique(np.linspace(0, len(path) - 1, waypoints or len(path)).round().astype(int))
    poses = np.tile(np.eye(4), (len(keep), 1, 1))
    poses[:, :3, :3] = np.asarray(path.target.rotation)[keep]
    poses[:, :3, 3] = np.asarray(path.target.position)[keep]
    first = jaxik.Pose(poses[0, :3, 3], poses[0, :3, :3])
    middle = np.array([0, 0.5, 0, -1.2, 0, 0.8, 0])
    start = np.asarray(jaxik.solve_nearest(shared.arm, first, middle).raise_if_invalid().q)
    return poses, np.asarray(path.time)[keep], start


def _posed(target: jaxik.Pointing) -> jaxik.Pose:
    z = np.asarray(target.direction)
    seed = np.array([1.0, 0, 0]) if np.abs(z[:, 0]).max() < 0.9 else np.array([0, 1.0, 0])
    y = np.cross(z, seed)
    y /= np.linalg.norm(y, axis=-1, keepdims=True)
    return jaxik.Pose(np.asarray(target.position), np.stack([np.cross(y, z), y, z], axis=-1))


def _row(peer: Peer, q: np.ndarray, poses: np.ndarray, time: np.ndarray) -> dict[str, object]:
    shared = peer.shared
    tool = shared.forward(q)
    turn = np.linalg.norm(tool[:, :3, :3] - poses[:, :3, :3], axis=(-2, -1))
    speed = np.abs(np.diff(q, axis=0)) / np.diff(time)[:, None]
    beyond = np.maximum(shared.lower - q, q - shared.upper)
    return {
        "peer": peer.name,
        "version": peer.version(),
        "returns": peer.returns,
        "waypoints": len(q),
        "energy": float(np.sum(np.diff(q, axis=0) ** 2 / np.diff(time)[:, None])),
        "position_worst": float(np.linalg.norm(tool[:, :3, 3] - poses[:, :3, 3], axis=-1).max()),
        "rotation_worst": float(2 * np.arcsin(np.clip(turn / 8**0.5, 0, 1)).max()),
        "beyond_limits": float(max(0.0, beyond.max())),
        "speed_ratio": float((speed / shared.speed).max()),
    }


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--paths", nargs="+", default=list(QUICK), help="example paths and files")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--waypoints", type=int, default=0, help="thin every path to so many; 0 keeps all")
    parser.add_argument("--peers", nargs="+", default=list(FILES), choices=FILES)
    options = parser.parse_args()
    print(save(run(tuple(options.paths), options.rounds, tuple(options.peers), options.waypoints)))


if __name__ == "__main__":
    main()
