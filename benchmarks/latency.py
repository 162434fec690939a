"""Latency of the first call, of a single pose, and of another arm of the same shape.

python -m benchmarks.latency
"""

import time

import jax
import numpy as np

import jaxik
from benchmarks.common import best_seconds, table

jax.config.update("jax_enable_x64", True)


def main() -> None:
    model = jaxik.presets.iiwa14()
    jax.block_until_ready(jax.numpy.zeros(1) + 1)  # starts the backend
    q = jax.numpy.linspace(-0.9, 0.9, 7)
    target = jaxik.forward_kinematics(model.arm, q)
    swivel, _ = jaxik.swivel_of(model.arm, q)
    rows = []
    for name, call in (
        ("solve_ik", lambda arm: jaxik.solve_ik(arm, target, swivel)),
        ("swivel_arcs", lambda arm: jaxik.swivel_arcs(arm, target)),
        ("solve_nearest", lambda arm: jaxik.solve_nearest(arm, target, q)),
    ):
        start = time.perf_counter()
        jax.block_until_ready(call(model.arm))
        first = time.perf_counter() - start
        start = time.perf_counter()
        jax.block_until_ready(call(jaxik.presets.iiwa7().arm))
        other = time.perf_counter() - start
        best, median = best_seconds(lambda call=call: call(model.arm), 2000 if name == "solve_ik" else 200)
        rows.append((name, f"{first:.2f} s", f"{other * 1e3:.1f} ms", f"{best * 1e6:.0f} us", f"{median * 1e6:.0f} us"))
    table("One pose, float64", ("call", "first call", "first with another arm", "best", "median"), rows)
    assert np.isfinite(np.asarray(target.position)).all()


if __name__ == "__main__":
    main()
