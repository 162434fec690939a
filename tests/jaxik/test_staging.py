"""A stage is one call in the compiled program, and nothing inside it is."""

import re

import jax
import jax.numpy as jnp
import pytest

from jaxik.numerics.fusion import fused_separately


@fused_separately
def bounded(x):
    return jnp.where(x > 0.0, jnp.round(3.0 * x), jnp.clip(x, -1.0, 1.0) ** 2)


TRANSFORMED = {
    "alone": bounded,
    "vmap": jax.vmap(bounded),
    "jvp": lambda x: jax.jvp(bounded, (x,), (x,))[1],
    "vmap of jvp": jax.vmap(lambda x: jax.jvp(bounded, (x,), (jnp.ones_like(x),))[1]),
    "scan": lambda x: jax.lax.scan(lambda c, row: (c + bounded(row), bounded(c)), x[0], x)[0],
}


@pytest.mark.parametrize("transformed", TRANSFORMED)
def test_a_stage_stays_one_call_however_it_is_transformed(transformed):
    compiled = jax.jit(TRANSFORMED[transformed]).lower(jnp.ones((3, 5))).compile()
    calls = re.findall(r' call\(.*to_apply=%(\w+).*inlineable="false"', str(compiled.as_text()))
    assert calls
    assert all("bounded" in name for name in calls)


def test_the_gradient_of_a_stage_is_few_calls():
    compiled = jax.jit(jax.grad(lambda x: bounded(x).sum())).lower(jnp.ones(5)).compile()
    assert str(compiled.as_text()).count(" call(") <= 2  # forward and backward
