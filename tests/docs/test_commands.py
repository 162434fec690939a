"""The command lines of README.md and docs/ work as printed, one after the other, in an empty folder."""

import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
TEXTS = [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").glob("*.md")), REPOSITORY / "notebooks" / "README.md"]
FENCE = re.compile(r"^```(.*?)\n(.*?)^```[ ]*$", re.MULTILINE | re.DOTALL)
SHELLS = ("", "sh", "console")
SPOKEN = re.compile(r"`((?:jaxik|python -m jaxik)[^`]*)`")
# Commands that need a port, a file of the reader, a dialogue or a training.
THEIRS = re.compile(r"/dev/|[A-Z]{4,}|…|yours|my_arm|mine\.json|\barm\.urdf|calibrate|teach|train|--bluetooth|COM3")


def commands(text):
    """Lines of blocks without a language, and commands with options in the text, without comments."""
    lines = [line for fence in FENCE.finditer(text) if fence[1] in SHELLS for line in fence[2].splitlines()]
    lines += [
        re.sub(r"\s+", " ", found[1])
        for found in SPOKEN.finditer(text)
        if found[1].startswith("python") or len(found[1].split()) > 2
    ]
    stripped = [line.split("  #")[0].split("     ")[0].strip().removeprefix(".venv/bin/") for line in lines]
    return [c for c in stripped if c.startswith(("jaxik ", "python -m jaxik")) and not THEIRS.search(c)]


# A shell in the background ignores Ctrl-C, and so do its children unless they install a handler.
PROGRAM = """\
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
import jaxik.cli
sys.exit(jaxik.cli.main())
"""

FILES = {file.relative_to(REPOSITORY).as_posix(): commands(file.read_text(encoding="utf-8")) for file in TEXTS}


def test_readme_has_commands():
    assert "jaxik view" in FILES["README.md"]
    assert any(command.startswith("jaxik plan wave") for command in FILES["README.md"])


def test_blocks_in_other_languages_are_no_commands():
    text = "```text\njaxik a\n```\njaxik b\n```\njaxik c  # said\n```\n```python\njaxik d\n```\n```sh\njaxik e\n```\n"
    assert commands(text) == ["jaxik c", "jaxik e"]


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, found in FILES.items() if found])
def test_commands_work_as_printed(name, tmp_path):
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(filter(None, (str(REPOSITORY), os.environ.get("PYTHONPATH")))),
        "MPLBACKEND": "Agg",
        "JAX_PLATFORMS": "cpu",
    }
    environment.pop("XLA_FLAGS", None)
    for command in dict.fromkeys(FILES[name]):
        words = command.split()
        call = [sys.executable, *words[1:]] if words[0] == "python" else [sys.executable, "-c", PROGRAM, *words[1:]]
        if words[:2] == ["jaxik", "view"] and "--out" not in words:
            _view(command, call, tmp_path, environment)
            continue
        done = subprocess.run(
            call, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300, check=False
        )
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"


def _view(command, call, folder, environment):
    """Start the viewer, open its page, and stop it by Ctrl-C."""
    run = subprocess.Popen(
        [*call, "--port", "0"], cwd=folder, env=environment | {"PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    said, end = "", time.monotonic() + 240
    try:
        while "open http" not in said:
            assert time.monotonic() < end, f"{command}\n{said}"
            assert run.poll() is None, f"{command}\n{said}{run.stdout.read()}"
            said += run.stdout.readline()
        address = re.search(r"http://\S+", said)[0]
        with urllib.request.urlopen(address, timeout=30) as page:
            assert b"<html" in page.read().lower()
        run.send_signal(signal.SIGINT)
        assert run.wait(120) == 0, f"{command}\n{said}{run.stdout.read()}"
    finally:
        run.kill()
        run.stdout.close()
