"""Calibration against arms whose deviations are known."""

import dataclasses
import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

import jaxik
import training
from training.calibration.calibrate import GROUPS, fit_kinematics, fitted_parameters
from training.calibration.kinematic_errors import KinematicErrors, deviating_arm, names_of

MODEL = jaxik.presets.meccanoid("right")
ARM = MODEL.arm
NOISE = 1e-3
POINTS = 50


def deviations(rng) -> KinematicErrors:
    """Lengths wrong by 5 % and zeros wrong by 3 degrees."""
    none = KinematicErrors.none(ARM)
    return dataclasses.replace(
        none,
        length=jnp.asarray(0.05 * rng.choice([-1.0, 1.0], 3)),
        zero=jnp.asarray(math.radians(3) * rng.choice([-1.0, 1.0], ARM.n_joints)),
    )


def tips(true: KinematicErrors, q: np.ndarray) -> np.ndarray:
    """Tips of the real arm at given readings, by its chain of joints: the oracle for ``deviating_arm``."""
    angle = (1 + np.asarray(true.scale)) * q + np.asarray(true.zero)
    axes = np.asarray(ARM.axes)
    lengths = 1 + np.asarray(true.length)
    links = [
        lengths[i] * np.asarray(b - a)
        for i, (a, b) in enumerate([(ARM.shoulder, ARM.elbow), (ARM.elbow, ARM.wrist), (ARM.wrist, ARM.tool_position)])
    ]
    points = []
    for row in angle:
        turn = rotation(np.asarray(true.turn))
        at = np.asarray(ARM.shoulder) + np.asarray(true.shift)
        for joint, theta in enumerate(row):
            if joint == 3:
                at = at + turn @ links[0]
            if joint == 4:
                at = at + turn @ links[1]
            turn = turn @ rotation(axes[joint] * theta)
        points.append(at + turn @ links[2])
    return np.array(points)


def rotation(vector: np.ndarray) -> np.ndarray:

    return Rotation.from_rotvec(np.array(vector)).as_matrix()


def readings(rng, count: int) -> np.ndarray:
    return rng.uniform(np.asarray(ARM.lower), np.asarray(ARM.upper), (count, ARM.n_joints))


def probe_points(seed: int, outliers: int = 0):
    rng = np.random.default_rng(seed)
    true = deviations(rng)
    q = readings(rng, POINTS)
    measured = tips(true, q) + NOISE * rng.standard_normal((POINTS, 3))
    measured[:outliers] += 0.1 * rng.standard_normal((outliers, 3))
    return true, q, measured


def test_an_arm_with_every_deviation_is_the_chain_written_out():
    rng = np.random.default_rng(7)
    none = KinematicErrors.none(ARM)
    true = none.like(jnp.asarray(0.1 * rng.standard_normal(none.flat().shape)))
    q = readings(rng, 20)
    built = deviating_arm(ARM, true)
    found = jaxik.forward_kinematics(built, (1 + true.scale) * q).position
    np.testing.assert_allclose(found, tips(true, q), atol=1e-14)
    # It is an arm of the class: the closed form solves it.
    target = jaxik.forward_kinematics(built, q)
    swivel, branch = jaxik.swivel_of(built, q)
    solution = jaxik.solve_ik(built, jaxik.Pointing(target.position, target.rotation[..., 2]), swivel)
    again = jnp.take_along_axis(solution.q, branch[:, None, None], 1)[:, 0]
    np.testing.assert_allclose(np.sin((again - q) / 2), 0, atol=1e-9)


def test_tips_of_new_poses_are_right_to_the_noise():
    true, q, measured = probe_points(0, outliers=5)
    found = training.calibrate(MODEL, q, measured)
    assert found.outliers == (0, 1, 2, 3, 4)
    assert found.noise == pytest.approx(NOISE, rel=0.2)
    new = readings(np.random.default_rng(1), 500)
    off = np.linalg.norm(
        jaxik.forward_kinematics(found.model.arm, found.angles(new)).position - tips(true, new), axis=1
    )
    assert off.mean() < 1.5e-3
    nominal = np.linalg.norm(jaxik.forward_kinematics(ARM, new).position - tips(true, new), axis=1)
    assert nominal.mean() > 20e-3


def test_undetermined_combinations_are_named_with_infinite_errors():
    _, q, measured = probe_points(2)
    found = training.calibrate(MODEL, q, measured)
    assert len(found.undetermined) == 1
    assert "zero of right_shoulder_swing" in found.undetermined[0]
    assert "rotation of the mount about y" in found.undetermined[0]
    infinite = [name for name, e in zip(found.names, found.deviation.flat(), strict=True) if math.isinf(e)]
    assert sorted(infinite) == ["rotation of the mount about y", "zero of right_shoulder_swing"]
    # Without the mount among the unknowns, the zero is determined.
    fixed = training.calibrate(MODEL, q, measured, fit=("lengths", "zeros", "scales"))
    assert fixed.undetermined == ()
    assert np.isfinite(fixed.deviation.flat()).all()
    assert not fixed.errors.turn.any()


@pytest.mark.slow
def test_points_at_one_posture_determine_little_and_change_little():
    rng = np.random.default_rng(3)
    q = np.tile(readings(rng, 1), (60, 1))
    measured = tips(deviations(rng), q) + NOISE * rng.standard_normal((60, 3))
    found = training.calibrate(MODEL, q, measured)
    assert len(found.undetermined) >= 15
    assert float(jnp.abs(found.errors.length).max()) < 0.2


@pytest.mark.slow
def test_standard_errors_cover_the_truth_at_the_stated_rate():
    trials = 200
    data = [probe_points(1000 + i) for i in range(trials)]
    truth = np.stack([np.asarray(true.flat()) for true, *_ in data])
    q, measured = (jnp.asarray(np.stack([row[i] for row in data])) for i in (1, 2))
    mask = jnp.asarray(fitted_parameters(ARM, GROUPS))
    fits = jax.jit(jax.vmap(lambda q, tip: fit_kinematics(ARM, q, tip, mask)))(q, measured)
    assert float(fits.step.max()) < 1e-3
    found = np.asarray(jax.vmap(lambda e: e.flat())(fits.errors))
    error = np.asarray(jax.vmap(lambda e: e.flat())(fits.deviation))
    names = names_of(MODEL.joint_names)
    determined = [
        i for i, n in enumerate(names) if n not in ("rotation of the mount about y", "zero of right_shoulder_swing")
    ]
    ratio = np.abs(found - truth)[:, determined] / error[:, determined]
    for rate in (0.68, 0.95):
        covered = (ratio <= stats.norm.ppf((1 + rate) / 2)).mean(axis=0)
        # Each parameter within what 200 trials scatter (four standard deviations), all together much closer.
        assert np.abs(covered - rate).max() < 4 * math.sqrt(rate * (1 - rate) / trials)
        assert covered.mean() == pytest.approx(rate, abs=0.02)
    new = jnp.asarray(readings(np.random.default_rng(9), 100))
    angles = jax.vmap(lambda e: (1 + e.scale) * new)(fits.errors)
    arms = jax.vmap(lambda e: deviating_arm(ARM, e))(fits.errors)
    reached = jax.vmap(lambda arm, q: jaxik.forward_kinematics(arm, q).position)(arms, angles)
    real = np.stack([tips(true, np.asarray(new)) for true, *_ in data])
    assert np.linalg.norm(reached - real, axis=-1).mean(axis=1).max() < 1.5e-3


@pytest.mark.parametrize(
    ("count", "fit", "said"),
    [(5, GROUPS, "measure at least"), (50, ("lengths", "colors"), "'colors'")],
)
def test_what_cannot_be_fitted_is_refused(count, fit, said):
    _, q, measured = probe_points(0)
    with pytest.raises(ValueError, match=said):
        training.calibrate(MODEL, q[:count], measured[:count], fit=fit)


def test_degrees_for_radians_are_noticed():
    _, q, measured = probe_points(0)
    with pytest.raises(training.CalibrationError, match="units"):
        training.calibrate(MODEL, np.degrees(q), measured)


def write(path, q, measured, degrees=False, names=MODEL.joint_names):
    factor, ending = (180 / math.pi, "_deg") if degrees else (1.0, "")
    header = ",".join([*(name + ending for name in names), "x", "y", "z"])
    np.savetxt(path, np.hstack([factor * q, measured]), delimiter=",", header=header, comments="", fmt="%.17g")


@pytest.mark.parametrize("degrees", [False, True])
def test_points_from_a_file(tmp_path, degrees):
    _, q, measured = probe_points(0)
    write(tmp_path / "t.csv", q, measured, degrees)
    loaded = training.load_probe_points(tmp_path / "t.csv", MODEL.joint_names)
    np.testing.assert_allclose(loaded.q, q, atol=1e-15)
    np.testing.assert_array_equal(loaded.tip, measured)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_points_from_a_spreadsheet(tmp_path, encoding):
    _, q, measured = probe_points(0)
    write(tmp_path / "t.csv", q, measured)
    text = (tmp_path / "t.csv").read_text().replace(",", ";").replace(".", ",").replace("\n", ";;\r\n") + ";;;\r\n"
    (tmp_path / "t.csv").write_bytes(text.encode(encoding))
    loaded = training.load_probe_points(tmp_path / "t.csv", MODEL.joint_names)
    np.testing.assert_array_equal(loaded.q, q)
    np.testing.assert_array_equal(loaded.tip, measured)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty"),
        ("a,b\n1,2\n", "expected the columns"),
        ("q1,q2,q3,q4,q5,q6,x,y,z\n", "got none"),
        ("q1,q2,q3,q4,q5,q6,x,y,z\n1,2,3\n", "t.csv:2: expected 9 numbers"),
        ("q1,q2,q3,q4,q5,q6,x,y,z\n1,2,3,4,5,6,7,8,nan\n", "expected finite numbers"),
        ("q1,q2,q3,q4,q5,q6,x,y,z\n1,2,3,4,5,6,7,8,red\n", "expected numbers"),
    ],
)
def test_a_bad_file_is_refused_with_its_line(tmp_path, text, said):
    file = tmp_path / "t.csv"
    file.write_text(text)
    with pytest.raises(jaxik.FileFormatError, match=said):
        training.load_probe_points(file, MODEL.joint_names)


def test_the_command_writes_a_model_that_every_command_takes(tmp_path, monkeypatch, capsys):
    from jaxik.cli.inputs import find_arm
    from training.cli import calibrate_geometry

    true, q, measured = probe_points(0)
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "t.csv", q, measured)
    assert calibrate_geometry(tmp_path / "t.csv", out=tmp_path / "mine.json", json=True) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["deviation"]["length of the upper arm"] == pytest.approx(float(true.length[0]), abs=0.01)
    assert facts["standard_error"]["zero of right_shoulder_swing"] is None
    model = find_arm(str(tmp_path / "mine.json"))
    new = readings(np.random.default_rng(5), 50)
    scale = 1 + np.array([facts["deviation"][f"scale of {name}"] for name in MODEL.joint_names])
    off = jaxik.forward_kinematics(model.arm, scale * new).position - tips(true, new)
    assert np.linalg.norm(off, axis=1).mean() < 1.5e-3
