"""The program: exit codes, errors in one sentence, and JSON output."""

import json

import numpy as np
import pytest

import jaxik
from jaxik.cli import program, run
from jaxik.cli.inputs import parse_fraction
from tests.helpers.urdf_text import arm_urdf, iiwa_urdf, two_arms


def test_help_lists_every_installed_command(capsys):
    assert run(["--help"]) == 0
    text = capsys.readouterr().out
    for name in ("demo", "info", "plan", "play", "solve"):
        assert f"\n  {name} " in text
    assert max(map(len, text.splitlines())) <= 80


def test_no_command_is_wrong_usage(capsys):
    assert run([]) == 2
    assert "usage: jaxik COMMAND" in capsys.readouterr().out


def test_version(capsys):
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.startswith("jaxik ")


@pytest.mark.parametrize("words", [["dance"], ["solve"], ["solve", "1", "2"], ["plan", "word", "--nonsense"]])
def test_wrong_usage_is_exit_code_2(words, capsys):
    assert run(words) == 2


def test_a_commands_help_is_no_error(capsys):
    assert run(["solve", "--help"]) == 0
    assert "meters" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "fraction"), [("0.01", 0.01), ("1%", 0.01), ("0", 0.0), ("0 %", 0.0), ("12.5%", 0.125)]
)
def test_a_fraction_is_a_number_or_a_percentage(text, fraction):
    assert parse_fraction(text) == pytest.approx(fraction, abs=1e-15)


def test_the_help_of_plan_shows_a_percent_sign(capsys):
    assert run(["plan", "--help"]) == 0
    assert "0.01 or 1%;" in " ".join(capsys.readouterr().out.replace("│", " ").split())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["plan", "word", "--gap", "1"], "expected a fraction such as 0.01 or a percentage such as 1%, got '1'"),
        (["plan", "word", "--gap=-1%"], "got '-1%'"),
        (["plan", "word", "--gap", "little"], "got 'little'"),
        (["plan", "no.csv"], "jaxik plan: no.csv: No such file or directory"),
        (["plan", "loop"], "jaxik plan: no path 'loop'; there are word, figure-eight"),
        (["info", "--arm", "octopus"], "jaxik info: no arm 'octopus'; there are meccanoid-right"),
        (["info", "--arm", "iiwa7", "--base", "a"], "--base and --tip are links of a URDF file; iiwa7 is none"),
        (["info", "no.urdf"], "jaxik info: no.urdf: No such file or directory"),
        (["plan", "word", "--arm", "octopus"], "jaxik plan: no arm 'octopus'; there are meccanoid-right"),
        (["play", "x.txt"], "jaxik play: x.txt: expected a file name ending in"),
        (["solve", "0", "0", "0", "--direction", "1", "0", "0", "--quaternion", "1", "0", "0", "0"], "not both"),
    ],
)
def test_a_failure_is_one_sentence_and_exit_code_1(words, said, capsys):
    assert run(words) == 1
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert "Traceback" not in error


def test_debug_shows_the_traceback(capsys):
    assert run(["plan", "no.csv", "--debug"]) == 1
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (KeyboardInterrupt(), 130, "jaxik info: stopped"),
        (RuntimeError("two\nlines"), 1, "jaxik info: RuntimeError: two lines (use --debug for details)"),
        (jaxik.UnreachableError("too far"), 1, "jaxik info: too far\n"),
    ],
)
def test_whatever_a_command_raises_becomes_a_sentence(error, code, said, monkeypatch, capsys):
    def fail(point, words):
        raise error

    monkeypatch.setattr(program, "_call", fail)
    assert run(["info"]) == code
    assert said in capsys.readouterr().err


def test_info_names_versions_arms_and_paths(capsys):
    assert run(["info", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["double precision"] == "on"
    assert "iiwa14" in facts["arms"]
    assert "word" in facts["paths"]
    assert run(["info"]) == 0
    assert "iiwa14" in capsys.readouterr().out


def test_solve_prints_solutions_that_reach(capsys):
    words = ["solve", "0.2", "-0.1", "-0.2", "--direction", "1", "0", "-0.2", "--swivel-deg", "40", "--json"]
    code = run(words)
    answer = json.loads(capsys.readouterr().out)
    assert len(answer["branches"]) == 8
    usable = [b for b in answer["branches"] if b["status"] in ("OK", "NEAR_SINGULAR")]
    assert code == (0 if usable else 1)
    arm = jaxik.presets.meccanoid("right").arm
    for branch in answer["branches"]:
        tool = jaxik.forward_kinematics(arm, np.array(branch["q_rad"]))
        np.testing.assert_allclose(tool.position, [0.2, -0.1, -0.2], atol=1e-10)
    assert run(words[:-1]) == code
    table = capsys.readouterr().out
    assert "111" in table
    assert "[m]" in table  # the unit is no mark of rich's


def test_solve_out_of_reach_fails_and_says_so(capsys):
    assert run(["solve", "9", "0", "0", "--arm", "iiwa14", "--quaternion", "1", "0", "0", "0"]) == 1
    assert "OUT_OF_REACH" in capsys.readouterr().out


def test_solve_asks_for_the_rotation_where_a_direction_does_not_do(capsys):
    assert run(["solve", "0.4", "0.1", "0.5", "--arm", "fr3"]) == 1
    assert "give --quaternion w x y z, such as 0 1 0 0" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--base", "x"], "got 1 and 0 for 2 arms"),
        (["motion.npz"], "trajectories and --world go with one --arm; got iiwa14, fr3"),
    ],
)
def test_several_arms_are_shown_alone_and_each_with_its_links(words, said, capsys):
    assert run(["view", "--arm", "iiwa14", "--arm", "fr3", *words]) == 1
    assert said in capsys.readouterr().err


def test_play_reports_how_it_ended(tmp_path, capsys):
    t = np.linspace(0, 1, 30)
    jaxik.Trajectory(t, np.sin(t)[:, None], ("a",)).save(tmp_path / "x.json")
    assert run(["play", str(tmp_path / "x.json"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["result"] == "SUCCESS"
    assert run(["play", str(tmp_path / "x.json"), "--speed", "20"]) == 1
    assert "LIMIT: a would need" in capsys.readouterr().out


def urdf(folder, text):
    (folder / "x.urdf").write_text(text)
    return str(folder / "x.urdf")


def test_info_describes_an_arm(tmp_path, capsys):
    assert run(["info", "--arm", "iiwa7", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["name"] == "iiwa7"
    assert facts["class"] == "S-R-S"
    np.testing.assert_allclose(facts["range_deg"][1], [-120, 120])
    np.testing.assert_allclose([facts["upper_arm"], facts["forearm"]], 0.4)
    jaxik.save_model(jaxik.presets.iiwa7(), tmp_path / "x.json")
    assert run(["info", str(tmp_path / "x.json")]) == 0
    said = capsys.readouterr().out
    assert "joint_7" in said
    assert "upper arm 0.4 m" in said


def test_info_lists_the_arms_of_a_urdf(tmp_path, capsys):
    file = urdf(tmp_path, iiwa_urdf(7))
    assert run(["info", file, "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)["arms"]
    assert (found["base"], found["tip"], found["class"], found["problem"]) == ("link_0", "flange", "S-R-S", "")
    assert run(["info", file]) == 0
    said = capsys.readouterr().out
    assert f"use one: jaxik plan reach --arm {file} --base link_0 --tip flange\n" in said  # in one line, to be copied
    assert f"arms in {file}\n" in said
    file = urdf(tmp_path, arm_urdf(shifts={2: (0.1, 0, 0.1), 7: (0, 0.1, 0)}))
    assert run(["info", file, "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)["arms"]
    assert found["class"].startswith("near ")
    assert 0.1 < found["deviation"] < 1.0
    assert run(["info", file]) == 0
    said = capsys.readouterr().out
    assert f"use one: jaxik plan reach --arm {file}" in said
    assert "solved by refinement" in said
    assert run(["info", file, "--base", "base", "--tip", "tip"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "solved: refined from" in said
    assert "pass each other at 100 mm" in said
    assert run(["info", urdf(tmp_path, arm_urdf("zyzzzyz"))]) == 1
    assert "the shoulder is 0 mm from axis 4" in " ".join(capsys.readouterr().out.split())
    assert run(["info", urdf(tmp_path, arm_urdf("zyz"))]) == 1
    assert run(["info", urdf(tmp_path, arm_urdf(shifts={2: (0.1, 0, 0.1)})), "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out.splitlines()[-1])["arms"]
    assert (found["class"], found["parameter"]) == ("R-U shoulder", "q1 (j1)")


def test_the_reasons_of_other_limbs_do_not_bury_the_arms_of_a_urdf(tmp_path, capsys):
    assert run(["info", urdf(tmp_path, two_arms("zyzzzyz"))]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "base tip" in said
    assert "not an S-R-S arm" not in said
    assert "the reason why one is not solved: jaxik info" in said


def test_solve_takes_a_urdf(tmp_path, capsys):
    file = urdf(tmp_path, iiwa_urdf(7))
    words = ["solve", "0.4", "0.1", "0.5", "--quaternion", "0", "1", "0", "0", "--swivel-deg", "180", "--json", "--arm"]
    assert run([*words, file]) == run([*words, file, "--base", "link_0", "--tip", "flange"]) == 0
    first, second = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert first == second
    arm = jaxik.load_urdf(file, "link_0", "flange").arm
    tool = jaxik.forward_kinematics(arm, np.array(first["branches"][0]["q_rad"]))
    np.testing.assert_allclose(tool.position, [0.4, 0.1, 0.5], atol=1e-10)


@pytest.mark.parametrize(
    ("text", "words", "said"),
    [
        (arm_urdf(), ["--base", "base"], "--base and --tip go together; `jaxik info"),
        (arm_urdf("zyz"), [], "has no arm of the class: no six or seven turning joints follow each other"),
        (
            arm_urdf("zyzzzyz"),
            [],
            "from base to tip: not an S-R-S arm: the shoulder is 0 mm from axis 4",
        ),
        (arm_urdf(), ["--base", "tip", "--tip", "base"], "base and tip are swapped"),
        (two_arms(), [], "has 2 arms; select one: --base base --tip tip, --base base_2 --tip tip_2"),
    ],
)
def test_a_urdf_that_needs_more_is_one_sentence(tmp_path, text, words, said, capsys):
    assert run(["solve", "0", "0", "0", "--arm", urdf(tmp_path, text), *words]) == 1
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_a_warning_is_a_sentence_and_no_failure(tmp_path, capsys):
    file = urdf(tmp_path, arm_urdf().replace('lower="-2.0"', 'lower="-170"', 1))
    assert run(["info", "--arm", file, "--json"]) == 0
    caught = capsys.readouterr()
    assert json.loads(caught.out)["name"] == "test"
    assert caught.err.startswith("jaxik info: warning: x.urdf: the limits of j1 (-170 to 2) look like degrees")
    assert caught.err.count("\n") == 1
