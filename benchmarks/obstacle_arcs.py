"""Free arcs among random obstacles against sweeps, and what they cost.

python -m benchmarks.obstacle_arcs [--arms iiwa14 3 …] [--targets 1000] [--first 0] [--samples 40001] [--cost]

1. Every target's swivel is sampled; a sample is free where `solve_ik` without a body keeps the limits and the spheres,
   carried by kinematics written here, are apart. Counted are samples that the arcs contradict farther than 1e-9 rad
   from their ends. Bodies have 7 to 30 spheres, worlds 20 spheres and a table. Arms are presets by name and random ones
   by number; every other of these has joint limits.
2. ``--cost``: time and memory of arcs with 30 spheres on the robot among 100.
"""

import argparse
import resource
from collections.abc import Callable
from time import perf_counter, process_time

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxik
from benchmarks.common import table
from tests.helpers.arms import ALL_PRESETS, random_arm
from tests.helpers.bodies import random_world
from tests.helpers.reachable import target_of

jax.config.update("jax_enable_x64", True)

BORDER = 1e-9  # rad
PIECE, BLOCK = 1 << 14, 1 << 9  # postures carried by one call, and by one pass of its loop, whose arrays stay small
ROWS = 100  # targets solved at once
TURN = 2 * np.pi


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    every = [*ALL_PRESETS, *map(str, range(20))]
    parser.add_argument("--arms", nargs="*", default=every, help="names of presets, seeds of random arms")
    parser.add_argument("--targets", type=int, default=1000, help="targets per arm")
    parser.add_argument("--first", type=int, default=0, help="number of the first target, to go on with")
    parser.add_argument("--samples", type=int, default=40_001)
    parser.add_argument("--cost", action="store_true", help="time and memory in the place of sweeps")
    options = parser.parse_args()
    if options.cost:
        measure_cost()
        return
    rows = []
    for name in options.arms:
        began = perf_counter()
        rows.append((name, *sweep(name, options.first, options.targets, options.samples)))
        print(*rows[-1], f"{perf_counter() - began:.0f} s", flush=True)
    header = ("arm", "spheres", "targets", "samples", "free", "differ", "farthest from an end [rad]", "arcs")
    table(f"Arcs among obstacles against {options.samples} samples", header, rows)


def body_of(arm: jaxik.Arm, seed: int, count: int) -> jaxik.Body:
    """Spheres on base, upper arm, forearm and hand, on and off the links' axes."""
    rng, length, last = np.random.default_rng(seed), float(arm.length), arm.n_joints
    shoulder, elbow, wrist, tool = (np.asarray(x) for x in (arm.shoulder, arm.elbow, arm.wrist, arm.tool_position))
    ends = {
        0: (shoulder - 0.4 * length * np.asarray(arm.axes[0]), shoulder),
        3: (shoulder, elbow),
        4: (elbow, wrist),
        last: (wrist, tool),
    }
    link = np.array([0, 3, 4, 3, 4, 3, 4, last, 3, 4] * 3)[:count]
    link[min(7, count - 1)] = last
    along = rng.uniform(0.2, 0.8, count)[:, None]
    first, second = (np.array([ends[int(i)][k] for i in link]) for k in (0, 1))
    aside = rng.normal(0.0, 0.04 * length, (count, 3))
    aside[link == last] *= last == 7  # a hand whose roll is free has its spheres on its axis
    return jaxik.Body(link, first + along * (second - first) + aside, rng.uniform(0.02, 0.05, count) * length)


def sweep(name: str, first: int, count: int, samples: int) -> tuple[str, ...]:
    """Compare one arm; columns of the table."""
    seed = int(name) if name.isdigit() else 100 + list(ALL_PRESETS).index(name)
    bare = random_arm(seed, 7 - (seed % 5 == 4), limits=seed % 2 == 1) if name.isdigit() else ALL_PRESETS[name]().arm
    arm = jaxik.with_body(bare, body_of(bare, seed, 7 + seed % 24))
    swivel, free_of = np.linspace(-np.pi, np.pi, samples), free_postures(arm)
    differ, farthest, free, total, arcs_found = 0, 0.0, 0, 0, 0
    for begin in range(first, first + count, ROWS):
        world = random_world(bare, 1000 * seed + begin)
        rng = np.random.default_rng((seed, begin))
        low, high = np.maximum(bare.lower, -np.pi), np.minimum(bare.upper, np.pi)
        target = target_of(bare, rng.uniform(low, high, (ROWS, bare.n_joints)))
        arcs = jax.tree.map(np.asarray, jaxik.swivel_arcs(arm, target, world=world))
        for row in range(min(ROWS, first + count - begin)):
            one = jax.tree.map(lambda x, row=row: jnp.broadcast_to(x[row], (samples, *x[row].shape)), target)
            found = jaxik.solve_ik(bare, one, swivel)
            ok = np.array(found.ok)
            ok[ok] = free_of(np.asarray(found.q)[ok], world)
            start, end, valid = arcs.start[row], arcs.end[row], arcs.valid[row]
            offset = swivel[:, None, None] - start
            held = (valid & (offset - TURN * np.floor(offset / TURN) <= end - start)).any(axis=-1)
            for sample, branch in np.argwhere(held != ok):
                ends = np.concatenate([x[branch][valid[branch]] for x in (start, end)])
                off = np.abs(np.mod(ends - swivel[sample] + np.pi, TURN) - np.pi).min(initial=np.pi)
                differ, farthest = differ + bool(off > BORDER), max(farthest, float(off))
            free, total, arcs_found = free + int(ok.sum()), total + ok.size, arcs_found + int(valid.sum())
    spheres = str(len(arm.surroundings.body.link))
    return spheres, str(count), str(total), f"{free / total:.3f}", str(differ), f"{farthest:.1e}", str(arcs_found)


def free_postures(arm: jaxik.Arm) -> Callable[[np.ndarray, jaxik.World], np.ndarray]:
    """A test of postures ``(n, joint)`` by products of turns and all distances, compiled for pieces of one size."""
    body = arm.surroundings.body
    link, joints = np.array(body.link), arm.n_joints
    axes = np.asarray(arm.axes)
    points = [np.asarray(x) for x in [arm.shoulder] * 3 + [arm.elbow] + [arm.wrist] * 3]
    radii, pairs = np.asarray(body.radii), np.array(body.pairs).reshape(-1, 2)

    def turned(v: list[Array], joint: int, sin: Array, cos: Array) -> list[Array]:
        """A point turned about a joint's axis (Rodrigues), its coordinates apart so that loops fuse."""
        a, p = axes[joint], points[joint]
        x, y, z = (c - o for c, o in zip(v, p, strict=True))
        along = (1 - cos) * (a[0] * x + a[1] * y + a[2] * z)
        across = a[1] * z - a[2] * y, a[2] * x - a[0] * z, a[0] * y - a[1] * x
        return [o + cos * c + sin * s + along * k for o, c, s, k in zip(p, (x, y, z), across, a, strict=True)]

    def apart(q: Array, world: jaxik.World) -> Array:
        sin, cos, places = jnp.sin(q), jnp.cos(q), []
        for center, moved in zip(np.asarray(body.centers), link, strict=True):
            place = [jnp.full(q.shape[1:], c) for c in center]
            for joint in reversed(range(moved)):
                place = turned(place, joint, sin[joint], cos[joint])
            places.append(place)
        free = jnp.ones(q.shape[1:], bool)
        for (x, y, z), radius, moved in zip(places, radii, link, strict=True):
            if moved:
                u, v, w = (c - o[:, None] for c, o in zip((x, y, z), world.centers.T, strict=True))
                free &= jnp.min(u * u + v * v + w * w - ((world.radii + radius) ** 2)[:, None], axis=0) >= 0
                for n, d in zip(world.normals, world.offsets, strict=True):
                    free &= d - (n[0] * x + n[1] * y + n[2] * z) >= radius
        for i, j in pairs:
            off = [a - b for a, b in zip(places[i], places[j], strict=True)]
            free &= sum(c * c for c in off) >= (radii[i] + radii[j]) ** 2
        return free

    @jax.jit
    def in_blocks(q: Array, world: jaxik.World) -> Array:
        return jax.lax.map(lambda some: apart(some, world), q)

    def test(q: np.ndarray, world: jaxik.World) -> np.ndarray:
        padded = np.concatenate([q, np.zeros((-len(q) % PIECE, joints))])
        blocks = padded.reshape(-1, PIECE // BLOCK, BLOCK, joints).swapaxes(2, 3)
        return np.concatenate([*(np.asarray(in_blocks(x, world)).ravel() for x in blocks), np.zeros(0, bool)])[: len(q)]

    return test


def measure_cost(rows: tuple[int, ...] = (1000, 10_000), repeats: int = 7) -> None:
    """Print time per target of arcs with 30 spheres on the robot, without and with worlds, and the peak of memory."""
    bare = ALL_PRESETS["iiwa14"]().arm
    lines = []
    for dtype in (np.float32, np.float64):
        arm = jaxik.with_body(bare, body_of(bare, 3, 30)).astype(dtype)
        for spheres, count in [*((s, rows[0]) for s in (0, 20, 100)), (100, rows[1]), (2000, rows[0])]:
            rng = np.random.default_rng(0)
            q = rng.uniform(np.asarray(bare.lower), np.asarray(bare.upper), (count, 7))
            target = jax.tree.map(lambda x, dtype=dtype: jnp.asarray(x, dtype), target_of(bare, q))
            world = random_world(bare, 7, spheres) if spheres else jaxik.World()
            world = jax.tree.map(lambda x, dtype=dtype: jnp.asarray(x, dtype), world)
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            walls, busy = [], []
            for _ in range(repeats + 1):
                wall, cpu = perf_counter(), process_time()
                jax.block_until_ready(jaxik.swivel_arcs(arm, target, world=world))
                walls.append(perf_counter() - wall)
                busy.append(process_time() - cpu)
            per = 1e6 / count
            more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
            figures = [f"{per * min(x[1:]):.1f}" for x in (walls, busy)] + [f"{per * np.median(walls[1:]):.1f}"]
            lines.append((np.dtype(dtype).name, str(spheres), str(count), *figures, f"{more:.0f}"))
            print(*lines[-1], flush=True)
    header = (
        "dtype",
        "obstacles",
        "targets",
        "best wall [us]",
        "best cpu [us]",
        "median wall [us]",
        "memory grew [MB]",
    )
    table("Arcs of one target, all branches, 30 spheres on the robot and a table", header, lines)


if __name__ == "__main__":
    main()
