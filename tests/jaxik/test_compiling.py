"""Programs of the host: compiled once, ahead or at the call, and plain ones under other transformations."""

import logging
import threading
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import energy as energies
from jaxik.cli.compiling import Compilations
from jaxik.numerics.compiling import compiled_sooner
from jaxik.planning.padding import padded_problem, padded_size, problem_shapes
from jaxik.planning.search_size import searched_size


@pytest.fixture
def compiled():
    """Names of the programs compiled so far."""
    names = []

    def listen(event, *_, fun_name="", **__):
        if "backend_compile" in event:
            names.append(fun_name)

    jax.monitoring.register_event_duration_secs_listener(listen)
    yield names
    jax.monitoring.unregister_event_duration_listener(listen)


def square(x):
    return jnp.sum(x * x)


def test_compiles_once_ahead_or_at_the_call(compiled):
    program, x = compiled_sooner(square), np.arange(5.0)
    program.compile_ahead(jax.ShapeDtypeStruct((5,), np.float64))
    assert float(program(x)) == 30.0
    assert float(program(jnp.asarray(x))) == 30.0
    assert compiled.count("jit(square)") == 1
    program(np.arange(3.0))
    assert compiled.count("jit(square)") == 2


def test_what_is_wrong_is_said_by_the_call_alone():
    program = compiled_sooner(lambda x: x @ jnp.ones((4, 2)))
    program.compile_ahead(jax.ShapeDtypeStruct((5,), np.float64))
    with pytest.raises(TypeError, match="shape"):
        program(np.arange(5.0))
    assert program(np.arange(4.0)).shape == (2,)


def test_is_plain_under_other_transformations():
    program, x = compiled_sooner(square), jnp.arange(5.0)
    assert float(jax.jit(lambda: program(x))()) == 30.0  # no argument is a tracer
    assert float(jax.jit(program)(x)) == 30.0
    np.testing.assert_array_equal(jax.grad(program)(x), 2 * x)
    np.testing.assert_array_equal(jax.jit(jax.vmap(jax.grad(program)))(jnp.stack([x, x])), jnp.stack([2 * x, 2 * x]))


def described(x):
    return np.shape(x), x.dtype if hasattr(x, "dtype") else type(x)


@pytest.mark.parametrize(("name", "target"), [("iiwa14", "pose"), ("iiwa14", "pointing"), ("meccanoid", "pointing")])
def test_shapes_compiled_ahead_are_those_of_the_plan(name, target):
    arm = getattr(jaxik.presets, name)().arm
    q = jnp.linspace(0.2, 0.6, 40)[:, None] * jnp.ones(arm.n_joints)
    pose = jaxik.forward_kinematics(arm, q)
    path = jaxik.Path(pose.pointing() if target == "pointing" else pose, jnp.arange(40.0))
    path, energy = jax.tree.map(np.asarray, path), energies.servo()
    for size in (padded_size(len(path)), searched_size(len(path))):
        ahead, real = problem_shapes(arm, path, size, energy), padded_problem(arm, path, size, energy)
        assert jax.tree.structure(ahead) == jax.tree.structure(real)
        assert [described(x) for x in jax.tree.leaves(ahead)] == [described(x) for x in jax.tree.leaves(real)]


def test_time_of_compilations_side_by_side_counts_once():
    """Two threads compile, a third gets its program from the cache; the seconds are those on the clock."""
    said = []
    found = Compilations(said.append)
    barrier = threading.Barrier(2)

    def compile_for(seconds):
        barrier.wait()
        found.emit(logging.LogRecord("", 0, "", 0, "PERSISTENT COMPILATION CACHE MISS for %s", (), None))
        time.sleep(seconds)
        found.ended("/jax/core/compile/backend_compile_duration", seconds)

    threads = [threading.Thread(target=compile_for, args=(s,)) for s in (0.2, 0.1)]
    for thread in threads:
        thread.start()
    found.ended("/jax/core/compile/backend_compile_duration", 5.0)  # a hit of this thread
    for thread in threads:
        thread.join()
    assert 0.2 <= found.seconds < 5.0
    assert said[-1] is False
