"""Arguments in the place of an arm, an array or a target: taken, or refused in the library's own words."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import presets

MODEL = presets.iiwa7()
ARM = MODEL.arm
Q = np.array([0.3, 0.8, -0.2, -1.2, 0.5, 0.9, 0.1])
POSE = jaxik.forward_kinematics(ARM, Q)
COLUMNS = (Q[:3, None], np.eye(3)[:, :, None], np.zeros(1))

# Public functions of an arm: how to call them with an arm and one array, and that array's name in the message.
OF_JOINTS = {
    "forward_kinematics": (jaxik.forward_kinematics, "joint angles"),
    "joint_positions": (jaxik.joint_positions, "joint angles"),
    "jacobian": (jaxik.jacobian, "joint angles"),
    "manipulability": (jaxik.manipulability, "joint angles"),
    "self_motion_direction": (jaxik.self_motion_direction, "joint angles"),
    "gravity_torque": (jaxik.gravity_torque, "joint angles"),
    "mass_matrix": (jaxik.mass_matrix, "joint angles"),
    "inverse_dynamics q": (lambda arm, q: jaxik.inverse_dynamics(arm, q, Q, Q), "joint angles"),
    "inverse_dynamics qd": (lambda arm, q: jaxik.inverse_dynamics(arm, Q, q, Q), "joint velocities"),
    "inverse_dynamics qdd": (lambda arm, q: jaxik.inverse_dynamics(arm, Q, Q, q), "joint accelerations"),
}
OTHERS = {
    "solve_ik": lambda arm: jaxik.solve_ik(arm, POSE, 0.3),
    "solve_ik_columns": lambda arm: jaxik.solve_ik_columns(arm, *COLUMNS),
    "stream_ik": lambda arm: next(jaxik.stream_ik(arm, *COLUMNS)).branches,
    "with_payload": lambda arm: jaxik.with_payload(arm, 1.0),
}
OF_ARMS = {**{name: lambda arm, f=f: f(arm, Q) for name, (f, _) in OF_JOINTS.items()}, **OTHERS}


def same(a, b):
    return all(np.array_equal(x, y) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True))


@pytest.mark.parametrize("name", OF_ARMS)
def test_a_model_is_taken_for_its_arm(name):
    given, expected = OF_ARMS[name](MODEL), OF_ARMS[name](ARM)
    assert same(getattr(given, "arm", given), expected)


@pytest.mark.usefixtures("without_type_checks")
@pytest.mark.parametrize("name", OF_ARMS)
@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (jax.tree.map(lambda x: jnp.stack([x, x]), ARM), r"got a batch of arms .*\(2, 7, 3\).*jax.vmap"),
        (presets.iiwa7, r"the function iiwa7: call it, iiwa7\(\)"),
        (None, "expected a jaxik.Arm or jaxik.ArmModel, .*got NoneType"),
        (POSE, "expected a jaxik.Arm or jaxik.ArmModel, .*got Pose"),
    ],
)
def test_what_is_no_arm_is_refused(name, wrong, words):
    with pytest.raises(ValueError, match=words):
        OF_ARMS[name](wrong)


@pytest.mark.parametrize("name", sorted(OF_ARMS.keys() - {"stream_ik"}))  # which works on the host
def test_a_batch_of_arms_is_mapped_over(name):
    arms = jax.tree.map(lambda *x: jnp.stack(x), ARM, presets.iiwa14().arm)
    mapped = jax.vmap(OF_ARMS[name])(arms)
    for i, arm in enumerate((ARM, presets.iiwa14().arm)):
        one = OF_ARMS[name](arm)
        for x, y in zip(jax.tree.leaves(mapped), jax.tree.leaves(one), strict=True):
            assert np.allclose(x[i], y, rtol=0, atol=1e-9)


@pytest.mark.usefixtures("without_type_checks")
@pytest.mark.parametrize("name", OF_JOINTS)
def test_lists_of_numbers_are_taken_for_arrays(name):
    function, _ = OF_JOINTS[name]
    assert same(function(MODEL, Q.tolist()), function(ARM, Q))
    assert same(function(MODEL, [Q.tolist(), jnp.asarray(Q)]), function(ARM, np.stack([Q, Q])))
    assert same(function(MODEL, [0] * 7), function(ARM, np.zeros(7)))


@pytest.mark.usefixtures("without_type_checks")
@pytest.mark.parametrize("name", OF_JOINTS)
@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("home", "expected {name}.*, got str"),
        (None, "expected {name}.*, got NoneType"),
        ([[1.0], [1.0, 2.0]], r"expected {name}.*, got \[\[1.0\]"),
        (np.array(["a"] * 7), "expected {name}.*, got an array of <U1"),
        (np.array([None] * 7), "expected {name}.*, got an array of object"),
        (np.zeros(6), r"expected joint angles of shape \(\*batch, 7\), got \(6,\)"),
        (0.0, r"expected joint angles of shape \(\*batch, 7\), got \(\)"),
        (np.zeros(7, complex), "expected real numbers, got an array of complex128"),
        (np.zeros(7, np.float16), "expected float32 or float64, got an array of float16, .*convert it"),
        (jnp.zeros(7, jnp.bfloat16), "expected float32 or float64, got an array of bfloat16, .*convert it"),
    ],
)
def test_what_is_no_array_is_refused(name, wrong, words):
    function, argument = OF_JOINTS[name]
    with pytest.raises(ValueError, match=words.format(name=argument)):
        function(MODEL, wrong)


def test_solve_ik_takes_whatever_stands_for_a_pose():
    expected = jaxik.solve_ik(ARM, POSE, 0.3)
    matrix = POSE.matrix()

    class SE3:
        def as_matrix(self):
            return matrix

    for target in (matrix, np.asarray(matrix), SE3()):
        assert same(jaxik.solve_ik(MODEL, target, 0.3), expected)


@pytest.mark.usefixtures("without_type_checks")
def test_solve_ik_takes_lists():
    expected = jaxik.solve_ik(ARM, jax.tree.map(lambda x: x[None], POSE), np.array([0.3]))
    lists = jaxik.Pose([POSE.position.tolist()], [POSE.rotation.tolist()])
    assert same(jaxik.solve_ik(MODEL, lists, [0.3]), expected)
    assert same(jaxik.solve_ik(MODEL, POSE.matrix()[None].tolist(), [0.3]), expected)
    assert same(jaxik.solve_ik_columns(MODEL, *(x.tolist() for x in COLUMNS)), jaxik.solve_ik_columns(ARM, *COLUMNS))


@pytest.mark.usefixtures("without_type_checks")
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: jaxik.solve_ik(MODEL, np.zeros(3), 0.0), r"jaxik.Pose, .*got an array of shape \(3,\)"),
        (lambda: jaxik.solve_ik(MODEL, MODEL, 0.0), "jaxik.Pose, .*got ArmModel"),
        (lambda: jaxik.solve_ik(MODEL, POSE, "up"), "swivel angles .*got str"),
        (lambda: jaxik.solve_ik(MODEL, POSE, np.float16(0.3)), "float32 or float64, got an array of float16"),
        (lambda: jaxik.solve_nearest(MODEL, jax.tree.map(jnp.bfloat16, POSE), Q), "got an array of bfloat16"),
        (lambda: jaxik.swivel_arcs(MODEL, jax.tree.map(np.float16, POSE)), "got an array of float16"),
        (lambda: jaxik.solve_ik(MODEL, POSE, None), "swivel angles .*got NoneType"),
        (lambda: jaxik.solve_ik(presets.paper_arm(), np.eye(4), 0.0), r"6-joint arm .*pose.pointing\(\)"),
        (lambda: jaxik.solve_ik_columns(MODEL, "x", *COLUMNS[1:]), r"positions of shape \(3, n\), got str"),
        (lambda: jaxik.solve_ik_columns(MODEL, *COLUMNS[:2], 0.0), r"and swivel \(n,\), got .* and \(\)"),
        (lambda: jaxik.stream_ik(MODEL, *COLUMNS[:2], [None]), r"swivel angles of shape \(n,\), got \[None\]"),
        (lambda: jaxik.stream_ik(MODEL, *COLUMNS[:2], np.zeros(2)), "expected position .*, got "),
        (lambda: jaxik.stream_ik(MODEL, *COLUMNS, chunk=0), "positive chunk"),
        (lambda: jaxik.with_payload(MODEL, [1.0, 2.0]), r"the load's mass of shape \(\), got \(2,\)"),
        (lambda: jaxik.with_payload(MODEL, "heavy"), "numbers for the load's mass, got str"),
        (lambda: jaxik.with_payload(MODEL, 1.0, np.zeros(2)), r"center_of_mass of shape \(3,\), got \(2,\)"),
        (lambda: jaxik.with_payload(MODEL, 1.0, None, np.ones(3)), r"inertia of shape \(3, 3\), got \(3,\)"),
        (lambda: jaxik.save_model(ARM, "x.json"), "expected a jaxik.ArmModel, got Arm"),
        (lambda: jaxik.save_path("x.csv", None), r"got str; the order is save_path\(path, file\)"),
        (lambda: jaxik.save_trajectory("x.csv", None), r"got str; the order is save_trajectory\(trajectory, file\)"),
        (lambda: jaxik.Path.paced(np.zeros(3)), "jaxik.Pose, "),
        (lambda: jaxik.Path.paced(POSE, speed=0.0), "positive speeds; got speed=0.0"),
        (lambda: jaxik.Path("x", np.arange(2.0)).checked(), "jaxik.Pose, .*got str"),
        (lambda: jaxik.Path(np.zeros((2, 4, 4)), "x").checked(), r"times of shape \(K,\), got str"),
        (lambda: jaxik.example_path(3), "no example path 3; there are word"),
        (lambda: jaxik.Trajectory("x", Q[None], tuple("abcdefg")), "expected numbers for time; got 'x'"),
        (lambda: jaxik.Trajectory([0.0], "home", tuple("abcdefg")), "expected numbers for q; got"),
    ],
)
def test_wrong_arguments_are_refused_in_our_words(call, words):
    with pytest.raises(ValueError, match=words):
        call()


@pytest.mark.usefixtures("without_type_checks")
def test_payloads_take_lists():
    loaded = jaxik.with_payload(ARM, 1.0, np.array([0.1, 0.0, 0.0]), 0.01 * np.eye(3))
    assert same(jaxik.with_payload(ARM, 1, [0.1, 0, 0], (0.01 * np.eye(3)).tolist()), loaded)


def test_a_path_of_matrices_and_lists_is_checked_into_one_of_poses():
    matrices = np.stack([np.eye(4)] * 3)
    path = jaxik.Path(matrices, [0.0, 1.0, 2.0]).checked()
    assert isinstance(path.target, jaxik.Pose)
    assert path.target.rotation.shape == (3, 3, 3)
    assert len(path) == 3
    assert path.checked() is path
