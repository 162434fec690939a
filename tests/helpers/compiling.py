"""How programs are compiled in tests, where compiling takes most of the time."""

from collections.abc import Iterator
from contextlib import contextmanager

# The older of two code generators with fewer of LLVM's passes compiles in half the time. README.md and all command
# lines are tested without these flags, as readers run them.
QUICK_COMPILING = "--xla_cpu_use_fusion_emitters=false --xla_backend_optimization_level=1"


@contextmanager
def hardly_optimized() -> Iterator[None]:
    """Programs compiled in here compile in half of that time and run slower: for those that run once."""
    import jax  # after the flags have been set

    jax.config.update("jax_disable_most_optimizations", True)
    try:
        yield
    finally:
        jax.config.update("jax_disable_most_optimizations", False)
