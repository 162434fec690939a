"""The ground of every test: float64, strict promotion, eight virtual devices and shape checks at every call."""

import os
import zlib
from pathlib import Path

from tests.helpers.compiling import QUICK_COMPILING

# Before jax starts its backends: eight virtual CPU devices, so that sharded runs are tested on any machine. Commands,
# notebooks and the documentation's code are tested with one, as readers run them.
os.environ["XLA_FLAGS"] = (
    f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=8 {QUICK_COMPILING}"
).strip()

import hypothesis
import jax
import jaxtyping
import numpy as np
import pytest

REPOSITORY = Path(__file__).resolve().parent.parent

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")

# No deadline: the first example of a property compiles. `ci` runs the same examples every time.
hypothesis.settings.register_profile("dev", deadline=None, max_examples=25)
hypothesis.settings.register_profile(
    "ci", deadline=None, max_examples=50, derandomize=True, print_blob=True, database=None
)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "dev")


def _leave_containers_unchecked() -> None:
    """Make the type check skip the constructors of pytree dataclasses.

    JAX builds these itself, with leaves that are no arrays (None in jacrev, ShapeDtypeStruct in eval_shape, object() in
    places) or with more batch axes than the annotation names, and in_axes=Pose(0, 0) is usual. Functions that take or
    return them are checked as always.
    """
    register_dataclass = jax.tree_util.register_dataclass

    def register_unchecked(nodetype, *args, **kwargs):
        nodetype.__no_type_check__ = True
        return register_dataclass(nodetype, *args, **kwargs)

    jax.tree_util.register_dataclass = register_unchecked


_leave_containers_unchecked()
jaxtyping.install_import_hook(["jaxik", "training", "hardware"], "beartype.beartype")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put files with slow tests first, so that a run ends with short ones and no worker waits long for another."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


_MAPS = Path("/proc/self/maps")
_MOST_MAPS = 20_000  # of the 65 530 that Linux allows a process


@pytest.fixture(autouse=True, scope="module")
def _few_programs():
    """Drop compiled programs when there are many.

    Each takes some regions of memory, and a process that has all it may have dies at the next program it compiles.
    """
    yield
    if _MAPS.exists() and _MAPS.read_bytes().count(b"\n") > _MOST_MAPS:
        jax.clear_caches()


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A generator of the test's own, so that its numbers do not depend on the tests before it."""
    return np.random.default_rng(zlib.crc32(request.node.nodeid.encode()))


@pytest.fixture
def without_type_checks():
    """Switch the shape checks off, to reach the library's own complaint about a wrong shape."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder with recorded paths and human arm motion, which are no part of the project."""
    folder = Path(os.environ.get("JAXIK_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no recorded data in {folder}: set JAXIK_DATA to the folder that holds paths/ and human_arm/")
    return folder


@pytest.fixture(scope="session")
def repository() -> Path:
    """Root of the checkout."""
    return REPOSITORY
