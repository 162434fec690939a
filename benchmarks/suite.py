"""All comparisons with peers in one run, and the tables in docs/benchmarks.md.

python -m benchmarks.suite [--full] [--peers jaxik ssik ...] [--only ik arcs paths scaling] [--paths FILE ...]

Without ``--full``: what takes ten minutes on two idle cores. Runs that are left out keep their last results.
"""

import argparse
from pathlib import Path

import jax

from benchmarks import compare_arcs, compare_ik, compare_paths, report, scaling
from benchmarks.measure import RESULTS, note, save
from benchmarks.peers import FILES

PARTS = ("ik", "arcs", "paths", "scaling")


def run(full: bool = False, files=FILES, parts=PARTS, paths=(), folder: Path = RESULTS) -> list[Path]:
    """Run parts and return the files of their results."""
    saved = []
    for part in parts:
        note(f"--- {part}")
        if part == "ik":
            found = compare_ik.run(10_000, 100, 7 if full else 3, files)
        elif part == "arcs":
            found = compare_arcs.run(4096, 9 if full else 3, files)
        elif part == "paths":
            which = (*compare_paths.EXAMPLES, *paths) if full else (*compare_paths.QUICK, *paths)
            found = compare_paths.run(which, 3 if full else 1, files, 0 if full else 60)
        else:
            found = scaling.run(10_000_000 if full else 10_000, 10_000 if full else 100, files=files)
        found["settings"]["full"] = full
        saved.append(save(found, folder))
    return saved


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--full", action="store_true", help="all sizes and example paths")
    parser.add_argument("--only", nargs="+", default=list(PARTS), choices=PARTS)
    parser.add_argument("--peers", nargs="+", default=list(FILES), choices=FILES)
    parser.add_argument("--paths", nargs="*", default=[], help="path files beside the example paths")
    options = parser.parse_args()
    for path in run(options.full, tuple(options.peers), tuple(options.only), tuple(options.paths)):
        print(path)
    report.write()


if __name__ == "__main__":
    main()
