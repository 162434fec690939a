"""The test configuration: shapes are checked, except in the containers that JAX builds."""

import importlib
import sys

import jax
import jax.numpy as jnp
import pytest

MODULE = """
from dataclasses import dataclass

import jax
from jaxtyping import Array, Float


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Pair:
    a: Float[Array, "*batch 3"]
    b: Float[Array, "*batch 3 3"]


@dataclass(frozen=True)
class Spec:
    name: str


def add(pair: Pair, x: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
    return pair.a + x
"""


@pytest.fixture
def example(tmp_path, monkeypatch):
    """A module to which the import hook applies as to those of jaxik."""
    import jaxik

    (tmp_path / "hook_example.py").write_text(MODULE)
    monkeypatch.setattr(jaxik, "__path__", [*jaxik.__path__, str(tmp_path)])
    yield importlib.import_module("jaxik.hook_example")
    del sys.modules["jaxik.hook_example"]


def test_wrong_shape_and_type_are_reported(example):
    pair = example.Pair(jnp.ones(3), jnp.ones((3, 3)))
    with pytest.raises(TypeError, match="add"):
        example.add(pair, jnp.ones(4))
    with pytest.raises(TypeError, match="Spec"):
        example.Spec(3)


def test_checks_can_be_switched_off(example, without_type_checks):
    assert example.add(example.Pair(jnp.ones(1), jnp.ones(1)), jnp.ones(4)).shape == (4,)


def test_containers_survive_transformations(example):
    pair = example.Pair(jnp.ones((2, 3)), jnp.ones((2, 3, 3)))
    x = jnp.ones((2, 3))
    assert jax.vmap(example.add, in_axes=(example.Pair(0, 0), 0))(pair, x).shape == (2, 3)
    assert jax.jacrev(lambda p: example.add(p, x))(pair).b.shape == (2, 3, 2, 3, 3)
    assert jax.eval_shape(lambda p: p, pair).a.shape == (2, 3)
    assert jax.tree.map(lambda leaf: leaf.ndim, pair) == example.Pair(2, 3)


def test_float64_strict_promotion_and_eight_devices():
    assert jnp.ones(1).dtype == jnp.float64
    with pytest.raises(Exception, match="promotion"):
        jnp.ones(1, jnp.float32) + jnp.ones(1, jnp.float64)
    assert jax.device_count("cpu") == 8
