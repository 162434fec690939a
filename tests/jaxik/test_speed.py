"""Guards of speed that hold on a busy machine: ratios of CPU time measured in turns, and sizes of programs."""

import re
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxik import forward_kinematics, solve_ik, solve_ik_columns, swivel_arcs
from jaxik.arm import presets
from jaxik.numerics.chunks import CHUNK

ARM = presets.iiwa14().arm


def cpu_times(*calls, repeats=7):
    """Least CPU time of each call [s], measured in turns."""
    best = np.full(len(calls), np.inf)
    for call in calls:
        jax.block_until_ready(call())
    for _ in range(repeats):
        for i, call in enumerate(calls):
            began = time.process_time()
            jax.block_until_ready(call())
            best[i] = min(best[i], time.process_time() - began)
    return best


def test_a_plain_call_and_a_gradient_cost_few_columns(rng):
    """Measured: 1.3 of the columns per row for a plain call, and 2.7 of the value for a gradient."""
    rows = 8 * CHUNK
    pose, swivel = forward_kinematics(ARM, rng.uniform(-2.0, 2.0, (rows, 7))), jnp.asarray(rng.uniform(-3, 3, rows))
    part, at = pose[:CHUNK], swivel[:CHUNK]
    columns = jnp.moveaxis(part.position, 0, -1), jnp.moveaxis(part.rotation, 0, -1), at

    def value(pose, swivel):
        return jnp.sum(solve_ik(ARM, pose, swivel).q ** 2)

    compiled, gradient = jax.jit(value), jax.jit(jax.value_and_grad(value, (0, 1)))
    inner, plain, one, slope = cpu_times(
        lambda: solve_ik_columns(ARM, *columns),
        lambda: solve_ik(ARM, pose, swivel).q,
        lambda: compiled(part, at),
        lambda: gradient(part, at),
    )
    assert plain / 8 < 3.0 * inner
    assert slope < 6.0 * one


SIZES = {
    "solve_ik": (lambda pose, swivel: solve_ik(ARM, pose, swivel).q, 3000),
    "gradient": (jax.grad(lambda pose, swivel: jnp.sum(solve_ik(ARM, pose, swivel).q ** 2), (0, 1)), 7000),
    "swivel_arcs": (lambda pose, swivel: swivel_arcs(ARM, pose).start, 10_000),
}


@pytest.mark.parametrize("name", SIZES)
def test_programs_stay_small(name):
    """Compile time follows the number of operations, those within fusions included."""
    f, most = SIZES[name]
    pose = forward_kinematics(ARM, np.zeros((64, 7)))
    text = str(jax.jit(f).lower(pose, jnp.zeros(64)).compile().as_text())
    operations = len(re.findall(r"^\s+(?:ROOT )?%?[\w.-]+ = ", text, re.MULTILINE))
    assert 0.3 * most < operations < most
