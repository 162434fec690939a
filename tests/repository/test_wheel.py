"""The wheel, built from the source archive, contains exactly the three packages, and works with the core alone."""

import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile

import pytest
import yaml

from tests.helpers.checkout import project_files
from tests.helpers.fresh_import import fresh_import

PACKAGES = {"jaxik", "training", "hardware"}


@pytest.fixture(scope="module")
def built(repository, tmp_path_factory):
    """A source archive, and a wheel built from it, with the installed build tools, so without a download."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(repository)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    return folder


@pytest.fixture(scope="module")
def wheel(built):
    (path,) = built.glob("*.whl")
    return path


def test_source_archive_holds_what_builds_tests_and_documents(built, repository):
    (path,) = built.glob("*.tar.gz")
    with tarfile.open(path) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    files = set(project_files(repository, "--cached", "--others", "--exclude-standard"))
    assert {name for name in files if not name.startswith(".")} <= names
    assert not [name for name in names if name.startswith((".ci/", ".venv", "build/", "demo/"))]
    assert path.stat().st_size < 20e6


def test_version_citation_and_changelog_agree(repository):
    version = tomllib.loads((repository / "pyproject.toml").read_text())["project"]["version"]
    citation = yaml.safe_load((repository / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()
    assert citation["version"] == version
    changelog = (repository / "CHANGELOG.md").read_text(encoding="utf-8")
    first = re.search(r"^## \[(.+?)\] - (Unreleased|\d{4}-\d\d-\d\d)$", changelog, re.MULTILINE)
    assert first[1] == version
    assert first[2] == "Unreleased" or str(citation["date-released"]) == first[2]


def test_wheel_holds_the_three_packages_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    assert {name.split("/")[0] for name in names} - PACKAGES == {"jaxik-" + wheel.name.split("-")[1] + ".dist-info"}
    assert not [name for name in names if "tests/" in name or "notebooks/" in name or name.endswith((".pyc", ".ipynb"))]


def test_wheel_misses_no_file(wheel, repository):
    """Every file of the packages in the checkout is in the wheel: code, type markers and data."""
    files = project_files(repository, "--cached", "--others", "--exclude-standard", "--", *sorted(PACKAGES))
    with zipfile.ZipFile(wheel) as archive:
        packed = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert packed == set(files)
    assert {f"{package}/py.typed" for package in PACKAGES} <= packed


@pytest.mark.slow
def test_wheel_works_with_the_core_dependencies_alone(wheel, repository, tmp_path):
    environment = tmp_path / "bare"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(environment)], check=True, timeout=60)
    python = environment / "bin" / "python"
    install = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--no-input"]
    install += ["--retries", "1", "--constraint", str(repository / "constraints.txt"), str(wheel)]
    try:
        run = subprocess.run(install, cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False)
    except subprocess.TimeoutExpired:
        pytest.fail("the core dependencies could not be installed within 600 s: is a package index in reach?")
    assert run.returncode == 0, (
        f"the core dependencies could not be installed: is a package index in reach?\n{run.stderr}"
    )

    for package in sorted(PACKAGES):
        report = fresh_import(package, tmp_path, python)
        assert report["file"].startswith(str(environment))
        assert report["config"] == []
