"""Damaged files: every reader takes them or refuses them in one sentence (see tests/helpers/reader_fuzz.py)."""

import random

import pytest

from jaxik.errors import FileFormatError
from tests.helpers.reader_fuzz import Reader, damaged, judge, readers

NAMES = (
    "urdf", "arms", "path", "csv", "json", "npz", "model", "ros", "bag", "ros path", "calibration", "world", "points",
    "body", "shapes", "mjcf",
)  # fmt: skip
SLOW = ("ros", "bag", "ros path", "body")  # YAML is read a hundred times slower
MANY = [name for name in NAMES if name not in (*SLOW, "shapes", "mjcf")]


@pytest.fixture(scope="module")
def every_reader(tmp_path_factory):
    found = readers(tmp_path_factory.mktemp("seeds"))
    assert tuple(found) == NAMES
    return found


def problems(reader: Reader, name: str, seeds: range, folder) -> list[str]:
    file = folder / f"fuzz{reader.ending}"
    judged = ((i, judge(reader, damaged(reader, random.Random(f"{name} {i}")), file)) for i in seeds)
    return [f"{name} {i}: {problem}" for i, problem in judged if problem]


@pytest.mark.parametrize("name", NAMES)
def test_seeds_are_read(every_reader, name, tmp_path):
    reader = every_reader[name]
    for content in reader.seeds:
        file = tmp_path / f"fuzz{reader.ending}"
        assert judge(reader, content, file) == ""
        assert reader.sound(reader.load(file))


@pytest.mark.parametrize("name", NAMES)
def test_damaged_files_are_read_or_refused_in_a_sentence(
    every_reader, name, tmp_path, monkeypatch, without_type_checks
):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warnings to a file
    assert not problems(every_reader[name], name, range(400), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", MANY)
def test_many_damaged_files_are_read_or_refused_in_a_sentence(every_reader, name, tmp_path, without_type_checks):
    # The same ones every time; `python -m benchmarks.fuzz_readers` makes as many others as are asked for.
    assert not problems(every_reader[name], name, range(400, 4_000), tmp_path)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (KeyError("a"), "KeyError"),
        (ValueError("no file named"), "ValueError"),
        (FileFormatError("two\nlines"), "not in one sentence"),
        (MemoryError(), "MemoryError"),
        (RuntimeWarning("overflow"), "RuntimeWarning"),
    ],
)
def test_the_judge_sees_what_is_wrong(tmp_path, error, said):
    def load(file):
        raise error

    assert said in judge(Reader(".x", load, (), lambda result: True), b"", tmp_path / "x")
    assert "no valid one" in judge(Reader(".x", lambda file: 1, (), lambda result: False), b"", tmp_path / "x")
