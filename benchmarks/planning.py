"""Time of a plan, alone and among many.

python -m benchmarks.planning [--path hello.csv] [--paths 256]
"""

import argparse
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np

import jaxik
from benchmarks.common import best_seconds, table

jax.config.update("jax_enable_x64", True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--path", help="path file; default is the example path `word`")
    parser.add_argument("--paths", type=int, default=256, help="number of paths of 100 poses at once")
    options = parser.parse_args()
    arm = jaxik.presets.iiwa14().arm
    path = jaxik.example_path("word") if options.path is None else jaxik.load_path(options.path)
    path = jaxik.fit_path(arm, path)

    def one(target: jaxik.Pose, time: jax.Array, search: int) -> jaxik.SwivelMotion:
        return jaxik.least_energy_motion(arm, target, time, search=search)

    began = perf_counter()
    motion = jax.block_until_ready(one(path.target, path.time, 70))
    first = perf_counter() - began
    best, median = best_seconds(lambda: one(path.target, path.time, 70), 20)
    row = (len(path), f"{float(motion.energy):.5f}", f"{first:.1f}", f"{1e3 * best:.0f}", f"{1e3 * median:.0f}")
    table("One plan, joint motion, iiwa14", ("poses", "energy", "first call [s]", "best [ms]", "median [ms]"), [row])

    index = np.linspace(0, len(path) - 1, 100).round().astype(int)
    shifts = jnp.asarray(np.random.default_rng(0).uniform(-0.03, 0.03, (options.paths, 1, 3)))
    short = jax.tree.map(lambda x: x[index], path.target)
    moved = jaxik.Pose(
        short.position + shifts, jnp.broadcast_to(short.rotation, (options.paths, *short.rotation.shape))
    )
    each = lambda target: one(target, path.time[index], 32)  # noqa: E731
    rows = []
    for name, many in (
        ("vmap", jax.jit(jax.vmap(each))),
        ("lax.map", jax.jit(lambda targets: jax.lax.map(each, targets))),
    ):
        solved = int(jnp.isfinite(many(moved).energy).sum())
        best, median = best_seconds(lambda many=many: many(moved), 4)
        rows.append((name, solved, f"{options.paths / best:.0f}", f"{options.paths / median:.0f}"))
    table(f"{options.paths} paths of 100 poses", ("by", "feasible", "plans/s, best", "median"), rows)


if __name__ == "__main__":
    main()
