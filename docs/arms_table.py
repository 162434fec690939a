"""Write docs/arms.md: every arm of a file of kinematics, its class, and the share of postures found again.

Run ``python docs/arms_table.py ARMS.json``. The file holds per arm: unit ``axes`` and ``points`` on them at zero in the
base frame [m], the ``tool`` frame, ``limits`` as [lower, upper, velocity] with null for none, and its ``source``. In
pieces, ``python docs/arms_table.py ARMS.json KEPT.json 60`` measures for a minute, keeps what it has in KEPT.json, and
writes the page once all arms are in it.
"""

import json
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxik

POSTURES = 10_000
FOLLOWED = 1_000  # of arms solved by refinement, whose nearest postures take a thousand times as long
AWAY = 0.05  # rad
HERE = Path(__file__).parent
TEXT = """\
# Arms

Which arms jaxik solves, and how: `python docs/arms_table.py ARMS.json` measures this table, from the kinematics of
{count} robots read from their URDF files. An arm's class is found by `jaxik info`, `jaxik.load_urdf` and
`jaxik.arm_from_axes`; all functions take every class, unless they say otherwise.

| class | what it needs | redundancy parameter | solutions |
|---|---|---|---|
| S-R-S | three axes meet in the shoulder, three in the wrist | swivel | 8, closed form |
| U-R wrist | axes 1 to 3 meet, axes 5 and 6 meet | q7 | 8, closed form |
| R-U shoulder | axes 2 and 3 meet, axes 5 to 7 meet | q1 | 8, closed form |
| near U-R wrist, near R-U shoulder | seven joints, roughly as above | q7 or q1 | up to 16, by refinement |

Refinement solves the chain as the file has it. The nearest arm with a closed form gives eight seeds at the same
parameter; where its branches meet, or it does not reach the target, the seeds are kept apart. Newton's method brings
them onto the chain, and from each solution a second one is sought across the fold next to it. What is found is exact:
residual, status and derivatives are those of the chain, and a slot without a solution says UNSOLVED. What is not
guaranteed is that every solution is found: the table says how many are.

Each posture is drawn within the limits at random, {postures} per arm; "found" is the share that solve_ik at the
posture's own parameter returns within 1e-5 rad, with a feasible status. Residuals are of all feasible solutions,
relative to the arm's length. Times are of one core, for all solutions with their statuses.

"Followed" is the share that `solve_nearest` and `follow` reach from a posture 0.05 rad away, within the
limits, with no more joint motion than back to it: what a control loop asks for. {followed} postures per arm that is
solved by refinement, {postures} of the others.

What is missed lies near a fold, where two solutions meet and Newton's steps converge slowly, or far from every seed on
arms with offsets as large as Sawyer's.

| arm | class | found [%] | followed [%] | worst residual | µs per target | source |
|---|---|---|---|---|---|---|
{rows}

Not solved: chains of five joints and fewer (EAIK has closed forms up to six joints, pink solves any chain numerically),
with prismatic joints (pink), or with closed loops (pinocchio).
"""


def built(content: dict) -> jaxik.Arm:
    """Return an arm of the file."""
    lower, upper, _ = zip(*content["limits"], strict=True)
    tool = np.array(content["tool"])
    return jaxik.arm_from_axes(
        content["axes"],
        content["points"],
        tool[:3, 3],
        tool[:3, :3],
        lower=[-np.inf if x is None else x for x in lower],
        upper=[np.inf if x is None else x for x in upper],
        tolerance=1e-5,
    )


def measured(arm: jaxik.Arm) -> tuple[float, float, float]:
    """Return the share found, the worst residual and the time per target [µs]."""
    low, high = np.maximum(np.asarray(arm.lower), -np.pi), np.minimum(np.asarray(arm.upper), np.pi)
    q = jnp.asarray(np.random.default_rng(0).uniform(low, high, (POSTURES, 7)))
    target, parameter = jaxik.forward_kinematics(arm, q), jaxik.swivel_of(arm, q).swivel
    solution = jaxik.solve_ik(arm, target, parameter)
    apart = np.abs((np.asarray(solution.q) - np.asarray(q)[:, None] + np.pi) % (2 * np.pi) - np.pi).max(-1)
    ok = np.asarray(solution.ok)
    off = np.maximum(np.asarray(solution.residual.position) / float(arm.length), np.asarray(solution.residual.rotation))
    start = time.process_time()
    jax.block_until_ready(jaxik.solve_ik(arm, target, parameter).q)
    spent = time.process_time() - start
    return 100 * float((ok & (apart < 1e-5)).any(-1).mean()), float(off[ok].max()), 1e6 * spent / POSTURES


def followed(arm: jaxik.Arm) -> float:
    """Return the share of targets that are reached from a posture nearby without more motion [%]."""
    low, high = np.maximum(np.asarray(arm.lower), -np.pi), np.minimum(np.asarray(arm.upper), np.pi)
    rng, count = np.random.default_rng(1), POSTURES if arm.closed_form else FOLLOWED
    q, step = rng.uniform(low, high, (count, 7)), rng.normal(size=(count, 7))
    now = np.clip(q + AWAY * step / np.linalg.norm(step, axis=1, keepdims=True), low, high)
    target = jaxik.forward_kinematics(arm, jnp.asarray(q))
    nearest, step = jaxik.solve_nearest(arm, target, now), jaxik.follow(arm, target, now, 1.0)
    least = np.sum((q - now) ** 2, axis=1) * (1 + 1e-6)
    reached = np.asarray(nearest.ok) & (np.asarray(nearest.motion) <= least) & np.asarray(step.ok)
    return 100 * float(reached.mean())


def row(name: str, content: dict) -> str:
    """Return the row of an arm."""
    arm = built(content)
    found, residual, microseconds = measured(arm)
    return (
        f"| {name} | {arm.kinematic_class} | {found:.2f} | {followed(arm):.2f} | {residual:.0e} | {microseconds:.1f} "
        f"| {content['source']} |"
    )


def main(file: str, kept: str | None = None, seconds: str = "inf") -> None:
    """Measure every seven-joint arm of a file and write the page."""
    jax.config.update("jax_enable_x64", True)
    content, begun = json.loads(Path(file).read_text(encoding="utf-8")), time.monotonic()
    rows = json.loads(Path(kept).read_text(encoding="utf-8")) if kept and Path(kept).exists() else {}
    names = [name for name in content if len(content[name]["axes"]) == 7]
    for name in names:
        if name in rows:
            continue
        if time.monotonic() - begun > float(seconds):
            return
        rows[name] = row(name, content[name])
        print(rows[name], flush=True)
        if kept:
            Path(kept).write_text(json.dumps(rows), encoding="utf-8")
    numbers = {"postures": f"{POSTURES:,}".replace(",", " "), "followed": f"{FOLLOWED:,}".replace(",", " ")}
    text = TEXT.format(count=len(names), rows="\n".join(rows[name] for name in names), **numbers)
    (HERE / "arms.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) not in (2, 4):
        raise SystemExit("usage: python docs/arms_table.py ARMS.json [KEPT.json SECONDS]")
    main(*sys.argv[1:])
