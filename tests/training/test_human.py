"""Natural elbows: files, the reference rules, the energy; and the recorded arm where it is at hand."""

import csv
import json

import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
import training
from tests.helpers.arms import ALL_PRESETS
from training.human.data import HumanFrames
from training.human.natural_elbow import elbow_circle
from training.human.training import HumanConfig
from training.loop import LoopConfig


def made_up(count: int) -> HumanFrames:
    """A person whose elbow hangs down and back, by a rule a network can learn."""
    rng = np.random.default_rng(0)
    hand = rng.normal(size=(count, 3))
    hand = np.abs(hand) * [1, -1, 1] + [0.3, 0, -0.3]
    hand *= (0.5 + 0.4 * rng.uniform(size=(count, 1))) / np.linalg.norm(hand, axis=1, keepdims=True)
    rotation = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    rotation *= np.linalg.det(rotation)[:, None, None]
    n = hand / np.linalg.norm(hand, axis=1, keepdims=True)
    pull = np.array([-0.5, -0.3, -1.0]) + 0.3 * rotation[:, :, 0]
    across = pull - (pull * n).sum(1, keepdims=True) * n
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    upper, fore = 0.52, 0.46
    along = (upper**2 - fore**2 + (hand**2).sum(1)) / (2 * np.linalg.norm(hand, axis=1))
    elbow = along[:, None] * n + np.sqrt(upper**2 - along**2)[:, None] * across
    return HumanFrames(elbow, hand, rotation)


def write(path, rows):
    names = [f"{p}_{a}" for p in ("elbow", "hand") for a in "xyz"] + [f"hand_q{a}" for a in "xyzw"]
    with open(path, "w", newline="") as file:
        csv.writer(file).writerows([names, *rows])


def test_axes_become_those_of_a_robot(tmp_path):
    # In T-pose: arm along +x, hand not turned. Then the arm forward (z), the hand turned with it, about the upward y.
    half = np.sqrt(0.5)
    write(tmp_path / "h.csv", [[0.5, 0, 0, 1, 0, 0, 0, 0, 0, 1], [0, 0.1, 0.5, 0, 0, 1, 0, -half, 0, half]])
    frames = training.load_human(tmp_path / "h.csv")
    np.testing.assert_allclose(frames.hand, [[0, -1, 0], [1, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(frames.elbow[1], [0.5, 0, 0.1], atol=1e-15)
    np.testing.assert_allclose(frames.rotation[:, :, 2], frames.hand, atol=1e-12)  # it points along the arm
    np.testing.assert_allclose(frames.rotation[0, :, 0], [1, 0, 0], atol=1e-12)  # thumb forward, palm down
    np.testing.assert_allclose(np.linalg.det(frames.rotation), 1)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([], "at least 2"),
        ([[0.0] * 10] * 2, "h.csv:2: expected finite"),
        ([["x"] * 10] * 2, "h.csv:2: expected numbers"),
    ],
)
def test_a_bad_recording_is_refused(tmp_path, rows, said):
    write(tmp_path / "h.csv", rows)
    with pytest.raises(jaxik.FileFormatError, match=said):
        training.load_human(tmp_path / "h.csv")


def test_the_fitted_arms_circle_goes_through_the_elbows():
    frames = made_up(50)
    arm = training.human_arm(frames).arm
    center, cos, sin = elbow_circle(arm, jaxik.Pose(jnp.asarray(frames.hand), jnp.asarray(frames.rotation)))
    offset = frames.elbow - center
    np.testing.assert_allclose(np.linalg.norm(offset, axis=1), np.linalg.norm(cos, axis=1), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(cos, axis=1), np.linalg.norm(sin, axis=1), atol=1e-9)
    np.testing.assert_allclose((offset * frames.hand).sum(1), 0, atol=1e-9)


@pytest.fixture(scope="module")
def learned():
    config = HumanConfig(members=2, width=16, loop=LoopConfig(steps=150, batch=128, learning_rate=5e-3))
    return made_up(600), training.train_human(made_up(600), config)


@pytest.mark.slow
def test_a_rule_is_learned_and_better_than_simpler_ones(learned):
    _, trained = learned
    scores = trained.scores
    assert scores["floor"].median < 1e-6
    assert scores["policy"].median < 0.6 * min(scores[name].median for name in ("nearest neighbors", "constant swivel"))


def test_swivel_and_direction_are_one_elbow(learned):
    frames, trained = learned
    pose = jaxik.Pose(jnp.asarray(frames.hand[:20]), jnp.asarray(frames.rotation[:20]))
    swivel = trained.policy.swivel(trained.policy.arm, pose)
    q = jaxik.solve_ik(trained.policy.arm, pose, swivel).q[:, 0]
    elbow = jaxik.joint_positions(trained.policy.arm, q)[:, 1]
    n = pose.position / jnp.linalg.norm(pose.position, axis=1, keepdims=True)
    across = elbow - jnp.sum(elbow * n, axis=1, keepdims=True) * n
    across = across / jnp.linalg.norm(across, axis=1, keepdims=True)
    np.testing.assert_allclose(across, trained.policy.direction(pose.position, pose.rotation), atol=1e-6)


@pytest.mark.parametrize("name", ["iiwa7", "meccanoid_left", "meccanoid_right", "paper_arm"])
def test_the_swivel_of_any_arm_turns_its_elbow_where_a_persons_would_be(learned, name):
    _, trained = learned
    policy, arm = trained.policy, ALL_PRESETS[name]().arm
    side = "left" if name.endswith("left") else "right"
    turn = (
        np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]) if name == "iiwa7" else np.eye(3)
    )  # an arm that stands upright
    q = jnp.asarray(np.random.default_rng(0).uniform(-1.0, 1.0, (10, arm.n_joints)))
    pose = jaxik.forward_kinematics(arm, q)
    swivel = policy.swivel(arm, pose, side=side, person=turn)
    target = pose if arm.n_joints == 7 else pose.pointing()
    points = np.asarray(jaxik.joint_positions(arm, jaxik.solve_ik(arm, target, swivel).q[:, 0]))
    shoulder, elbow, wrist = (points[:, i] for i in range(3))
    n = (wrist - shoulder) / np.linalg.norm(wrist - shoulder, axis=1, keepdims=True)
    across = elbow - shoulder - ((elbow - shoulder) * n).sum(1, keepdims=True) * n
    across = across / np.linalg.norm(across, axis=1, keepdims=True)
    # The oracle: the hand as a person's, by hand.
    mirror = np.diag([1.0, -1.0, 1.0]) if side == "left" else np.eye(3)
    length = lambda a: np.linalg.norm(a.elbow - a.shoulder) + np.linalg.norm(a.wrist - a.elbow)  # noqa: E731
    position = (wrist - shoulder) @ turn.T @ mirror * length(policy.arm) / length(arm)
    natural = policy.direction(jnp.asarray(position), jnp.asarray(mirror @ turn @ np.asarray(pose.rotation) @ mirror))
    np.testing.assert_allclose(across, np.asarray(natural) @ mirror @ turn, atol=2e-5)
    np.testing.assert_allclose(policy.elbow_direction(arm, pose, side=side, person=turn), across, atol=2e-5)
    if name == "iiwa7":
        with pytest.raises(ValueError, match=r"expected poses, .*got Pointing"):
            policy.swivel(arm, pose.pointing())
        with pytest.raises(ValueError, match="side must be"):
            policy.swivel(arm, pose, side="up")


def test_a_file_gives_the_same_elbows(tmp_path, learned):
    frames, trained = learned
    training.save_natural_elbow(trained.policy, tmp_path / "h")
    again = training.load_natural_elbow(tmp_path / "h")
    hand = jnp.asarray(frames.hand[:5]), jnp.asarray(frames.rotation[:5])
    np.testing.assert_array_equal(again.direction(*hand), trained.policy.direction(*hand))
    with pytest.raises(jaxik.FileFormatError, match="kind"):
        training.load_policy(tmp_path / "h")


def test_the_energy_is_zero_for_the_natural_elbow_and_the_same_for_the_mirrored_one(learned):
    _, trained = learned
    arms = {side: jaxik.presets.meccanoid(side).arm for side in ("left", "right")}
    q = jnp.radians(jnp.array([[40.0, 30, 10, 70, 20, -10], [60.0, 50, -20, 40, 0, 10]]))
    rates = {side: training.human_elbow(trained.policy, side=side).rest_rate(arms[side], q) for side in arms}
    np.testing.assert_allclose(rates["left"], rates["right"], rtol=1e-5)
    # The oracle: the elbow's distance from the point of its circle that lies where the policy says.
    points = jaxik.joint_positions(arms["right"], q)
    wrist = points[:, 2] - points[:, 0]
    human = trained.policy.arm
    size = float(jnp.linalg.norm(human.elbow) + jnp.linalg.norm(human.wrist - human.elbow)) / (0.17 + 0.15)
    toward = trained.policy.direction(wrist * size, jaxik.forward_kinematics(arms["right"], q).rotation)
    n = wrist / jnp.linalg.norm(wrist, axis=1, keepdims=True)
    elbow = points[:, 1] - points[:, 0]
    along = jnp.sum(elbow * n, axis=1, keepdims=True) * n
    natural = along + jnp.linalg.norm(elbow - along, axis=1, keepdims=True) * toward
    np.testing.assert_allclose(rates["right"], jnp.sum((elbow - natural) ** 2, axis=1) / 0.17**2, rtol=1e-5)
    with pytest.raises(ValueError, match="side"):
        training.human_elbow(trained.policy, side="both")


@pytest.mark.slow
def test_a_plan_moves_more_like_a_person_when_asked_to(learned):
    _, trained = learned
    model = jaxik.presets.iiwa14()
    path = jaxik.fit_path(model.arm, jaxik.example_path("reach"))
    natural = training.human_elbow(trained.policy)
    plain = jaxik.plan(model, path)
    human = jaxik.plan(model, path, energy=jaxik.energy.joint_motion() + 20.0 * natural)
    assert plain.ok
    assert human.ok
    motion = lambda plan: (jnp.asarray(plan.trajectory.q), path.time)  # noqa: E731
    assert float(natural(model.arm, *motion(human))) < 0.8 * float(natural(model.arm, *motion(plain)))


@pytest.mark.slow
def test_the_recorded_arm(data_dir, tmp_path, capsys):
    from training.cli import train_human

    file = data_dir / "human_arm" / "right_arm.csv"
    assert train_human(file, out=tmp_path / "human.policy", folder=tmp_path / "run", json=True) == 0
    scores = json.loads(capsys.readouterr().out)["scores"]
    assert scores["policy"][0] <= 6.3  # 5.8 to 6.1 with the seeds tried
    assert scores["policy"][1] <= 14.0
    assert scores["floor"] == pytest.approx([2.9, 10.1], abs=0.1)
    assert scores["elbow down"] == pytest.approx([41.3, 62.4], abs=0.2)
    assert len((tmp_path / "run" / "human.jsonl").read_text().splitlines()) >= 3
