"""Programs that the host runs once a path: what they cost is mostly their first call."""

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import jax

from jaxik.numerics.chunks import on_one_cpu

F = TypeVar("F", bound=Callable)

# The older of XLA's two code generators for CPUs. Measured with jax 0.10.2: a plan's programs compile in two thirds of
# the CPU time and in half the wall time on two cores, and run a quarter slower.
_SOONER = {"xla_cpu_use_fusion_emitters": False}


def compiled_sooner(f: F, **options: Any) -> F:
    """Compile ``f`` as ``jax.jit`` does, on CPUs with less time for compiling and a little more for each call.

    Under another transformation it is plain ``jax.jit``: options are the outermost program's.
    """
    plain, sooner = jax.jit(f, **options), jax.jit(f, compiler_options=_SOONER, **options)

    @functools.wraps(f)
    def run(*args: Any, **kwargs: Any) -> Any:
        program = sooner if on_one_cpu(args, kwargs) and _sooner_is_known() else plain
        return program(*args, **kwargs)

    return run  # pyright: ignore[reportReturnType]


@functools.cache
def _sooner_is_known() -> bool:
    """Test whether this version of XLA has the option: it refuses those that it does not know."""
    try:
        jax.jit(lambda: 0, compiler_options=_SOONER)()
    except Exception:  # of a type that depends on the version
        return False
    return True
