"""Peers: solvers that the benchmarks compare, one file for each library.

A file defines ``IK``, ``ARCS`` or ``PATHS``, tuples of subclasses of :class:`~benchmarks.peers.peer.Peer`. To add a
library, add a file and its name here; nothing else changes. A library that is not installed, or fails, is reported.
"""

import importlib
from collections.abc import Iterator

from benchmarks.peers.peer import Peer, PeerError

FILES = ("jaxik", "ssik", "eaik", "jaik", "frankik", "roboticstoolbox", "pinocchio", "pink", "mink", "pyroki", "casadi")


def peers(kind: str, files: tuple[str, ...] = FILES) -> Iterator[type[Peer] | PeerError]:
    """Yield the classes in ``kind`` ("IK", "ARCS" or "PATHS") of every file, or why a file cannot be used."""
    for name in files:
        try:
            module = importlib.import_module(f"benchmarks.peers.{name}")
        except Exception as error:  # an import may fail in any way
            yield PeerError(name, "import", f"{type(error).__name__}: {error}")
            continue
        yield from getattr(module, kind, ())
