"""``jaxik doctor``: the state of the installation, a line per thing, and the next step where something is missing."""

import os
import platform
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from jaxik.beside import BESIDE, HOME, standing_before
from jaxik.cli.console import Screen

_CORE = ("jaxik", "jax", "jaxlib", "numpy", "scipy", "optax")
_OTHERS = {"all", "bench", "dev", "docs", "test"}  # extras for work on jaxik, and their sum
_REQUIREMENT = re.compile(r"([\w.-]+)(?:\[([\w,. -]+)\])?[^;]*(?:;.*\bextra == [\"']([\w-]+)[\"'])?")
_OLDEST = (3, 11)


@dataclass(frozen=True)
class Finding:
    """A line of the report.

    Attributes:
        name: The thing.
        value: Its state.
        advice: Next step, or "" where nothing is amiss.
        serious: Things do not work without the next step.
    """

    name: str
    value: str
    advice: str = ""
    serious: bool = False


def doctor(json: bool = False) -> int:
    """Check the installation: versions, devices, compilation cache, serial ports and extras.

    Args:
        json: Print one JSON document instead of a line per thing.

    Returns:
        0, or 1 if something does not work.
    """
    screen = Screen(json)
    findings = [*_versions(), *_devices(), *_cache(), *_ports(), *extras(), *shadowed()]
    width = max(len(finding.name) for finding in findings)
    for finding in findings:
        mark = "[red]✗[/red]" if finding.serious else "[yellow]·[/yellow]" if finding.advice else "[green]✓[/green]"
        screen.say(f"{mark} {finding.name:<{width}}  {_plain(finding.value)}", styled=True)
        if finding.advice:
            screen.say(f"  {'':<{width}}  {_plain(finding.advice)}", styled=True)
    serious = [finding.name for finding in findings if finding.serious]
    screen.say(f"not in order: {', '.join(serious)}" if serious else "in order")
    listed = [{"name": f.name, "value": f.value, "advice": f.advice, "ok": not f.serious} for f in findings]
    screen.result({"ok": not serious, "findings": listed})
    return 1 if serious else 0


def extras() -> Iterator[Finding]:
    """Yield every optional part of the program, and the line that installs one that is missing."""
    for name, packages in optional_packages(requires("jaxik") or []).items():
        missing = [package for package in packages if _version(package) is None]
        advice = f'pip install "jaxik[{name}]"' if missing else ""
        yield Finding(f"extra {name}", f"without {', '.join(missing)}" if missing else "installed", advice)


def optional_packages(requirements: list[str]) -> dict[str, list[str]]:
    """Return the packages of every extra that users may want, from the requirements in a package's metadata.

    Args:
        requirements: Requirements such as ``viser>=1.0; extra == 'view'``.
    """
    found: dict[str, list[str]] = {}
    for requirement in requirements:
        match = _REQUIREMENT.fullmatch(requirement.strip())
        if match and match[3] and match[3] not in _OTHERS:
            entries = found.setdefault(match[3], [])
            own = re.split(r"[, ]+", match[2]) if match[1] == "jaxik" and match[2] else None
            entries += [f"jaxik[{extra}]" for extra in own] if own else [match[1]]

    def resolved(name: str) -> Iterator[str]:
        for entry in found.get(name, []):
            yield from resolved(entry[6:-1]) if entry.startswith("jaxik[") else (entry,)

    return {name: list(dict.fromkeys(resolved(name))) for name in sorted(found)}


def shadowed() -> Iterator[Finding]:
    """Yield the packages beside jaxik, and the folder of the user's that stands before one."""
    for name in BESIDE:
        other = standing_before(name)
        if not (HOME / name).is_dir():
            yield Finding(name, "missing", 'pip install --force-reinstall --no-deps "jaxik"', serious=True)
        elif other is not None:
            yield Finding(name, f"`import {name}` finds {other}", f"`import jaxik.{name}` finds jaxik's")
        else:
            yield Finding(name, "found")


def _versions() -> Iterator[Finding]:
    old = sys.version_info < _OLDEST
    yield Finding("python", platform.python_version(), "install Python 3.11 or newer" if old else "", old)
    for name in _CORE:
        found = _version(name)
        yield Finding(name, found or "missing", "" if found else f"pip install {name}", serious=found is None)


def _devices() -> Iterator[Finding]:
    import jax

    try:
        devices = jax.devices()
    except RuntimeError as error:
        yield Finding("devices", " ".join(str(error).split())[:120], "JAX_PLATFORMS=cpu uses the processor", True)
        return
    kinds = dict.fromkeys(device.device_kind for device in devices)
    yield Finding("devices", f"{len(devices)} × {', '.join(kinds)} ({jax.default_backend()})")
    yield Finding("double precision", "on" if jax.config.jax_enable_x64 else "off")  # pyright: ignore


def _cache() -> Iterator[Finding]:
    import jax

    folder = jax.config.jax_compilation_cache_dir  # pyright: ignore
    if not folder:
        advice = "set JAX_COMPILATION_CACHE_DIR, and programs are compiled once only"
        yield Finding("compilation cache", "off", advice)
        return
    folder = Path(folder)
    parent = next(place for place in (folder, *folder.parents) if place.exists())
    if not os.access(parent, os.W_OK):
        advice = "set JAX_COMPILATION_CACHE_DIR to a folder that can be written"
        yield Finding("compilation cache", f"{folder} cannot be written", advice)
        return
    files = [file.stat().st_size for file in folder.glob("*") if file.is_file()] if folder.is_dir() else []
    yield Finding("compilation cache", f"{folder}, {len(files)} files, {sum(files) / 1e6:.0f} MB")


def _ports() -> Iterator[Finding]:
    from serial.tools.list_ports import comports

    ports = sorted(port.device for port in comports() if port.hwid != "n/a")
    closed = [port for port in ports if os.name == "posix" and not os.access(port, os.R_OK | os.W_OK)]
    value = ", ".join(ports) or "none with a device; `jaxik play` uses the simulated board"
    advice = f"no access to {', '.join(closed)}: sudo usermod -aG dialout $USER, and log in again" if closed else ""
    yield Finding("serial ports", value, advice)


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _plain(text: str) -> str:
    """Return text whose brackets are no markup of rich."""
    return text.replace("[", r"\[")
