"""Programs that the host runs once a path: what they cost is mostly their first call."""

import functools
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import jax

from jaxik.numerics.chunks import cores, on_one_cpu

# The older of XLA's two code generators for CPUs, and fewer of LLVM's passes. Measured with jax 0.10.2: a plan's
# programs compile in half the CPU time and run a tenth slower; at level 0 in a quarter, and four times slower.
_SOONER = {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 1}


class CompiledSooner:
    """A function compiled as by ``jax.jit``; on CPUs with less time for compiling and a little more for each call.

    Under another transformation it is plain ``jax.jit``: options are the outermost program's.
    """

    def __init__(self, f: Callable, **options: Any) -> None:
        functools.update_wrapper(self, f)
        self._plain, self._sooner = jax.jit(f, **options), jax.jit(f, compiler_options=_SOONER, **options)
        self._ahead: list[Future] = []

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Call the function."""
        while self._ahead:
            self._ahead.pop().exception()  # waits; what is wrong with it the call says itself
        program = self._sooner if on_one_cpu(args, kwargs) and _sooner_is_known() else self._plain
        return program(*args, **kwargs)

    def shapes(self, *args: Any) -> Any:
        """Return the shapes of the result."""
        return self._sooner.eval_shape(*args)

    def compile_ahead(self, *args: Any) -> None:
        """Begin to compile for arguments, of which the shapes are enough; the next call waits for it."""
        self._ahead.append(_workers().submit(lambda: self._sooner.lower(*args).compile()))


def compiled_sooner(f: Callable, **options: Any) -> CompiledSooner:
    """Compile a function as ``jax.jit`` with these options does, but see :class:`CompiledSooner`."""
    return CompiledSooner(f, **options)


@functools.cache
def _workers() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max(1, cores() - 1), thread_name_prefix="compiling")


@functools.cache
def _sooner_is_known() -> bool:
    """Test whether this version of XLA has the option: it refuses those that it does not know."""
    try:
        jax.jit(lambda: 0, compiler_options=_SOONER)()
    except Exception:  # of a type that depends on the version
        return False
    return True
