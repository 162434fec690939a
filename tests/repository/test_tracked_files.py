"""Tracked files contain no package registries, machine names, personal folders or download addresses."""

import re

import pytest

from tests.helpers.checkout import project_files

# Written so that this file does not match itself.
FORBIDDEN = {
    "a package registry": r"\b(?:py" r"pi|pythonhosted|registry\.npmjs|npmjs)\.(?:org|com)\b",
    "a package index address": r"https?://\S*/simple\b|--(?:extra-)?index" r"-url",
    "a lock file's download address": r'"resolved" *: *"http',
    "a path of one machine": r"(?<![\w.~])/(?:work|root|home)/[.\w]",
}


@pytest.fixture(scope="module")
def tracked(repository):
    """Path and text of every tracked text file."""
    texts = {}
    for name in project_files(repository):
        if b"\0" not in (content := (repository / name).read_bytes()):
            texts[name] = content.decode("utf-8")
    assert "pyproject.toml" in texts
    return texts


@pytest.mark.parametrize("what", FORBIDDEN)
def test_no_file_names(what, tracked):
    pattern = re.compile(FORBIDDEN[what])
    found = [
        f"{name}:{number}: {line.strip()[:120]}"
        for name, text in tracked.items()
        for number, line in enumerate(text.splitlines(), start=1)
        if pattern.search(line)
    ]
    assert not found, f"{what} in tracked files:\n" + "\n".join(found)


@pytest.mark.parametrize(
    ("what", "line"),
    [
        ("a package registry", "see " + "py" + "pi.org/project/jaxik"),
        ("a package index address", "https:" + "//example.com/simple/jax"),
        ("a lock file's download address", '  "resolved"' + ': "https://example.com/a.tgz"'),
        ("a path of one machine", "source '/" + "root/.bashrc'"),
    ],
)
def test_patterns_find_what_they_are_for(what, line):
    assert re.search(FORBIDDEN[what], line)


def test_no_lock_file_and_nothing_generated(tracked):
    wrong = re.compile(r"(^|/)(uv\.lock|poetry\.lock|__pycache__/.*|\.DS_Store|.*\.pyc|\.venv.*/.*)$")
    assert not [name for name in tracked if wrong.search(name)]
