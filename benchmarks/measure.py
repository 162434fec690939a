"""Interleaved timing, the machine, and records of results."""

import json
import os
import platform
import resource
import sys
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import jax
import numpy as np

RESULTS = Path(__file__).parent / "results"
PACKAGES = ("jaxik", "jax", "jaxlib", "numpy", "scipy")
# Keys that every record has; every row is a dictionary of strings, numbers, booleans and nulls.
KEYS = {"name": str, "machine": dict, "versions": dict, "settings": dict, "rows": list, "errors": list, "date": str}


def cores() -> int:
    """Return the number of cores available to this process."""
    return len(os.sched_getaffinity(0))


def processor() -> str:
    """Return the model of the processor."""
    try:
        with open("/proc/cpuinfo") as info:
            return next(line.split(":", 1)[1].strip() for line in info if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "unknown processor"


def machine() -> dict[str, Any]:
    """Return the kind of machine: processor, cores, memory, devices and their kind, load."""
    pages = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    devices = jax.devices()
    return {
        "processor": processor(),
        "cores": cores(),
        "memory_gib": round(pages / 2**30),
        "devices": len(devices),
        "device": devices[0].device_kind,
        "platform": devices[0].platform,
        "load": round(os.getloadavg()[0], 1),
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
    }


def note(text: str) -> None:
    """Say on the error stream what comes next."""
    print(f"  {text}", file=sys.stderr, flush=True)


def timed(call: Callable[[], Any]) -> tuple[Any, float, float]:
    """Return a call's result, its wall time and its processor time, of all threads [s]."""
    cpu, wall = time.process_time(), time.perf_counter()
    result = call()
    return result, time.perf_counter() - wall, time.process_time() - cpu


def interleaved(calls: dict[str, Callable[[], Any]], rounds: int, budget: float = np.inf) -> dict[str, np.ndarray]:
    """Call everything in turn, ``rounds`` times, so that all sides see the same load; ends early after ``budget`` [s].

    Returns:
        Wall and processor times per call of each name, ``(calls, 2)`` [s].
    """
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    began = time.perf_counter()
    for _ in range(rounds):
        for name, call in calls.items():
            times[name].append(timed(call)[1:])
        if time.perf_counter() - began > budget:
            break
    return {name: np.array(rows) for name, rows in times.items()}


def peak_memory() -> int:
    """Return the largest resident size of this process so far [bytes]."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def versions(packages: Sequence[str] = ()) -> dict[str, str]:
    """Return versions of packages that are installed."""
    found = {}
    for package in (*PACKAGES, *packages):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def record(name: str, rows: list[dict], errors: list, settings: dict, packages: Sequence[str] = ()) -> dict[str, Any]:
    """Return a record: rows of results with what they were measured on."""
    return {
        "name": name,
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "machine": machine(),
        "versions": versions(packages),
        "settings": settings,
        "rows": rows,
        "errors": [{"peer": e.name, "step": e.step, "message": e.message.splitlines()[0][:200]} for e in errors],
    }


def check(found: dict[str, Any]) -> dict[str, Any]:
    """Return a record if it has the form of all records.

    Raises:
        ValueError: With the key that is wrong.
    """
    for key, kind in KEYS.items():
        if not isinstance(found.get(key), kind):
            raise ValueError(f"record: {key} is {found.get(key)!r}, expected a {kind.__name__}")
    for row in found["rows"]:
        if not isinstance(row, dict) or not all(isinstance(x, str | int | float | bool | None) for x in row.values()):
            raise ValueError(f"record {found['name']}: a row holds other than plain values: {row!r}")
    return found


def save(found: dict[str, Any], folder: Path = RESULTS) -> Path:
    """Write a record as JSON; numbers that are not finite become null."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{found['name']}.json"
    path.write_text(json.dumps(_plain(check(found)), indent=1, sort_keys=True, allow_nan=False) + "\n")
    return path


def load(name: str, folder: Path = RESULTS) -> dict[str, Any]:
    """Read a record."""
    return check(json.loads((folder / f"{name}.json").read_text()))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(x) for key, x in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(x) for x in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if np.isfinite(value) else None
    return value
