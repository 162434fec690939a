"""Trajectories: validation, sampling, and files that read back to the last bit."""

import json

import numpy as np
import pytest

import jaxik
from jaxik.trajectories.trajectory_files import FORMAT

ENDINGS = (".npz", ".csv", ".json")


def make(count=7, **changes):
    rng = np.random.default_rng(3)
    fields = {
        "time": np.cumsum(rng.uniform(0.01, 0.1, count)),
        "q": rng.normal(size=(count, 3)),
        "joint_names": ("shoulder, first", 'the "elbow"', "Ärmel"),
        "arm_name": "test arm",
        "swivel": rng.normal(size=count),
        "branch": rng.integers(0, 8, count),
        "notes": ("one", "two; three"),
    }
    return jaxik.Trajectory(**(fields | changes))


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("changes", [{}, {"swivel": None, "branch": None, "notes": ()}, {"q": np.full((7, 3), 1e-310)}])
def test_files_read_back_to_the_last_bit(tmp_path, ending, changes):
    trajectory = make(**changes)
    trajectory.save(tmp_path / f"x{ending}")
    assert jaxik.load_trajectory(tmp_path / f"x{ending}") == trajectory
    assert [f.name for f in tmp_path.iterdir()] == [f"x{ending}"], "temporary files remain"


def test_one_changed_bit_makes_trajectories_unequal():
    trajectory = make()
    q = trajectory.q.copy()
    q[3, 1] = np.nextafter(q[3, 1], 9)
    assert make(q=q) != trajectory
    assert make(arm_name="other") != trajectory
    assert make(swivel=None) != trajectory


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"q": np.zeros((6, 3))}, "needs q (7, 3); got (6, 3)"),
        ({"q": np.full((7, 3), np.nan)}, "q of waypoint 0 of 7 is not finite"),
        ({"time": np.zeros(7)}, "time does not increase at waypoint 1 of 7"),
        ({"time": np.append(np.arange(6.0), np.inf)}, "time of waypoint 6 of 7 is not finite"),
        ({"joint_names": ("a", "a", "b")}, "joint names must differ"),
        ({"swivel": np.zeros(6)}, "swivel needs one value per waypoint"),
        ({"branch": np.full(7, 8)}, "branch numbers are 0 to 7"),
    ],
)
def test_what_is_no_trajectory_is_refused(changes, said):
    with pytest.raises(ValueError, match=r".") as caught:
        make(**changes)
    assert said in str(caught.value)


def test_sampling_is_straight_between_and_holds_the_ends():
    t = jaxik.Trajectory(np.array([1.0, 2.0, 4.0]), np.array([[0.0], [1.0], [-1.0]]), ("a",))
    np.testing.assert_allclose(t.sample(np.array([0.0, 1.5, 3.0, 9.0]))[:, 0], [0, 0.5, 0, -1])
    np.testing.assert_allclose(t.qd[:, 0], [1, -1])
    assert t.duration == 3.0


def test_another_ending_is_refused(tmp_path):
    with pytest.raises(
        jaxik.FileFormatError, match=r"expected a file name ending in .npz, .csv, .ros.json, .json, .*; got '.txt'"
    ):
        make().save(tmp_path / "x.txt")


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("content", [b"", b"nonsense", b"\xff\x00\x80", b"{}", b"[1]"])
def test_other_files_are_refused_by_name(tmp_path, ending, content):
    file = tmp_path / f"x{ending}"
    file.write_bytes(content)
    with pytest.raises(jaxik.FileFormatError, match=rf"x\{ending}: ") as caught:
        jaxik.load_trajectory(file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_cut_file_is_refused(tmp_path, ending):
    file = tmp_path / f"x{ending}"
    make().save(file)
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 2 // 3 - 1])
    with pytest.raises(jaxik.FileFormatError, match=r"x\."):
        jaxik.load_trajectory(file)


def test_a_later_format_says_to_update(tmp_path):
    make().save(tmp_path / "x.json")
    content = json.loads((tmp_path / "x.json").read_text())
    assert content["format"] == FORMAT
    (tmp_path / "x.json").write_text(json.dumps(content | {"version": 2}))
    with pytest.raises(jaxik.FileFormatError, match=r"expected format version 1; got 2: update jaxik"):
        jaxik.load_trajectory(tmp_path / "x.json")


def test_nonfinite_numbers_in_a_file_are_refused(tmp_path):
    make().save(tmp_path / "x.csv")
    lines = (tmp_path / "x.csv").read_text().splitlines()
    cells = lines[4].split(",")
    (tmp_path / "x.csv").write_text("\n".join([*lines[:4], ",".join([cells[0], "nan", *cells[2:]]), *lines[5:]]))
    with pytest.raises(jaxik.FileFormatError, match=r"q of waypoint 2 of 7 is not finite"):
        jaxik.load_trajectory(tmp_path / "x.csv")


def test_a_pickle_in_an_npz_is_not_run(tmp_path):
    np.savez(tmp_path / "x.npz", format=np.array([print], dtype=object))
    with pytest.raises(jaxik.FileFormatError, match=r"x.npz"):
        jaxik.load_trajectory(tmp_path / "x.npz")


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    file = tmp_path / "x.csv"
    make().save(file)
    monkeypatch.setattr("os.fsync", lambda number: (_ for _ in ()).throw(OSError("no space left")))
    with pytest.raises(OSError, match=r"no space"):
        make(arm_name="new").save(file)
    monkeypatch.undo()
    assert jaxik.load_trajectory(file) == make()
    assert len(list(tmp_path.iterdir())) == 1
