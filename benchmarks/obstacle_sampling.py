"""Plans among obstacles against a sampling planner like CppFlow's, on the same worlds.

python -m benchmarks.obstacle_sampling [--worlds 20] [--path word wave] [--samples 175]

The sampling planner takes postures at random swivels for every waypoint, leaves out those that collide or break limits,
finds the cheapest sequence by dynamic programming (CppFlow's first stage, with its 175 postures
a waypoint), and improves it by further rounds with samples closer and closer about the last sequence, in the place of
CppFlow's Levenberg-Marquardt steps, which also leave a motion that may collide. Kinematics, distances and energies of
both planners' motions are computed here in numpy. Solving and distances of the sampling planner are batched; times are
wall times of calls after the first.

Morgan et al., "CppFlow: Generative Inverse Kinematics for Efficient and Robust Cartesian Path Planning", ICRA 2024.
"""

import argparse
from collections.abc import Callable
from time import perf_counter

import jax
import numpy as np

import jaxik
from benchmarks.common import table
from benchmarks.obstacle_arcs import free_postures
from benchmarks.obstacles import MODEL, apart, worlds_about
from tests.helpers.bodies import random_body, random_world

jax.config.update("jax_enable_x64", True)

ROUNDS, NEAR = 12, 32  # rounds of improvement, and samples of a waypoint in each
FAST = 1e3  # times the square of what a step exceeds its speed limit by, added to that of the step
WIDTH, NARROWER = 0.3, 0.55  # rad; spread of the samples in the first round, and its factor from round to round


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=20, help="worlds per path")
    parser.add_argument("--path", nargs="+", default=["wave", "word"], help="example paths or path files")
    parser.add_argument("--samples", type=int, default=175, help="postures of a waypoint")
    options = parser.parse_args()
    for name in options.path:
        compare(name, options.worlds, options.samples)


def compare(name: str, count: int, samples: int) -> None:
    """Plan a path in some worlds by both, and print energies, successes and times."""
    crowded = name != "wave"
    path = jaxik.example_path(name) if "." not in name else jaxik.load_path(name)
    path = jaxik.fit_path(MODEL, path)[:: 1 if crowded else 10]
    body = jaxik.Body.preset("iiwa14") if crowded else random_body(MODEL.arm, 1)
    model = jaxik.with_body(MODEL, body)
    free = jaxik.plan(MODEL, path, gap=None).raise_if_invalid()
    if crowded:
        worlds = list(worlds_about(model, path, free.trajectory.q, count))
    else:
        worlds = [random_world(MODEL.arm, seed, 4 + seed % 5) for seed in range(count)]
    test = free_postures(model.arm)
    for _ in range(2):  # the first round compiles
        jaxik.plan(model, path, world=worlds[0], gap=None)
        sampled(model.arm, path, worlds[0], test, samples, 1)
    rows, worse, ratios, times = [], [], [], []
    for seed, world in enumerate(worlds):
        began = perf_counter()
        plan = jaxik.plan(model, path, world=world, gap=None)
        ours = perf_counter() - began
        began = perf_counter()
        first = sampled(model.arm, path, world, test, samples, seed)
        drawn = perf_counter() - began
        better = None if first is None else improved(model.arm, path, world, test, first, seed)
        both = perf_counter() - began
        motions = [plan.trajectory.q if plan.ok else None, first and first[0], better and better[0]]
        found = [energy(path, q) if valid(model.arm, path, world, q) else np.inf for q in motions]
        if plan.ok and not np.isfinite(found[0]):
            worse.append(f"world {seed}: the plan collides or breaks limits")
        if min(found[1:]) < found[0] * (1 - 1e-6):
            worse.append(f"world {seed}: sampling {min(found[1:]):.5g}, plan {found[0]:.5g} ({plan.status.name})")
        if np.isfinite(found).all():
            ratios.append([x / found[0] for x in found[1:]])
        times.append((ours, drawn, both))
        rows.append((str(seed), *(f"{x:.5g}" for x in found), *(f"{x:.2f}" for x in times[-1])))
        print(*rows[-1], flush=True)
    header = ("world", "plan", "sampled", "improved", "plan [s]", "sampled [s]", "both stages [s]")
    table(f"Energy among obstacles, {name}, {len(path)} waypoints, {samples} postures each", header, rows)
    energies = np.array([row[1:4] for row in rows], float)
    print(f"motions found of {count}: plan, sampled, improved: {np.isfinite(energies).sum(axis=0)}")
    if ratios:
        print(
            f"energy relative to the plan's, median and largest: {np.median(ratios, axis=0)}, {np.max(ratios, axis=0)}"
        )
    print(f"median times [s]: {np.median(times, axis=0)}")
    print("\n".join(worse) or "sampling is better in no world, and no plan collides")


def energy(path: jaxik.Path, q: np.ndarray) -> float:
    """Energy of joint motion."""
    return float(np.sum(np.diff(q, axis=0) ** 2 / np.diff(path.time)[:, None]))


def valid(arm: jaxik.Arm, path: jaxik.Path, world: jaxik.World, q: np.ndarray | None) -> bool:
    """Test a motion for limits, speeds, targets and collisions at its waypoints."""
    if q is None:
        return False
    tool = jaxik.forward_kinematics(arm, q)
    speed = np.abs(np.diff(q, axis=0)) / np.diff(path.time)[:, None]
    return bool(
        (q >= np.asarray(arm.lower) - 1e-6).all()
        and (q <= np.asarray(arm.upper) + 1e-6).all()
        and (speed <= np.asarray(arm.velocity_limit) * (1 + 1e-6)).all()
        and np.abs(np.asarray(tool.position) - np.asarray(path.target.position)).max() < 1e-6
        and apart(arm, world, q).min() > -1e-6
    )


Motion = tuple[np.ndarray, np.ndarray, np.ndarray]  # joint angles (K, joint), swivels (K,) and branches (K,)
Test = Callable[[np.ndarray, jaxik.World], np.ndarray]


def solved(arm: jaxik.Arm, path: jaxik.Path, world: jaxik.World, test: Test, swivel: np.ndarray) -> tuple:
    """Joint angles ``(K, S, 8, joint)`` at swivels ``(K, S)``, and which are free."""
    bare = MODEL.arm
    target = jax.tree.map(lambda x: np.repeat(np.asarray(x)[:, None], swivel.shape[1], axis=1), path.target)
    found = jaxik.solve_ik(bare, target, swivel)
    q, ok = np.asarray(found.q), np.array(found.ok)
    ok[ok] = test(q[ok], world)
    return q, ok


def sampled(arm: jaxik.Arm, path: jaxik.Path, world: jaxik.World, test: Test, samples: int, seed: int) -> Motion | None:
    """The cheapest sequence of random postures, or None."""
    rng = np.random.default_rng(seed)
    swivel = rng.uniform(-np.pi, np.pi, (len(path), samples // 2))
    q, ok = solved(arm, path, world, test, swivel)
    layers = []
    for k in range(len(path)):
        places = np.argwhere(ok[k])
        places = places[rng.permutation(len(places))[:samples]]
        layers.append((q[k][tuple(places.T)], swivel[k, places[:, 0]], places[:, 1]))
    return cheapest(arm, path, layers)


def improved(
    arm: jaxik.Arm, path: jaxik.Path, world: jaxik.World, test: Test, motion: Motion, seed: int
) -> Motion | None:
    """A sequence improved by samples about it."""
    rng, width, rows = np.random.default_rng(seed), WIDTH, np.arange(len(path))
    for _ in range(ROUNDS):
        swivel = motion[1][:, None] + width * rng.normal(size=(len(path), NEAR)) * (np.arange(NEAR) > 0)
        q, ok = solved(arm, path, world, test, swivel)
        q, ok = q[rows, :, motion[2]], ok[rows, :, motion[2]]
        ok[:, 0] = True  # the last sequence itself, to rounding
        q[:, 0] = motion[0]
        layers = [(q[k][ok[k]], swivel[k][ok[k]], np.full(ok[k].sum(), motion[2][k])) for k in rows]
        motion = cheapest(arm, path, layers) or motion
        width *= NARROWER
    return motion


def cheapest(arm: jaxik.Arm, path: jaxik.Path, layers: list[Motion]) -> Motion | None:
    """The sequence of least energy by dynamic programming; what is too fast is penalized, and judged in the end."""
    limit, steps = np.asarray(arm.velocity_limit), np.diff(path.time)
    value, choices = np.zeros(len(layers[0][0])), []
    for (before, _, _), (after, _, _), dt in zip(layers, layers[1:], steps, strict=False):
        if not len(before) or not len(after):
            return None
        off = after[None] - before[:, None]
        fast = np.maximum(np.abs(off) - limit * dt, 0.0)
        cost = np.sum(off * off + FAST * fast * fast, axis=-1) / dt
        total = value[:, None] + cost
        choices.append(np.argmin(total, axis=0))
        value = total.min(axis=0)
    if not len(value) or not np.isfinite(value.min()):
        return None
    route = [int(np.argmin(value))]
    for choice in reversed(choices):
        route.append(int(choice[route[-1]]))
    picked = [[x[i] for x in layer] for layer, i in zip(layers, route[::-1], strict=True)]
    q, swivel, branch = (np.array(x) for x in zip(*picked, strict=True))
    return q, swivel, branch


if __name__ == "__main__":
    main()
