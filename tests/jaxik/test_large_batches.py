"""Large batches are computed in chunks, and residuals when asked for: the same numbers, wherever they are asked for."""

import copy
import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from jaxik import Pose, forward_kinematics, solve_ik
from jaxik.arm import presets
from jaxik.ik.residual import residual
from jaxik.numerics.chunks import CHUNK, in_chunks, map_chunks

ARM = presets.iiwa14().arm
ROWS = 2 * CHUNK + 5


@jax.jit
def scaled(factor, x, y):
    assert x.shape[0] == CHUNK
    return {"sum": factor * (jnp.sum(x, axis=1) + y), "positive": y > 0.0}


@pytest.mark.parametrize("batch", [(CHUNK,), (ROWS,), (3, CHUNK // 2 + 1)])
def test_chunks_cover_every_row_once(batch, rng):
    x, y = rng.normal(size=(*batch, 2)), rng.normal(size=batch[-1:])
    found = map_chunks(scaled, jnp.asarray(3.0), (x, y), (1, 0), batch)
    assert found["sum"].shape == batch
    assert np.array_equal(found["sum"], 3.0 * (x.sum(-1) + y))
    assert np.array_equal(found["positive"], np.broadcast_to(y > 0.0, batch))


def test_an_error_in_a_chunk_is_raised():
    with pytest.raises(TypeError, match="incompatible shapes"):
        map_chunks(jax.jit(lambda c, x: x + c), jnp.zeros(3), (np.zeros(CHUNK),), (0,), (CHUNK,))


def test_only_large_batches_of_values_on_one_processor_are_chunked():
    x = jnp.zeros(ROWS)
    assert in_chunks((ROWS,), x, np.zeros(3), 1.0)
    assert not in_chunks((2 * CHUNK,), x)
    inside = []
    jax.eval_shape(lambda y: inside.append(in_chunks((ROWS,), y)), x)
    jax.eval_shape(lambda: inside.append(in_chunks((ROWS,), x)))  # a constant of a trace
    assert inside == [False, False]
    mesh = Mesh(np.array(jax.devices()[:2]), ("rows",))
    assert not in_chunks((ROWS + 1,), jax.device_put(jnp.zeros(ROWS + 1), NamedSharding(mesh, P("rows"))))
    assert not in_chunks((ROWS,), jax.device_put(x, jax.devices()[1]))


def test_a_large_batch_has_the_numbers_of_its_chunks(rng):
    q = rng.uniform(-2.0, 2.0, (ROWS, 7))
    pose, swivel = forward_kinematics(ARM, q), rng.uniform(-3.0, 3.0, ROWS)
    whole = solve_ik(ARM, pose, swivel)
    for part in (slice(0, CHUNK), slice(ROWS - CHUNK, ROWS)):
        one = solve_ik(ARM, pose[part], swivel[part])
        assert np.array_equal(forward_kinematics(ARM, q[part]).rotation, pose.rotation[part])
        assert np.array_equal(one.q, whole.q[part])
        assert np.array_equal(one.status, whole.status[part])
        assert np.array_equal(one.residual.position, whole.residual.position[part])
        assert np.array_equal(one.residual.rotation, whole.residual.rotation[part])


def solved():
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (CHUNK, 7))
    pose = forward_kinematics(ARM, q)
    pose = Pose(pose.position.at[0].mul(3.0), pose.rotation)  # a row out of reach leaves a distance to see
    return pose, solve_ik(ARM, pose, np.zeros(CHUNK))


def test_a_residual_is_that_of_forward_kinematics_of_the_angles():
    pose, solution = solved()
    expected = residual(
        ARM, jnp.moveaxis(solution.q, 0, -1), jnp.moveaxis(pose.position, 0, -1), jnp.moveaxis(pose.rotation, 0, -1)
    )
    assert float(solution.residual.position[0].min()) > 0.1
    assert np.allclose(solution.residual.position, expected[0].T, rtol=0, atol=1e-14)
    assert np.allclose(solution.residual.rotation, expected[1].T, rtol=0, atol=1e-14)


def test_a_residual_waits_until_it_is_asked_for_by_anyone():
    _, solution = solved()
    assert not solution.residual.computed
    assert not solution.best().residual.computed
    expected = np.asarray(solved()[1].residual.position)
    askers = {
        "field": lambda s: s.residual.position,
        "leaves": lambda s: jax.tree.leaves(s)[2],
        "trace": lambda s: jax.jit(lambda x: s.residual.position + x)(0.0),
        "argument": lambda s: jax.jit(lambda s: s.residual.position)(s),
        "pickle": lambda s: pickle.loads(pickle.dumps(s)).residual.position,
        "copy": lambda s: copy.deepcopy(s).residual.position,
    }
    for asker, ask in askers.items():
        _, solution = solved()
        assert np.array_equal(ask(solution), expected), asker
        assert solution.residual.computed, asker
    best = solution.best()
    assert np.array_equal(best.residual.position, expected[np.arange(CHUNK), best.branch])
    with pytest.raises(AttributeError, match="'Residual' object has no attribute 'velocity'"):
        _ = solution.residual.velocity
