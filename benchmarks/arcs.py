"""Time per pose for the exact feasible arcs of all eight branches.

python -m benchmarks.arcs
"""

import jax
import numpy as np

import jaxik
from benchmarks.common import best_seconds, reachable_targets, table

jax.config.update("jax_enable_x64", True)


def main() -> None:
    rows = []
    for name, model in (("iiwa14", jaxik.presets.iiwa14()), ("meccanoid", jaxik.presets.meccanoid("right"))):
        for dtype in ("float64", "float32"):
            for count in (1024, 2048, 4096, 16_384):
                position, rotation, _ = reachable_targets(model.arm, count)
                position = np.moveaxis(position, -1, 0).astype(dtype)
                rotation = np.moveaxis(rotation, -1, 0).astype(dtype)
                if model.arm.n_joints == 7:
                    target = jaxik.Pose(jax.numpy.asarray(position), jax.numpy.asarray(rotation))
                else:
                    target = jaxik.Pointing(jax.numpy.asarray(position), jax.numpy.asarray(rotation[..., 2]))
                best, median = best_seconds(lambda arm=model.arm, target=target: jaxik.swivel_arcs(arm, target), 50)
                rows.append((name, dtype, count, f"{best / count * 1e6:.2f}", f"{median / count * 1e6:.2f}"))
    table("Feasible arcs of 8 branches, time per pose [us]", ("arm", "dtype", "batch", "best", "median"), rows)


if __name__ == "__main__":
    main()
