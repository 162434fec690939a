"""The programs in examples/, without what only a robot has."""

import importlib.util
import json

import jax
import jax.numpy as jnp
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import jaxik


def load(repository, name):
    spec = importlib.util.spec_from_file_location(name, repository / "examples" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_node_answers_a_pose_with_a_motion_to_it(repository):
    node, model = load(repository, "ros_node"), jaxik.presets.iiwa14()
    now = jnp.array([0.3, 0.5, 0.2, -1.2, 0.1, 0.9, 0.0])
    pose = jaxik.forward_kinematics(model, now)
    angles = dict(zip(model.joint_names, now.tolist(), strict=True)) | {"gripper": 1.0}
    w, *xyz = pose.wxyz().tolist()
    motion = node.answer(model, (pose.position + jnp.array([0.0, 0.05, 0.0])).tolist(), (*xyz, w), angles)
    np.testing.assert_array_equal(motion.q[0], now)
    reached = jaxik.forward_kinematics(model, motion.q[1])
    np.testing.assert_allclose(reached.position, pose.position + jnp.array([0.0, 0.05, 0.0]), atol=1e-9)
    np.testing.assert_allclose(reached.rotation, pose.rotation, atol=1e-9)
    # The spline between two postures at rest is fastest in its middle.
    fastest = 1.5 * np.abs(motion.q[1] - motion.q[0]) / motion.duration
    assert (fastest <= node.SPEED * np.asarray(model.arm.velocity_limit) * (1 + 1e-9)).all()
    assert node.answer(model, (9.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), angles) is None


def test_motions_become_a_dataset_that_reads_back(repository, tmp_path):
    example = load(repository, "lerobot_dataset")
    first = jaxik.Trajectory(np.array([0.0, 1.0]), np.array([[0.0, 1.0], [1.0, 0.0]]), ("a", "b"))
    second = jaxik.Trajectory(np.array([2.0, 2.5]), np.array([[0.5, 0.5], [0.5, 1.0]]), ("a", "b"))
    example.write_dataset(tmp_path / "set", [first, second], ["reach", "wave"], fps=10)
    info = json.loads((tmp_path / "set" / "meta" / "info.json").read_text())
    frames = pq.read_table(tmp_path / "set" / info["data_path"].format(chunk_index=0, file_index=0))
    assert frames.column_names == list(info["features"])
    assert frames.schema.field("action").type == pa.list_(pa.float32(), 2)
    for name, feature in info["features"].items():  # one number is a plain column
        assert feature["shape"] != [1] or str(frames.schema.field(name).type) in (feature["dtype"], "float"), name
    episodes = pq.read_table(tmp_path / "set" / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pylist()
    assert [(e["dataset_from_index"], e["dataset_to_index"], e["length"]) for e in episodes] == [
        (0, 11, 11),
        (11, 17, 6),
    ]
    for episode, motion in zip(episodes, (first, second), strict=True):
        rows = frames.slice(episode["dataset_from_index"], episode["length"]).to_pydict()
        time = np.array(rows["timestamp"])
        np.testing.assert_allclose(time, np.arange(len(time)) / 10, atol=1e-7)
        played = [motion.sample(motion.time[0] + t) for t in time]
        np.testing.assert_allclose(rows["observation.state"], played, atol=1e-6)
        np.testing.assert_allclose(rows["action"][:-1], rows["observation.state"][1:])
    tasks = pq.read_table(tmp_path / "set" / "meta" / "tasks.parquet")
    assert tasks["task"].to_pylist() == ["reach", "wave"]
    assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["task"]
    stats = json.loads((tmp_path / "set" / "meta" / "stats.json").read_text())
    np.testing.assert_allclose(stats["action"]["max"], [1.0, 1.0])
    assert stats["index"]["count"] == [info["total_frames"]] == [17]
    with pytest.raises(ValueError, match="got 2 motions of 1 kinds of joints and 1 tasks"):
        example.write_dataset(tmp_path / "other", [first, second], ["reach"])
    assert not (tmp_path / "other").exists()


def test_hundreds_of_arms_reach_their_goals_within_their_limits(repository):
    example = load(repository, "arm_environments")
    keys = jax.random.split(jax.random.key(0), 256)
    states, rewards = jax.jit(lambda keys: example.rollout(example.toward_the_goal, keys))(keys)
    assert rewards.shape == (40, 256)
    assert rewards[0].mean() < -0.1
    assert np.median(rewards[-1]) > -1e-3
    assert (states.q >= states.arm.lower).all()
    assert (states.q <= states.arm.upper).all()
    wild = jax.random.uniform(jax.random.key(1), (256, 4), minval=-3.0, maxval=3.0)
    after, rewards = jax.vmap(example.step)(states, wild)
    moved = np.abs(after.q - states.q)
    assert (moved <= example.DT * np.asarray(states.arm.velocity_limit) * (1 + 1e-6)).all()
    assert moved.max() > 1e-3
    reached = jax.vmap(jaxik.forward_kinematics)(after.arm, after.q)
    np.testing.assert_allclose(reached.position, after.tool.position, atol=1e-12)
    assert (rewards <= -np.linalg.norm(after.goal - reached.position, axis=-1) + 1e-12).all()
