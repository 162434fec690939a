"""The network of the policies: residual layers that mix each waypoint with its neighbors, nearer and farther ones.

Features come first, waypoints and paths after: a layer is one matrix product over all of them. Without dilations it
sees each waypoint by itself.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import PRNGKeyArray


class Layer(eqx.Module):
    """Residual layer h + out · silu(mix · [h before, h, h after, mean of h] + bias), or without neighbors."""

    mix: Array
    bias: Array
    out: Array
    dilation: int = eqx.field(static=True)

    def __init__(self, width: int, dilation: int, key: PRNGKeyArray) -> None:
        mix, out = jax.random.split(key)
        seen = 4 * width if dilation else width
        self.mix = _normal(mix, width, seen)
        self.bias = jnp.zeros((width, 1), jnp.float32)
        self.out = 0.3 * _normal(out, width, width)  # close to the identity at first
        self.dilation = dilation

    def __call__(self, h: Array) -> Array:
        """Map ``(width, K, B)`` to the same shape."""
        width, shape = h.shape[0], h.shape
        a = jax.nn.silu(h)
        if self.dilation:
            mean = jnp.broadcast_to(jnp.mean(a, axis=1, keepdims=True), shape)
            a = jnp.concatenate([_shifted(a, -self.dilation), a, _shifted(a, self.dilation), mean])
        a = jax.nn.silu(self.mix @ a.reshape(len(a), -1) + self.bias)
        return h + (self.out @ a).reshape(width, *shape[1:])


class WaypointNet(eqx.Module):
    """Network from features ``(features, K, B)`` to outputs ``(outputs, K, B)``; zero at first.

    Args:
        features: Number of features.
        outputs: Number of outputs.
        width: Width of the hidden layers.
        dilations: Distance of the neighbors that each layer sees, in waypoints; 0 for none.
        key: Key of the random weights.
    """

    first: Array
    bias: Array
    layers: list[Layer]
    last: Array
    offset: Array
    mean: Array
    scale: Array

    def __init__(self, features: int, outputs: int, width: int, dilations: tuple[int, ...], key: PRNGKeyArray) -> None:
        head, *keys = jax.random.split(key, len(dilations) + 1)
        self.first = _normal(head, width, features)
        self.bias = jnp.zeros((width, 1), jnp.float32)
        self.layers = [Layer(width, d, k) for d, k in zip(dilations, keys, strict=True)]
        self.last = jnp.zeros((outputs, width), jnp.float32)
        self.offset = jnp.zeros((outputs, 1), jnp.float32)
        self.mean, self.scale = jnp.zeros((features, 1), jnp.float32), jnp.ones((features, 1), jnp.float32)

    def normalized(self, x: Array) -> "WaypointNet":
        """Return the same network for features with the mean and spread of an example."""
        flat = x.reshape(len(x), -1)
        mean, scale = jnp.mean(flat, axis=1, keepdims=True), jnp.std(flat, axis=1, keepdims=True) + 1e-2
        return eqx.tree_at(lambda net: (net.mean, net.scale), self, (mean, scale))

    def __call__(self, x: Array) -> Array:
        """Map features to outputs."""
        mean, scale = jax.lax.stop_gradient((self.mean, self.scale))
        h = (self.first @ ((x.reshape(len(x), -1) - mean) / scale) + self.bias).reshape(-1, *x.shape[1:])
        for layer in self.layers:
            h = layer(h)
        y = self.last @ jax.nn.silu(h).reshape(len(h), -1) + self.offset
        return y.reshape(-1, *x.shape[1:])


def _normal(key: PRNGKeyArray, rows: int, columns: int) -> Array:
    return jax.random.normal(key, (rows, columns), jnp.float32) / columns**0.5


def _shifted(a: Array, by: int) -> Array:
    """Waypoint k + by in the place of k; the ends are repeated."""
    count = a.shape[1]
    by = max(-count, min(by, count))
    if by > 0:
        return jnp.concatenate([a[:, by:], jnp.repeat(a[:, -1:], by, axis=1)], axis=1)
    return jnp.concatenate([jnp.repeat(a[:, :1], -by, axis=1), a[:, : count + by]], axis=1)
