"""The solver inside a network and inside a scan: gradients reach the weights, the targets and the arm."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

import jaxik
from tests.helpers.postures import quick
from training.layers import PostureNet

ARM = jaxik.presets.iiwa7().arm
HALF = jnp.array([0.3, 0.6, -0.4, 1.1, 0.5, 0.7, -0.2])


def targets(count: int) -> jaxik.Pose:
    q = HALF + 0.3 * jax.random.uniform(jax.random.key(1), (count, 7), minval=-1.0)
    return jaxik.forward_kinematics(ARM, q)


def elbows(net, arm, target):
    q = jax.vmap(net, in_axes=(None, 0))(arm, target)
    return jnp.mean(jaxik.joint_positions(arm, q)[:, 1, 2]), q


def follow(arm, target, swivel, rate, branch):
    """Squared joint motion and joint angles along a path with given swivel increments, by the solver in a scan."""

    def waypoint(carry, step):
        swivel, before, moved = carry
        target, turn = step
        swivel = swivel + turn
        q = jaxik.solve_ik(arm, target, swivel).q[branch]
        return (swivel, q, moved + jnp.sum((q - before) ** 2)), q

    begin = jaxik.solve_ik(arm, jax.tree.map(lambda x: x[0], target), swivel + rate[0]).q[branch]
    (_, _, moved), q = jax.lax.scan(waypoint, (swivel, begin, jnp.zeros(())), (target, rate))
    return moved, q


def lowest_elbow(arm, target, swivel, branch):
    """Swivel with the lowest elbow, by gradient descent through the solver in a scan."""

    def height(s):
        return jaxik.joint_positions(arm, jaxik.solve_ik(arm, target, s).q[branch])[1, 2] / arm.length

    return jax.lax.scan(lambda s, _: (s - 2.0 * jax.grad(height)(s), None), swivel, None, length=50)[0]


def along(f, tree, seed):
    """Directional derivative by automatic differentiation and by differences."""
    leaves, structure = jax.tree.flatten(tree)
    keys = jax.random.split(jax.random.key(seed), len(leaves))
    toward = [jax.random.normal(k, x.shape) for k, x in zip(keys, leaves, strict=True)]
    exact = sum(jnp.vdot(g, w) for g, w in zip(jax.tree.leaves(jax.grad(f)(tree)), toward, strict=True))
    h = 1e-6
    moved = [
        f(jax.tree.unflatten(structure, [x + s * h * w for x, w in zip(leaves, toward, strict=True)])) for s in (1, -1)
    ]
    return float(exact), float(moved[0] - moved[1]) / (2 * h)


def test_a_network_reaches_its_targets_whatever_its_weights_and_learns_through_the_solver():
    net, target = PostureNet(ARM, jax.random.key(0)), targets(16)
    optimizer = optax.adam(3e-3)
    state = optimizer.init(eqx.filter(net, eqx.is_array))

    @eqx.filter_jit
    def step(net, state):
        (value, _), slope = eqx.filter_value_and_grad(elbows, has_aux=True)(net, ARM, target)
        with jax.numpy_dtype_promotion("standard"):  # optax mixes its integer step count with floats
            updates, state = optimizer.update(slope, state)
        return eqx.apply_updates(net, updates), state, value

    heights = []
    for _ in range(60):
        net, state, height = step(net, state)
        heights.append(float(height))
    assert heights[-1] < heights[0] - 0.02
    _, q = elbows(net, ARM, target)
    np.testing.assert_allclose(jaxik.forward_kinematics(ARM, q).position, target.position, atol=1e-12)


@pytest.mark.parametrize("what", quick("weights", slow=["target", "arm"]))
def test_the_networks_gradients_are_those_of_differences(what):
    net, target = PostureNet(ARM, jax.random.key(0)), targets(4)
    weights, static = eqx.partition(net, eqx.is_array)
    geometry = {name: getattr(ARM, name) for name in ("shoulder", "elbow", "wrist", "tool_position")}

    def arm_of(points):
        return dataclasses.replace(ARM, **points)

    value = {
        "weights": (lambda w: elbows(eqx.combine(w, static), ARM, target)[0], weights),
        "target": (lambda p: elbows(net, ARM, jaxik.Pose(p, target.rotation))[0], target.position),
        "arm": (lambda g: elbows(net, arm_of(g), target)[0], geometry),
    }[what]
    exact, differences = along(*value, seed=2)
    assert exact == pytest.approx(differences, rel=1e-5, abs=1e-9)
    assert abs(exact) > 1e-6


@pytest.mark.slow
def test_gradients_go_through_a_scan():
    count = 12
    q = HALF + 0.2 * jnp.sin(jnp.linspace(0, 3, count))[:, None] * jnp.arange(1.0, 8.0) / 7
    target = jaxik.forward_kinematics(ARM, q)
    swivel, branch = jaxik.swivel_of(ARM, q)
    rate = jnp.concatenate([jnp.zeros(1), jnp.diff(swivel)])
    moved, found = follow(ARM, target, swivel[0], rate, branch[0])
    np.testing.assert_allclose(found, q, atol=1e-9)  # the rates of a motion give it back
    assert float(moved) == pytest.approx(float(jnp.sum(jnp.diff(q, axis=0) ** 2)), rel=1e-9)

    def cost(inputs):
        position, rate, elbow = inputs

        arm = dataclasses.replace(ARM, elbow=elbow)
        return follow(arm, jaxik.Pose(position, target.rotation), swivel[0], rate, branch[0])[0]

    exact, differences = along(cost, (target.position, rate, ARM.elbow), seed=3)
    assert exact == pytest.approx(differences, rel=1e-5)


@pytest.mark.slow
def test_an_optimizer_inside_a_scan_finds_the_lowest_elbow():
    target = jax.tree.map(lambda x: x[0], targets(1))
    branch = int(jaxik.swivel_of(ARM, HALF).branch)
    found = lowest_elbow(ARM, target, jnp.asarray(1.0), branch)
    grid = jnp.linspace(-jnp.pi, jnp.pi, 721)
    spread = jax.tree.map(lambda x: jnp.broadcast_to(x, (721, *x.shape)), target)
    heights = jaxik.joint_positions(ARM, jaxik.solve_ik(ARM, spread, grid).q[:, branch])[:, 1, 2]
    off = found - grid[jnp.argmin(heights)]
    assert abs(float(off - 2 * jnp.pi * jnp.round(off / (2 * jnp.pi)))) < 0.02
