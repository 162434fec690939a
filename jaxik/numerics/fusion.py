"""Parts of a long formula that the CPU compiler fuses separately.

XLA's CPU backend gives every output array a loop of its own and, when it fuses, recomputes in each loop whatever the
outputs share: the closed form as one piece takes 11 000 operations per pose, in separately fused parts 2 900.
Optimization barriers do not help, since they are removed before fusion. A call marked as not to be inlined is a border
that fusion respects. GPUs and TPUs have fusions with several outputs (not measured here), so there the formula stays
whole.
"""

import functools
from collections.abc import Callable
from typing import TypeVar

import jax
from jax.experimental.xla_metadata import set_xla_metadata

F = TypeVar("F", bound=Callable)


def fused_separately(f: F) -> F:
    """Compile ``f``, a function of arrays, apart from its surroundings on CPUs; nothing else changes."""
    # Reverse mode keeps the arguments only and repeats the part where it needs what is between: to store all that is
    # between and to read it again takes longer.
    repeated = jax.checkpoint(f, prevent_cse=False)

    @functools.wraps(f)
    def inside(*args):
        # Without it every jnp.where within would become a call too. Set the attribute per operation: vmap and autodiff
        # re-trace inside the outer call and would otherwise inherit its `inlineable=false`.
        with set_xla_metadata(inlineable="true"):
            return repeated(*args)

    whole = jax.jit(inside)

    def apart(*args):
        with set_xla_metadata(inlineable="false"):
            return whole(*args)

    @functools.wraps(f)
    def run(*args):
        # Each of the two is traced, and with nothing but CPUs at hand a program for others is an export at most, which
        # works with borders too.
        if jax.default_backend() == "cpu":
            return apart(*args)
        return jax.lax.platform_dependent(*args, cpu=apart, default=whole)

    return run  # pyright: ignore[reportReturnType]
