"""Files that are complete or not there."""

import os
import stat

import pytest

from jaxik.atomic_file import write_atomically


def test_writes_text_and_bytes_and_replaces(tmp_path):
    file = tmp_path / "é.txt"
    write_atomically(file, "ä\n")
    assert file.read_bytes() == "ä\n".encode()
    write_atomically(str(file), b"\x00\xff")
    assert file.read_bytes() == b"\x00\xff"
    assert os.listdir(tmp_path) == [file.name]


@pytest.mark.parametrize("umask", [0o022, 0o077])
def test_permissions_are_those_of_a_new_file(tmp_path, umask):
    before = os.umask(umask)
    try:
        write_atomically(tmp_path / "a", "x")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o666 & ~umask


def test_a_name_of_the_greatest_length(tmp_path):
    name = "ö" * 125 + ".json"
    write_atomically(tmp_path / name, "x")
    assert os.listdir(tmp_path) == [name]


def test_a_symbolic_link_stays(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there" / "file")
    write_atomically(tmp_path / "link", "x")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "there" / "file").read_text() == "x"


def test_errors_name_the_file_asked_for(tmp_path):
    missing = tmp_path / "nowhere" / "a.json"
    with pytest.raises(FileNotFoundError) as caught:
        write_atomically(missing, "x")
    assert caught.value.filename == str(missing)
    assert "part" not in str(caught.value)
    with pytest.raises(IsADirectoryError) as caught:
        write_atomically(tmp_path, "x")
    assert caught.value.filename == str(tmp_path)


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    file = tmp_path / "a"
    file.write_text("old")

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as caught:
        write_atomically(file, "new")
    assert caught.value.filename == str(file)
    assert file.read_text() == "old"
    assert os.listdir(tmp_path) == ["a"]
