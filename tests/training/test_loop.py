"""The loop: resumable bit for bit, the same on one device, eight devices and two processes."""

import json
import os
import socket
import subprocess
import sys
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.helpers.least_squares import curve, loss
from training.examples import Examples, data_mesh
from training.loop import _HELD_OUT, LoopConfig, fit

CONFIG = LoopConfig(steps=30, batch=64, learning_rate=0.3, validate_every=10)
START = {"w": jnp.zeros(5), "b": jnp.zeros(())}


def same(a, b):
    return all(np.array_equal(x, y) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True))


def test_one_seed_one_result():
    first, second = fit(START, loss, CONFIG), fit(START, loss, CONFIG)
    assert same(first.params, second.params)
    assert first.losses[-1] < 0.8 * first.losses[0]
    assert [step for step, _ in first.validation] == [10, 20, 30]


def test_a_stopped_run_continues_bit_for_bit(tmp_path):
    whole = fit(START, loss, replace(CONFIG, metrics=tmp_path / "whole.jsonl"))
    stored = replace(CONFIG, checkpoints=tmp_path / "run", metrics=tmp_path / "run.jsonl")

    class Stop(Exception):
        pass

    def stop(share):
        if share >= 0.8:  # after the validation of step 20, on the way to 30
            raise Stop

    with pytest.raises(Stop):
        fit(START, loss, stored, progress=stop)
    resumed = fit(START, loss, stored)
    assert len(resumed.losses) == 10
    np.testing.assert_array_equal(resumed.losses, whole.losses[20:])
    assert same(resumed.params, whole.params)
    assert (tmp_path / "run.jsonl").read_text() == (tmp_path / "whole.jsonl").read_text()
    lines = [json.loads(line) for line in (tmp_path / "run.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines] == [10, 20, 30]


def test_another_training_in_the_folder_is_refused(tmp_path):
    stored = replace(CONFIG, steps=10, checkpoints=tmp_path / "run")
    fit(START, loss, stored)
    with pytest.raises(ValueError, match="another folder"):
        fit({"w": jnp.zeros((5, 2)), "b": jnp.zeros(())}, loss, stored)


def test_it_stops_when_validation_no_longer_improves_and_returns_the_best():
    def growing(params, rows):
        return loss(params, rows)[0] * 0.0 + jnp.sum(jnp.abs(params["w"])) * len(rows), jnp.asarray(len(rows), float)

    found = fit(START, loss, replace(CONFIG, steps=500, validate_every=5, patience=3), validation=growing)
    assert found.stopped_early
    assert found.step == 20  # the first validation is the best of those that only grow
    assert float(jnp.abs(found.params["w"]).sum()) < 1.0


def test_a_loss_that_is_no_number_is_an_error():
    def broken(params, rows):
        return jnp.log(-1.0 - params["b"] ** 2) * len(rows), jnp.asarray(len(rows), float)

    with pytest.raises(FloatingPointError, match="step 10"):
        fit(START, broken, CONFIG)


def test_a_batch_that_does_not_divide_is_refused():
    with pytest.raises(ValueError, match="multiple"):
        fit(START, loss, replace(CONFIG, batch=60), mesh=data_mesh())


def test_more_rows_than_numbers_and_a_second_mesh_are_refused():
    with pytest.raises(ValueError, match="at most 2147483648 rows"):
        fit(START, loss, replace(CONFIG, steps=1 << 27))
    with pytest.raises(ValueError, match="omit mesh"):
        fit(START, loss, CONFIG, examples=Examples(lambda rows: rows), mesh=data_mesh())


def test_rows_held_out_are_no_rows_trained_on():
    rows = Examples(lambda rows: rows)
    assert int(rows(_HELD_OUT, 32).max()) < 0
    assert int(rows((1 << 31) - 32, 32).min()) > 0


def test_eight_devices_have_the_curve_of_one():
    assert len(jax.devices()) == 8
    one, eight = fit(START, loss, CONFIG), fit(START, loss, CONFIG, mesh=data_mesh())
    np.testing.assert_allclose(eight.losses, one.losses, rtol=1e-12)
    np.testing.assert_allclose(eight.params["w"], one.params["w"], rtol=1e-10)


WORKER = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_cpu_collectives_implementation", "gloo")
jax.distributed.initialize(f"localhost:{sys.argv[1]}", num_processes=2, process_id=int(sys.argv[2]))
import numpy as np
from tests.helpers.least_squares import curve
losses = curve(everything=True)
assert jax.process_count() == 2 and len(jax.devices()) == 4
if jax.process_index() == 0:
    np.save(sys.argv[3], losses)
jax.distributed.shutdown()
"""


@pytest.mark.slow
def test_the_policys_training_has_one_curve_on_one_device_and_on_eight():
    from tests.helpers.policy_curve import curve

    one, eight = curve(everything=False), curve(everything=True)
    assert len(set(one.tolist())) == len(one)  # each step has paths of its own: that it learns, validation tells
    np.testing.assert_allclose(eight, one, atol=1e-5)


@pytest.mark.slow
def test_two_processes_have_the_curve_of_one_device(tmp_path, repository):
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    environment = os.environ | {
        "PYTHONPATH": str(repository),
        "JAX_PLATFORMS": "cpu",
        "XLA_FLAGS": "--xla_force_host_platform_device_count=2",
    }
    workers = [
        subprocess.Popen(
            [sys.executable, "-c", WORKER, str(port), str(i), str(tmp_path / "two.npy")],
            env=environment,
            cwd=repository,
            stderr=subprocess.PIPE,
            text=True,
        )
        for i in range(2)
    ]
    try:
        for worker in workers:
            _, said = worker.communicate(timeout=400)
            assert worker.returncode == 0, said
    finally:
        for worker in workers:
            worker.kill()
            worker.wait()
    np.testing.assert_allclose(np.load(tmp_path / "two.npy"), curve(everything=False), atol=1e-5)
