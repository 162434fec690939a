"""An arm taken from what callers have, and which of its joints turn without end."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxik.arm import as_arm, make_arm, presets
from jaxik.arm.arm import Arm

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
IIWA = presets.iiwa7()


def with_limits(half):
    axes = [Z, Y, Z, Y, Z, Y, Z]
    return make_arm(axes, (0, 0, 0), (0, 0, 3), (0, 0, 6), (0, 0, 7), lower=[-h for h in half], upper=half)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_turning_means_more_than_one_turn(dtype):
    half = [np.pi, 3.141592, 3.14159265358979, 3.2, np.inf, 3.14162, 1.0]
    arm = with_limits(half).astype(dtype)
    assert arm.turning.tolist() == [False, False, False, True, True, True, False]


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_exactly_one_turn_is_not_turning_wherever_it_begins(dtype):
    low = np.linspace(-12, 6, 700)
    arm = with_limits([1.0] * 7).astype(dtype)
    turning = jax.vmap(lambda low: dataclasses.replace(arm, lower=low, upper=low + 2 * np.pi).turning)
    assert not np.any(turning(jnp.asarray(low.reshape(-1, 7), dtype)))


def test_as_arm_takes_an_arm_or_a_model():
    assert as_arm(IIWA.arm) is IIWA.arm
    assert as_arm(IIWA) is IIWA.arm


def test_as_arm_works_under_vmap_and_jit():
    arms = jax.tree.map(lambda x: jnp.stack([x, x]), IIWA.arm)
    assert jax.vmap(lambda arm: as_arm(arm).lower)(arms).shape == (2, 7)
    assert np.array_equal(jax.jit(lambda arm: as_arm(arm).lower)(IIWA.arm), IIWA.arm.lower)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (None, "got NoneType"),
        ("iiwa7", "got str"),
        (presets.iiwa7, r"the function iiwa7: call it, iiwa7\(\)"),
        (jax.tree.map(lambda x: x[None], IIWA.arm), r"\(1, 7, 3\).*jax.vmap\(f, in_axes=\(0, None\)\)"),
        (jax.tree.map(lambda x: 0, IIWA.arm), "axes of shape"),
        (Arm, "got type"),
    ],
)
def test_as_arm_refuses_anything_else_in_our_words(wrong, words):
    with pytest.raises(ValueError, match=words):
        as_arm(wrong)
