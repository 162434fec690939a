"""Trained networks as single files: a header line in JSON, then the numbers in equinox's format."""

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
    """Write a network atomically."""
    header = json.dumps({"format": FORMAT, "version": VERSION, "kind": kind, **facts}, allow_nan=False)
    content = io.BytesIO()
    content.write(header.encode() + b"\n")
    eqx.tree_serialise_leaves(content, module)
    write_atomically(path, content.getvalue())


def read_header(path: str | os.PathLike[str], kind: str) -> dict[str, Any]:
    """Read the header of a file.

    Raises:
        FileFormatError: The file has another format or holds another kind of network.
        OSError: The file cannot be read.
    """
    with open(path, "rb") as file:
        line = file.readline(1 << 20)
    try:
        header = json.loads(line)
    except ValueError:
        raise FileFormatError(f"{path}: expected a {FORMAT} file") from None
    if not isinstance(header, dict) or header.get("format") != FORMAT or header.get("version") != VERSION:
        raise FileFormatError(f"{path}: expected a {FORMAT} file of version {VERSION}")
    if header.get("kind") != kind:
        raise FileFormatError(f"{path}: expected a network of kind {kind!r}, got {header.get('kind')!r}")
    return header


def read(path: str | os.PathLike[str], like: Module) -> Module:
    """Read the numbers of a file in the shapes of ``like``.

    Raises:
        FileFormatError: The file is truncated or has other shapes.
    """
    with open(path, "rb") as file:
        file.readline(1 << 20)
        try:
            return eqx.tree_deserialise_leaves(file, like)
        except (ValueError, RuntimeError, EOFError, OSError) as error:
            raise FileFormatError(f"{path}: the numbers do not match the header ({error})") from None
