"""Write docs/arms.md: every arm of a file of kinematics, its class, and the share of postures found again.

Run ``python docs/arms_table.py ARMS.json``. The file holds per arm: unit ``axes`` and ``points`` on them at zero in the
base frame [m], the ``tool`` frame, ``limits`` as [lower, upper, velocity] with null for none, and its ``source``.
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

What is missed lies near a fold, where two solutions meet and Newton's steps converge slowly, or far from every seed on
arms with offsets as large as Sawyer's.

| arm | class | found [%] | worst residual | µs per target | source |
|---|---|---|---|---|---|
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


def main(file: str) -> None:
    """Measure every seven-joint arm of a file and write the page."""
    jax.config.update("jax_enable_x64", True)
    content = json.loads(Path(file).read_text(encoding="utf-8"))
    rows = []
    for name, arm_content in content.items():
        if len(arm_content["axes"]) != 7:
            continue
        arm = built(arm_content)
        found, residual, microseconds = measured(arm)
        source = arm_content["source"]
        rows.append(
            f"| {name} | {arm.kinematic_class} | {found:.2f} | {residual:.0e} | {microseconds:.1f} | {source} |"
        )
        print(rows[-1], flush=True)
    text = TEXT.format(count=len(rows), postures=f"{POSTURES:,}".replace(",", " "), rows="\n".join(rows))
    (HERE / "arms.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit("usage: python docs/arms_table.py ARMS.json")
    main(sys.argv[1])
