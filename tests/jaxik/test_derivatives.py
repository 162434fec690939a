"""Derivatives on regular inputs: forward is reverse is central differences, in the target, the swivel and the arm."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxik import forward_kinematics, joint_positions, solve_ik, swivel_of
from tests.helpers.postures import SAMPLE_ARMS, distances, moved, orientation_of, posed, quick, value_and_gradients

ROWS = 16
NAMES = quick("general_7", slow=["paper_arm", "iiwa14"])


def regular(arm, seed=0):
    """Postures well away from every singular set, and their targets and swivels."""
    rng = np.random.default_rng(seed)
    q = jnp.asarray(rng.uniform(-3, 3, (500, arm.n_joints)))
    q = q[distances(arm, q).min(axis=0) > 0.2][:ROWS]
    assert len(q) == ROWS
    return q, *posed(arm, q)


def along(x, tangent, step):
    return jax.tree.map(lambda a, b: a + step * b, x, tangent)


def tangents(inputs, rng):
    """Random changes of every array, orientations turning as rotations do, a pointing hand staying straight."""
    arm, position, orientation, _ = inputs
    arm_change = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), arm)
    if orientation.ndim == 2:
        turn, longer = jnp.asarray(rng.normal(size=3)), rng.normal()
        hand = arm.tool_position - arm.wrist
        arm_change = dataclasses.replace(
            arm_change,
            tool_rotation=jnp.cross(turn, arm.tool_rotation.T).T,
            tool_position=arm_change.wrist + jnp.cross(turn, hand) + longer * hand,
        )
    hat = jnp.cross(jnp.asarray(rng.normal(size=(ROWS, 1, 3))), jnp.eye(3)).swapaxes(1, 2)
    turned = hat @ orientation if orientation.ndim == 3 else jnp.einsum("nij,nj->ni", hat, orientation)
    return arm_change, jnp.asarray(rng.normal(size=position.shape)), turned, jnp.asarray(rng.normal(size=ROWS))


@pytest.mark.parametrize("name", NAMES)
def test_reverse_is_forward_is_central_differences(name):
    arm, rng = SAMPLE_ARMS[name](), np.random.default_rng(1)
    _, target, swivel = regular(arm)
    inputs = (arm, target.position, jnp.asarray(orientation_of(target)), swivel)
    change = tangents(inputs, rng)
    weights = jnp.asarray(rng.normal(size=(ROWS, 8, arm.n_joints)))

    @jax.jit
    def forward(inputs, change):
        return jax.jvp(lambda i: solve_ik(i[0], type(target)(i[1], i[2]), i[3]).q, (inputs,), (change,))

    only = [tuple(c if i == k else jax.tree.map(jnp.zeros_like, c) for i, c in enumerate(change)) for k in range(4)]
    _, arm_gradient, others = value_and_gradients(*inputs, weights)
    gradients = (arm_gradient, *others)
    for k, part in enumerate((*only, change)):
        q, rate = forward(inputs, part)
        reverse = [jnp.vdot(g, c) for g, c in zip(jax.tree.leaves(gradients), jax.tree.leaves(part), strict=True)]
        scale = float(sum(jnp.abs(g * c).sum() for g, c in zip(*map(jax.tree.leaves, (gradients, part)), strict=True)))
        assert abs(float(sum(reverse) - jnp.sum(rate * weights))) <= 1e-10 * scale, k
        # Fourth-order differences. The step suits the arm, whose axes leave the class: 1e-4 loses digits, 3e-6 too.
        step = 1e-5
        near, far = ([forward(along(inputs, part, s * h), part)[0] - q for s in (1, -1)] for h in (step, 2 * step))
        turn = [jnp.round(d / (2 * np.pi)) * 2 * np.pi for d in (*near, *far)]
        a, b, c, d = (x - t for x, t in zip((*near, *far), turn, strict=True))
        central = (8 * (a - b) - (c - d)) / (12 * step)
        error = jnp.linalg.norm(central - rate, axis=-1) / jnp.linalg.norm(rate, axis=-1)
        assert float(jnp.where(jnp.linalg.norm(rate, axis=-1) > 0, error, 0).max()) <= 1e-6, k


@pytest.mark.parametrize("name", NAMES)
def test_solutions_move_so_that_the_tool_follows_target_and_arm(name):
    """Forward kinematics after inverse is the identity, so its derivative is: that of the target, whatever the arm."""
    arm, rng = SAMPLE_ARMS[name](), np.random.default_rng(2)
    _, target, swivel = regular(arm, 1)
    velocity, angular = rng.normal(size=(2, ROWS, 3))
    lengths = jnp.asarray(rng.normal(size=4))

    def changed(time):  # a larger arm, moved, on a longer upper arm: still of the class
        stretch = 1 + time * lengths[0]
        shift = time * lengths[1:] * stretch
        points = {k: getattr(arm, k) * stretch + shift for k in ("shoulder", "elbow", "wrist", "tool_position")}
        return type(arm)(**{**vars(arm), **points})

    @jax.jit
    @jax.vmap
    def tool(time):
        now = changed(time)
        sol = solve_ik(now, moved(target, velocity, angular, time), swivel + time)
        pose = forward_kinematics(now, sol.q)
        return pose.position, pose.rotation if arm.n_joints == 7 else pose.rotation[..., 2], swivel_of(now, sol.q)[0]

    _, rates = jax.jvp(tool, (jnp.zeros(1),), (jnp.ones(1),))
    position, orientation, turned = (np.asarray(r[0]) for r in rates)
    np.testing.assert_allclose(position, np.broadcast_to(velocity[:, None], position.shape), atol=1e-9)
    spin = np.asarray(orientation_of(moved(target, velocity, angular, 1.0)) - orientation_of(target))
    np.testing.assert_allclose(orientation, np.broadcast_to(spin[:, None], orientation.shape), atol=1e-9)
    np.testing.assert_allclose(turned, 1.0, atol=1e-9)


@pytest.mark.parametrize("name", quick("general_7", slow=["paper_arm"]))
def test_forward_maps_have_exact_derivatives(name):
    arm, rng = SAMPLE_ARMS[name](), np.random.default_rng(3)
    q, _, _ = regular(arm, 2)
    rate = jnp.asarray(rng.normal(size=q.shape))
    arm_change = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), arm)

    @jax.jit
    def everything(arm, q):
        pose = forward_kinematics(arm, q)
        return pose.position, pose.rotation, joint_positions(arm, q), swivel_of(arm, q)[0]

    _, exact = jax.jvp(everything, (arm, q), (arm_change, rate))
    step = 1e-4
    at = {k: everything(along(arm, arm_change, k * step), q + k * step * rate) for k in (1, -1, 2, -2)}
    for i, rates in enumerate(exact):
        central = (8 * (at[1][i] - at[-1][i]) - (at[2][i] - at[-2][i])) / (12 * step)
        np.testing.assert_allclose(rates, central, atol=1e-7, rtol=1e-7)
