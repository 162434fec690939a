"""Throughput of learning through the solver, and accuracy and speed of a policy.

python -m benchmarks.training [--policy elbow.policy] [--paths 1024] [--arm iiwa14] [--recorded hello.csv square.csv]

A policy is compared with certified plans, `jaxik.plan` with default options: energy above theirs and above their lower
bounds, and time relative to theirs and to plans without a certificate.
"""

import argparse
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np

import jaxik
import training
from benchmarks.common import best_seconds, reachable_targets, table
from jaxik.cli import find_arm

jax.config.update("jax_enable_x64", True)

CHUNK = 16_384  # rows per gradient, the fastest of 1024, 4096 and 16 384


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policy", help="policy file; without it only the throughput of the solver is measured")
    parser.add_argument("--paths", type=int, default=1024, help="number of paths of 100 poses in the policy's batch")
    parser.add_argument("--planned", type=int, default=64, help="number of these paths that are planned")
    parser.add_argument("--seed", type=int, default=11, help="seed of the paths")
    parser.add_argument("--recorded", nargs="*", default=[], help="path files, in addition to random paths")
    parser.add_argument("--arm", default="iiwa14")
    options = parser.parse_args()
    arm = find_arm(options.arm).arm
    solves(arm)
    if options.policy is not None:
        policy = training.load_policy(options.policy)
        policies(arm, policy, training.held_out_paths(arm, options.paths, seed=options.seed), options.planned)
        if options.recorded:
            recorded(arm, policy, options.recorded)


def solves(arm: jaxik.Arm) -> None:
    """Measure targets solved in all eight branches with the gradient of a loss in the swivel."""
    single = arm.astype(jnp.float32)
    cores = len(os.sched_getaffinity(0))
    count = 32 * CHUNK * cores
    position, rotation, swivel = (x.astype(np.float32) for x in reachable_targets(arm, count))

    def loss(swivel: jax.Array, position: jax.Array, rotation: jax.Array) -> jax.Array:
        # The eight branches share their angles, so that a loss of the shared angles covers all eight.
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


def policies(arm: jaxik.Arm, policy: training.ElbowPolicy, paths: jaxik.Path, planned: int) -> None:
    """Compare a policy in a batch with the planner on paths of 100 poses."""
    single, count = paths.astype(jnp.float32), paths.time.shape[0]
    some = jax.tree.map(lambda x: x[:planned], paths)
    each = [jax.tree.map(lambda x, i=i: x[i], some) for i in range(planned)]
    for path in each:  # compiles
        jaxik.plan(arm, path)
    certified, times = zip(*(timed(lambda path=path: jaxik.plan(arm, path)) for path in each), strict=True)
    searched = [timed(lambda path=path: jaxik.plan(arm, path, gap=None))[1] for path in each]
    plans = jax.jit(
        lambda t, s: jax.lax.map(lambda row: jaxik.least_energy_motion(arm, row[0], row[1], search=32).energy, (t, s))
    )
    batch, _ = best_seconds(lambda: plans(some.target, some.time), 3)
    alone = best_seconds(lambda: policy(single.target, single.time), 9)[0] / count
    uncorrected = best_seconds(lambda: jaxik.plan_batch(policy.arm, single.target, single.time), 9)[0] / count
    rows = [
        (name, f"{1e6 * seconds:.0f}", f"{seconds / alone:.1f}")
        for name, seconds in (
            (f"policy, {count} in a batch", alone),
            (f"plan_batch, {count} in a batch", uncorrected),
            (f"least_energy_motion, {planned} in a batch", batch / planned),
            ("plan without certificate, median", float(np.median(searched))),
            ("plan, certified to 1 %, median", float(np.median(times))),
            ("plan, certified to 1 %, mean", float(np.mean(times))),
        )
    ]
    table("One path of 100 poses", ("method", "time [us]", "relative to the policy"), rows)
    energy = np.array([plan.energy for plan in certified])
    score = training.evaluate(policy, some, optimum=energy)
    print(f"\nAgainst certified plans:\n{score.report()}")
    bound = np.array([plan.lower_bound for plan in certified if plan.lower_bound is not None])
    beyond = [100 * ((1 + x) * score.planner / bound - 1).mean() for x in (score.excess, score.refined)]
    print(f"above their lower bounds: mean {beyond[0]:.2f} %, after refinement {beyond[1]:.2f} %")


def recorded(arm: jaxik.Arm, policy: training.ElbowPolicy, files: list[str]) -> None:
    """Compare a policy with certified plans on recorded paths, fitted into the arm's workspace."""
    rows = []
    for file in files:
        path = jaxik.fit_path(arm, jaxik.load_path(file))
        plan = jaxik.plan(arm, path)
        if plan.lower_bound is None:
            rows.append((file.rsplit("/", 1)[-1], len(path), plan.status.name, *["-"] * 5))
            continue
        score = training.evaluate(policy, path, optimum=np.array([plan.energy]))
        excess = np.array([score.excess[0], score.refined[0]])
        shown = [f"{100 * x:.2f} %" for x in (*excess, *((1 + excess) * plan.energy / plan.lower_bound - 1))]
        rows.append((file.rsplit("/", 1)[-1], len(path), plan.status.name, *shown, score.violations))
    header = ("path", "poses", "plan", "policy", "refined", "policy, bound", "refined, bound", "outside limits")
    table("Energy above certified plans and above their lower bounds", header, rows)


def timed(call: Callable[[], jaxik.Plan]) -> tuple[jaxik.Plan, float]:
    """Return the result of a call and its wall time [s]."""
    began = perf_counter()
    return call(), perf_counter() - began


if __name__ == "__main__":
    main()
