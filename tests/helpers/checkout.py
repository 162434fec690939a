"""Which files belong to the project, as git sees it."""

import subprocess
from pathlib import Path

import pytest


def project_files(repository: Path, *arguments: str) -> list[str]:
    """Paths that ``git ls-files`` gives with these arguments; skips the test without git or outside a checkout."""
    command = ["git", "ls-files", "-z", *arguments]
    try:
        listing = subprocess.run(command, cwd=repository, capture_output=True, text=True, check=True).stdout
    except (FileNotFoundError, subprocess.CalledProcessError):
        pytest.skip("no git, or not a git checkout: nothing says which files belong to the project")
    return [name for name in listing.split("\0") if name and (repository / name).is_file()]
