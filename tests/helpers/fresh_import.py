"""Imports a package in a fresh interpreter and reports what that did."""

import json
import subprocess
import sys
from pathlib import Path

PROBE = """
import json, os, pathlib, sys
import jax
before, environment = dict(jax.config.values), dict(os.environ)
import {package}
report = dict(
    file={package}.__file__,
    modules=sorted({{name.partition(".")[0] for name in sys.modules}}),
    config=sorted(key for key, value in jax.config.values.items() if before.get(key, value) != value),
    same_environment=dict(os.environ) == environment,
    started_devices=sys.modules["jax._src.xla_bridge"].backends_are_initialized(),
)
pathlib.Path(sys.argv[1]).write_text(json.dumps(report))
"""


def fresh_import(package: str, folder: Path, python: str | Path = sys.executable) -> dict:
    """Import ``package`` with every warning an error; fails if that prints anything.

    Args:
        package: What to import.
        folder: Empty folder to run in, so that nothing is imported from the checkout by accident.
        python: The interpreter to run.

    Returns:
        ``file`` of the package, top-level ``modules`` loaded by then, names of changed entries of JAX's ``config``,
        ``same_environment`` and ``started_devices``.
    """
    report = folder / "report.json"
    command = [python, "-W", "error", "-c", PROBE.format(package=package), report]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert run.returncode == 0, run.stderr
    assert (run.stdout, run.stderr) == ("", "")
    return json.loads(report.read_text())
