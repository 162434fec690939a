"""At the singular postures themselves: solved to 1e-9, finite, and with the derivative that the docstring promises."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxik import Pointing, Status, solve_ik, swivel_of
from tests.helpers import mp_oracle
from tests.helpers.arms import ALL_PRESETS
from tests.helpers.postures import (
    SAMPLE_ARMS,
    at_wrist,
    free,
    middle_offsets,
    posed,
    quick,
    random_rotations,
    random_units,
    reach_limits,
    turns_apart,
)

NAMES = quick("paper_arm", "iiwa14", slow=["general_7_paper", "general_6"])
EACH = 6
KINDS = ("straight", "folded", "shoulder", "wrist", "both", "all", "line", "zero")


def singular(arm, rng):
    """Postures of every kind, ``(kind * EACH, n_joints)``, and rates they can have with what is held at zero."""
    shoulder, straight, wrist = (float(x) for x in middle_offsets(arm))
    q = rng.uniform(-3, 3, (len(KINDS), EACH, arm.n_joints))
    rate = rng.normal(size=q.shape)
    half_turn = np.pi * rng.integers(2, size=(len(KINDS), EACH))
    q[..., 3] = straight + rng.uniform(0.5, 2.5, q.shape[:2]) * rng.choice([-1, 1], q.shape[:2])
    for kind in range(len(KINDS)):
        if KINDS[kind] in ("straight", "all"):
            q[kind, :, 3] = straight
            rate[kind, :, 3] = 0
        if KINDS[kind] == "folded":
            q[kind, :, 3] = straight + np.pi
            rate[kind, :, 3] = 0
        if KINDS[kind] in ("shoulder", "both", "all"):
            q[kind, :, 1] = half_turn[kind] - shoulder
            q[kind, :, 0] = rate[kind, :, 0] = 0
        if KINDS[kind] in ("wrist", "both", "all"):
            q[kind, :, 5] = half_turn[kind] - wrist
            q[kind, :, 4] = rate[kind, :, 4] = 0
        if KINDS[kind] == "line":
            high = reach_limits(arm)[1]
            n = np.tile(np.asarray(arm.reference.vectors()[0]), (EACH, 1))
            target = at_wrist(arm, n, rng.uniform(0.6 * high, 0.9 * high, EACH), random_rotations(rng, EACH))
            branch = np.arange(EACH)
            q[kind] = np.asarray(solve_ik(arm, target, rng.uniform(-3, 3, EACH)).q)[branch, branch]
        if KINDS[kind] == "zero":
            q[kind] = 0
    return jnp.asarray(q.reshape(-1, arm.n_joints)), jnp.asarray(rate.reshape(-1, arm.n_joints))


@jax.jit
def following(arm, q, rate):
    """The solution at a posture, its branch, and the rates of all branches when target and swivel follow q(s)."""

    def at(time):
        target, swivel = posed(arm, q + time * rate)
        return solve_ik(arm, target, swivel), swivel

    (sol, _), (sol_rate, swivel_rate) = jax.jvp(at, (0.0,), (1.0,))
    return sol, sol_rate.q, swivel_of(arm, q)[1], swivel_rate


@pytest.mark.parametrize("name", NAMES)
def test_singular_postures_are_solved_and_follow_every_motion_they_can(name):
    arm = SAMPLE_ARMS[name]()
    q, rate = singular(arm, np.random.default_rng(11))
    sol, rates, branch, swivel_rate = following(arm, q, rate)
    for leaf in jax.tree.leaves((sol, rates, swivel_rate)):
        assert np.isfinite(leaf).all()
    kind = np.repeat(KINDS, EACH)
    reachable = np.asarray(sol.status <= Status.NEAR_SINGULAR).all(axis=1)
    centered = name == "paper_arm"  # links of one length: folded, the wrist is in the shoulder
    assert reachable[(kind != "folded") | (not centered)].all()
    assert (np.asarray(sol.status)[kind != "zero"] >= Status.NEAR_SINGULAR).any(axis=1).all()
    solved = reachable[:, None]
    assert np.where(solved, sol.residual.position, 0).max() <= 1e-9 * arm.length
    assert np.where(solved, sol.residual.rotation, 0).max() <= 1e-9
    # The posture comes back in its branch, and so does every motion that leaves still what the docstring holds still.
    row = np.arange(len(q))
    own, own_rate = np.asarray(sol.q)[row, branch], np.asarray(rates)[row, branch]
    exact = np.isin(kind, ("shoulder", "wrist", "both", "line"))
    assert turns_apart(own, q)[exact].max() < 1e-9
    np.testing.assert_allclose(own_rate[exact], rate[exact], atol=1e-7)
    # Stretched or folded the bend's rate is that of a margin of 64 eps, 4e6 times the rounding of the distance's.
    bent = (kind == "straight") | ((kind == "folded") & (not centered))
    np.testing.assert_allclose(own_rate[bent], rate[bent], atol=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_on_the_singular_line_the_reference_moves_without_spin(name):
    """The swivel's rate is then the rate at which the arm plane turns about the wrist's line, in 60 digits."""
    arm = SAMPLE_ARMS[name]()
    q, rate = singular(arm, np.random.default_rng(11))
    swivel_rate = following(arm, q, rate)[3]
    exact_arm, sense = mp_oracle.mp_arm(arm), arm.reference.sense
    for i in range(KINDS.index("line") * EACH, KINDS.index("line") * EACH + EACH):
        with mp_oracle.mp.workdps(mp_oracle.DIGITS):
            angles, rates = mp_oracle.vector(q[i]), mp_oracle.vector(rate[i])

            def plane(step, angles=angles, rates=rates):
                at = mp_oracle.plus(angles, mp_oracle.scaled(rates, step))
                _, _, elbow, wrist = mp_oracle.forward(exact_arm, at)
                n = mp_oracle.unit(mp_oracle.minus(wrist, exact_arm.shoulder))
                return n, mp_oracle.unit(mp_oracle.across(mp_oracle.minus(elbow, exact_arm.shoulder), n))

            h = mp_oracle.STEP
            (n, e), (_, ahead), (_, behind) = plane(0 * h), plane(h), plane(-h)
            change = mp_oracle.scaled(mp_oracle.minus(ahead, behind), 1 / (2 * h))
            spin = float(mp_oracle.dot(change, mp_oracle.cross(n, e)))
        # 1e-14 off the line at most: what the arm plane does there is known to about that.
        np.testing.assert_allclose(swivel_rate[i], sense * spin, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", quick("paper_arm", "iiwa7", "iiwa14", slow=["meccanoid_left", "meccanoid_right"]))
def test_the_arm_at_zero_angles_is_solved(name):
    """Hanging down or standing up: elbow straight, triples aligned, for the paper's arm on the reference's line too."""
    arm = free(ALL_PRESETS[name]().arm)
    q = jnp.zeros((len(KINDS) * EACH, arm.n_joints))
    sol, rates, _, _ = following(arm, q, jnp.ones_like(q))
    assert (sol.status == Status.NEAR_SINGULAR).all()
    assert sol.residual.position.max() <= 1e-9 * arm.length
    assert sol.residual.rotation.max() <= 1e-9
    assert np.isfinite(rates).all()


def test_a_wrist_in_the_shoulder_is_finite():
    arm, rng = SAMPLE_ARMS["paper_arm"](), np.random.default_rng(12)
    reach = np.where(np.arange(16) < 8, 0.0, 10.0 ** -np.arange(8, 24))
    target = at_wrist(arm, random_units(rng, 16), reach, random_rotations(rng, 16))
    sol, rate = jax.jvp(
        lambda p: solve_ik(arm, Pointing(p, target.direction), np.zeros(16)),
        (target.position,),
        (jnp.ones((16, 3)),),
    )
    assert np.isfinite(sol.q).all()
    assert np.isfinite(rate.q).all()
    assert (sol.status >= Status.NEAR_SINGULAR).all()
