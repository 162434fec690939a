"""Branch solutions per second, compared with a plain C kernel.

python -m benchmarks.ik_throughput [--targets 10000000]
"""

import argparse
import ctypes
import os
import subprocess
import tempfile
import threading
import time
from pathlib import Path

import jax
import numpy as np

import jaxik
from benchmarks.common import best_seconds, reachable_targets, table
from jaxik.ik.arm_constants import arm_constants
from jaxik.ik.stream import CHUNK

jax.config.update("jax_enable_x64", True)


def c_kernel(single: bool) -> ctypes.CDLL:
    """Compile the closed form in plain C for this machine."""
    library = Path(tempfile.mkdtemp()) / "kernel.so"
    source = Path(__file__).with_name("ik_kernel.c")
    flags = ["-O3", "-march=native", "-ffast-math", "-shared", "-fPIC", *(["-DSINGLE"] if single else [])]
    subprocess.run(["gcc", *flags, str(source), "-o", str(library), "-lm"], check=True)
    return ctypes.CDLL(str(library))


def c_seconds(arm: jaxik.Arm, columns: tuple[np.ndarray, ...], dtype: str) -> tuple[float, np.ndarray]:
    """Return the best time of the C kernel with the batch split over the cores, and its solutions ``(8, 7, n)``."""
    g = arm_constants(arm)
    pole, zero = g.reference.vectors()
    order = (g.shoulder, g.to_shoulder_frame, g.shoulder_delta, g.shoulder_from_elbow, g.upper, g.fore, g.skew)
    order += (g.straight, g.wrist_delta, g.wrist_from_elbow, g.tool_to_wrist, g.tool_offset, pole, zero)
    constants = np.concatenate([np.asarray(x, dtype).ravel() for x in order])
    solve = c_kernel(dtype == "float32").solve
    cores = len(os.sched_getaffinity(0))
    parts = [[np.ascontiguousarray(p) for p in np.array_split(x.astype(dtype), cores, axis=-1)] for x in columns]
    outs = [np.empty((8, 7, part.shape[-1]), dtype) for part in parts[2]]

    def pointer(x: np.ndarray) -> ctypes.c_void_p:
        return ctypes.c_void_p(x.ctypes.data)

    def run() -> None:
        threads = [
            threading.Thread(target=solve, args=(ctypes.c_long(o.shape[-1]), *map(pointer, (constants, p, r, s, o))))
            for p, r, s, o in zip(*parts, outs, strict=True)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    run()
    best = np.inf
    for _ in range(10):
        start = time.perf_counter()
        run()
        best = min(best, time.perf_counter() - start)
    return best, np.concatenate(outs, axis=-1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--targets", type=int, default=10_000_000, help="targets of the streamed call")
    targets = parser.parse_args().targets
    arm = jaxik.presets.iiwa14().arm
    rows = []
    for dtype in ("float64", "float32"):
        columns = reachable_targets(arm, CHUNK)
        typed = [jax.numpy.asarray(x, dtype) for x in columns]
        best, median = best_seconds(lambda typed=typed: jaxik.solve_ik_columns(arm, *typed), 200)
        written = jax.jit(lambda *x: jaxik.solve_ik_columns(arm, *x).q)
        full, full_median = best_seconds(lambda typed=typed, written=written: written(*typed), 200)
        c_time, c_q = c_seconds(arm, columns, dtype)
        off = np.abs(np.angle(np.exp(1j * (np.asarray(written(*typed), float) - c_q))))
        # The C kernel does not handle singular postures; a few of its rows are NaN in float32.
        agreement = np.nanquantile(off, 0.99)
        assert agreement < (1e-9 if dtype == "float64" else 1e-3), f"the two kernels differ by {agreement:.3g} rad"

        repeats = -(-targets // CHUNK)
        long = [np.tile(np.asarray(x, dtype), repeats)[..., :targets] for x in columns]
        start = time.perf_counter()
        for _, solved in jaxik.stream_ik(arm, *long):
            assert solved.elbow.shape[-1]
        streamed = time.perf_counter() - start
        rates = [f"{8 * CHUNK / t / 1e6:.0f}" for t in (best, median, full, full_median)]
        rates += [f"{8 * targets / streamed / 1e6:.0f}", f"{8 * CHUNK / c_time / 1e6:.0f}", f"{c_time / best:.1f}"]
        rows.append((dtype, *rates))
    header = (
        "dtype",
        "columns",
        "(median)",
        "all 8 expanded",
        "(median)",
        f"{targets} streamed",
        "plain C",
        "ratio to C",
    )
    table(f"Branch solutions per second, million; chunks of {CHUNK}", header, rows)


if __name__ == "__main__":
    main()
