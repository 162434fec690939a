"""Feasible swivels of a pose against peers: time, and agreement with each other.

python -m benchmarks.compare_arcs [--poses 4096] [--peers jaxik ssik]
"""

import argparse
from functools import partial

import jax
import numpy as np

from benchmarks.measure import interleaved, note, record, save, timed
from benchmarks.peers import FILES, PeerError, peers
from benchmarks.poses import poses_of
from benchmarks.shared_arm import iiwa14


def run(count: int = 4096, rounds: int = 5, files: tuple[str, ...] = FILES):
    """Return the record of all peers; the first of them is what the others are compared with."""
    shared = iiwa14()
    poses = poses_of(shared, "random", count)
    built, rows, errors, packages = {}, [], [], []
    for found in peers("ARCS", files):
        if isinstance(found, PeerError):
            errors.append(found)
            continue
        note(f"{found.name}: first call")
        packages.append(found.package)
        try:
            peer, building, _ = timed(partial(found, shared))
            call = partial(peer.arcs, poses[: peer.chunk or count])
            result, first, _ = timed(call)
            built[peer.name] = peer, call, peer.widths(result), building + first
        except Exception as error:  # a peer may fail in any way
            errors.append(PeerError(found.name, "first call", f"{type(error).__name__}: {error}"))
    times = interleaved({name: call for name, (_, call, _, _) in built.items()}, rounds)
    first_widths = next(iter(built.values()))[2] if built else np.zeros((0, 8))
    for name, (peer, call, widths, first) in built.items():
        size = len(call.args[0])
        both = min(size, len(first_widths))
        off = np.abs(widths[:both] - first_widths[:both])
        rows.append(
            {
                "peer": name,
                "version": peer.version(),
                "returns": peer.returns,
                "poses": size,
                "us_per_pose": 1e6 * float(times[name][:, 0].min()) / size,
                "us_per_pose_median": 1e6 * float(np.median(times[name][:, 0])) / size,
                "cores_used": float(times[name][:, 1].sum() / times[name][:, 0].sum()),
                "first_call_s": first,
                "feasible_swivel_mean": float(widths.mean()),
                "largest_difference": float(off.max()),
                "branches_that_differ": int((off > 1e-6).sum()),
            }
        )
    settings = {"poses": count, "rounds": rounds, "arm": shared.name}
    return record("arcs", rows, errors, settings, packages)


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=4096)
    parser.add_argument("--peers", nargs="+", default=list(FILES), choices=FILES)
    options = parser.parse_args()
    print(save(run(options.poses, files=tuple(options.peers))))


if __name__ == "__main__":
    main()
