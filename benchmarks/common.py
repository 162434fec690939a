"""Shared code of the benchmarks: targets, timing, and tables."""

import os
import time
from collections.abc import Callable

import jax
import numpy as np

import jaxik


def machine() -> str:
    """Return the name of the processor and the number of cores available to this process."""
    name = "unknown processor"
    with open("/proc/cpuinfo") as info:
        for line in info:
            if line.startswith("model name"):
                name = line.split(":", 1)[1].strip()
                break
    return f"{name}, {len(os.sched_getaffinity(0))} cores, jax {jax.__version__}"


def best_seconds(call: Callable[[], object], repeats: int = 20) -> tuple[float, float]:
    """Return the best and the median wall time of a call [s], excluding the first call."""
    jax.block_until_ready(call())
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    return min(times), float(np.median(times))


def reachable_targets(arm: jaxik.Arm, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return batch-last positions ``(3, n)``, rotations ``(3, 3, n)`` and swivels of random postures within limits."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(np.asarray(arm.lower), np.asarray(arm.upper), (count, arm.n_joints))
    pose = jaxik.forward_kinematics(arm, q)
    position = np.ascontiguousarray(np.moveaxis(np.asarray(pose.position), 0, -1))
    rotation = np.ascontiguousarray(np.moveaxis(np.asarray(pose.rotation), 0, -1))
    return position, rotation, rng.uniform(-np.pi, np.pi, count)


def table(title: str, header: tuple[str, ...], rows: list[tuple[object, ...]]) -> None:
    """Print aligned columns."""
    cells = [header, *[tuple(str(c) for c in row) for row in rows]]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    print(f"\n{title}\n{machine()}")
    for row in cells:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
