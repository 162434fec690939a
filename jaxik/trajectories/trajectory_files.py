"""The forms of trajectory files: npz for programs, csv for spreadsheets, json for everything else, and ROS 2's own.

The first three hold a format version, the arm's name, the notes, and numbers that read back to the last bit. Messages
of ROS 2 hold names, angles and times in whole nanoseconds from the first waypoint on.
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
from jaxik.errors import FileFormatError, MissingExtraError
from jaxik.ros_text import as_yaml, parse_json, parse_yaml
from jaxik.tables import decoded, number, separator, table_rows, trimmed
from jaxik.trajectories.ros_bag import bag_file, read_bag, write_bag
from jaxik.trajectories.ros_trajectory import fields_of, message_of

FORMAT = "jaxik-trajectory"
VERSION = 1
Fields = dict[str, Any]

_LARGEST = 1 << 30  # bytes of an unpacked npz file: a day at 1 kHz; a small archive may claim to hold any number


def write(name: str, fields: Fields) -> None:
    """Write a trajectory's fields in the form that the file's ending names."""
    writer = _form(name)[0]
    write_atomically(name, writer(fields))


def read(name: str) -> Fields:
    """Read a trajectory's fields."""
    file = bag_file(name)
    reader = _form(file)[1]
    data = Path(file).read_bytes()
    try:
        return reader(data)
    except MissingExtraError:
        raise
    except FileFormatError as error:
        raise FileFormatError(f"{name}: {error}") from error
    except Exception as error:  # of zip, zlib and json on bytes that were damaged in any way
        raise FileFormatError(f"{name}: expected a {FORMAT} file; {_sentence(error)}") from error


def _sentence(error: Exception) -> str:
    """Return the reason in words: a KeyError's text is only the key."""
    return f"{error} is missing" if isinstance(error, KeyError) else " ".join(str(error).split())[:200]


def _check_version(form: object, version: object) -> None:
    """Raise for other formats and for later versions."""
    if form != FORMAT:
        raise FileFormatError(f"expected the format {FORMAT!r}; got {form!r:.80}")
    if version != VERSION:
        raise FileFormatError(f"expected format version {VERSION}; got {version!r:.80}: update jaxik to read this file")


def _text(name: str, value: object) -> str:
    if not isinstance(value, str):
        raise FileFormatError(f"expected {name} to be a text; got {value!r:.80}")
    return value


def _texts(name: str, value: object) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise FileFormatError(f"expected {name} to be a list of texts; got {value!r:.80}")
    return tuple(_text(f"{name}[{i}]", x) for i, x in enumerate(value))


def _write_npz(fields: Fields) -> bytes:
    arrays = {k: v for k, v in fields.items() if isinstance(v, np.ndarray)}
    texts = {k: np.array(fields[k], dtype=np.str_) for k in ("joint_names", "notes", "arm_name")}
    stream = io.BytesIO()
    np.savez_compressed(stream, format=np.array(FORMAT), version=np.array(VERSION), **arrays, **texts)  # pyright: ignore[reportArgumentType]
    return stream.getvalue()


def _read_npz(data: bytes) -> Fields:
    if not zipfile.is_zipfile(io.BytesIO(data)):
        raise FileFormatError("expected an npz archive, which `jaxik plan` and save_trajectory write; it is none")
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        names = [name for name in archive.namelist() if name.endswith(".npy")]
        total = sum(archive.getinfo(name).file_size for name in names)
        if total > _LARGEST:
            raise FileFormatError(f"expected less than {_LARGEST} bytes; the archive claims to hold {total}")
        content = {name.removesuffix(".npy"): _read_array(archive, name) for name in names}
    _check_version(str(content["format"]), int(content["version"]))
    numbers = {k: content.get(k) for k in ("time", "q", "swivel", "branch")}
    for name, array in numbers.items():
        if (array is None and name in ("time", "q")) or (array is not None and array.dtype.kind not in "fiu"):
            raise FileFormatError(f"expected {name} to be an array of numbers; got {getattr(array, 'dtype', None)}")
    return {
        **numbers,
        "joint_names": _texts("joint_names", content["joint_names"].tolist()),
        "arm_name": _text("arm_name", content["arm_name"].tolist()),
        "notes": _texts("notes", content["notes"].tolist()),
    }


def _read_array(archive: zipfile.ZipFile, name: str) -> np.ndarray:
    """Return an array of an npz archive whose header agrees with the bytes that follow it."""
    data = archive.read(name)
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read_header(stream)
    if dtype.hasobject:
        raise FileFormatError(f"expected numbers or texts in {name.removesuffix('.npy')}; got Python objects")
    count = 1
    for length in shape:
        count *= length
    if count * dtype.itemsize != len(data) - stream.tell():
        raise FileFormatError(f"{name.removesuffix('.npy')} of shape {shape} is cut short or damaged")
    return np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)


def _write_json(fields: Fields) -> bytes:
    plain = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in fields.items()}
    return json.dumps({"format": FORMAT, "version": VERSION, **plain}, allow_nan=False).encode()


def _read_json(data: bytes) -> Fields:
    content = json.loads(data)
    if not isinstance(content, dict):
        raise FileFormatError("expected a JSON object")
    if "format" not in content and _ROS_FIELDS & content.keys():
        return fields_of(content)
    _check_version(content.pop("format", None), content.pop("version", None))
    arrays = {k: content[k] for k in ("time", "q", "swivel", "branch")}
    for name in ("time", "q"):
        if not isinstance(arrays[name], list):
            raise FileFormatError(f"expected {name} to be a list of numbers; got {arrays[name]!r:.80}")
    return {
        **{k: None if v is None else np.array(v, np.float64) for k, v in arrays.items()},
        "joint_names": _texts("joint_names", content["joint_names"]),
        "arm_name": _text("arm_name", content["arm_name"]),
        "notes": _texts("notes", content["notes"]),
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
    """Read the table, also after a spreadsheet has saved it again in its own way."""
    first, _, table = decoded(data).replace("\r\n", "\n").partition("\n")
    divider = separator(table.partition("\n")[0])
    meta = _meta(first, divider)
    rows = list(table_rows(table, divider, first_line=2, comments=False))
    if not rows:
        raise FileFormatError("line 2: expected the columns time, q:<joint>..., swivel, branch; the file ends")
    header = trimmed(rows[0].cells)
    joints = [c for c in header if c.startswith("q:")]
    known = ["time", *joints, *(c for c in ("swivel", "branch") if c in header)]
    if not joints or known != header:
        raise FileFormatError(f"line 2: expected the columns time, q:<joint>..., swivel, branch; got {header!r:.200}")
    for row in rows[1:]:
        if len(row.cells) < len(header) or trimmed(row.cells[len(header) :]):
            raise FileFormatError(f"line {row.number}: expected {len(header)} numbers; got {len(row.cells)}")
    columns = {}
    for i, column in enumerate(header):
        try:
            columns[column] = np.array([number(row.cells[i], divider) for row in rows[1:]])
        except ValueError as error:
            raise FileFormatError(f"column {column[:40]!r}: {error}") from error
    if len(columns) < len(header):
        raise FileFormatError(f"line 2: a column is given twice in {header!r:.200}")
    return {
        "time": columns["time"],
        "q": np.stack([columns[c] for c in joints], -1),
        "joint_names": tuple(c[2:] for c in joints),
        "arm_name": _text("arm_name", meta["arm_name"]),
        "swivel": columns.get("swivel"),
        "branch": columns.get("branch"),
        "notes": _texts("notes", meta["notes"]),
    }


def _meta(line: str, divider: str) -> dict[str, Any]:
    """Return version, name and notes from the first line; a spreadsheet cuts it into cells and quotes them."""
    mark = f"# {FORMAT} "
    as_written = line.rstrip(f"{divider}\r ")
    as_cells = ",".join(next(csv.reader([line], delimiter=divider), [])).rstrip(", ")
    for text in (as_written, as_cells):
        if text.startswith(mark):
            try:
                meta = json.loads(text[len(mark) :])
            except ValueError:
                continue
            if isinstance(meta, dict):
                _check_version(FORMAT, meta.get("version"))
                return meta
    raise FileFormatError(f"expected the first line to begin with {mark!r}, then name and notes as JSON")


def _write_ros_json(fields: Fields) -> bytes:
    return json.dumps(message_of(fields), allow_nan=False).encode()


def _read_ros_json(data: bytes) -> Fields:
    return fields_of(parse_json(data))


def _write_yaml(fields: Fields) -> bytes:
    return as_yaml(message_of(fields)).encode()


def _read_yaml(data: bytes) -> Fields:
    return fields_of(parse_yaml(decoded(data)))


_ROS_FIELDS = {"points", "trajectory", "goal"}  # of a message, where a file of jaxik says its format
_FORMS: dict[str, tuple[Callable[[Fields], bytes], Callable[[bytes], Fields]]] = {
    ".npz": (_write_npz, _read_npz),
    ".csv": (_write_csv, _read_csv),
    ".ros.json": (_write_ros_json, _read_ros_json),
    ".json": (_write_json, _read_json),
    ".yaml": (_write_yaml, _read_yaml),
    ".yml": (_write_yaml, _read_yaml),
    ".mcap": (write_bag, read_bag),
}


def _form(name: str) -> tuple[Callable[[Fields], bytes], Callable[[bytes], Fields]]:
    """Return writer and reader for a file name."""
    for ending, form in _FORMS.items():
        if name.lower().endswith(ending):
            return form
    raise FileFormatError(f"{name}: expected a file name ending in {', '.join(_FORMS)}; got {Path(name).suffix!r}")
