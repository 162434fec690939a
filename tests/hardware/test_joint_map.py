"""Calibration: conversion both ways, limits, files, and the error for each kind of bad file."""

import math
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

import hardware
from jaxik.arm import presets

GOOD = """
format = 1
robot = "one joint"
[[joint]]
name = "elbow"
raw_range = [24, 232]
neutral = 128
raw_per_rad = 60
sign = -1
limits_deg = [-90, 90]
max_rate_deg_s = 100
safe_deg = 10
readback = true
"""


def load(folder, text):
    (folder / "robot.toml").write_text(text)
    return hardware.load_joint_map(folder / "robot.toml")


def test_radians_and_raw_values_are_inverse_to_half_a_step(tmp_path):
    joints = load(tmp_path, GOOD)
    q = np.linspace(-1.5, 1.5, 101)[:, None]
    raw = joints.to_raw(q)
    assert raw.dtype == np.int64
    assert raw[0, 0] == 128 + 90
    np.testing.assert_allclose(joints.to_rad(raw), q, atol=0.5 / 60 + 1e-12)
    np.testing.assert_array_equal(joints.to_raw(joints.to_rad(raw)), raw)
    assert np.isnan(joints.to_rad(np.array([np.nan]))).all()


def test_the_crc_depends_on_every_number(tmp_path):
    crcs = {load(tmp_path, GOOD.replace(*change)).crc for change in [("", ""), ("128", "129"), ("elbow", "Elbow")]}
    assert len(crcs) == 3
    assert load(tmp_path, GOOD).crc == load(tmp_path, GOOD).crc


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_shipped_calibration_fits_the_preset(side):
    model = presets.meccanoid(side)
    joints = hardware.load_joint_map("meccanoid.toml").select(model.joint_names)
    np.testing.assert_allclose(joints.column("lower"), model.arm.lower, atol=1e-6)
    np.testing.assert_allclose(joints.column("upper"), model.arm.upper, atol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("format = 1", "format = 2", "expected format = 1; got 2"),
        ('robot = "one joint"', "robot = 3", 'expected robot = "a name"; got 3'),
        ("neutral = 128", "", "joint 1 (elbow): lacks 'neutral'"),
        ("neutral = 128", "neutral = 128\nspeed = 1", "does not know 'speed'"),
        ("neutral = 128", "neutral = nan", "expected neutral to be a finite number; got [nan]"),
        ("[24, 232]", "[24]", "expected raw_range to be 2 finite numbers; got [24]"),
        ("[24, 232]", "[232, 24]", "raw_range must rise"),
        ("sign = -1", "sign = 0", "sign must be 1 or -1"),
        ("raw_per_rad = 60", "raw_per_rad = 0", "raw_per_rad must be above 0"),
        ("[-90, 90]", "[-170, 90]", "limits_deg reach raw 33.8 to 306.0, outside raw_range [24, 232]"),
        ("safe_deg = 10", "safe_deg = 95", "safe_deg must lie inside limits_deg"),
        ("readback = true", "readback = 1", "expected readback to be true or false"),
        ("readback = true", "readback = true\nchannel = 3", 'expected channel to be a text such as "D8/1"; got 3'),
        ("max_rate_deg_s = 100", "max_rate_deg_s = -1", "max_rate_deg_s must be above 0"),
        ("max_rate_deg_s = 100", "max_rate_deg_s = 1e307", "max_rate_deg_s must lie between 3 and 3600"),
        ("max_rate_deg_s = 100", "max_rate_deg_s = 1e9", "max_rate_deg_s must lie between 3 and 3600"),
        ("max_rate_deg_s = 100", "max_rate_deg_s = 4000", "max_rate_deg_s is at most 3600 for any joint; got 4000"),
        ("[24, 232]", "[24.5, 232]", "expected raw_range to be whole numbers; got [24.5, 232]"),
        ("sign = -1", "sign = 1.7", "sign must be 1 or -1; got 1.7"),
        ("readback = true", 'readback = true\nchannel = "A3"', "channel 'A3' is none of any board; an Arduino has"),
        (
            "readback = true",
            "readback = true\nmeasured = true",
            "expected measured to hold times of zero, scale, lower",
        ),
        (
            "readback = true",
            "readback = true\nmeasured.zero = 3",
            "such as measured.zero = 2026-11-28T12:00:00Z; got zero",
        ),
        ("readback = true", "readback = true\nmeasured.neutral = 2026-11-28T12:00:00Z", "got neutral = 2026-11-28"),
        ("[[joint]]", "[joint]", "expected at least one [[joint]] table"),
        ("format = 1", "format =", "expected a TOML file"),
    ],
)
def test_a_bad_file_is_refused_in_one_sentence(tmp_path, old, new, said):
    assert old in GOOD
    with pytest.raises(hardware.CalibrationError, match=r"robot\.toml: ") as caught:
        load(tmp_path, GOOD.replace(old, new))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_saved_calibration_reads_back_and_an_invalid_one_leaves_the_file(tmp_path):
    joints, file = hardware.load_joint_map("meccanoid.toml"), tmp_path / "mine.toml"
    hardware.save_joint_map(joints, file)
    again = hardware.load_joint_map(file)
    assert (again.robot, again.names) == (joints.robot, joints.names)
    for joint, read in zip(joints.joints, again.joints, strict=True):
        for field, value in vars(joint).items():
            assert getattr(read, field) == (pytest.approx(value, abs=1e-9) if isinstance(value, float) else value)
    before = file.read_bytes()
    reversed_limits = replace(joints.joints[0], lower=1.0, upper=0.5)
    with pytest.raises(hardware.CalibrationError, match="right_shoulder_swing: limits_deg must rise"):
        hardware.save_joint_map(hardware.JointMap("x", (reversed_limits,)), file)
    assert file.read_bytes() == before
    assert list(tmp_path.iterdir()) == [file]


def test_times_of_measurement_are_kept_and_change_nothing_else(tmp_path):
    old = load(tmp_path, GOOD)
    assert old.joints[0].estimates() == ("zero", "scale", "lower", "upper")
    times = "measured.zero = 2026-11-28T12:00:00Z\nmeasured.upper = 2026-11-28T14:00:00+02:00\n"
    joints = load(tmp_path, GOOD + times)
    noon = datetime(2026, 11, 28, 12, tzinfo=UTC)
    assert joints.joints[0].measured == hardware.Measured(zero=noon, upper=noon)
    assert joints.joints[0].estimates() == ("scale", "lower")
    assert joints.crc == old.crc, "a board holds the same calibration"
    hardware.save_joint_map(joints, tmp_path / "again.toml")
    assert hardware.load_joint_map(tmp_path / "again.toml") == joints
    assert "measured.upper = 2026-11-28T12:00:00Z\n" in (tmp_path / "again.toml").read_text()
    assert "measured.scale" not in (tmp_path / "again.toml").read_text()


def test_two_joints_on_one_channel_are_both_named(tmp_path):
    joint = GOOD[GOOD.index("[[joint]]") :] + 'channel = "D8/1"\n'
    two = GOOD[: GOOD.index("[[joint]]")] + joint + joint.replace("elbow", "wrist")
    with pytest.raises(hardware.CalibrationError, match=r"robot\.toml: elbow and wrist have one channel, 'D8/1'"):
        load(tmp_path, two)
    assert len(load(tmp_path, two.replace("D8/1", "D8/2", 1)).joints) == 2


def test_a_joint_named_twice_or_missing_is_refused(tmp_path):
    with pytest.raises(hardware.CalibrationError, match="joint 'elbow' appears twice"):
        load(tmp_path, GOOD + GOOD[GOOD.index("[[joint]]") :])
    with pytest.raises(hardware.CalibrationError, match="lacks wrist; it has elbow"):
        load(tmp_path, GOOD).select(["elbow", "wrist"])


def test_ideal_servos_round_by_at_most_a_tenth_of_a_milliradian():
    joints = hardware.ideal_joint_map(["a", "b"])
    q = np.random.default_rng(0).uniform(-math.pi, math.pi, (50, 2))
    np.testing.assert_allclose(joints.to_rad(joints.to_raw(q)), q, atol=1e-4 + 1e-12)
