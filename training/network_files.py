"""Trained networks as single files: one line of JSON that says what it is, then the numbers (equinox's format)."""

import io
import json
import os
from typing import Any, TypeVar

import equinox as eqx

from jaxik.atomic_file import write_atomically
from jaxik.errors import FileFormatError

FORMAT, VERSION = "jaxik-policy", 1
Module = TypeVar("Module")


def write(path: str | os.PathLike[str], kind: str, facts: dict[str, Any], module: Any) -> None:
    """Writes a network; the file appears under its name only when it is complete."""
    header = json.dumps({"format": FORMAT, "version": VERSION, "kind": kind, **facts}, allow_nan=False)
    content = io.BytesIO()
    content.write(header.encode() + b"\n")
    eqx.tree_serialise_leaves(content, module)
    write_atomically(path, content.getvalue())


def read_header(path: str | os.PathLike[str], kind: str) -> dict[str, Any]:
    """What the file says it is.

    Raises:
        FileFormatError: No such file format, or another kind of network.
        OSError: The file cannot be read.
    """
    with open(path, "rb") as file:
        line = file.readline(1 << 20)
    try:
        header = json.loads(line)
    except ValueError:
        raise FileFormatError(f"{path}: not a {FORMAT} file") from None
    if not isinstance(header, dict) or header.get("format") != FORMAT or header.get("version") != VERSION:
        raise FileFormatError(f"{path}: not a {FORMAT} file of version {VERSION}")
    if header.get("kind") != kind:
        raise FileFormatError(f"{path}: expected a policy of kind {kind!r}; got {header.get('kind')!r}")
    return header


def read(path: str | os.PathLike[str], like: Module) -> Module:
    """The numbers of a file, in the shape of ``like``.

    Raises:
        FileFormatError: The file is cut off or of another shape.
    """
    with open(path, "rb") as file:
        file.readline(1 << 20)
        try:
            return eqx.tree_deserialise_leaves(file, like)
        except (ValueError, RuntimeError, EOFError, OSError) as error:
            raise FileFormatError(f"{path}: the numbers do not fit what the first line says ({error})") from None
