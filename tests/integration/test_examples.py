"""The programs in examples/, without what only a robot has."""

import importlib.util

import jax.numpy as jnp
import numpy as np

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
