"""Model files: the same bits back, and one clear sentence for every way a file can be wrong."""

import copy
import json
import os

import jax
import numpy as np
import pytest

from jaxik.arm import presets
from jaxik.arm.arm import ArmModel, Gripper
from jaxik.arm.model_file import load_model, save_model
from jaxik.errors import ArmClassError, FileFormatError
from tests.helpers.arms import ALL_PRESETS, random_arm, same_bits


def named(arm):
    names = tuple(f"joint {i} µ\n" for i in range(arm.n_joints))
    return ArmModel(arm, names, "näme", "so\turce", ("a", "b"), Gripper("grip", -0.1, 1 / 3))


def assert_same(a: ArmModel, b: ArmModel):
    assert same_bits(a.arm, b.arm)
    for field in ("joint_names", "name", "source", "notes", "gripper"):
        assert getattr(a, field) == getattr(b, field)


@pytest.mark.parametrize("name", ALL_PRESETS)
def test_presets_round_trip(tmp_path, name):
    model = ALL_PRESETS[name]()
    save_model(model, tmp_path / "arm.json")
    assert_same(load_model(tmp_path / "arm.json"), model)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("seed", range(8))
def test_random_arms_round_trip(tmp_path, seed, dtype):
    model = named(random_arm(seed, 6 + seed % 2, limits=seed < 4, keep_out=seed % 3).astype(np.dtype(dtype)))
    save_model(model, str(tmp_path / "arm.json"))
    assert_same(load_model(str(tmp_path / "arm.json")), model)


def test_signed_zeros_and_smallest_numbers_survive(tmp_path):
    model = presets.iiwa7()
    leaves, tree = jax.tree.flatten(model.arm)
    odd = np.asarray(model.arm.gravity).copy()
    odd[:2] = -0.0, 5e-324
    leaves = [odd_leaf if x is model.arm.gravity else x for x in leaves for odd_leaf in [jax.numpy.asarray(odd)]]
    model = ArmModel(jax.tree.unflatten(tree, leaves), model.joint_names, model.name, model.source)
    save_model(model, tmp_path / "arm.json")
    assert_same(load_model(tmp_path / "arm.json"), model)


def test_file_is_strict_readable_json(tmp_path):
    save_model(presets.meccanoid("left"), tmp_path / "arm.json")
    content = json.loads((tmp_path / "arm.json").read_text(encoding="utf-8"))
    assert content["format"] == "jaxik-arm-model"
    assert content["version"] == 1
    assert content["arm"]["reference"]["kind"] == "stereographic"
    assert os.stat(tmp_path / "arm.json").st_mode & 0o600 == 0o600


def test_a_failed_save_leaves_the_old_file_and_no_litter(tmp_path, monkeypatch):
    path = tmp_path / "arm.json"
    save_model(presets.iiwa7(), path)
    before = path.read_bytes()

    def full(*_):
        raise OSError(28, "no space left")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="no space left"):
        save_model(presets.iiwa14(), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["arm.json"]


def test_what_cannot_be_saved(tmp_path):
    model = presets.iiwa7()
    batch = ArmModel(jax.tree.map(lambda x: x[None], model.arm), model.joint_names, "a", "b")
    with pytest.raises(ValueError, match=r"axes have shape \(1, 7, 3\), which is a batch"):
        save_model(batch, tmp_path / "arm.json")
    broken = ArmModel(jax.tree.map(lambda x: x * np.nan, model.arm), model.joint_names, "a", "b")
    with pytest.raises(ValueError, match="not finite"):
        save_model(broken, tmp_path / "arm.json")
    assert not list(tmp_path.iterdir())


def damaged(change):
    """The iiwa's file with one change made to its content."""

    def _text(tmp_path):
        save_model(presets.iiwa7(), tmp_path / "good.json")
        content = json.loads((tmp_path / "good.json").read_text(encoding="utf-8"))
        change(content)
        return json.dumps(content)

    return _text


def put(*keys_and_value):
    *keys, last, value = keys_and_value

    def change(content):
        for key in keys:
            content = content[key]
        content[last] = copy.deepcopy(value)

    return damaged(change)


def drop(*keys):
    def change(content):
        for key in keys[:-1]:
            content = content[key]
        del content[keys[-1]]

    return damaged(change)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{\n "format": "jaxik-arm-model",\n oops', r"arm\.json, line 3: not valid JSON"),
        ("", "line 1: not valid JSON"),
        ("[1, 2]", 'not an arm model: expected an object with "format": "jaxik-arm-model"'),
        ('{"a": 1, "a": 2}', "the field a is given twice"),
        ('{"a": NaN}', "NaN is not a number a model file may hold"),
        ("[" * 100_000, "nested too deeply"),
        (put("version", 2), "version 2 is unknown"),
        (put("dtype", "float16"), 'dtype should be "float32" or "float64", found \'float16\''),
        (drop("arm", "axes"), r"arm\.axes is missing"),
        (put("arm", "axis", 1), r"arm\.axis is not a field; known here are axes"),
        (put("arm", 3), "arm should be an object with the fields axes"),
        (put("arm", "shoulder", [0, 0]), r"arm\.shoulder should be a list of 3, found 2"),
        (put("arm", "shoulder", "here"), r"arm\.shoulder should be a list of 3, found 'here'"),
        (put("arm", "shoulder", 1, "x"), r"arm\.shoulder\[1\] should be a finite number, found 'x'"),
        (put("arm", "shoulder", 1, True), r"arm\.shoulder\[1\] should be a finite number, found True"),
        (put("arm", "shoulder", 1, 10**400), r"arm\.shoulder\[1\] should be a finite number"),
        (put("arm", "axes", [[0, 0, 1]]), r"arm\.axes should be a list of 7, found 1"),
        (put("arm", "links", "inertia", 2, [1, 2, 3]), r"arm\.links\.inertia\[2\]\[0\] should be a list of 3, found 1"),
        (put("arm", "keep_out", {"normal": [[1, 0, 0]], "offset": []}), r"arm\.keep_out\.offset should be a list of 1"),
        (put("arm", "lower", 3, 9.0), r"arm\.lower\[3\] = 9 should be below arm\.upper\[3\]"),
        (put("arm", "velocity_limit", 0, 0), r"arm\.velocity_limit should be positive"),
        (put("arm", "reference", "kind", "other"), r"reference\.kind should be one of 'paper', 'stereographic'"),
        (put("arm", "reference", "pole", [0, 0, 2]), "two perpendicular unit vectors, they are off by 1"),
        (put("joint_names", ["a"]), "joint_names should be 6 or 7 names, found 1"),
        (put("joint_names", 2, 5), r"joint_names\[2\] should be a string, found 5"),
        (put("notes", "all"), "notes should be a list of strings"),
        (put("name", None), "name should be a string, found None"),
        (put("gripper", {"name": "g", "lower": 0}), r"gripper\.upper is missing"),
    ],
)
def test_bad_files_are_refused_in_one_sentence(tmp_path, text, message):
    path = tmp_path / "arm.json"
    path.write_text(text if isinstance(text, str) else text(tmp_path), encoding="utf-8")
    with pytest.raises(FileFormatError, match=message) as caught:
        load_model(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_numbers_outside_the_class_are_refused(tmp_path):
    path = tmp_path / "arm.json"
    path.write_text(put("arm", "axes", 0, [0, 0.6, 0.8])(tmp_path), encoding="utf-8")
    with pytest.raises(ArmClassError, match=r"arm\.json: not an S-R-S arm: axes 1 and 2 are .* off the right angle"):
        load_model(path)


def test_not_text_and_not_there(tmp_path):
    (tmp_path / "arm.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match="not UTF-8"):
        load_model(tmp_path / "arm.json")
    with pytest.raises(FileNotFoundError, match=r"none\.json"):
        load_model(tmp_path / "none.json")


def test_an_arm_alone_has_no_names_to_save(tmp_path, without_type_checks):
    with pytest.raises(ValueError, match=r"expected a jaxik.ArmModel, got Arm: .*jaxik.ArmModel\(arm, joint_names"):
        save_model(presets.iiwa7().arm, tmp_path / "arm.json")
