"""The paper's worked example: printed numbers, errata, and the solver's result."""

import dataclasses
import json
import math
import os
import subprocess
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxik import Pointing, Status, joint_positions, paper, solve_ik, swivel_of
from jaxik.arm import presets
from jaxik.paper import formulas
from jaxik.paper.steps import FOREARM, HAND, TIP, UPPER_ARM, WRIST

STEPS = {step.equation: step for step in paper.worked_example()}
ROUNDED_TWICE = {"42", "48", "77", "78", "86"}  # degrees of an angle that was first rounded to 0.01 rad
ERRATA = ROUNDED_TWICE | {"7-10", "44", "45", "46", "49", "text after 78"}
ELBOW = (2.5 + 0.06066017177982128, 0.4393398282201787, -1.5)  # 3/2 ± 3 / (2 sqrt 2), as printed: 2.56, 0.44


@pytest.fixture(scope="module")
def printed_values() -> dict:
    """The file of printed and independently computed numbers, which is no part of the project."""
    default = Path(__file__).resolve().parents[3] / "shared" / "paper"
    file = Path(os.environ.get("JAXIK_PAPER", default)) / "printed_values.json"
    if not file.is_file():
        pytest.skip(f"no {file}: set JAXIK_PAPER to the folder that holds printed_values.json")
    return json.loads(file.read_text(encoding="utf-8"))


def test_every_number_of_the_file_is_matched(printed_values):
    assert len(printed_values["values"]) >= 28
    for value in printed_values["values"]:
        step = STEPS[value["eq"]]
        assert step.printed == tuple(np.atleast_1d(value["printed"])), step
        np.testing.assert_allclose(step.exact, np.atleast_1d(value["exact"]), rtol=1e-13, atol=1e-15, err_msg=step.name)


def test_errata_are_those_of_the_file(printed_values):
    stated = {value["eq"] for value in printed_values["values"] if "erratum" in value}
    checked = {value["eq"] for value in printed_values["values"]}
    # The file accepts (78) and (86), although they are rounded in radians first like its errata (42) and (48).
    assert ERRATA & checked - stated == {"78", "86"}
    assert stated <= ERRATA


def test_inputs_and_joint_angles_are_those_of_the_file(printed_values):
    given = printed_values["inputs"]
    assert (given["wrist"], given["hand_tip"]) == (list(WRIST), list(TIP))
    assert (given["upper_arm_d1"], given["forearm_d2"]) == (UPPER_ARM, FOREARM)
    solved = printed_values["closed_form_solution_that_reaches_the_target"]
    np.testing.assert_allclose(np.degrees(paper.solve_example().q[0]), solved["q_deg"], atol=1e-8)
    np.testing.assert_allclose(ELBOW, solved["forward_check"]["elbow"], atol=1e-15)


@pytest.mark.parametrize("step", STEPS.values(), ids=STEPS)
def test_printed_is_a_rounding_of_the_exact_or_a_stated_erratum(step):
    assert step.is_rounding == (step.erratum is None), step
    assert (step.equation in ERRATA) == (step.erratum is not None)


@pytest.mark.parametrize("equation", sorted(ERRATA - {"7-10"}))
def test_wrong_numbers_are_retraced_to_what_was_printed_before(equation):
    step = STEPS[equation]
    (printed,) = step.printed
    assert 0.0 <= abs(step.retraced) - abs(printed) + 0.005 < 0.015, step
    assert step.retraced != pytest.approx(step.exact[0], abs=1e-3)


def test_rounding_means_the_digits_printed():
    def step(printed, exact):
        return paper.Step("0", "", "", "", (printed,), 2, (exact,))

    assert all(step(2.6, exact).is_rounding for exact in (2.595, 2.6, 2.6049, 2.609))
    assert not any(step(2.6, exact).is_rounding for exact in (2.594, 2.611, -2.6))
    assert step(-0.41, -0.408).is_rounding
    assert not step(-0.41, 0.408).is_rounding


def test_every_number_in_order_without_the_file():
    assert len(STEPS) == len(paper.worked_example())
    np.testing.assert_allclose(STEPS["38-40"].exact, ELBOW, rtol=1e-15)
    np.testing.assert_allclose(STEPS["58"].exact, 1.5 * 1.0606601717798212 * np.array([1, 1, 2]), rtol=1e-14)
    degrees = {"42": 60.0, "46": 60.0, "48": 60.0, "49": 120.0, "44": math.degrees(math.atan(0.171572875253810))}
    for equation, exact in degrees.items():
        assert STEPS[equation].exact == pytest.approx((exact,), rel=1e-13)
    # Side lengths 3, 3 and 3 sqrt 3 by the law of cosines; (2 + sqrt 2) / 4 at the wrist, 1 / sqrt 6 at the plane.
    assert STEPS["49"].exact[0] == pytest.approx(math.degrees(math.acos((9 + 9 - 27) / 18)), rel=1e-13)
    assert STEPS["85"].exact[0] == pytest.approx(-(2 + math.sqrt(2)) / 4, rel=1e-13)
    assert STEPS["76"].exact[0] == pytest.approx(1 / math.sqrt(6), rel=1e-13)


def test_paper_arm_reaches_where_the_printed_roll_misses():
    misses = paper.printed_roll_misses()
    assert set(misses) == {(sign, offset) for sign in (1, -1) for offset in (0, 90, 180, 270)}
    assert min(misses.values()) == pytest.approx(0.129, abs=5e-4)
    assert paper.printed_roll_miss() == min(misses.values())
    assert paper.printed_roll_miss(51.58933961964989) < 1e-14
    assert paper.solved_miss() < 1e-14


def test_printed_roll_misses_whatever_the_flexion():
    """By brute force on the solved angles, flexion swept over a whole turn."""
    q = np.asarray(paper.solve_example().q[0])
    sweep = np.radians(np.arange(0.0, 360.0, 0.5))
    for (sign, offset), miss in paper.printed_roll_misses().items():
        roll = math.radians(sign * 114.11 + offset)
        tips = [paper.chain(np.array([*q[:4], roll, a]), UPPER_ARM, FOREARM, HAND)[2] for a in sweep]
        nearest = np.min(np.linalg.norm(np.array(tips) - TIP, axis=1))
        assert miss - 1e-12 <= nearest <= miss + 1e-4


def test_roll_is_the_dihedral_angle_and_relates_to_the_printed_one():
    elbow, wrist, tip = np.array(ELBOW), np.array(WRIST), np.array(TIP)
    roll = paper.forearm_roll(elbow, wrist, tip)
    assert math.degrees(roll) == pytest.approx(51.58933961964989, rel=1e-12)
    line_plane = math.radians(STEPS["78"].exact[0])
    flexion = math.pi - paper.interior_wrist_angle(elbow, wrist, tip)
    assert math.sin(line_plane) == pytest.approx(abs(math.sin(roll) * math.sin(flexion)), rel=1e-13)


@pytest.mark.parametrize("t", np.linspace(0.0, 2 * np.pi, 13)[:-1])
def test_swivel_is_the_papers_parameter_and_comes_back(t):
    arm = presets.paper_arm().arm
    solution = paper.solve_example(t)
    elbow = paper.elbow_circle(np.array(WRIST), UPPER_ARM, FOREARM).point(float(t))
    for branch in range(8):
        reached = paper.chain(np.asarray(solution.q[branch]), UPPER_ARM, FOREARM, HAND)
        np.testing.assert_allclose(reached, (elbow, WRIST, TIP), atol=1e-14)
        swivel, found = swivel_of(arm, solution.q[branch])
        assert found == branch
        assert abs(math.remainder(float(swivel) - t, 2 * math.pi)) < 1e-14


def test_example_lies_on_the_printed_elbow_within_the_servo_ranges():
    solution = paper.solve_example()
    elbow, wrist, tip = paper.chain(np.asarray(solution.q[0]), UPPER_ARM, FOREARM, HAND)
    np.testing.assert_allclose(elbow, (2.56, 0.44, -1.5), atol=1e-3)
    np.testing.assert_allclose((wrist, tip), (WRIST, TIP), atol=1e-14)
    assert solution.status[0] == Status.OK
    assert np.all(solution.status[1:] == Status.LIMITS)


@pytest.mark.parametrize("below", [True, False])
@pytest.mark.parametrize("left", [True, False])
def test_arcsine_and_arccosine_lose_three_quadrants_of_four(below, left):
    elbow = np.array([2.0, 1.0 if left else -1.0, -2.0 if below else 2.0])
    printed = paper.elbow_from_shoulder_angles(*paper.printed_shoulder_angles(elbow, 3.0), 3.0)
    holds = paper.elbow_from_shoulder_angles(*paper.shoulder_angles(elbow), 3.0)
    np.testing.assert_allclose(holds, elbow, atol=1e-15)
    lost = [0.0 if left else 2.0, 0.0 if below else 4.0]  # mirrored in y, in z
    np.testing.assert_allclose(np.linalg.norm(printed - elbow), np.hypot(*lost), atol=1e-14)


def test_elbow_and_shoulder_errors_in_lengths():
    """What the printed angles cost, everything else exact."""
    reach = math.sqrt(9 + 9 - 18 * math.cos(math.radians(105.57)))
    assert np.linalg.norm(WRIST) - reach == pytest.approx(0.418, abs=5e-4)
    elbow = paper.elbow_from_shoulder_angles(math.radians(60.16), math.radians(8.59), UPPER_ARM)
    assert np.linalg.norm(elbow - ELBOW) == pytest.approx(0.053, abs=5e-4)


def test_hand_of_two_gives_another_wrist():
    np.testing.assert_array_equal(paper.wrist_from_hand(np.array(TIP), 2.0, 0.0, 0.0), (3, 4, -1))
    along_y = paper.wrist_from_hand(np.array(TIP), 1.0, -math.pi / 2, math.pi / 2)
    np.testing.assert_allclose(along_y, WRIST, atol=1e-15)


def test_absolute_value_would_fold_the_wrist():
    interior = paper.interior_wrist_angle(np.array(ELBOW), np.array(WRIST), np.array(TIP))
    assert math.degrees(interior) == pytest.approx(148.60028519008097, rel=1e-12)
    assert math.degrees(math.acos(abs(math.cos(interior)))) == pytest.approx(31.39971480991902, rel=1e-12)


@pytest.mark.parametrize("height", [-5.0, 5.0])
def test_paper_has_no_axes_for_a_wrist_on_the_vertical_and_jaxik_does(height):
    circle = paper.elbow_circle(np.array([0.0, 0.0, height]), UPPER_ARM, FOREARM)
    assert not circle.a1.any()
    assert np.isnan(circle.point(math.pi)).all()
    arm = dataclasses.replace(presets.paper_arm().arm, lower=jnp.full(6, -4.0), upper=jnp.full(6, 4.0))
    solution = solve_ik(arm, Pointing(np.array([1.0, 0.0, height]), np.array([1.0, 0.0, 0.0])), 3.0)
    assert np.all(solution.status == Status.NEAR_SINGULAR)
    assert np.all(solution.residual.position < 1e-13)


@pytest.mark.parametrize("wrist", [(0.0, 4.0, -5.0), (0.3, 0.2, -0.1)])
def test_paper_has_no_circle_out_of_reach_and_jaxik_says_so(wrist):
    forearm = 2.0  # with d1 = 3 the wrist must be 1 to 5 from the shoulder
    circle = paper.elbow_circle(np.array(wrist), UPPER_ARM, forearm)
    assert np.isnan(circle.radius)
    up = jnp.array([0.0, 0.0, 1.0])
    arm = dataclasses.replace(presets.paper_arm().arm, wrist=5.0 * up, tool_position=6.0 * up)
    solution = solve_ik(arm, Pointing(np.add(wrist, (0, 1, 0)), np.array([0.0, 1.0, 0.0])), math.pi)
    assert np.all(solution.status == Status.OUT_OF_REACH)
    assert np.all(np.isfinite(solution.q))


def test_arm_hanging_down_has_no_axes_in_the_paper():
    """The rest posture: straight, and on the line where eq. (21) vanishes."""
    arm = presets.paper_arm().arm
    circle = paper.elbow_circle(np.array([0.0, 0.0, -6.0]), UPPER_ARM, FOREARM)
    assert not circle.a1.any()
    solution = solve_ik(arm, Pointing(np.array([0.0, 0.0, -7.0]), np.array([0.0, 0.0, -1.0])), 1.0)
    assert np.all(np.isfinite(solution.q))
    assert np.all(solution.residual.position < 1e-6)
    assert not np.any(solution.status == Status.OUT_OF_REACH)


def test_table_names_every_equation_and_erratum():
    lines = paper.table().splitlines()
    assert all(len(line) <= 120 for line in lines)
    listed = lines[1 : lines.index("")]
    assert len(listed) == len(STEPS)
    for step, line in zip(STEPS.values(), listed, strict=True):
        assert line.startswith(step.equation)
        assert line.endswith("]") == (step.erratum is not None)
    assert any("114.11 deg" in line and "114.095 deg" in line for line in listed)
    assert lines[-1].startswith("  with the joint angles of jaxik.solve_ik in float64: ")


@pytest.mark.slow
def test_module_prints_the_table_in_float64(repository, tmp_path):
    run = subprocess.run(
        [sys.executable, "-W", "error", "-m", "jaxik.paper"],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(repository)},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip() == paper.table().strip()


def test_chain_of_the_paper_is_that_of_the_arm():
    q = np.random.default_rng(0).uniform(-3, 3, 6)
    expected = np.asarray(joint_positions(presets.paper_arm().arm, q))[1:]
    np.testing.assert_allclose(formulas.chain(q, UPPER_ARM, FOREARM, HAND), expected, atol=1e-14)
