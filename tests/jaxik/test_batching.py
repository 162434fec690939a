"""A batch, a loop, vmap and eight devices give the same numbers; a second arm of one shape compiles nothing."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from jaxik import (
    Pointing,
    Pose,
    Status,
    forward_kinematics,
    joint_positions,
    solve_ik,
    solve_nearest,
    swivel_arcs,
    swivel_of,
)
from jaxik.arm import presets
from jaxik.ik.solve import _solve_ik
from tests.helpers.arms import random_arm, same_bits
from tests.helpers.postures import SAMPLE_ARMS, posed, quick, turns_apart

ROWS = 64


def batch(arm, seed=0, rows=ROWS):
    q = jnp.asarray(np.random.default_rng(seed).uniform(-3, 3, (rows, arm.n_joints)))
    return q, *posed(arm, q)


def close(a, b, tolerance=1e-11):
    """Equal integers, and angles and residuals within rounding: a bit may differ where the compiler fuses otherwise."""
    assert (a.status == b.status).all()
    assert turns_apart(a.q, b.q).max() < tolerance
    assert jnp.abs(a.residual.position - b.residual.position).max() < 1e-12
    assert jnp.abs(a.residual.rotation - b.residual.rotation).max() < 1e-12


@pytest.mark.parametrize("name", quick("iiwa14", slow=["paper_arm"]))
def test_batch_loop_and_vmap_give_the_same_numbers(name):
    arm = SAMPLE_ARMS[name]()
    _, target, swivel = batch(arm)
    whole = solve_ik(arm, target, swivel)
    loop = [solve_ik(arm, *jax.tree.map(lambda x, i=i: x[i], (target, swivel))) for i in range(ROWS)]
    close(whole, jax.tree.map(lambda *x: jnp.stack(x), *loop))
    close(whole, jax.vmap(solve_ik, in_axes=(None, 0, 0))(arm, target, swivel))
    folded = jax.tree.map(lambda x: x.reshape(4, 2, 8, *x.shape[1:]), (target, swivel))
    assert same_bits(whole, jax.tree.map(lambda x: x.reshape(ROWS, *x.shape[3:]), solve_ik(arm, *folded)))


def test_vmap_over_arms_is_a_loop_over_arms():
    arms = [random_arm(seed, reference="stereographic") for seed in range(3)]
    batches = [batch(arm, seed, 16)[1:] for seed, arm in enumerate(arms)]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *[(a, *b) for a, b in zip(arms, batches, strict=True)])
    together = jax.vmap(solve_ik)(*stacked)
    for i, (arm, one) in enumerate(zip(arms, batches, strict=True)):
        close(solve_ik(arm, *one), jax.tree.map(lambda x, i=i: x[i], together), 1e-9)


@pytest.mark.slow
@given(
    shape=st.sampled_from([(), (1,), (3, 1, 2, 1), (2, 3)]),
    target_axes=st.sampled_from(["all", "ones", "fewer"]),
    swivel_axes=st.sampled_from(["all", "ones", "none"]),
)
def test_leading_axes_broadcast(shape, target_axes, swivel_axes):
    arm = SAMPLE_ARMS["iiwa14"]()

    def axes(kind):
        return {"all": shape, "ones": (1,) * len(shape), "fewer": shape[1:], "none": ()}[kind]

    rng = np.random.default_rng(0)
    q = rng.uniform(-2, 2, (*axes(target_axes), 7))
    pose, swivel = forward_kinematics(arm, q), rng.uniform(-3, 3, axes(swivel_axes))
    expected = np.broadcast_shapes(axes(target_axes), axes(swivel_axes))
    sol = jax.eval_shape(solve_ik, arm, pose, jnp.asarray(swivel))
    assert sol.q.shape == (*expected, 8, 7)
    assert sol.status.shape == sol.residual.position.shape == sol.residual.rotation.shape == (*expected, 8)
    assert joint_positions(arm, q).shape == (*axes(target_axes), 4, 3)
    assert [x.shape for x in swivel_of(arm, q)] == [axes(target_axes)] * 2


def test_an_empty_batch_has_an_empty_solution():
    arm = SAMPLE_ARMS["iiwa14"]()
    target = Pose(jnp.zeros((0, 3)), jnp.zeros((0, 3, 3)))
    assert jax.eval_shape(solve_ik, arm, target, jnp.zeros(0)).q.shape == (0, 8, 7)
    assert jax.eval_shape(swivel_arcs, arm, target).start.shape == (0, 8, 12)
    assert jax.eval_shape(solve_nearest, arm, target, jnp.zeros(7)).q.shape == (0, 7)


def test_position_orientation_and_swivel_broadcast_against_each_other():
    arm = SAMPLE_ARMS["iiwa14"]()
    _, target, swivel = batch(arm, 1, 6)
    cross = solve_ik(arm, Pose(target.position[:2, None, None], target.rotation[2:5, None]), swivel[2:6])
    assert cross.q.shape == (2, 3, 4, 8, 7)
    for i, j, k in itertools.product(range(2), range(3), range(4)):
        one = solve_ik(arm, Pose(target.position[i], target.rotation[2 + j]), swivel[2 + k])
        close(one, jax.tree.map(lambda x, i=i, j=j, k=k: x[i, j, k], cross))


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_the_dtype_is_that_of_target_and_swivel(dtype):
    arm = SAMPLE_ARMS["iiwa14"]()
    pose = forward_kinematics(arm, np.zeros((2, 7), dtype))
    assert pose.position.dtype == pose.rotation.dtype == dtype
    sol = jax.eval_shape(solve_ik, arm, pose, jnp.zeros(2, dtype))
    assert sol.q.dtype == sol.residual.position.dtype == sol.residual.rotation.dtype == dtype
    assert jnp.issubdtype(sol.status.dtype, jnp.integer)
    assert jax.eval_shape(swivel_of, arm, jnp.zeros((2, 7), dtype))[0].dtype == dtype


@pytest.mark.parametrize("name", quick("iiwa14", slow=["paper_arm"]))
def test_eight_devices_give_the_same_numbers_without_talking(name):
    arm = SAMPLE_ARMS[name]()
    _, target, swivel = batch(arm)
    mesh = Mesh(np.array(jax.devices()), ("rows",))
    assert len(mesh.devices) == 8
    rows, everywhere = NamedSharding(mesh, P("rows")), NamedSharding(mesh, P())
    inputs = (jax.device_put(arm, everywhere), *jax.device_put((target, swivel), rows))
    sol = solve_ik(*inputs)
    assert len(sol.q.sharding.device_set) == 8
    assert sol.q.addressable_shards[0].data.shape == (ROWS // 8, 8, arm.n_joints)
    close(jax.device_put(sol, jax.devices()[0]), solve_ik(arm, target, swivel))
    program = jax.jit(solve_ik).lower(*inputs).compile().as_text()
    assert not any(word in program for word in ("all-gather", "all-reduce", "all-to-all", "collective-permute"))


def test_three_arms_of_one_shape_are_traced_once():
    traces = []

    @jax.jit
    def solve(arm, target, swivel):
        traces.append(None)
        return solve_ik(arm, target, swivel), forward_kinematics(arm, jnp.zeros(7)), swivel_of(arm, jnp.zeros(7))

    arms = [presets.iiwa7().arm, presets.iiwa14().arm, random_arm(3, limits=True, reference="stereographic")]
    _, target, swivel = batch(arms[0], rows=2)
    counted = _solve_ik._cache_size()
    for arm in arms:
        jax.eval_shape(solve, arm, target, swivel)
        solve_ik(arm, target, swivel)
    assert len(traces) == 1
    assert _solve_ik._cache_size() <= counted + 1


def test_wrong_shapes_and_kinds_are_refused_in_words(without_type_checks):
    seven, six = SAMPLE_ARMS["iiwa14"](), SAMPLE_ARMS["paper_arm"]()
    point, turn = np.zeros(3), np.eye(3)
    for match, call in {
        r"6-joint arm cannot choose": lambda: solve_ik(six, Pose(point, turn), 0.0),
        r"Pose.position of shape \(\*batch, 3\), got \(2,\)": lambda: solve_ik(seven, Pose(np.zeros(2), turn), 0.0),
        r"Pose.rotation of shape .*got \(3,\)": lambda: solve_ik(seven, Pose(point, point), 0.0),
        r"Pointing.direction .*got \(4,\)": lambda: solve_ik(seven, Pointing(point, np.zeros(4)), 0.0),
        r"do not broadcast: got \(2,\), \(3,\)": lambda: solve_ik(six, Pointing(np.zeros((2, 3)), point), np.zeros(3)),
        r"real numbers, got an array of complex": lambda: solve_ik(seven, Pose(point, turn), 1j),
        r"\(\*batch, 7\), got \(6,\)": lambda: forward_kinematics(seven, np.zeros(6)),
        r"\(\*batch, 6\), got \(7,\)": lambda: swivel_of(six, np.zeros(7)),
        r"\(\*batch, 7\), got \(\)": lambda: joint_positions(seven, 0.0),
    }.items():
        with pytest.raises(ValueError, match=match):
            call()


def test_a_hand_off_the_pointing_axis_cannot_point():
    """Seven joints, but the last does not merely roll the hand: the status says so, in every row."""
    arm = random_arm(5)
    sol = solve_ik(arm, Pointing(np.zeros((2, 3)), np.ones((2, 3))), np.zeros(2))
    assert (sol.status == Status.INVALID_TARGET).all()
    assert np.isfinite(sol.q).all()
