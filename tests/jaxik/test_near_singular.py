"""Derivatives at distances 1e-9 to 1e-1 from every singular set, against 60 digits at the very same float64 inputs.

Distance is that of the target: the reach margin over the arm's reach for the straight or folded elbow, the sine of the
middle angle for an aligned triple, sine or chord for the reference's line, wrist to shoulder over the reach. Errors are
relative to the whole Jacobian: a single direction may happen to be one that the singularity hardly touches.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxik import PaperReference, Status, solve_ik
from tests.helpers import mp_oracle
from tests.helpers.postures import (
    SAMPLE_ARMS,
    at_wrist,
    middle_offsets,
    moved,
    orientation_of,
    posed,
    quick,
    random_rotations,
    random_units,
    reach_limits,
)

NAMES = quick("paper_arm", "iiwa14", slow=["general_7_paper", "general_6"])
EACH = 6  # samples of every kind


@functools.partial(jax.jit, static_argnums=0)
def _rates(solve, arm, target, swivel, velocity, angular, swivel_rate):
    def at(time):
        return solve(arm, moved(target, velocity, angular, time), swivel + time * swivel_rate)

    sol, rate = jax.jvp(at, (0.0,), (1.0,))
    return sol, rate.q


def jacobians(arm, target, swivel):
    """Solution, and joint rates for each of velocity, angular velocity and swivel rate, ``(n, 7, 8, n_joints)``."""
    n = len(swivel)
    seven = jax.tree.map(lambda x: jnp.repeat(x, 7, axis=0), (target, swivel))
    unit = jnp.tile(jnp.eye(7), (n, 1))
    sol, rate = _rates(solve_ik, arm, *seven, unit[:, :3], unit[:, 3:6], unit[:, 6])
    return jax.tree.map(lambda x: x[::7], sol), np.asarray(rate).reshape(n, 7, 8, -1)


def exact_jacobian(arm, position, orientation, swivel):
    unit = np.eye(7)
    return np.stack([mp_oracle.derivative(arm, position, orientation, swivel, (u[:3], u[3:6], u[6])) for u in unit])


def near(arm, kind, distance, rng):
    """Targets and swivels at a distance from one singular set, all else random."""
    count = len(distance)
    rotations, n = random_rotations(rng, count), random_units(rng, count)
    low, high = reach_limits(arm)
    swivel = jnp.asarray(rng.uniform(-3, 3, count))
    usual = rng.uniform(low + 0.2 * (high - low), high - 0.2 * (high - low), count)
    if kind == "straight":
        return at_wrist(arm, n, high * (1 - distance), rotations), swivel
    if kind == "folded":  # for links of one length also the wrist near the shoulder
        return at_wrist(arm, n, low + high * distance, rotations), swivel
    if kind == "line":
        first, second = (np.asarray(v) for v in arm.reference.vectors())
        if isinstance(arm.reference, PaperReference):
            first = first * rng.choice([-1, 1], (count, 1))
        turn = rng.uniform(-3, 3, (count, 1))
        aside = np.cos(turn) * second + np.sin(turn) * np.cross(first, second)
        n = first * np.sqrt(1 - distance**2)[:, None] + distance[:, None] * aside
        return at_wrist(arm, n / np.linalg.norm(n, axis=1, keepdims=True), usual, rotations), swivel
    q = rng.uniform(-3, 3, (count, arm.n_joints))
    shoulder, straight, wrist = (float(x) for x in middle_offsets(arm))
    q[:, 3] = straight + rng.uniform(0.3, 2.8, count) * rng.choice([-1, 1], count)
    middle = np.arcsin(distance) * rng.choice([-1, 1], count) + np.pi * rng.integers(2, size=count)
    if kind in ("shoulder", "both"):
        q[:, 1] = middle - shoulder
    if kind in ("wrist", "both"):
        q[:, 5] = middle - wrist
    return posed(arm, jnp.asarray(q))


KINDS = ("straight", "folded", "shoulder", "wrist", "both", "line")


@pytest.mark.parametrize("name", NAMES)
def test_derivatives_hold_near_every_singular_set(name):
    arm, rng = SAMPLE_ARMS[name](), np.random.default_rng(8)
    distance = 10 ** rng.uniform(-9, -1, (len(KINDS), EACH))
    cases = [near(arm, kind, d, rng) for kind, d in zip(KINDS, distance, strict=True)]
    target, swivel = jax.tree.map(lambda *x: jnp.concatenate(x), *cases)
    sol, rates = jacobians(arm, target, swivel)
    assert (sol.status <= Status.NEAR_SINGULAR).all()
    assert sol.residual.position.max() <= 1e-9 * arm.length
    assert sol.residual.rotation.max() <= 1e-9
    exact_arm, orientation = mp_oracle.mp_arm(arm), orientation_of(target)
    for i, d in enumerate(distance.ravel()):
        exact = exact_jacobian(exact_arm, target.position[i], orientation[i], swivel[i])
        error = np.linalg.norm(rates[i] - exact, axis=(0, 2)) / np.linalg.norm(exact, axis=(0, 2))
        # Measured: 4e-6 at worst. float64 inputs carry about eps / distance, 2e-7 at 1e-9; the rest is the other sines.
        assert error.max() <= 1e-4, (KINDS[i // EACH], d)
        assert error.max() <= 1e-12 / d, (KINDS[i // EACH], d)


def test_full_stretch_has_the_radial_rate_of_a_margin_of_64_eps():
    for name in ("iiwa14", "general_7"):
        arm, rng = SAMPLE_ARMS[name](), np.random.default_rng(9)
        n, rotations = random_units(rng, 4), random_rotations(rng, 4)
        low, high = reach_limits(arm)
        target, swivel = at_wrist(arm, n, np.full(4, high), rotations), jnp.asarray(rng.uniform(-3, 3, 4))
        # Written out: x = sin²(a/2) = (high² - r²) / (high² - low²), and the bend's rate is dx / sqrt(x (1 - x)).
        expected = 2 * high / (high**2 - low**2) / np.sqrt(64 * np.finfo(float).eps)
        # As many rows as above: compiled once.
        _, rates = jacobians(arm, *jax.tree.map(lambda x: jnp.tile(x, (9,) + (1,) * (x.ndim - 1)), (target, swivel)))
        radial = np.einsum("nvbj,nv->nbj", rates[:4, :3], n)
        side = np.array([1, 1, -1, -1, 1, 1, -1, -1])
        np.testing.assert_allclose(radial[:, :, 3], np.tile(-side * expected, (4, 1)), rtol=1e-6)
        # Just inside, exactly at that margin, 60 digits say the same of every joint.
        inside = shifted_to_margin(arm, target.position[0], target.rotation[0], 64 * np.finfo(float).eps)
        exact = mp_oracle.derivative(arm, inside, target.rotation[0], swivel[0], (n[0], np.zeros(3), [0.0]))
        assert np.linalg.norm(radial[0] - exact) <= 1e-6 * np.linalg.norm(exact)


@mp_oracle.mp.workdps(mp_oracle.DIGITS)
def shifted_to_margin(arm, position, rotation, sin2_half):
    """The position moved along the wrist's ray until the bend's half has this squared sine, in 60 digits."""
    exact = mp_oracle.mp_arm(arm)
    position = mp_oracle.vector(position)
    hand = mp_oracle.matmul(mp_oracle.orthonormal(np.asarray(rotation)), mp_oracle.transpose(exact.tool_rotation))
    offset = mp_oracle.matvec(hand, mp_oracle.minus(exact.tool_position, exact.wrist))
    wrist = mp_oracle.minus(mp_oracle.minus(position, offset), exact.shoulder)
    u, v = mp_oracle.minus(exact.elbow, exact.shoulder), mp_oracle.minus(exact.wrist, exact.elbow)
    upper, fore = (mp_oracle.norm(mp_oracle.across(x, exact.axes[3])) for x in (u, v))
    skew = mp_oracle.dot(mp_oracle.plus(u, v), exact.axes[3])
    reach = mp_oracle.mp.sqrt((upper + fore) ** 2 + skew**2 - 4 * upper * fore * sin2_half)
    return mp_oracle.plus(position, mp_oracle.scaled(mp_oracle.unit(wrist), reach - mp_oracle.norm(wrist)))


@pytest.mark.parametrize("name", NAMES)
def test_out_of_reach_the_bend_is_held(name):
    arm, rng = SAMPLE_ARMS[name](), np.random.default_rng(10)
    low, high = reach_limits(arm)
    reach = high * rng.uniform(1.001, 2, 36)
    if low > 0.05 * high:
        reach[:12] = low * rng.uniform(0.3, 0.99, 12)
    target = at_wrist(arm, random_units(rng, 36), reach, random_rotations(rng, 36))
    swivel = jnp.asarray(rng.uniform(-3, 3, 36))
    sol, rates = jacobians(arm, target, swivel)
    assert (sol.status == Status.OUT_OF_REACH).all()
    assert (rates[..., 3] == 0).all()
    exact_arm = mp_oracle.mp_arm(arm)
    for i in range(0, 36, 6):
        exact = exact_jacobian(exact_arm, target.position[i], orientation_of(target)[i], swivel[i])
        assert np.linalg.norm(rates[i] - exact) <= 1e-9 * np.linalg.norm(exact)
