"""The plumbing of the comparisons, with a peer that is made up: errors never end a run, records have one form."""

import json

import numpy as np
import pytest

import benchmarks.peers
from benchmarks import accelerator, compare_arcs, compare_ik, compare_paths, measure, report, scaling, suite
from benchmarks.accelerator_cases import CASES
from benchmarks.peers.peer import Peer, PeerError
from benchmarks.poses import HARD, poses_of, random_postures
from benchmarks.shared_arm import iiwa14

pytest.importorskip("pinocchio")

JOINTS = 7


class Exact(Peer):
    """Knows the answers, as a second posture beside a wrong one that it does not claim."""

    name, package, returns = "exact", "numpy", "one posture"
    chunk = 4
    batched = False

    def solve(self, poses, seeds):
        known = random_postures(self.shared, 6, seed=1)  # what the random poses are made of
        near = [np.abs(self.shared.forward(known) - pose).max(axis=(1, 2)).argmin() for pose in poses]
        return [known[i] for i in near]

    def answers(self, result):
        q = np.stack([np.zeros((len(result), JOINTS)), np.array(result)], axis=1)
        return q, np.tile([False, True], (len(result), 1))

    def arcs(self, poses):
        return np.zeros((len(poses), 8))

    def widths(self, result):
        return result

    def follow(self, poses, time, start):
        return np.tile(start, (len(poses), 1))


class Wrong(Exact):
    """Claims its wrong posture."""

    name = "wrong"
    chunk = None
    batched = True

    def answers(self, result):
        return np.zeros((len(result), 1, JOINTS)) + 9.0, np.ones((len(result), 1), bool)


class Failing(Exact):
    """Fails when called."""

    name = "failing"

    def solve(self, poses, seeds):
        raise RuntimeError("no solution\nand a second line")

    arcs = follow = solve


class Unbuildable(Exact):
    """Fails when built."""

    name = "unbuildable"

    def __init__(self, shared):
        raise ValueError("cannot be built")


@pytest.fixture
def _fakes(monkeypatch):
    def found(kind, files):
        yield PeerError("missing", "import", "ModuleNotFoundError: No module named 'missing'")
        yield from (Unbuildable, Failing, Exact, Wrong)

    for module in (compare_ik, compare_arcs, compare_paths, scaling):
        monkeypatch.setattr(module, "peers", found)


@pytest.mark.usefixtures("_fakes")
def test_answers_are_judged_by_independent_kinematics_and_errors_reported():
    found = compare_ik.run(6, 2, 2)
    rows = {(row["peer"], row["set"]): row for row in found["rows"]}
    assert set(rows) == {(name, which) for name in ("exact", "wrong") for which in ("random", *HARD)}
    exact, wrong = rows["exact", "random"], rows["wrong", "random"]
    assert (exact["poses"], exact["answers_per_pose"], exact["reached_within_limits"]) == (4, 1.0, 1.0)
    assert exact["position_worst"] < 1e-12
    assert exact["wrong_answers"] == 0.0
    assert (wrong["poses"], wrong["reached"], wrong["claimed"], wrong["wrong_answers"]) == (6, 0.0, 1.0, 1.0)
    assert wrong["position_median"] > 1e-3
    assert {(e["peer"], e["step"]) for e in found["errors"]} == {
        ("missing", "import"),
        ("unbuildable", "first call"),
        ("failing", "first call"),
    }
    assert all("\n" not in e["message"] for e in found["errors"])


@pytest.mark.usefixtures("_fakes")
def test_every_part_of_the_suite_is_saved_and_written_to_the_page(tmp_path, monkeypatch):
    shared = iiwa14()
    start = np.array([0.3, 0.7, -0.2, -1.3, 0.2, 0.9, 0.1])
    curve = np.repeat(shared.forward(start[None]), 5, axis=0), np.arange(5.0), start
    monkeypatch.setattr(compare_paths, "path_of", lambda *_: curve)
    monkeypatch.setattr(compare_ik, "run", lambda count, *_, run=compare_ik.run: run(6, 2, 1))
    monkeypatch.setattr(scaling, "run", lambda *_, files, run=scaling.run: run(10, 10, (), files))
    saved = suite.run(folder=tmp_path)
    assert [path.stem for path in saved] == list(suite.PARTS)
    paths = measure.load("paths", tmp_path)["rows"]
    assert {row["peer"] for row in paths} == {"exact", "wrong"}
    assert all(row["energy"] == row["position_worst"] == row["off_start"] == 0.0 for row in paths)
    page = tmp_path / "page.md"
    marks = [f"before\n<!-- {name} -->\nnothing yet\n<!-- /{name} -->\nafter\n" for name in report.TABLES]
    page.write_text("".join(marks))
    for _ in range(2):  # writing twice changes nothing
        report.write(page, tmp_path, tmp_path)
        text = page.read_text()
        assert text.count("nothing yet") == 1  # no results of an accelerator
        assert text.count("before") == text.count("after") == len(report.TABLES)
        assert text.count("| exact |") == 3 + 1 + 2 + 2
    assert "ModuleNotFoundError: No module named 'missing'" in text
    assert (tmp_path / "scaling.png").stat().st_size > 1000


def test_a_peer_that_is_not_installed_is_named(monkeypatch):
    found = list(benchmarks.peers.peers("IK", ("no_such_file",)))
    assert [(e.name, e.step) for e in found] == [("no_such_file", "import")]
    assert found[0].message.startswith("ModuleNotFoundError")


def test_jaxik_as_a_peer(monkeypatch):
    import benchmarks.peers.jaxik as peer

    monkeypatch.setattr(peer, "IK", (peer.SolveIk,))
    found = compare_ik.run(1, 1, 1, ("jaxik",))  # one shape to compile
    assert not found["errors"]
    assert [row["set"] for row in found["rows"]] == ["random", *HARD]
    for row in found["rows"]:
        reached = row["set"] != "unreachable"
        assert (row["claimed"], row["reached"]) == (reached, reached)
        assert not reached or row["position_worst"] < 1e-9


def test_the_shared_arm_is_the_same_as_arrays_and_as_a_urdf():
    shared = iiwa14()
    q = random_postures(shared, 20)
    steps = np.diff(np.vstack([np.zeros(3), shared.points, shared.tool[:3, 3]]), axis=0)
    for angles, pose in zip(q, shared.forward(q), strict=True):
        position, rotation = np.zeros(3), np.eye(3)
        for axis, step, angle in zip(shared.axes, steps, angles, strict=False):
            position = position + rotation @ step
            cross = np.cross(np.eye(3), axis)
            rotation = rotation @ (np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)
        assert np.abs(pose[:3, :3] - rotation).max() < 1e-12
        assert np.abs(pose[:3, 3] - position - rotation @ steps[-1]).max() < 1e-12


def test_unreachable_poses_are_out_of_reach_by_their_distance():
    shared = iiwa14()
    poses = poses_of(shared, "unreachable", 50)
    wrist = poses[:, :3, 3] - 0.126 * poses[:, :3, 2]
    beyond = np.linalg.norm(wrist - shared.points[0], axis=1) - 0.82
    assert beyond.min() > 0.9e-6
    assert beyond.max() < 1.01


@pytest.mark.parametrize(
    ("key", "value"), [("rows", {}), ("machine", "a computer"), ("rows", [{"x": [1]}]), ("date", None)]
)
def test_a_record_of_another_form_is_refused(key, value):
    good = measure.record("name", [{"x": 1.0, "y": None, "z": "text"}], [], {})
    assert measure.check(good) is good
    with pytest.raises(ValueError, match="record"):
        measure.check(good | {key: value})


def test_numbers_that_are_not_finite_are_saved_as_null(tmp_path):
    path = measure.save(measure.record("name", [{"x": float("nan"), "y": float("inf")}], [], {}), tmp_path)
    assert json.loads(path.read_text())["rows"] == [{"x": None, "y": None}]


def test_accelerator_compares_and_times():
    found = accelerator.run(60.0, (8,), (), 8, 8, (), ("float64",), CASES[:3])
    assert not found["errors"]
    assert [(row["kind"], row["function"]) for row in found["rows"]] == [
        (kind, case.name) for kind in ("agreement", "throughput") for case in CASES[:3]
    ]
    assert all(row["agrees"] and row["rows"] == 8 for row in found["rows"][:3])
    accelerator.show(measure.check(found))


def test_accelerator_finds_a_difference_and_goes_on_after_a_failure():
    calls = iter([1.0, 1.5])
    case = CASES[0]
    differing = type(case)("differing", lambda *_: np.full(8, next(calls)), lambda x: ((x,), np.ones(8, bool)))
    failing = type(case)("failing", lambda *_: 1 / 0, case.compared)
    found = accelerator.run(60.0, (), (), 8, 8, (), ("float64",), (differing, failing, case))
    assert [(row["function"], row["agrees"]) for row in found["rows"]] == [("differing", False), (case.name, True)]
    assert found["rows"][0]["difference_worst"] == 0.5
    assert [e["message"] for e in found["errors"]] == ["ZeroDivisionError: division by zero"]


def test_results_in_the_repository_have_the_form_of_records():
    for path in measure.RESULTS.glob("*.json"):
        assert measure.load(path.stem)["name"] == path.stem
