"""How fast does one learn through the solver, and how fast is what was learned?

python -m benchmarks.training [--policy elbow.policy] [--paths 1024] [--arm iiwa14]
"""

import argparse
import os
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np

import jaxik
import training
from benchmarks.common import best_seconds, reachable_targets, table
from jaxik.cli.inputs import find_arm

jax.config.update("jax_enable_x64", True)

CHUNK = 16_384  # rows of one gradient: the best of 1024, 4096 and 16 384


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policy", help="policy file; without it only the solver's rate is measured")
    parser.add_argument("--paths", type=int, default=1024, help="paths of 100 poses in the policy's batch")
    parser.add_argument("--planned", type=int, default=64, help="paths that the planner is timed on")
    parser.add_argument("--arm", default="iiwa14")
    options = parser.parse_args()
    arm = find_arm(options.arm).arm
    solves(arm)
    if options.policy is not None:
        policies(arm, training.load_policy(options.policy), options.paths, options.planned)


def solves(arm: jaxik.Arm) -> None:
    """Targets solved in all eight branches with the gradient of a loss of all their angles in the swivel."""
    single = arm.astype(jnp.float32)
    cores = len(os.sched_getaffinity(0))
    count = 32 * CHUNK * cores
    position, rotation, swivel = (x.astype(np.float32) for x in reachable_targets(arm, count))

    def loss(swivel: jax.Array, position: jax.Array, rotation: jax.Array) -> jax.Array:
        # The eight branches share their angles; a loss of the shared ones is one of all eight.
        found = jaxik.solve_ik_columns(single, position, rotation, swivel)
        return jnp.sum(found.shoulder**2) + jnp.sum(found.elbow**2) + jnp.sum(found.wrist**2)

    gradient = jax.jit(jax.value_and_grad(loss))
    parts = [slice(i, i + CHUNK) for i in range(0, count, CHUNK)]
    chunks = [
        tuple(jax.device_put(np.ascontiguousarray(x[..., part])) for x in (swivel, position, rotation))
        for part in parts
    ]
    with ThreadPoolExecutor(cores) as pool:
        best, median = best_seconds(lambda: list(pool.map(lambda c: jax.block_until_ready(gradient(*c)), chunks)), 7)
    rows = [(count, f"{count / best / 1e6:.2f}", f"{count / median / 1e6:.2f}")]
    table("Targets solved with gradient, eight branches, float32", ("targets", "best [M/s]", "median [M/s]"), rows)


def policies(arm: jaxik.Arm, policy: training.ElbowPolicy, paths: int, planned: int) -> None:
    """A policy in a batch against the planner in a batch, on held-out paths of 100 poses."""
    held_out = training.held_out_paths(arm, paths, seed=1)
    single = held_out.astype(jnp.float32)
    count = held_out.time_s.shape[0]
    some = jax.tree.map(lambda x: x[:planned], held_out)
    plans = jax.jit(
        lambda t, s: jax.lax.map(lambda row: jaxik.least_energy_motion(arm, row[0], row[1], search=32).energy, (t, s))
    )
    plan, _ = best_seconds(lambda: plans(some.target, some.time_s), 2)
    alone, _ = best_seconds(lambda: policy(single.target, single.time_s), 7)
    plan, alone = plan / planned, alone / count
    rows = [
        ("planner", f"{1e6 * plan:.0f}", "1"),
        ("policy, projected", f"{1e6 * alone:.1f}", f"{plan / alone:.0f}"),
    ]
    table("One path of 100 poses, in a batch", ("by", "time [us]", "times faster"), rows)
    print(training.evaluate(policy, some).report())


if __name__ == "__main__":
    main()
