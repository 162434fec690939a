"""Torques against pinocchio, on files and on arms handed over link by link; derivatives; the load in the hand."""

import dataclasses
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pinocchio as pin
import pytest

import jaxik
from tests.helpers.arms import ALL_PRESETS, random_angles, random_arm
from tests.helpers.pinocchio_oracle import pinocchio_model

RELATIVE = 1e-10  # what two recursions in float64 leave apart, with room
ARM = jaxik.presets.iiwa14().arm

CASES = {
    **{name: lambda build=build: build().arm for name, build in ALL_PRESETS.items()},
    "general_7": lambda: random_arm(21),
    "general_6": lambda: random_arm(22, 6),
}


def states(arm, count=20, seed=4):
    rng = np.random.default_rng(seed)
    return random_angles(arm, rng, count), *rng.normal(scale=3, size=(2, count, arm.n_joints))


def assert_close(got, expected):
    np.testing.assert_allclose(got, expected, rtol=0, atol=RELATIVE * np.abs(expected).max())


@pytest.mark.parametrize("name", CASES)
def test_torques_and_mass_matrix_are_those_of_pinocchio(name):
    # What torques do not see made alike: arms of one structure share a compiled program.
    arm = dataclasses.replace(CASES[name](), keep_out=ARM.keep_out, reference=ARM.reference)
    model, data = (lambda m: (m, m.createData()))(pinocchio_model(arm))
    q, qd, qdd = states(arm)
    assert_close(jaxik.gravity_torque(arm, q), [np.array(pin.computeGeneralizedGravity(model, data, row)) for row in q])
    expected = [pin.rnea(model, data, *rows).copy() for rows in zip(q, qd, qdd, strict=True)]
    assert_close(jaxik.inverse_dynamics(arm, q, qd, qdd), expected)
    upper = [np.triu(pin.crba(model, data, row)) for row in q[:3]]
    assert_close(jaxik.mass_matrix(arm, q[:3]), [u + np.triu(u, 1).T for u in upper])


def test_torques_of_a_urdf_arm_are_those_of_its_file():
    """The whole robot as pinocchio reads it, everything but the arm at rest: limbs, root and fixed parts included."""
    folders = [Path(p, "cmeel.prefix/share/example-robot-data/robots") for p in sys.path]
    file = next((f / "romeo_description/urdf/romeo_small.urdf" for f in folders if f.is_dir()), None)
    if file is None:
        pytest.skip("example-robot-data is not installed: pip install example-robot-data")
    model = jaxik.load_urdf(file, "torso", "l_wrist")
    robot = pin.buildModelFromUrdf(str(file))
    data, place = robot.createData(), [robot.joints[robot.getJointId(n)].idx_v for n in model.joint_names]
    q, qd, qdd = states(model.arm, 5)
    for rows in zip(q, qd, qdd, strict=True):
        whole = [np.zeros(robot.nv) for _ in rows]
        for values, part in zip(whole, rows, strict=True):
            values[place] = part
        whole[0] = whole[0] + pin.neutral(robot)
        assert_close(jaxik.inverse_dynamics(model.arm, *rows), pin.rnea(robot, data, *whole)[place])
        assert_close(
            jaxik.gravity_torque(model.arm, rows[0]), pin.computeGeneralizedGravity(robot, data, whole[0])[place]
        )


def test_energy_is_conserved_by_the_torques():
    """Power equals the change of kinetic and potential energy: no oracle but mechanics."""
    q, qd, qdd = (jnp.asarray(x[0]) for x in states(ARM))
    at = lambda t: (q + t * qd + t**2 / 2 * qdd, qd + t * qdd)  # noqa: E731

    def potential(q):
        moved = jaxik.forward_kinematics
        links, total = ARM.links, jnp.zeros(())
        for i in range(7):
            point = dataclasses.replace(ARM, tool_position=links.center_of_mass[i])
            place = moved(point, jnp.where(jnp.arange(7) <= i, q, 0.0)).position
            total = total - links.mass[i] * ARM.gravity @ place
        return total

    def energy(t):
        q, qd = at(t)
        return qd @ jaxik.mass_matrix(ARM, q) @ qd / 2 + potential(q)

    power = jax.jvp(energy, (jnp.zeros(()),), (jnp.ones(()),))[1]
    np.testing.assert_allclose(power, jaxik.inverse_dynamics(ARM, q, qd, qdd) @ qd, rtol=1e-12)


def test_batches_broadcast_and_agree_with_single_rows_and_vmap():
    q, qd, qdd = states(ARM, 6)
    batch = jaxik.inverse_dynamics(ARM, q.reshape(2, 3, 7), qd[0], qdd.reshape(2, 3, 7))
    assert batch.shape == (2, 3, 7)
    single = np.stack([jaxik.inverse_dynamics(ARM, q[i], qd[0], qdd[i]) for i in range(6)])
    np.testing.assert_allclose(batch.reshape(6, 7), single, rtol=1e-12, atol=1e-12)
    arms = jax.tree.map(lambda *leaves: jnp.stack(leaves), ARM, jaxik.presets.iiwa7().arm)
    both = jax.vmap(jaxik.gravity_torque, (0, None))(arms, jnp.asarray(q))
    np.testing.assert_allclose(both[1], jaxik.gravity_torque(jaxik.presets.iiwa7().arm, q), rtol=1e-12, atol=1e-12)
    assert jaxik.gravity_torque(ARM, np.zeros((0, 7))).shape == (0, 7)


def test_float32_follows_the_input():
    q = np.asarray(states(ARM)[0], np.float32)
    small = jaxik.gravity_torque(ARM, q)
    assert small.dtype == jnp.float32
    np.testing.assert_allclose(small, jaxik.gravity_torque(ARM, np.asarray(q, np.float64)), atol=1e-4)


def test_derivatives_in_motion_and_arm_are_those_of_differences():
    """Along one random direction of everything at once; forward, reverse and differences."""
    rng = np.random.default_rng(8)
    states_, pull = tuple(jnp.asarray(x[0]) for x in states(ARM)), jnp.asarray(rng.normal(size=7))
    where = (states_, ARM.gravity, ARM.links, ARM.axes, ARM.wrist, ARM.elbow)
    toward = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), where)

    @jax.jit
    def torque(where):
        (q, qd, qdd), gravity, links, axes, wrist, elbow = where
        arm = dataclasses.replace(ARM, gravity=gravity, links=links, axes=axes, wrist=wrist, elbow=elbow)
        return jnp.stack([jaxik.inverse_dynamics(arm, q, qd, qdd), jaxik.gravity_torque(arm, q)]) @ pull

    forward = jax.jit(lambda: jax.jvp(torque, (where,), (toward,))[1])()
    move = lambda h: jax.tree.map(lambda x, d: x + h * d, where, toward)  # noqa: E731
    h = 1e-5
    np.testing.assert_allclose(forward, (torque(move(h)) - torque(move(-h))) / (2 * h), rtol=1e-7)
    slope = jax.jit(jax.grad(lambda where: torque(where).sum()))(where)
    products = jax.tree.map(lambda a, b: jnp.sum(a * b), slope, toward)
    np.testing.assert_allclose(sum(jax.tree.leaves(products)), forward.sum(), rtol=1e-11)


def test_a_load_in_the_hand_is_one_more_body_of_pinocchio():
    mass, center = 2.5, np.array([0.05, -0.02, 0.1])
    own = np.diag([0.01, 0.02, 0.015])
    loaded = jaxik.with_payload(ARM, mass, center, own)
    model = pinocchio_model(ARM)
    turn = np.asarray(ARM.tool_rotation)
    place = np.asarray(ARM.tool_position) - np.asarray(ARM.wrist) + turn @ center
    model.appendBodyToJoint(7, pin.Inertia(mass, place, turn @ own @ turn.T), pin.SE3.Identity())
    q, qd, qdd = states(ARM, 3)
    expected = [np.array(pin.rnea(model, model.createData(), *rows)) for rows in zip(q, qd, qdd, strict=True)]
    assert_close(jaxik.inverse_dynamics(loaded, q, qd, qdd), expected)


def test_a_load_of_nothing_changes_nothing_and_its_slope_is_finite():
    paper = jaxik.presets.paper_arm().arm
    massless = dataclasses.replace(paper, links=jax.tree.map(jnp.zeros_like, paper.links))
    same = jaxik.with_payload(massless, 0.0, np.array([1.0, 2.0, 3.0]))
    assert all(np.array_equal(a, b) for a, b in zip(jax.tree.leaves(same), jax.tree.leaves(massless), strict=True))
    q = jnp.asarray(states(ARM)[0][0])
    torque = lambda m: jaxik.gravity_torque(jaxik.with_payload(ARM, m, np.array([0.0, 0.0, 0.1])), q)  # noqa: E731
    slope = jax.jvp(torque, (0.0,), (1.0,))[1]
    np.testing.assert_allclose(slope, torque(1.0) - torque(0.0), rtol=1e-10, atol=1e-12)  # linear in the load


def test_a_loaded_model_keeps_its_names_and_says_what_it_carries():
    model = jaxik.with_payload(jaxik.presets.iiwa14(), 3.0)
    assert model.joint_names == jaxik.presets.iiwa14().joint_names
    assert "Carries a load of 3 kg in the hand." in model.notes
    np.testing.assert_allclose(model.arm.links.mass[-1], 4.2)


def test_wrong_shapes_are_told(without_type_checks):
    with pytest.raises(ValueError, match=r"expected joint angles of shape \(\*batch, 7\), got \(6,\)"):
        jaxik.gravity_torque(ARM, np.zeros(6))
    with pytest.raises(ValueError, match=r"got \(2, 6\)"):
        jaxik.inverse_dynamics(ARM, np.zeros(7), np.zeros(7), np.zeros((2, 6)))
