"""Cuts a long formula into programs that the CPU compiler keeps apart.

XLA's CPU backend gives every output array a loop of its own and, when it fuses, recomputes in each loop whatever the
outputs share: the closed form as one piece did 11 000 operations a pose, in stages it does 2 900. Optimization
barriers do not help, they are gone before fusion. A conditional is a border that fusion respects, and a condition
behind an optimization barrier is one that the simplifier cannot see through. GPUs and TPUs have fusions with several
outputs (not measured here), so there the formula stays whole.
"""

import functools
from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp

F = TypeVar("F", bound=Callable)


def stage(f: F) -> F:
    """Compiles ``f``, a function of arrays, apart from its surroundings on CPUs; changes nothing else."""
    whole = jax.jit(f)

    def nothing(*args):
        return jax.tree.map(lambda out: jnp.zeros(out.shape, out.dtype), jax.eval_shape(whole, *args))

    def apart(*args):
        return jax.lax.cond(jax.lax.optimization_barrier(jnp.array(True)), whole, nothing, *args)

    @functools.wraps(f)
    def run(*args):
        return jax.lax.platform_dependent(*args, cpu=apart, default=whole)

    return run  # pyright: ignore[reportReturnType]
