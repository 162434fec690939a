"""Certified gaps of plans, and the time of the certificates.

python -m benchmarks.proofs [--arms iiwa14 meccanoid-right] [--paths hello.csv square.csv] [--gap 0.01]
"""

import argparse
from functools import partial

import jax

import jaxik
from benchmarks.common import table

jax.config.update("jax_enable_x64", True)

ARMS = {
    "meccanoid-right": partial(jaxik.presets.meccanoid, "right"),
    "meccanoid-left": partial(jaxik.presets.meccanoid, "left"),
    "iiwa7": jaxik.presets.iiwa7,
    "iiwa14": jaxik.presets.iiwa14,
    "paper": jaxik.presets.paper_arm,
}
EXAMPLES = ("word", "figure-eight", "reach", "wave", "spiral")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", nargs="+", choices=list(ARMS), default=list(ARMS))
    parser.add_argument("--paths", nargs="*", default=[], help="path files, beside the five example paths")
    parser.add_argument("--gap", type=float, default=0.01)
    options = parser.parse_args()
    for name in options.arms:
        arm, rows = ARMS[name]().arm, []
        for which in (*EXAMPLES, *options.paths):
            path = jaxik.example_path(which) if which in EXAMPLES else jaxik.load_path(which)
            path = jaxik.fit_path(arm, path)
            jaxik.plan(arm, path, gap=options.gap)  # compiles
            plan = jaxik.plan(arm, path, gap=options.gap)
            gap = "-" if plan.gap is None else f"{100 * plan.gap:.2f} %"
            seconds = [f"{plan.seconds.get(stage, 0.0):.2f}" for stage in ("search and refinement", "proof")]
            rows.append((which.rsplit("/", 1)[-1], len(path), plan.status.name, f"{plan.energy:.5g}", gap, *seconds))
        header = ("path", "poses", "status", "energy", "gap", "search and refinement [s]", "certificate [s]")
        table(f"Joint motion, {name}", header, rows)


if __name__ == "__main__":
    main()
