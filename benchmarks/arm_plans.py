"""How good are the plans of arms that have no proof? Against local minima from random starts along the same path.

Every start is a random posture at one end of the path, followed to the other end by least joint motions (the pseudo-
inverse of the Jacobian) and then refined in joint space to the nearest local minimum within limits and speeds.

    JAXIK_DATA=FOLDER python benchmarks/arm_plans.py [--arms gen3 g1 xarm7] [--paths s hello] [--starts 30]

FOLDER holds ``paths/*.csv``; without it, the example paths of the project are taken.
"""

import argparse
import os
import time
from pathlib import Path as File
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxik
from jaxik.planning.check import check
from jaxik.planning.motion import make_problem
from jaxik.planning.postures.refinement import held_ends, refine_postures
from jaxik.planning.problem import PlanningProblem
from jaxik.redundancy import correction

ARMS = ("gen3", "g1", "franka_fr3", "xarm7")
PARAMETERS = 512  # of which random starts are drawn


def paths(names: list[str] | None) -> dict[str, jaxik.Path]:
    """Return the paths by name."""
    folder = os.environ.get("JAXIK_DATA")
    found = {}
    if folder:
        found = {file.stem: jaxik.load_path(file) for file in sorted(File(folder, "paths").glob("*.csv"))}
    else:
        found = {name: jaxik.example_path(name) for name in jaxik.example_path_names()}
    return {name: path for name, path in found.items() if not names or name in names}


def random_postures(arm: jaxik.Arm, target: jaxik.Pose, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return random feasible postures at one target, ``(count, joint)`` [rad]."""
    solution = jaxik.solve_ik(arm, target, rng.uniform(-np.pi, np.pi, PARAMETERS))
    feasible = np.asarray(solution.q)[np.asarray(solution.ok)]
    return feasible[rng.integers(len(feasible), size=count)]


@jax.jit
def local_minimum(problem: PlanningProblem, q: jax.Array, backward: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Follow the path from a posture at one of its ends, and refine: energy and joint angles."""
    motion: Any = problem.motion
    order = jnp.where(backward, jnp.arange(len(problem.time))[::-1], jnp.arange(len(problem.time)))

    def follow(q: jax.Array, k: jax.Array) -> tuple[jax.Array, jax.Array]:
        for _ in range(3):
            q = q + correction(problem.arm, motion.position[:, k], motion.directions[..., k], q)
        return q, q

    _, along = jax.lax.scan(follow, q, order)
    end = refine_postures(problem, held_ends(problem, along[order]), 240)
    return problem.energy(problem.arm, end.q, problem.time), end.q


def compared(name: str, path: jaxik.Path, starts: int) -> str:
    """Plan one path and compare the plan with local minima: a row of the table."""
    model = getattr(jaxik.presets, name)()
    path = jaxik.fit_path(model, path)
    jaxik.plan(model, path, gap=None)  # compiles
    begun = time.perf_counter()
    plan = jaxik.plan(model, path, gap=None)
    seconds = time.perf_counter() - begun
    problem = make_problem(model.arm, path.target, path.time)
    rng, energies = np.random.default_rng(0), []
    for backward in (False, True):
        target = jax.tree.map(lambda x, end=-1 if backward else 0: x[end], path.target)
        for q in random_postures(model.arm, target, starts // 2, rng):
            energy, q = local_minimum(problem, jnp.asarray(q), jnp.asarray(backward))
            fits = check(model.arm, path, np.asarray(q)).problems == ()
            energies.append(float(energy) if fits else np.inf)
    least, median = np.min(energies), np.median(energies)
    scale = path.placement.scale if path.placement else 1.0
    share = np.mean(np.asarray(energies) <= plan.energy * 1.005)
    return (
        f"| {name} | {scale:.2f} | {plan.status.name} | {plan.energy:.4f} | {least:.4f} | "
        f"{100 * (plan.energy / least - 1):+.2f} % | {median:.3f} | {100 * share:.0f} % | {seconds:.1f} |"
    )


def main() -> None:
    """Print the table."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", nargs="+", default=ARMS)
    parser.add_argument("--paths", nargs="+")
    parser.add_argument("--starts", type=int, default=30)
    options = parser.parse_args()
    print("| path | arm | scale | status | plan | best start | plan against it | median | as low | s |", flush=True)
    for label, path in paths(options.paths).items():
        for name in options.arms:
            print(f"| {label} {compared(name, path, options.starts)}", flush=True)


if __name__ == "__main__":
    main()
