"""The three forms of trajectory files: npz for programs, csv for spreadsheets, json for everything else.

All three hold a format version, the arm's name, the notes, and numbers that read back to the last bit.
"""

import csv
import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from jaxik.atomic_file import write_atomically
from jaxik.errors import FileFormatError

FORMAT = "jaxik-trajectory"
VERSION = 1
Fields = dict[str, Any]


def write(name: str, fields: Fields) -> None:
    """Write a trajectory's fields in the form that the file's ending names."""
    writer = _form(name)[0]
    write_atomically(name, writer(fields))


def read(name: str) -> Fields:
    """Read a trajectory's fields."""
    reader = _form(name)[1]
    data = Path(name).read_bytes()
    try:
        return reader(data)
    except FileFormatError as error:
        raise FileFormatError(f"{name}: {error}") from error
    except (ValueError, KeyError, TypeError, IndexError, EOFError, zipfile.BadZipFile) as error:
        raise FileFormatError(f"{name}: expected a {FORMAT} file; {_sentence(error)}") from error


def _sentence(error: Exception) -> str:
    """Return the reason in words: a KeyError's text is only the key."""
    return f"{error} is missing" if isinstance(error, KeyError) else str(error)


def _check_version(form: object, version: object) -> None:
    """Raise for other formats and for later versions."""
    if form != FORMAT:
        raise FileFormatError(f"expected the format {FORMAT!r}; got {form!r}")
    if version != VERSION:
        raise FileFormatError(f"expected format version {VERSION}; got {version!r}: update jaxik to read this file")


def _write_npz(fields: Fields) -> bytes:
    arrays = {k: v for k, v in fields.items() if isinstance(v, np.ndarray)}
    texts = {k: np.array(fields[k], dtype=np.str_) for k in ("joint_names", "notes", "arm_name")}
    stream = io.BytesIO()
    np.savez_compressed(stream, format=np.array(FORMAT), version=np.array(VERSION), **arrays, **texts)  # pyright: ignore[reportArgumentType]
    return stream.getvalue()


def _read_npz(data: bytes) -> Fields:
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        content = {name: archive[name] for name in archive.files}
    _check_version(str(content["format"]), int(content["version"]))
    return {
        "time": content["time"],
        "q": content["q"],
        "joint_names": tuple(content["joint_names"].tolist()),
        "arm_name": str(content["arm_name"]),
        "swivel": content.get("swivel"),
        "branch": content.get("branch"),
        "notes": tuple(content["notes"].tolist()),
    }


def _write_json(fields: Fields) -> bytes:
    plain = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in fields.items()}
    return json.dumps({"format": FORMAT, "version": VERSION, **plain}, allow_nan=False).encode()


def _read_json(data: bytes) -> Fields:
    content = json.loads(data)
    if not isinstance(content, dict):
        raise FileFormatError("expected a JSON object")
    _check_version(content.pop("format", None), content.pop("version", None))
    arrays = {k: content[k] for k in ("time", "q", "swivel", "branch")}
    return {
        **{k: v if v is None else np.array(v, np.float64) for k, v in arrays.items()},
        "joint_names": tuple(content["joint_names"]),
        "arm_name": content["arm_name"],
        "notes": tuple(content["notes"]),
    }


def _write_csv(fields: Fields) -> bytes:
    meta = {"version": VERSION, "arm_name": fields["arm_name"], "notes": list(fields["notes"])}
    columns = {"time": fields["time"]}
    columns |= {f"q:{name}": fields["q"][:, i] for i, name in enumerate(fields["joint_names"])}
    columns |= {k: fields[k] for k in ("swivel", "branch") if fields[k] is not None}
    stream = io.StringIO()
    stream.write(f"# {FORMAT} {json.dumps(meta)}\n")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*([repr(x) for x in c.tolist()] for c in columns.values()), strict=True))
    return stream.getvalue().encode()


def _read_csv(data: bytes) -> Fields:
    lines = data.decode("utf-8").splitlines()
    mark = f"# {FORMAT} "
    if len(lines) < 2 or not lines[0].startswith(mark):
        raise FileFormatError(f"expected the first line to begin with {mark!r}")
    meta = json.loads(lines[0][len(mark) :])
    _check_version(FORMAT, meta.get("version"))
    rows = list(csv.reader(lines[1:]))
    header, body = rows[0], rows[1:]
    known = [c for c in header if c in ("time", "swivel", "branch") or c.startswith("q:")]
    if known != header or header[:1] != ["time"]:
        raise FileFormatError(f"line 2: expected the columns time, q:<joint>..., swivel, branch; got {header}")
    for number, row in enumerate(body, 3):
        if len(row) != len(header):
            raise FileFormatError(f"line {number}: expected {len(header)} numbers; got {len(row)}")
    table = {}
    for i, column in enumerate(header):
        try:
            table[column] = np.array([float(row[i]) for row in body])
        except ValueError as error:
            raise FileFormatError(f"column {column}: {error}") from error
    joints = [c for c in header if c.startswith("q:")]
    return {
        "time": table["time"],
        "q": np.stack([table[c] for c in joints], -1),
        "joint_names": tuple(c[2:] for c in joints),
        "arm_name": meta["arm_name"],
        "swivel": table.get("swivel"),
        "branch": table.get("branch"),
        "notes": tuple(meta["notes"]),
    }


_FORMS: dict[str, tuple[Callable[[Fields], bytes], Callable[[bytes], Fields]]] = {
    ".npz": (_write_npz, _read_npz),
    ".csv": (_write_csv, _read_csv),
    ".json": (_write_json, _read_json),
}


def _form(name: str) -> tuple[Callable[[Fields], bytes], Callable[[bytes], Fields]]:
    """Return writer and reader for a file name."""
    ending = Path(name).suffix.lower()
    if ending not in _FORMS:
        raise FileFormatError(f"{name}: expected a file name ending in {', '.join(_FORMS)}; got {ending!r}")
    return _FORMS[ending]
