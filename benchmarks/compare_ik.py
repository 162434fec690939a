"""Inverse kinematics against peers: rates, latency, errors and success, on random and on hard poses.

python -m benchmarks.compare_ik [--poses 10000] [--peers jaxik ssik ...] [--rounds 5]
"""

import argparse
from functools import partial
from typing import Any

import jax
import numpy as np

from benchmarks.measure import interleaved, note, record, save, timed
from benchmarks.peers import FILES, Peer, PeerError, peers
from benchmarks.poses import HARD, poses_of, random_postures
from benchmarks.shared_arm import iiwa14

ACCURATE = 1e-5  # [m] and [rad]: ten times what is asked of iterative solvers
ROUGH = 1e-3  # [m] and [rad]: enough for many uses
SLACK = 1e-6  # of joint limits, beyond the rounding of float32 [rad]
CHECKED = 40_000  # answers checked per peer and set
SINGLE = 60  # poses solved one by one
HARD_SECONDS = 4.0  # per hard set, for peers that solve pose by pose


def run(count: int = 10_000, hard: int = 100, rounds: int = 5, files: tuple[str, ...] = FILES, kind: str = "IK"):
    """Return the record of all peers."""
    shared = iiwa14()
    built, rows, errors, packages = [], [], [], []
    seeds = random_postures(shared, max(count, hard), seed=99)
    poses = poses_of(shared, "random", count)
    for found in peers(kind, files):
        if isinstance(found, PeerError):
            errors.append(found)
            continue
        packages.append(found.package)
        note(f"{found.name}: first call")
        try:
            built.append(_prepare(found, shared, poses, seeds))
        except Exception as error:  # a peer may fail in any way
            errors.append(PeerError(found.name, "first call", f"{type(error).__name__}: {error}"))
    note(f"{rounds} rounds of all")
    times = interleaved({p.name: call for p, call, _ in built}, rounds)
    singles = interleaved({p.name: partial(_singles, p, c.args[0], c.args[1]) for p, c, _ in built}, 2)
    for peer, call, first in built:
        note(f"{peer.name}: errors and hard poses")
        try:
            made, size = call(), len(call.args[0])
            quality = _quality(peer, made, call.args[0])
            rows.append(
                _row(peer, "random", size, times[peer.name], quality)
                | {"latency_us": 1e6 * float(singles[peer.name][-1, 0]) / min(SINGLE, size), "first_call_s": first}
            )
        except Exception as error:
            errors.append(PeerError(peer.name, "random", f"{type(error).__name__}: {error}"))
        for which in () if peer.own_arm else HARD:
            try:
                rows.append(_hard(peer, which, poses_of(shared, which, hard), seeds[:hard]))
            except Exception as error:
                errors.append(PeerError(peer.name, which, f"{type(error).__name__}: {error}"))
    settings = {"poses": count, "hard": hard, "rounds": rounds, "accurate": ACCURATE, "arm": shared.name}
    return record("ik", rows, errors, settings, packages)


def _prepare(kind: type[Peer], shared, poses: np.ndarray, seeds: np.ndarray) -> tuple[Peer, partial, float]:
    """Build a peer and call it once; return it, its call on its share of the poses, and the time of both [s]."""
    size = min(kind.chunk or len(poses), len(poses))
    peer, building, _ = timed(partial(kind, shared))
    own = peer.poses("random", size) if peer.own_arm else None
    some, start = (poses[:size], seeds[:size]) if own is None else own
    if own is not None:  # seeds of its own arm are other postures, not the answers
        start = np.roll(start, 1, axis=0)
    call = partial(peer.solve, some, start)
    first = timed(call)[1]
    peer.solve(some[:1], start[:1])  # compiles the single pose
    return peer, call, building + first


def _singles(peer: Peer, poses: np.ndarray, seeds: np.ndarray) -> None:
    for i in range(min(SINGLE, len(poses))):
        peer.solve(poses[i : i + 1], seeds[i : i + 1])


def _hard(peer: Peer, which: str, poses: np.ndarray, seeds: np.ndarray) -> dict[str, Any]:
    """Solve a hard set; a peer that solves pose by pose stops when its time is up."""
    if peer.batched:
        peer.solve(poses, seeds)  # compiles
        made, wall, cpu = timed(partial(peer.solve, poses, seeds))
        return _row(peer, which, len(poses), np.array([[wall, cpu]]), _quality(peer, made, poses))
    made, times = [], []
    for i in range(len(poses)):
        one, wall, cpu = timed(partial(peer.solve, poses[i : i + 1], seeds[i : i + 1]))
        made += one
        times.append((wall, cpu))
        if sum(x[0] for x in times) > HARD_SECONDS:
            break
    total = np.sum(times, axis=0)[None]
    return _row(peer, which, len(made), total, _quality(peer, made, poses[: len(made)]))


def _quality(peer: Peer, made: Any, poses: np.ndarray) -> dict[str, float]:
    """Errors of claimed answers by independent forward kinematics, and shares of poses."""
    q, claimed = peer.answers(made)
    some = max(1, CHECKED // q.shape[1])
    q, claimed, poses = q[:some], claimed[:some], poses[:some]
    row, _ = np.nonzero(claimed)
    tool = peer.forward(q[claimed]) if len(row) else np.empty((0, 4, 4))
    position = np.linalg.norm(tool[:, :3, 3] - poses[row, :3, 3], axis=-1)
    turn = np.linalg.norm(tool[:, :3, :3] - poses[row, :3, :3], axis=(-2, -1))
    rotation = 2 * np.arcsin(np.clip(turn / 8**0.5, 0, 1))
    lower, upper = peer.limits()
    within = np.all((q[claimed] >= lower - SLACK) & (q[claimed] <= upper + SLACK), axis=-1)
    accurate = (position <= ACCURATE) & (rotation <= ACCURATE)

    def share(which: np.ndarray) -> float:
        return len(np.unique(row[which])) / len(poses)

    none = len(row) == 0
    return {
        "answers_per_pose": len(row) / len(poses),
        "reached": share(accurate),
        "reached_within_limits": share(accurate & within),
        "reached_roughly": share((position <= ROUGH) & (rotation <= ROUGH) & within),
        "claimed": share(np.ones(len(row), bool)),
        "wrong_answers": float(np.mean(~accurate)) if not none else 0.0,
        "position_median": None if none else float(np.median(position)),
        "position_worst": None if none else float(position.max()),
        "rotation_median": None if none else float(np.median(rotation)),
        "rotation_worst": None if none else float(rotation.max()),
    }


def _row(peer: Peer, which: str, count: int, times: np.ndarray, quality: dict[str, float]) -> dict[str, Any]:
    best, middle = float(times[:, 0].min()), float(np.median(times[:, 0]))
    return {
        "peer": peer.name,
        "version": peer.version(),
        "arm": peer.own_arm or peer.shared.name,
        "set": which,
        "poses": count,
        "returns": peer.returns,
        "keeps_limits": peer.keeps_limits,
        "poses_per_s": count / best,
        "poses_per_s_median": count / middle,
        "solutions_per_s": count * quality["answers_per_pose"] / best,
        "cores_used": float(times[:, 1].sum() / times[:, 0].sum()),
        **quality,
    }


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--peers", nargs="+", default=list(FILES), choices=FILES)
    options = parser.parse_args()
    found = run(options.poses, rounds=options.rounds, files=tuple(options.peers))
    print(save(found))


if __name__ == "__main__":
    main()
