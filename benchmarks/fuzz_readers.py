"""Damaged files for every reader: is each read, or refused in one sentence?

Prints how many files each reader took and refused per second, and every other outcome with its seed. Memory is limited,
so that an allocation of the wrong size fails. Run: ``python -m benchmarks.fuzz_readers --files 1000000``.
"""

import argparse
import os
import random
import resource
import sys
import tempfile
import time
from pathlib import Path

from tests.helpers.reader_fuzz import damaged, judge, readers

_MEMORY = 16 << 30  # bytes of address space; JAX and its threads reserve some 10 GB of it


def main() -> None:
    """Damage files and print what the readers make of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=20_000, help="damaged files, over all readers")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reader", help="only this one")
    options = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
    problems = 0
    memory = "/dev/shm" if os.path.isdir("/dev/shm") else None  # files are not worth a disk
    with tempfile.TemporaryDirectory(dir=memory) as folder:
        os.chdir(folder)  # MuJoCo writes its warnings to a file
        known = {k: r for k, r in readers(Path(folder)).items() if options.reader in (None, k)}
        print(f"{'reader':<12} {'files':>8} {'per second':>10} {'problems':>8}")
        for name, reader in known.items():
            count, found, began = options.files // len(known), 0, time.perf_counter()
            for i in range(count):
                content = damaged(reader, random.Random(f"{name} {options.seed} {i}"))
                problem = judge(reader, content, Path(folder, f"fuzz{reader.ending}"))
                if problem:
                    found += 1
                    print(f"{name} {options.seed} {i}: {problem}", flush=True)
            problems += found
            print(f"{name:<12} {count:>8} {count / (time.perf_counter() - began):>10.0f} {found:>8}", flush=True)
    sys.exit(problems > 0)


if __name__ == "__main__":
    main()
