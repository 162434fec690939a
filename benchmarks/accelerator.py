"""One run on an accelerator: agreement with the CPU, throughput, memory, and plans in batch.

python -m benchmarks.accelerator [--minutes 6] [--quick] [--out FOLDER]

Needs jaxik with a jax for the accelerator, and no other package. Everything is bounded by time; what did not fit is
left out and said. ``--quick`` uses small sizes, for a machine without one. Results are a table and a JSON file.
"""

import argparse
import os
import time
from pathlib import Path
from typing import Any

# Before jax starts: large batches want all of the memory.
os.environ.setdefault("XLA_PYTHON_CLIENT_MEM_FRACTION", "0.92")

import jax
import numpy as np

import jaxik
from benchmarks.accelerator_cases import CASES, Case, Rows, make_rows
from benchmarks.measure import RESULTS, note, peak_memory, record, save, timed
from benchmarks.peers.peer import PeerError

COMPARED = 2**20  # rows compared with the CPU
PIECE = 2**16  # rows per call of the CPU
SIZES = tuple(2**k for k in (10, 13, 16, 18, 20, 22, 24, 26))
EXPENSIVE_SIZES = tuple(2**k for k in (10, 16, 20))
PATH_COUNTS = (16, 256, 4096, 65_536)
ALLOWED = 1e-4  # share of rows that may differ: rows at a threshold, decided by rounding


class Budget:
    """Seconds that are left, in shares."""

    def __init__(self, seconds: float) -> None:
        self.ends = time.perf_counter() + seconds

    def left(self) -> float:
        """Return the seconds that are left."""
        return self.ends - time.perf_counter()

    def share(self, part: float) -> "Budget":
        """Return a budget of a part of what is left."""
        return Budget(part * self.left())


def run(
    seconds: float = 345.0,
    sizes: tuple[int, ...] = SIZES,
    expensive: tuple[int, ...] = EXPENSIVE_SIZES,
    compared: int = COMPARED,
    piece: int = PIECE,
    path_counts: tuple[int, ...] = PATH_COUNTS,
    dtypes: tuple[str, ...] = ("float64", "float32"),
    cases: tuple[Case, ...] = CASES,
) -> dict[str, Any]:
    """Return the record."""
    budget = Budget(seconds)
    rows: list[dict[str, Any]] = []
    errors: list[PeerError] = []
    agreement(rows, errors, budget.share(0.45 if sizes else 1.0), cases, dtypes, compared, piece)
    for number, dtype in enumerate(dtypes):
        mine = budget.share(0.85 / (len(dtypes) - number))
        throughput(
            rows, errors, mine, [case for case in cases if case.name != "plan_batch"], _arm(dtype), sizes, expensive
        )
    plans(rows, errors, budget, path_counts)
    settings = {"seconds": seconds, "compared": compared, "arm": "iiwa14", "allowed": ALLOWED}
    return record("accelerator", rows, errors, settings, ("jax-cuda12-plugin", "jax-cuda13-plugin"))


def _arm(dtype: str) -> jaxik.Arm:
    return jax.device_put(jaxik.presets.iiwa14().arm.astype(dtype), jax.devices()[0])


def agreement(rows: list, errors: list, budget: Budget, cases, dtypes, count: int, piece: int) -> None:
    """Compare every case on the default device with the CPU, on as many rows as the CPU has time for."""
    host = jax.devices("cpu")[0]
    for number, case in enumerate(cases):
        mine = budget.share(1 / (len(cases) - number))
        for which, dtype in enumerate(dtypes):
            if mine.left() <= 0 or (which and case.expensive):  # the expensive ones in one precision
                note(f"{case.name} {dtype}: not compared")
                continue
            note(f"{case.name} {dtype}: compared with the CPU")
            try:
                arm = _arm(dtype)
                inputs = make_rows(arm, count)
                there = _numpy(case.compared(jax.block_until_ready(case.call(arm, inputs))))
                rows.append(_differences(case, dtype, arm, inputs, there, host, mine.share(0.7), piece))
            except Exception as error:  # one case must not end the run
                errors.append(PeerError(case.name, f"agreement, {dtype}", f"{type(error).__name__}: {error}"))


def _differences(case: Case, dtype, arm, inputs: Rows, there, host, budget: Budget, piece) -> dict[str, Any]:
    tolerance = case.tolerance[dtype == "float32"]
    at_home, off, counted = jax.device_put(arm, host), [], []
    with jax.default_device(host):
        for begin in range(0, len(inputs), piece):
            part = slice(begin, begin + piece)
            here = _numpy(case.compared(case.call(at_home, inputs[part].to(host))))
            both = here[1] & there[1][part]
            differences = [
                np.abs(a[part] - b).reshape(len(b), -1).max(1) for a, b in zip(there[0], here[0], strict=True)
            ]
            off.append(np.where(both, np.max(differences, axis=0), 0.0))
            counted.append(here[1] == there[1][part])
            if budget.left() <= 0:
                break
    off, same = np.concatenate(off), np.concatenate(counted)
    beyond = ~(off <= tolerance) | ~same
    return {
        "kind": "agreement",
        "function": case.name,
        "dtype": dtype,
        "rows": len(off),
        "difference_median": float(np.median(off)),
        "difference_worst": float(off.max()),
        "tolerance": tolerance,
        "rows_beyond": int(beyond.sum()),
        "agrees": bool(beyond.mean() <= ALLOWED),
    }


def _numpy(compared) -> tuple[list[np.ndarray], np.ndarray]:
    arrays, counts = compared
    return [np.asarray(x, float) for x in arrays], np.asarray(counts)


def throughput(rows: list, errors: list, budget: Budget, cases, arm: jaxik.Arm, sizes, expensive) -> None:
    """Time every case but plans at growing sizes, until memory or time ends."""
    dtype = str(arm.axes.dtype)
    for number, case in enumerate(cases):
        mine = budget.share(1 / (len(cases) - number))
        for size in expensive if case.expensive else sizes:
            if mine.left() <= 0:
                note(f"{case.name} {dtype}: no time for {size} rows")
                break
            note(f"{case.name} {dtype}: {size} rows")
            try:
                inputs = make_rows(arm, size)
                first, best = _timed(lambda case=case, inputs=inputs: case.call(arm, inputs), mine)
            except Exception as error:  # out of memory is an answer too
                errors.append(PeerError(case.name, f"{size} rows, {dtype}", f"{type(error).__name__}: {error}"))
                break
            rows.append(_rate("throughput", case.name, dtype, size, first, best))


def plans(rows: list, errors: list, budget: Budget, counts) -> None:
    """Time plans of many paths at once."""
    arm = _arm("float32")  # its own precision
    case = next(case for case in CASES if case.name == "plan_batch")
    for count in counts:
        if budget.left() <= 0:
            note(f"plan_batch: no time for {count} paths")
            break
        note(f"plan_batch: {count} paths")
        try:
            inputs = make_rows(arm, count)
            first, best = _timed(lambda inputs=inputs: case.call(arm, inputs), budget)
        except Exception as error:
            errors.append(PeerError("plan_batch", f"{count} paths", f"{type(error).__name__}: {error}"))
            break
        rows.append(_rate("plans", "plan_batch", str(arm.axes.dtype), count, first, best))


def _timed(call, budget: Budget) -> tuple[float, float]:
    first = timed(lambda: jax.block_until_ready(call()))[1]
    best = np.inf
    for _ in range(5):
        best = min(best, timed(lambda: jax.block_until_ready(call()))[1])
        if budget.left() <= 0:
            break
    return first, best


def _rate(kind: str, name: str, dtype: str, size: int, first: float, best: float) -> dict[str, Any]:
    stats = jax.devices()[0].memory_stats() or {}
    return {
        "kind": kind,
        "function": name,
        "dtype": dtype,
        "rows": size,
        "rows_per_s": size / best,
        "seconds": best,
        "first_call_s": first,
        # Of the process so far: only what the largest size needs can be read off.
        "peak_memory_gib": float(stats.get("peak_bytes_in_use", peak_memory())) / 2**30,
    }


def show(found: dict[str, Any]) -> None:
    """Print the record."""
    print(f"\n{found['machine']['device']}, {found['machine']['cores']} cores, jax {found['versions'].get('jax')}")
    for row in found["rows"]:
        head = f"{row['kind']:<11}{row['function']:<22}{row['dtype']:<9}{row['rows']:>10} rows  "
        if row["kind"] == "agreement":
            verdict = "agrees" if row["agrees"] else "DIFFERS"
            print(f"{head}{verdict}: worst {row['difference_worst']:.2g}, beyond {row['rows_beyond']}")
        else:
            speed, first, memory = row["rows_per_s"], row["first_call_s"], row["peak_memory_gib"]
            print(f"{head}{speed:>12.4g}/s  first call {first:.1f} s  peak {memory:.1f} GiB")
    for error in found["errors"]:
        print(f"left out: {error['peer']}, {error['step']}: {error['message']}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=5.75, help="time for all of it")
    parser.add_argument("--quick", action="store_true", help="small sizes, in a minute on a CPU")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the JSON file")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    found = run(55.0, (256,), (), 256, 256, (256,), ("float64",)) if options.quick else run(60.0 * options.minutes)
    show(found)
    print(save(found, options.out))


if __name__ == "__main__":
    main()
