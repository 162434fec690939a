"""Plans among random obstacles against brute force, and against MuJoCo's contacts.

python -m benchmarks.obstacles [--worlds 100] [--motions 10] [--path hello.csv]

1. Whether a path has a motion in a random world, by `plan` and by brute force: all branches at every degree of swivel,
   with kinematics and distances in numpy, and steps within the joints' speed limits. Where they differ, plans are
   checked by that kinematics, and motions of brute force are given to `plan` as a guess.
2. A path among 30 spheres: contacts that MuJoCo finds at the waypoints, and at 20 points between any two.
"""

import argparse
from collections.abc import Iterator
from time import process_time

import jax
import mujoco
import numpy as np
from scipy.spatial import cKDTree

import jaxik
from benchmarks.common import table
from tests.helpers.bodies import carried, distance, random_body, random_world

jax.config.update("jax_enable_x64", True)

MODEL = jaxik.presets.iiwa14()
SWIVELS = 360
SPHERES = 30
BETWEEN = 20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=100)
    parser.add_argument("--motions", type=int, default=10, help="worlds in which the path is planned")
    parser.add_argument("--path", help="path file; default is the example path `word`")
    options = parser.parse_args()
    if options.worlds:
        compare_with_brute_force(options.worlds)
    if options.motions:
        compare_with_mujoco(options.motions, options.path)


def compare_with_brute_force(worlds: int) -> None:
    """Print how often plan and brute force agree that there is a motion."""
    path = jaxik.fit_path(MODEL, jaxik.example_path("wave"))[::10]
    model = jaxik.with_body(MODEL, random_body(MODEL.arm, 1))
    postures = jaxik.solve_ik(MODEL, spread(path.target, SWIVELS), np.linspace(-np.pi, np.pi, SWIVELS, endpoint=False))
    q, within = np.asarray(postures.q), np.asarray(postures.ok)
    counts = dict.fromkeys(("both", "neither", "plan alone", "brute force alone"), 0)
    unnamed, wrong = 0, []
    for seed in range(worlds):
        world = random_world(MODEL.arm, seed, 4 + seed % 5)
        plan = jaxik.plan(model, path, world=world, gap=None)
        route = shortest(model.arm, world, q, within, np.diff(path.time))
        kind = ("neither", "brute force alone", "plan alone", "both")[2 * plan.ok + (route is not None)]
        counts[kind] += 1
        if plan.ok and apart(model.arm, world, plan.trajectory.q).min() < -1e-9:
            wrong.append(f"world {seed}: the plan meets something")
        if not plan.ok:
            unnamed += not any("sphere" in text or "half-space" in text for text in plan.problems)
        if kind == "brute force alone":
            wrong.append(f"world {seed}: {plan.status.name}, {plan.problems}")
            guess = np.linspace(-np.pi, np.pi, SWIVELS, endpoint=False)[route[0]], route[1]
            again = jaxik.plan(model, path, world=world, gap=None, guess=guess)
            wrong.append(f"world {seed} from the motion of brute force: {again.status.name}")
        print(f"world {seed}: {kind}, {plan.status.name}", flush=True)
    rows = [(kind, str(count)) for kind, count in counts.items()]
    table(f"A motion is found by, in {worlds} worlds", ("by", "worlds"), rows)
    print(f"failures that name no pair: {unnamed}")
    print("\n".join(wrong) or "no plan meets anything, and none is missing")


def spread(target: jaxik.Pose, count: int) -> jaxik.Pose:
    """Targets ``(K, count)``."""
    return jax.tree.map(lambda x: np.repeat(np.asarray(x)[:, None], count, axis=1), target)


def apart(arm: jaxik.Arm, world: jaxik.World, q: np.ndarray) -> np.ndarray:
    """Distances of the body at postures ``(..., joint)`` in numpy [m]."""
    body = arm.surroundings.body
    return distance(body, world, carried(arm, body, np.asarray(q)))


def shortest(
    arm: jaxik.Arm, world: jaxik.World, q: np.ndarray, within: np.ndarray, dt: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return swivel indices and branches ``(K,)`` of a motion over postures ``(K, swivel, branch, joint)``, or None."""
    limit, free, layers = np.asarray(arm.velocity_limit), within.copy(), []
    free[within] = apart(arm, world, q[within]) >= 0
    for k in range(len(q)):
        places = np.argwhere(free[k])
        postures = q[k][free[k]]
        before = np.full(len(places), -1)
        if k and len(places):
            tree = cKDTree(layers[-1][1] / (limit * dt[k - 1]))
            far, before = tree.query(postures / (limit * dt[k - 1]), p=np.inf, distance_upper_bound=1.0)
            reached = np.isfinite(far)
            places, postures, before = places[reached], postures[reached], before[reached]
        if not len(places):
            return None
        layers.append((places, postures, before))
    at, route = 0, []
    for places, _, before in reversed(layers):
        route.append(places[at])
        at = before[at]
    swivel, branch = np.array(route[::-1]).T
    return swivel, branch


def compare_with_mujoco(motions: int, file: str | None) -> None:
    """Print MuJoCo's contacts along plans of a path among spheres."""
    model = jaxik.with_body(MODEL, jaxik.Body.preset("iiwa14"))
    path = jaxik.fit_path(MODEL, jaxik.load_path(file) if file else jaxik.example_path("word"))
    free = jaxik.plan(MODEL, path, gap=None).raise_if_invalid()
    rows = []
    for seed, world in enumerate(worlds_about(model, path, free.trajectory.q, motions)):
        simulated = simulation(model.arm, world)
        began = process_time()
        plan = jaxik.plan(model, path, world=world, gap=None)
        taken = process_time() - began
        roomy = jaxik.plan(model, path, world=world, gap=None, clearance=0.01)
        rows.append(
            (
                str(seed),
                f"{1e3 * apart(model.arm, world, free.trajectory.q).min():.1f}",
                plan.status.name,
                f"{1e3 * taken:.0f}",
                contacts(simulated, plan.trajectory.q) if plan.ok else "-",
                roomy.status.name,
                contacts(simulated, between(roomy.trajectory.q)) if roomy.ok else "-",
            )
        )
        print(" ".join(rows[-1]), flush=True)
    header = ("world", "overlap without [mm]", "plan", "cpu [ms]", "contacts", "with 10 mm", "contacts between")
    table(f"{file or 'word'} among {SPHERES} spheres", header, rows)


def worlds_about(model: jaxik.ArmModel, path: jaxik.Path, q: np.ndarray, count: int) -> Iterator[jaxik.World]:
    """Worlds of spheres near the upper arm and elbow of a motion, away from the hand's way and the base."""
    rng, hand = np.random.default_rng(0), np.asarray(path.target.position)
    joints = np.asarray(jaxik.joint_positions(model, q))
    wrist, elbow, base = joints[:, 2], joints[:, 1], np.asarray(model.arm.shoulder)
    for _ in range(count):
        centers = []
        while len(centers) < SPHERES:
            at = elbow[rng.integers(len(q))] + rng.normal(0.0, 0.35, 3)
            clear = min(np.linalg.norm(x - at, axis=-1).min() for x in (hand, wrist))
            if clear > 0.2 and np.linalg.norm(at - base) > 0.3 and abs(at[2]) < 2 and np.hypot(*at[:2]) > 0.25:
                centers.append(at)
        yield jaxik.World(np.array(centers), rng.uniform(0.02, 0.05, SPHERES))


def simulation(arm: jaxik.Arm, world: jaxik.World) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return the body as spheres on hinges in MuJoCo, with contacts of what must not meet alone."""
    body, text = arm.surroundings.body, lambda x: " ".join(f"{v:.17g}" for v in np.asarray(x))
    stations, axes, on = np.asarray(arm.stations), np.asarray(arm.axes), arm.station_of_joint

    def spheres(link: int) -> str:
        return "".join(
            f'<geom name="b{i}" type="sphere" size="{float(body.radii[i]):.17g}" pos="{text(body.centers[i])}" '
            f'contype="{int(link > 0)}" conaffinity="0"/>'
            for i in range(len(body.link))
            if body.link[i] == link
        )

    chain = ""
    for joint in reversed(range(arm.n_joints)):
        hinge = f'<joint type="hinge" pos="{text(stations[on[joint]])}" axis="{text(axes[joint])}"/>'
        inertia = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        chain = f"<body>{inertia}{hinge}{spheres(joint + 1)}{chain}</body>"
    obstacles = "".join(
        f'<geom type="sphere" size="{r:.17g}" pos="{text(c)}" contype="0" conaffinity="1"/>'
        for c, r in zip(np.asarray(world.centers), np.asarray(world.radii), strict=True)
    )
    pairs = "".join(f'<pair geom1="b{i}" geom2="b{j}"/>' for i, j in body.pairs)
    xml = (
        f'<mujoco><compiler angle="radian"/><worldbody>{spheres(0)}{obstacles}{chain}</worldbody>'
        f"<contact>{pairs}</contact></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(xml)
    return model, mujoco.MjData(model)


def contacts(simulated: tuple[mujoco.MjModel, mujoco.MjData], q: np.ndarray) -> str:
    """Number of postures with a contact deeper than rounding."""
    model, data = simulated
    touching = 0
    for posture in np.asarray(q):
        data.qpos[:] = posture
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        touching += any(contact.dist < -1e-9 for contact in data.contact)
    return f"{touching} of {len(q)}"


def between(q: np.ndarray) -> np.ndarray:
    """Postures of a motion and between its waypoints."""
    share = np.linspace(0.0, 1.0, BETWEEN + 2)[:, None, None]
    return (q[:-1] + share * np.diff(q, axis=0)).reshape(-1, q.shape[-1])


if __name__ == "__main__":
    main()
