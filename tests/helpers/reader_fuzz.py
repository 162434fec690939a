"""Damaged files for every reader, and the judgment of what a reader makes of them.

A file is read, or refused in one sentence: no other exception, no warning of arithmetic, no waiting, no lost memory.
"""

import json
import random
import re
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

import jaxik
from hardware import JointMap, load_joint_map
from hardware.joint_map_file import save_joint_map
from jaxik.errors import JaxikError, JaxikWarning
from tests.helpers.urdf_text import arm_urdf, iiwa_urdf, joint, link, two_arms

SLOW = 5.0  # s; every one of these files is read in milliseconds
NUMBERS = (
    "0", "-0.0", "1", "-1", "nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "1e400", "9" * 400, "0x10", "1_0", "1,5",
    "", "٣",
    "1e", "--1", "true", "null", "[]", "{}", "3.4e38", "1e19", "6.28318530718", "0.5 0.5", "1e-9",
    "2147483648", "1e6", "180", "$" + "{pi}",
)  # fmt: skip
WORDS = (
    "", " ", "\n", "\0", "\ufeff", '"', "'", ",", ";", "\t", "#", "<", ">", "/>", "<!--", "-->", "&",
    "&lt;", "]]>", "<![CDATA[", "<a:b>", "é", "{", "}", "{3}", "[", "]", "=", "[[joint]]",
)  # fmt: skip
NUMBER = re.compile(r"[+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?")
WORD = re.compile(r"[A-Za-z_]\w*")


@dataclass(frozen=True)
class Reader:
    """A reader with valid files to damage.

    Attributes:
        ending: Ending of its files.
        load: The reader.
        seeds: Valid files.
        sound: Returns False for a result that no valid file gives.
    """

    ending: str
    load: Callable[[Path], Any]
    seeds: tuple[bytes, ...]
    sound: Callable[[Any], bool]


def readers(folder: Path) -> dict[str, Reader]:
    """Every reader, with seeds that are written to a folder once."""
    return {
        "urdf": Reader(".urdf", _load_urdf, (*(t.encode() for t in _urdfs()),), _finite_model),
        "arms": Reader(".urdf", jaxik.list_arms, (*(t.encode() for t in (*_urdfs(), two_arms())),), lambda arms: True),
        "path": Reader(".csv", jaxik.load_path, _paths(folder), lambda path: path.checked() is path),
        "csv": Reader(".csv", jaxik.load_trajectory, _trajectories(folder, ".csv"), _finite_trajectory),
        "json": Reader(".json", jaxik.load_trajectory, _trajectories(folder, ".json"), _finite_trajectory),
        "npz": Reader(".npz", jaxik.load_trajectory, _trajectories(folder, ".npz"), _finite_trajectory),
        "model": Reader(".json", jaxik.load_model, _models(folder), _finite_model),
        "ros": Reader(".yaml", jaxik.load_trajectory, _trajectories(folder, ".yaml"), _finite_trajectory),
        "bag": Reader(".mcap", jaxik.load_trajectory, _trajectories(folder, ".mcap"), _finite_trajectory),
        "ros path": Reader(".yaml", jaxik.load_path, _ros_paths(folder), lambda path: path.checked() is path),
        "calibration": Reader(".toml", load_joint_map, _calibrations(folder), _possible_joints),
        "world": Reader(".json", jaxik.load_world, _worlds(folder), _finite_world),
        "points": Reader(".csv", jaxik.load_world, _POINTS, _finite_world),
        "body": Reader(".yaml", _body_reader(folder), (_SPHERES,), _finite_body),
        "shapes": Reader(".urdf", _body_of_shapes, (_shapes(),), _finite_body),
        "mjcf": Reader(".xml", jaxik.from_mjcf, _mjcfs(), _finite_model),
    }  # fmt: skip


def judge(reader: Reader, content: bytes, file: Path) -> str:
    """Return what is wrong with the outcome, empty if nothing."""
    file.write_bytes(content)
    began = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", JaxikWarning)
            result = reader.load(file)
            if not reader.sound(result):
                return "it was read, but the result is no valid one"
    except JaxikError as error:
        text = str(error)
        if not text or "\n" in text or len(text) > 5000 or "Traceback" in text or not isinstance(error, ValueError):
            return f"refused, but not in one sentence: {type(error).__name__}: {text[:300]!r}"
    except ValueError as error:
        if type(error) is not ValueError or "\n" in str(error) or file.name not in str(error):
            return f"{type(error).__name__}: {str(error)[:300]!r}"
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return f"{type(error).__name__}: {str(error)[:300]!r}"
    seconds = time.perf_counter() - began
    return f"it took {seconds:.1f} s" if seconds > SLOW else ""


def damaged(reader: Reader, rng: random.Random) -> bytes:
    """A valid file with one to four changes."""
    content = rng.choice(reader.seeds)
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 4))):
        content = rng.choice(_CHANGES)(content, reader, rng)
    return content


def _bits(content: bytes, reader: Reader, rng: random.Random) -> bytes:
    if not content:
        return content
    changed, at = bytearray(content), rng.randrange(len(content))
    changed[at] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _cut(content: bytes, reader: Reader, rng: random.Random) -> bytes:
    start, end = sorted(rng.randrange(len(content) + 1) for _ in range(2))
    return rng.choice((content[:end], content[start:], content[:start] + content[end:]))


def _copied(content: bytes, reader: Reader, rng: random.Random) -> bytes:
    start = rng.randrange(len(content) + 1)
    end, at = min(len(content), start + rng.randrange(1, 200)), rng.randrange(len(content) + 1)
    return content[:at] + content[start:end] * rng.choice((1, 1, 2, 50)) + content[at:]


def _other(content: bytes, reader: Reader, rng: random.Random) -> bytes:
    other, at = rng.choice(reader.seeds), rng.randrange(len(content) + 1)
    return content[:at] + other[rng.randrange(len(other) + 1) :]


def _inserted(content: bytes, reader: Reader, rng: random.Random) -> bytes:
    at = rng.randrange(len(content) + 1)
    word = rng.choice(WORDS).encode() * rng.choice((1, 1, 1, 3, 3000))
    return content[:at] + word + content[at:]


def _number(content: bytes, reader: Reader, rng: random.Random) -> bytes:
    return _substituted(content, NUMBER, lambda found: rng.choice(NUMBERS), rng)


def _word(content: bytes, reader: Reader, rng: random.Random) -> bytes:
    words = WORD.findall(content.decode("latin-1")) or ["a"]
    return _substituted(content, WORD, lambda found: rng.choice(words), rng)


def _substituted(content: bytes, pattern: re.Pattern[str], change: Callable[[str], str], rng: random.Random) -> bytes:
    text = content.decode("latin-1")
    found = list(pattern.finditer(text))
    if not found:
        return content
    part = rng.choice(found)
    return (text[: part.start()] + change(part[0]) + text[part.end() :]).encode(
        "utf-8" if content.isascii() else "latin-1", "replace"
    )


def _lines(content: bytes, reader: Reader, rng: random.Random) -> bytes:
    lines = content.split(b"\n")
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    how = rng.randrange(3)
    if how == 0:
        del lines[at]
    elif how == 1:
        lines[at], lines[other] = lines[other], lines[at]
    else:
        lines.insert(at, lines[other])
    return b"\n".join(lines)


def _encoded(content: bytes, reader: Reader, rng: random.Random) -> bytes:
    encoding = rng.choice(("utf-16", "utf-16-le", "utf-8-sig", "utf-32", "cp037"))
    return content.decode("latin-1").encode(encoding, "replace")


def _separated(content: bytes, reader: Reader, rng: random.Random) -> bytes:
    return content.replace(b",", rng.choice((b";", b"\t", b" ", b",,", b", ", b"|")))


def _json_value(content: bytes, reader: Reader, rng: random.Random) -> bytes:
    """Another value somewhere in a JSON document; other files stay as they are."""
    try:
        document = json.loads(content)
    except (ValueError, RecursionError):
        return _number(content, reader, rng)
    values = [None, True, 0, -1.5, 1e300, 10**400, "", "x", [], {}, [[]], [1], {"a": 1}, [None], ["a", "a"]]
    at = document
    for _ in range(rng.randrange(1, 5)):
        keys = list(at) if isinstance(at, dict) else list(range(len(at))) if isinstance(at, list) else []
        if not keys:
            break
        key = rng.choice(keys)
        if rng.random() < 0.4 or not isinstance(at[key], dict | list):
            if rng.random() < 0.2:
                del at[key]
            else:
                at[key] = rng.choice(values)
            break
        at = at[key]
    return json.dumps(document).encode()


_CHANGES = (
    _bits, _bits, _cut, _copied, _other, _inserted, _inserted, _number, _number, _number, _word, _word, _lines, _lines,
    _encoded, _separated, _json_value, _json_value,
)  # fmt: skip


def _urdfs() -> tuple[str, ...]:
    gripper = link("f") + joint("jf", "l7", "f", kind="prismatic", extra='<mimic joint="j1"/>')
    return iiwa_urdf(7), arm_urdf(), arm_urdf("zyzyzy"), arm_urdf(kinds={1: "continuous"}, more=gripper)


def _load_urdf(file: Path) -> jaxik.ArmModel:
    base, tip = ("link_0", "flange") if b"flange" in file.read_bytes() else ("base", "tip")
    return jaxik.load_urdf(file, base, tip)


def _ros_paths(folder: Path) -> tuple[bytes, ...]:
    path = jaxik.example_path("reach")[:3]
    jaxik.save_path(path, folder / "path.yaml")
    pose = b"- {position: {x: 0.1, y: 2, z: 3e-1}, orientation: {x: 0, y: 0.6, z: 0.0, w: 0.8}}\n"
    return (folder / "path.yaml").read_bytes(), b"poses:\n" + 2 * pose


def _paths(folder: Path) -> tuple[bytes, ...]:
    path = jaxik.example_path("reach")[::10]
    jaxik.save_path(path, folder / "pose.csv")
    assert isinstance(path.target, jaxik.Pose)
    jaxik.save_path(jaxik.Path(path.target.pointing(), path.time), folder / "pointing.csv")
    poses, pointings = ((folder / f"{name}.csv").read_bytes() for name in ("pose", "pointing"))
    rows = poses.split(b"\n")[1:-1]
    frame = b",0,1,2,3,4,5,6,7\n" + b"".join(b"%d,%s\n" % (i, row) for i, row in enumerate(rows))
    return poses, pointings, frame, poses.replace(b",", b";").replace(b".", b",")


def _trajectories(folder: Path, ending: str) -> tuple[bytes, ...]:
    rng = np.random.default_rng(0)
    plain = jaxik.Trajectory(np.arange(6.0), rng.normal(size=(6, 3)), ("a", "b, c", 'd "e"'), "arm", notes=("one", "ä"))
    full = jaxik.Trajectory(np.arange(4.0), np.zeros((4, 1)), ("a",), swivel=np.zeros(4), branch=np.arange(4))
    for i, motion in enumerate((plain, full)):
        motion.save(folder / f"{i}{ending}")
    return tuple((folder / f"{i}{ending}").read_bytes() for i in range(2))


def _models(folder: Path) -> tuple[bytes, ...]:
    for i, model in enumerate((jaxik.presets.iiwa7(), jaxik.presets.meccanoid("left"), jaxik.presets.paper_arm())):
        jaxik.save_model(model, folder / f"{i}.json")
    return tuple((folder / f"{i}.json").read_bytes() for i in range(3))


def _calibrations(folder: Path) -> tuple[bytes, ...]:
    save_joint_map(load_joint_map("meccanoid.toml"), folder / "x.toml")
    return ((folder / "x.toml").read_bytes(),)


_POINTS = b"0.1,0.2,0.3\n-1,2e-1,.5\n", b"x y z r\n1 2 3 0.1\n"
_SPHERES = b"""robot:
  kinematics:
    collision_spheres:
      l1: [{center: [0.0, 0.1, 2e-2], radius: 0.05}, {center: [0, 0, 0], radius: 0.1}]
      l3:
      - {"center": [0.0, 0.0, 0.1], "radius": 0.04}
      l7: [{center: [0.0, 0.0, 0.1], radius: 0.04}]
    self_collision_ignore: {l1: [l3, l7], l3: []}
"""


def _worlds(folder: Path) -> tuple[bytes, ...]:
    world = jaxik.World(np.array([[0.1, 0.2, 0.3]]), np.array([0.1]), np.array([[0.0, 0, 1]]), np.array([0.5]))
    jaxik.save_world(world, folder / "world.json")
    shapes = {
        "boxes": [{"center": [0.5, 0.0, 0.2], "size": [0.1, 0.2, 0.1], "rpy": [0.0, 0.1, 0.2]}],
        "capsules": [{"from": [0, 0, 0.5], "to": [0.1, 0, 0.7], "radius": 0.05}],
        "overhang": 0.03,
    }
    return (folder / "world.json").read_bytes(), json.dumps(shapes).encode()


def _body_reader(folder: Path) -> Callable[[Path], jaxik.Body]:
    (folder / "body.urdf").write_text(arm_urdf())
    return lambda file: jaxik.Body.from_yaml(file, folder / "body.urdf", "base", "tip")


def _shapes() -> bytes:
    shapes = '<box size="0.1 0.1 0.2"/>', '<capsule radius="0.05" length="0.1"/>', '<mesh filename="a.stl"/>'
    text = arm_urdf()
    for number, shape in enumerate(shapes):
        begin = f'<link name="l{number + 1}">'
        assert begin in text
        placed = f'<collision><origin xyz="0 0 0.1" rpy="0 0.5 0"/><geometry>{shape}</geometry></collision>'
        text = text.replace(begin, begin + placed)
    return text.encode()


def _body_of_shapes(file: Path) -> jaxik.Body:
    return jaxik.Body.from_urdf(file, "base", "tip", skip_meshes=True)


def _mjcfs() -> tuple[bytes, ...]:
    return tuple(jaxik.to_mjcf(model).encode() for model in (jaxik.presets.iiwa7(), jaxik.presets.paper_arm()))


def _finite_world(world: jaxik.World) -> bool:
    return all(bool(np.isfinite(np.asarray(leaf)).all()) for leaf in jax.tree.leaves(world))


def _finite_body(body: jaxik.Body) -> bool:
    return bool(np.isfinite(np.asarray(body.centers)).all() and np.isfinite(np.asarray(body.radii)).all())


def _finite_model(model: jaxik.ArmModel) -> bool:
    return all(bool(np.isfinite(np.asarray(leaf)).all()) for leaf in jax.tree.leaves(model.arm))


def _possible_joints(joints: JointMap) -> bool:
    return not any(joint.problems() for joint in joints.joints)


def _finite_trajectory(motion: jaxik.Trajectory) -> bool:
    return bool(np.isfinite(motion.q).all() and np.isfinite(motion.time).all())
