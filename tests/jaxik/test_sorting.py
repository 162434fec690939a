"""The sorting network against the library's sort, for every number of rows, with equal values and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxik.numerics.sorting import sort_columns


@pytest.mark.parametrize("rows", [1, 2, 3, 8, 13, 24, 26, 33])
def test_columns_come_out_ascending(rows):
    x = np.random.default_rng(rows).integers(0, 20, (rows, 2, 50)) / 8.0  # with many equal values
    np.testing.assert_array_equal(jax.jit(sort_columns)(jnp.asarray(x)), np.sort(x, axis=0))


def test_the_derivative_goes_with_the_value_even_among_equals():
    x = jnp.array([3.0, 1.0, 2.0, 1.0])[:, None]
    rates = jnp.array([10.0, 20.0, 30.0, 40.0])[:, None]
    _, moved = jax.jvp(sort_columns, (x,), (rates,))
    assert moved[2:, 0].tolist() == [30.0, 10.0]
    assert sorted(moved[:2, 0].tolist()) == [20.0, 40.0]
