"""Scaling with the batch, the length of the path, and the number of devices.

python -m benchmarks.scaling [--largest 10000000] [--longest 10000] [--devices 1 2 4 8] [--peers jaxik ssik ...]
"""

import argparse
import json
import os
import subprocess
import sys
from functools import partial
from typing import Any

import jax
import numpy as np

import jaxik
from benchmarks.measure import note, record, save, timed
from benchmarks.peers import FILES, Peer, PeerError, peers
from benchmarks.poses import poses_of, random_postures
from benchmarks.shared_arm import SharedArm, iiwa14

DISTINCT = 10_000  # poses; larger batches repeat them
SECONDS = 2.0  # a peer's sizes end where one call takes longer
DEVICE_ROWS = 2**17
DEVICE_CALL = """
import json, sys, jax, numpy as np
from benchmarks.scaling import sharded_seconds
jax.config.update("jax_enable_x64", True)
print(json.dumps(sharded_seconds(int(sys.argv[1]))))
"""


def run(largest: int = 100_000, longest: int = 1000, devices=(1, 2, 4, 8), files: tuple[str, ...] = FILES):
    """Return the record."""
    shared = iiwa14()
    rows: list[dict[str, Any]] = []
    errors: list[PeerError] = []
    packages = batches(shared, rows, errors, largest, files)
    path_lengths(shared, rows, errors, longest, files)
    for count in devices:
        note(f"{count} devices")
        try:
            rows.append({"kind": "devices", "peer": "jaxik solve_ik", "size": count, "seconds": _on_devices(count)})
        except Exception as error:
            errors.append(PeerError("jaxik solve_ik", f"{count} devices", f"{type(error).__name__}: {error}"))
    settings = {"largest": largest, "longest": longest, "device_rows": DEVICE_ROWS, "arm": shared.name}
    return record("scaling", rows, errors, settings, packages)


def _powers(largest: int, smallest: int = 1) -> list[int]:
    return [10**k for k in range(9) if smallest <= 10**k <= largest]


def batches(shared: SharedArm, rows: list, errors: list, largest: int, files) -> list[str]:
    """Time the calls of all peers for one pose to many."""
    distinct = poses_of(shared, "random", min(DISTINCT, largest))
    seeds = random_postures(shared, len(distinct), seed=99)
    packages = []
    for kind in peers("IK", files):
        if isinstance(kind, PeerError):
            errors.append(kind)
            continue
        packages.append(kind.package)
        try:
            peer = kind(shared)
            own = peer.poses("random", len(distinct)) if peer.own_arm else (distinct, seeds)
            for size in _powers(largest):
                note(f"{peer.name}: {size} poses")
                index = np.arange(size) % len(own[0])
                call = partial(peer.solve, own[0][index], own[1][index])
                first = timed(call)[1]
                best = min(timed(call)[1] for _ in range(3 if first < SECONDS else 1))
                rows.append(_row("batch", peer, size, first, best))
                if best > SECONDS:
                    break
        except Exception as error:
            errors.append(PeerError(kind.name, "batch", f"{type(error).__name__}: {error}"))
    return packages


def path_lengths(shared: SharedArm, rows: list, errors: list, longest: int, files) -> None:
    """Time the calls of all peers for short paths to long ones, over the same curve."""
    for kind in peers("PATHS", files):
        if isinstance(kind, PeerError):
            continue  # said above
        try:
            peer = kind(shared)
            for size in _powers(longest, 10):
                note(f"{peer.name}: {size} waypoints")
                call = partial(peer.follow, *curve(shared, size))
                first = timed(call)[1]
                best = timed(call)[1] if first < 10 * SECONDS else first
                rows.append(_row("path", peer, size, first, best))
                if best > SECONDS:
                    break
        except Exception as error:
            errors.append(PeerError(kind.name, "path length", f"{type(error).__name__}: {error}"))


def curve(shared: SharedArm, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return poses on a circle of 20 cm from where a bent arm holds its tool, times, and that posture."""
    start = np.array([0.3, 0.7, -0.2, -1.3, 0.2, 0.9, 0.1])
    poses = np.repeat(shared.forward(start[None]), size, axis=0)
    turn = np.linspace(0, 2 * np.pi, size)
    poses[:, :3, 3] += 0.1 * np.stack([np.cos(turn) - 1, np.sin(turn), 0 * turn], axis=-1)
    return poses, np.linspace(0, 10, size), start


def _row(kind: str, peer: Peer, size: int, first: float, best: float) -> dict[str, Any]:
    return {"kind": kind, "peer": peer.name, "size": size, "seconds": best, "first_call_s": first}


def sharded_seconds(count: int) -> float:
    """Return the time of `solve_ik` on a batch that is spread over ``count`` devices [s]."""
    arm = jaxik.presets.iiwa14().arm
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (DEVICE_ROWS, 7))
    pose = jaxik.forward_kinematics(arm, q)
    mesh = jax.make_mesh((count,), ("rows",), devices=jax.devices()[:count])
    spread = jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec("rows"))
    target, swivel = jax.device_put((pose, np.zeros(DEVICE_ROWS)), spread)
    call = jax.jit(lambda target, swivel: jaxik.solve_ik(arm, target, swivel))
    jax.block_until_ready(call(target, swivel))
    return min(timed(lambda: jax.block_until_ready(call(target, swivel)))[1] for _ in range(5))


def _on_devices(count: int) -> float:
    # Devices of an accelerator are taken as they are; a CPU is divided.
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={count}"
    command = [sys.executable, "-c", DEVICE_CALL, str(count)]
    done = subprocess.run(command, env=os.environ | {"XLA_FLAGS": flags}, capture_output=True, text=True, timeout=300)
    if done.returncode:
        raise RuntimeError(done.stderr.strip().splitlines()[-1])
    return json.loads(done.stdout)


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--largest", type=int, default=10_000_000, help="batch")
    parser.add_argument("--longest", type=int, default=10_000, help="waypoints")
    parser.add_argument("--devices", type=int, nargs="*", default=[1, 2, 4, 8])
    parser.add_argument("--peers", nargs="+", default=list(FILES), choices=FILES)
    options = parser.parse_args()
    print(save(run(options.largest, options.longest, tuple(options.devices), tuple(options.peers))))


if __name__ == "__main__":
    main()
