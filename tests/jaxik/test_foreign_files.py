"""Paths and trajectories as other programs save them: data frames, spreadsheets, logs with time stamps."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik

NAMES = "x,y,z,qw,qx,qy,qz"
ROWS = ("0,0,0,1,0,0,0", "0.5,-0.25,1e-1,0.6,0.8,0,0")
PLAIN = "\n".join((NAMES, *ROWS)) + "\n"


def indexed(header, *rows):
    return "\n".join((header, *(f"{i},{row}" for i, row in enumerate(rows)))) + "\n"


POSES = {
    "as documented": PLAIN,
    "no names": indexed(",0,1,2,3,4,5,6", *ROWS),
    "no names, no index": "0,1,2,3,4,5,6\n" + "\n".join(ROWS),
    "index without a name": indexed("," + NAMES, *ROWS),
    "index with pandas' name": indexed("Unnamed: 0," + NAMES, *ROWS),
    "index with a name": indexed("index," + NAMES, *ROWS),
    "quoted names": '"' + NAMES.replace(",", '","') + '"\n' + "\n".join(ROWS),
    "quoted cells": "\n".join('"' + line.replace(",", '","') + '"' for line in (NAMES, *ROWS)),
    "semicolons": PLAIN.replace(",", ";"),
    "semicolons and decimal commas": PLAIN.replace(",", ";").replace(".", ","),
    "tabs": PLAIN.replace(",", "\t"),
    "tabs and decimal commas": PLAIN.replace(",", "\t").replace(".", ","),
    "spaces": PLAIN.replace(",", " , "),
    "Windows": PLAIN.replace("\n", "\r\n"),
    "old Mac": PLAIN.replace("\n", "\r"),
    "blank last lines": PLAIN + "\n\n   \n",
    "empty cells last": PLAIN.replace("\n", ",,\n") + ",,,,,,,,\n",
    "capitals": PLAIN.replace(NAMES, NAMES.upper()),
    "another order": "qx,qy,qz,qw,x,y,z\n0,0,0,1,0,0,0\n.8,0,0,.6,.5,-.25,.1\n",
    "UTF-16": PLAIN.encode("utf-16"),
    "UTF-16, big end first": b"\xfe\xff" + PLAIN.encode("utf-16-be"),
    "UTF-16 without a mark": PLAIN.encode("utf-16-le"),
    "byte order mark": PLAIN.encode("utf-8-sig"),
    "Windows' encoding": ("# año\n" + PLAIN).encode("cp1252"),
}


def load(folder, content):
    file = folder / "path.csv"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return jaxik.load_path(file)


@pytest.mark.parametrize("case", POSES)
def test_paths_of_other_programs(tmp_path, case):
    path = load(tmp_path, POSES[case]).checked()
    assert isinstance(path.target, jaxik.Pose)
    np.testing.assert_array_equal(path.target.position, [[0, 0, 0], [0.5, -0.25, 0.1]])
    np.testing.assert_allclose(path.target.rotation[1, :, 1], [0, -0.28, 0.96], atol=1e-12)


@pytest.mark.parametrize(
    ("content", "kind", "time"),
    [
        (indexed(",0,1,2,3,4,5,6,7", *(f"{5 + i},{row}" for i, row in enumerate(ROWS))), jaxik.Pose, [0, 1]),
        (indexed(",time," + NAMES, *(f"{5 + i},{row}" for i, row in enumerate(ROWS))), jaxik.Pose, [0, 1]),
        (indexed(",0,1,2,3,4,5,6", "2,0,0,0,0,0,2", "2.5,1,0,.1,3,4,0"), jaxik.Pointing, [0, 0.5]),
        (indexed(",0,1,2,3,4,5", "0,0,0,0,0,2", "0,.03,.04,0,0,1"), jaxik.Pointing, [0, 0.5]),
    ],
)
def test_columns_without_names_are_told_by_their_numbers(tmp_path, content, kind, time):
    path = load(tmp_path, content).checked()
    assert isinstance(path.target, kind)
    np.testing.assert_allclose(path.time, time, rtol=1e-12)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            indexed(",0,1,2,3,4,5,6", "0,0,0,0,1,0,0", "1,0,0,0,1,0,0"),
            "may be poses or times and pointing targets; name",
        ),
        (indexed(",0,1,2,3", "1,2,3,4", "1,2,3,4"), "path.csv:1: expected the header time,x,y,z"),
        (PLAIN.replace(NAMES, "x,y,z,qw,qx,qy,qy"), "path.csv:1: expected the header"),
        (PLAIN.replace(",", ";").replace("0.5", "0,5.1"), "path.csv:3: expected a number for x; got '0,5.1'"),
        (PLAIN.replace("0.5", "1_0"), "path.csv:3: expected a number for x; got '1_0'"),
        (PLAIN.replace("0.5", "1e300"), "path.csv:3: expected a finite number for x; got '1e300'"),
        (PLAIN.replace("0.5", '"' + "0" * 200_000), "check the quotes"),
        (PLAIN.encode("utf-32"), "expected a text file"),
        (bytes(range(256)), "expected a text file"),
    ],
)
def test_what_cannot_be_told_is_refused(tmp_path, content, said):
    with pytest.raises(jaxik.FileFormatError, match=r"path.csv") as caught:
        load(tmp_path, content)
    assert said in str(caught.value)


@pytest.mark.parametrize("wide", [True, False])
@pytest.mark.parametrize("shift", [0, 20_000, 1_700_000_000])
def test_time_stamps_keep_their_steps(tmp_path, wide, shift):
    rows = "".join(f"{shift + i // 250}.{4 * (i % 250):03d},{i},0,0,1,0,0,0\n" for i in range(600))
    with jax.enable_x64(wide):
        path = load(tmp_path, f"time,{NAMES}\n{rows}").checked()
        assert path.time.dtype == (np.float64 if wide else np.float32)
        exact = np.arange(600) * 4 / 1000
        np.testing.assert_array_equal(path.time, exact.astype(path.time.dtype))


def test_stamps_in_nanoseconds_are_subtracted_as_printed(tmp_path):
    rows = "".join(f"1700000000.{123456789 + 1000 * i},{i},0,0,1,0,0,0\n" for i in range(3))
    np.testing.assert_array_equal(load(tmp_path, f"time,{NAMES}\n{rows}").time, [0, 1e-6, 2e-6])
    same = "".join(f"1700000000.{123456789},{i},0,0,1,0,0,0\n" for i in range(3))
    with pytest.raises(jaxik.FileFormatError, match=r"path.csv:3: expected a time after 1700000000.1234567 s; got"):
        load(tmp_path, f"time,{NAMES}\n{same}")


@pytest.mark.parametrize("shift", [0.0, 20_000.0, 1.7e9])
def test_a_path_in_memory_keeps_its_steps_in_float32(shift):
    time = shift + 0.004 * np.arange(50)
    path = jaxik.Path(jaxik.Pointing(jnp.zeros((50, 3)), jnp.ones((50, 3))), time).checked()
    small = path.astype(jnp.float32)
    np.testing.assert_allclose(np.diff(np.asarray(small.time, float)), np.diff(time), atol=2e-8)
    small.checked()


def test_energies_and_the_fast_planner_keep_the_steps_of_stamps():
    """In float64 the stamps hold their steps to 0.2 µs; float32 would hold them to two minutes."""
    arm = jaxik.presets.iiwa7().arm.astype(jnp.float32)
    time = np.linspace(0.0, 2.0, 9)
    q = np.array([0.3, 0.5, 0.2, -1.2, 0.1, 0.9, 0.0]) + 0.2 * np.sin(time[:, None] + np.arange(7))
    with jax.enable_x64(False):
        energy = jaxik.energy.joint_motion() + 0.1 * jaxik.energy.smoothness()
        np.testing.assert_allclose(energy(arm, q, 1.7e9 + time), energy(arm, q, time), rtol=1e-4)
    target = jaxik.forward_kinematics(arm, q.astype(np.float32))
    first, second = (jaxik.plan_batch(arm, target, start + time) for start in (0.0, 1.7e9))
    np.testing.assert_array_equal(first.status, second.status)
    np.testing.assert_allclose(first.q, second.q, atol=1e-4)


def test_times_that_float32_holds_stay_as_they_are():
    path = jaxik.Path(jaxik.Pointing(jnp.zeros((3, 3)), jnp.ones((3, 3))), jnp.array([1.0, 1.5, 2.0]))
    np.testing.assert_array_equal(path.astype(jnp.float32).time, [1.0, 1.5, 2.0])


MOTION = jaxik.Trajectory(
    time=np.array([1.7e9, 1.7e9 + 0.5, 1.7e9 + 1.0]),
    q=np.array([[0.1, -2.0], [0.25, 1e-7], [1.5, 3.0]]),
    joint_names=("shoulder", "elbow"),
    arm_name="brazoñ",
    swivel=np.array([0.5, 0.25, -1.0]),
    branch=np.array([3, 3, 2]),
    notes=('planned "well", at 0.5 rad²/s', "one, two"),
)


def by_spreadsheet(text: str, divider: str, decimal: str = ".") -> str:
    """The table as a spreadsheet saves it again: the first line cut at commas, quoted, and filled up with cells."""
    first, *rows = text.splitlines()
    cells = first.split(",")
    quoted = ['"' + cell.replace('"', '""') + '"' if '"' in cell or divider in cell else cell for cell in cells]
    rows = [divider.join(cell.replace(".", decimal) for cell in row.split(",")) for row in rows]
    return "\r\n".join([divider.join([*quoted, ""]), *rows, ""])


def quoted_whole(text: str) -> str:
    first, rest = text.split("\n", 1)
    return '"' + first.replace('"', '""') + '"\n' + rest


RESAVED = {
    "as written": lambda text: text,
    "byte order mark": lambda text: "\ufeff" + text,
    "blank last lines": lambda text: text + "\n,,,,\n",
    "quoted first line": quoted_whole,
    "quoted first line and more cells": lambda text: quoted_whole(text).replace('"\n', '",,,,\n', 1),
    "cut at commas": lambda text: by_spreadsheet(text, ","),
    "semicolons and decimal commas": lambda text: by_spreadsheet(text, ";", ","),
    "tabs": lambda text: by_spreadsheet(text, "\t"),
    "all of it": lambda text: "\ufeff" + by_spreadsheet(text, ";", ",") + ";;;;\r\n\r\n",
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "cp1252"])
@pytest.mark.parametrize("case", RESAVED)
def test_a_trajectory_saved_again_by_a_spreadsheet(tmp_path, case, encoding):
    file = tmp_path / "x.csv"
    MOTION.save(file)
    text = RESAVED[case](file.read_text(encoding="utf-8"))
    if encoding == "cp1252":
        text = text.removeprefix("\ufeff")
    file.write_bytes(text.encode(encoding))
    assert jaxik.load_trajectory(file) == MOTION


def test_a_comma_before_a_quote_in_a_note_is_no_cell(tmp_path):
    motion = jaxik.Trajectory(MOTION.time, MOTION.q, ("a", "b"), notes=("one,", '"two"', ",,", "three;"))
    for ending in (".csv", ".json", ".npz"):
        motion.save(tmp_path / f"x{ending}")
        assert jaxik.load_trajectory(tmp_path / f"x{ending}") == motion


def test_names_with_line_breaks_and_spaces_read_back(tmp_path):
    motion = jaxik.Trajectory(MOTION.time, MOTION.q, ("a\nb", " c "))
    motion.save(tmp_path / "x.csv")
    assert jaxik.load_trajectory(tmp_path / "x.csv") == motion


@pytest.mark.parametrize("branch", [[0.5, 1, 2], [0, np.nan, 1], [0, 8, 1], [-1, 0, 0]])
def test_branches_are_whole_numbers(branch):
    with pytest.raises(ValueError, match="branch numbers are 0 to 7"):
        jaxik.Trajectory(MOTION.time, MOTION.q, ("a", "b"), branch=np.array(branch))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"joint_names": "ab"}, "expected joint_names to be a list of texts; got 'ab'"),
        ({"arm_name": 5}, "expected arm_name to be a text; got 5"),
        ({"notes": [1]}, r"expected notes[0] to be a text; got 1"),
        ({"q": [[10**400, 0]] * 3}, "expected a jaxik-trajectory file"),
        ({"q": None}, "expected q to be a list of numbers; got None"),
    ],
)
def test_wrong_json_fields_are_named(tmp_path, change, said):
    MOTION.save(tmp_path / "x.json")
    content = json.loads((tmp_path / "x.json").read_text())
    (tmp_path / "x.json").write_text(json.dumps(content | change))
    with pytest.raises(jaxik.FileFormatError, match=r"x.json") as caught:
        jaxik.load_trajectory(tmp_path / "x.json")
    assert said in str(caught.value)


def test_text_named_npz_and_archives_that_promise_too_much(tmp_path):
    MOTION.save(tmp_path / "x.csv")
    (tmp_path / "x.npz").write_bytes((tmp_path / "x.csv").read_bytes())
    with pytest.raises(jaxik.FileFormatError, match="expected an npz archive") as caught:
        jaxik.load_trajectory(tmp_path / "x.npz")
    assert "pickle" not in str(caught.value)
    fields = {"format": np.array("jaxik-trajectory"), "version": np.array(1), "q": np.zeros((3, 2))}
    np.savez(tmp_path / "x.npz", time=np.array([print], object), **fields)
    with pytest.raises(jaxik.FileFormatError, match="expected numbers or texts in time; got Python objects"):
        jaxik.load_trajectory(tmp_path / "x.npz")
    np.savez(tmp_path / "x.npz", time=np.zeros(3), **fields)
    data = (tmp_path / "x.npz").read_bytes()
    huge = data.replace(b"'shape': (3,), }       ", b"'shape': (30000000,), }")
    assert huge != data
    (tmp_path / "x.npz").write_bytes(huge)
    with pytest.raises(jaxik.FileFormatError, match=r"x.npz: expected a jaxik-trajectory file"):
        jaxik.load_trajectory(tmp_path / "x.npz")
