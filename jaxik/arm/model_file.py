"""Arm models as JSON files: numbers in full precision, names and notes."""

import dataclasses
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxik.arm.arm import Arm, ArmModel, Gripper, HalfSpaces, LinkInertia, Motors
from jaxik.arm.arm_classes import check_outer_joint
from jaxik.arm.outer_joint_arm import OuterJointArm
from jaxik.arm.outer_joint_class import OuterJointGeometry
from jaxik.arm.refined_arm import RefinedArm
from jaxik.arm.srs_class import ArmGeometry, exact_member
from jaxik.arm.swivel_reference import PaperReference, StereographicReference
from jaxik.atomic_file import write_atomically
from jaxik.errors import ArmClassError, FileFormatError

FORMAT = "jaxik-arm-model"
VERSION = 1

CLASS_TOLERANCE = 1e-5
"""Deviation from the S-R-S class accepted in a file: an arm kept in float32 misses right angles by some 1e-7."""

_LARGEST = float(np.finfo(np.float32).max)  # in either float type

_REFERENCES = {"paper": PaperReference, "stereographic": StereographicReference}

# Field, shape; J is the number of joints, H that of half-spaces.
_ARRAYS: dict[str, tuple[int | str, ...]] = {
    "axes": ("J", 3),
    "shoulder": (3,),
    "elbow": (3,),
    "wrist": (3,),
    "tool_position": (3,),
    "tool_rotation": (3, 3),
    "lower": ("J",),
    "upper": ("J",),
    "velocity_limit": ("J",),
    "torque_limit": ("J",),
    "gravity": (3,),
}
_GROUPS: dict[str, tuple[type, dict[str, tuple[int | str, ...]]]] = {
    "links": (LinkInertia, {"mass": ("J",), "center_of_mass": ("J", 3), "inertia": ("J", 3, 3)}),
    "motors": (Motors, {"resistance": ("J",), "torque_constant": ("J",)}),
    "keep_out": (HalfSpaces, {"normal": ("H", 3), "offset": ("H",)}),
}


def save_model(model: ArmModel, file: str | os.PathLike[str]) -> None:
    """Write an arm model as JSON; :func:`load_model` gives the same bits back.

    The file appears under its name only when it is complete, so a crash leaves the old one.

    Args:
        model: One arm (not a batch of arms).
        file: File name; an existing file is replaced.

    Raises:
        ValueError: If it is not a model, is a batch, or holds a number that is not finite.
        OSError: If the file cannot be written.
    """
    content = json.dumps(model_content(model), indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    write_atomically(file, content)


def load_model(file: str | os.PathLike[str]) -> ArmModel:
    """Read an arm model written by :func:`save_model`, or by hand.

    Numbers come back in the float type they were saved in; float64 needs JAX's 64-bit types enabled, else it becomes
    float32.

    Args:
        file: File name.

    Returns:
        The model.

    Raises:
        FileFormatError: If the file is no JSON, or a field is missing, unknown or not what it should be.
        OSError: If the file cannot be opened.
        ArmClassError: If the numbers are no arm of the class that the file names.
    """
    path = Path(file)
    try:
        text = path.read_text(encoding="utf-8")
        content = json.loads(text, parse_constant=_no_constant, object_pairs_hook=_no_duplicates)
        return model_from_content(content)
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: not UTF-8 text (byte {error.start}), so not a model file") from None
    except json.JSONDecodeError as error:
        raise FileFormatError(f"{path}, line {error.lineno}: not valid JSON: {error.msg}") from None
    except RecursionError:
        raise FileFormatError(f"{path}: nested too deeply to be a model file") from None
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from None
    except ArmClassError as error:
        raise ArmClassError(f"{path}: {error}") from None


def model_content(model: ArmModel) -> dict[str, Any]:
    """Return the content of a model file as plain values, for files that carry an arm among other things.

    Raises:
        ValueError: As :func:`save_model`.
    """
    if not isinstance(model, ArmModel):
        raise ValueError(
            f"expected a jaxik.ArmModel, got {type(model).__name__}: a file holds names too, "
            "jaxik.ArmModel(arm, joint_names, name, source)"
        )
    arm = model.arm
    if arm.surroundings is not None:
        raise ValueError("a model file holds no body: save the model as it was before jaxik.with_body")
    if arm.axes.ndim != 2:
        raise ValueError(f"one arm goes in a file; axes have shape {arm.axes.shape}, which is a batch of arms")
    dtypes = sorted({leaf.dtype.name for leaf in jax.tree.leaves(arm)})
    if len(dtypes) != 1:
        raise ValueError(f"the arm mixes float types ({', '.join(dtypes)}); convert it with arm.astype first")
    if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(arm)):
        raise ValueError("the arm holds a number that is not finite (NaN or infinity); check its arrays")
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": model.name,
        "source": model.source,
        "notes": list(model.notes),
        "joint_names": list(model.joint_names),
        "gripper": None if model.gripper is None else vars(model.gripper),
        "dtype": dtypes[0],
        "arm": {
            **{name: _list(getattr(arm, name)) for name in _ARRAYS},
            **{
                group: {name: _list(getattr(getattr(arm, group), name)) for name in fields}
                for group, (_, fields) in _GROUPS.items()
            },
            **_outer_content(arm),
            "reference": {
                "kind": arm.reference.kind,
                **{name: _list(getattr(arm.reference, name)) for name in _vector_names(type(arm.reference))},
            },
        },
    }


def model_from_content(content: Any) -> ArmModel:
    """Return the arm model of a file's content.

    Raises:
        FileFormatError: As :func:`load_model`, without the file's name.
        ArmClassError: The numbers are no arm of the class that the content names.
    """
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise FileFormatError(f'not an arm model: expected an object with "format": "{FORMAT}"')
    if content.get("version") != VERSION:
        raise FileFormatError(f"version {content.get('version')!r:.60} is unknown, this jaxik reads version {VERSION}")
    top = ("format", "version", "name", "source", "notes", "joint_names", "gripper", "dtype", "arm")
    _keys(content, top, "")
    if content["dtype"] not in ("float32", "float64"):
        raise FileFormatError(f'dtype should be "float32" or "float64", found {content["dtype"]!r:.60}')
    dtype = jax.dtypes.canonicalize_dtype(content["dtype"])
    names = _strings(content["joint_names"], "joint_names")
    if len(names) not in (6, 7):
        raise FileFormatError(f"joint_names should be 6 or 7 names, found {len(names)}")
    sizes = {"J": len(names)}

    fields = content["arm"]
    has_outer = isinstance(fields, dict) and "outer" in fields
    has_chain = has_outer and "chain" in fields
    extra = [name for name, given in (("outer", has_outer), ("chain", has_chain)) if given]
    _keys(fields, (*_ARRAYS, *_GROUPS, *extra, "reference"), "arm")
    values = {name: _numbers(fields[name], shape, sizes, f"arm.{name}") for name, shape in _ARRAYS.items()}
    outer = _outer(fields["outer"], sizes) if has_outer else None
    chain = _chain(fields["chain"], sizes) if has_chain else None
    _check_numbers(values if chain is None else values | {"axes": chain["member_axes"]}, outer)
    groups: dict[str, Any] = {}
    for group, (cls, parts) in _GROUPS.items():
        _keys(fields[group], tuple(parts), f"arm.{group}")
        numbers = {k: _numbers(fields[group][k], shape, sizes, f"arm.{group}.{k}") for k, shape in parts.items()}
        groups[group] = cls(**{k: jnp.asarray(v, dtype) for k, v in numbers.items()})
    arrays: dict[str, Any] = {name: jnp.asarray(value, dtype) for name, value in values.items()}
    arrays |= groups | {"reference": _reference(fields["reference"], lambda value: jnp.asarray(value, dtype))}
    if outer is not None:
        arrays |= {"outer": jnp.asarray(outer[1], dtype), "outer_joint": outer[0] - 1}
    if chain is not None:
        arrays |= {name: jnp.asarray(value, dtype) for name, value in chain.items()}
    kind = Arm if outer is None else OuterJointArm if chain is None else RefinedArm
    return ArmModel(
        arm=kind(**arrays),
        joint_names=names,
        name=_string(content["name"], "name"),
        source=_string(content["source"], "source"),
        notes=_strings(content["notes"], "notes"),
        gripper=_gripper(content["gripper"]),
    )


def _outer_content(arm: Arm) -> dict[str, Any]:
    """Return what a file says of an outer joint, by number from 1."""
    if isinstance(arm, RefinedArm):
        outer = {"joint": arm.outer_joint + 1, "point": _list(arm.outer)}
        return {"outer": outer, "chain": {"points": _list(arm.points), "member_axes": _list(arm.member_axes)}}
    if not isinstance(arm, OuterJointArm):
        return {}
    return {"outer": {"joint": arm.outer_joint + 1, "point": _list(arm.outer)}}


def _outer(value: Any, sizes: dict[str, int]) -> tuple[int, np.ndarray]:
    """Return the outer joint's number and a point on its axis."""
    _keys(value, ("joint", "point"), "arm.outer")
    if value["joint"] not in (1, 7) or sizes["J"] != 7:
        raise FileFormatError(f"arm.outer.joint should be 1 or 7 of seven joints, found {value['joint']!r:.60}")
    return value["joint"], _numbers(value["point"], (3,), {}, "arm.outer.point")


def _chain(value: Any, sizes: dict[str, int]) -> dict[str, np.ndarray]:
    """Return what a file says of a chain that is solved by refinement, beside its nearest member."""
    _keys(value, ("points", "member_axes"), "arm.chain")
    return {name: _numbers(value[name], ("J", 3), sizes, f"arm.chain.{name}") for name in ("points", "member_axes")}


def _check_numbers(values: dict[str, np.ndarray], outer: tuple[int, np.ndarray] | None) -> None:
    """Check what the shapes leave open; the numbers themselves stay as they are, to the bit."""
    geometry = {name: values[name] for name in ArmGeometry._fields}
    if outer is None:
        exact_member(ArmGeometry(**geometry), CLASS_TOLERANCE, adjustable=False)
    else:
        check_outer_joint(OuterJointGeometry(**geometry, outer=outer[1], outer_joint=outer[0] - 1), CLASS_TOLERANCE)
    for i, (low, high) in enumerate(zip(values["lower"], values["upper"], strict=True)):
        if not low < high:
            raise FileFormatError(f"arm.lower[{i}] = {low:g} should be below arm.upper[{i}] = {high:g}")
    for name in ("velocity_limit", "torque_limit"):
        if not (values[name] > 0).all():
            raise FileFormatError(f"arm.{name} should be positive, found {values[name].tolist()}")


def _vector_names(reference: type) -> tuple[str, ...]:
    return tuple(f.name for f in dataclasses.fields(reference) if f.name != "kind")


def _reference(value: Any, array: Callable[[np.ndarray], jax.Array]) -> PaperReference | StereographicReference:
    kind = value.get("kind") if isinstance(value, dict) else None
    if kind not in _REFERENCES:
        raise FileFormatError(
            f"arm.reference.kind should be one of {', '.join(map(repr, _REFERENCES))}, found {kind!r:.60}"
        )
    names = _vector_names(_REFERENCES[kind])
    _keys(value, ("kind", *names), "arm.reference")
    first, second = (_numbers(value[name], (3,), {}, f"arm.reference.{name}") for name in names)
    off = max(abs(np.linalg.norm(first) - 1), abs(np.linalg.norm(second) - 1), abs(first @ second))
    if off > CLASS_TOLERANCE:
        raise FileFormatError(f"arm.reference should hold two perpendicular unit vectors, they are off by {off:.3g}")
    return _REFERENCES[kind](array(first), array(second))


def _gripper(value: Any) -> Gripper | None:
    if value is None:
        return None
    _keys(value, ("name", "lower", "upper"), "gripper")
    lower, upper = (float(_numbers(value[k], (), {}, f"gripper.{k}")) for k in ("lower", "upper"))
    return Gripper(_string(value["name"], "gripper.name"), lower, upper)


def _keys(value: Any, expected: tuple[str, ...], where: str) -> None:
    """Raise unless the fields are exactly these, so that a misspelled one does not pass as a default."""
    prefix = f"{where}." if where else ""
    if not isinstance(value, dict):
        raise FileFormatError(f"{where} should be an object with the fields {', '.join(expected)}")
    for key in expected:
        if key not in value:
            raise FileFormatError(f"{prefix}{key} is missing")
    for key in value:
        if key not in expected:
            raise FileFormatError(f"{prefix}{key[:60]} is not a field; known here are {', '.join(expected)}")


def _numbers(value: Any, shape: tuple[int | str, ...], sizes: dict[str, int], where: str) -> np.ndarray:
    """Return nested lists of numbers as an array of a shape; the first use of a named size sets it."""
    if not shape:
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _LARGEST:
            raise FileFormatError(f"{where} should be a finite number, found {value!r:.60}")
        return np.array(value, np.float64)
    is_list, count = isinstance(value, list), shape[0]
    if isinstance(count, str):
        count = sizes.setdefault(count, len(value) if is_list else 0)
    if not is_list or len(value) != count:
        raise FileFormatError(
            f"{where} should be a list of {count}, found {len(value) if is_list else repr(value)[:60]}"
        )
    rows = [_numbers(v, shape[1:], sizes, f"{where}[{i}]") for i, v in enumerate(value)]
    return np.array(rows, np.float64).reshape(count, *(s for s in shape[1:] if isinstance(s, int)))


def _strings(value: Any, where: str) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise FileFormatError(f"{where} should be a list of strings, found {value!r:.60}")
    return tuple(_string(v, f"{where}[{i}]") for i, v in enumerate(value))


def _string(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise FileFormatError(f"{where} should be a string, found {value!r:.60}")
    return value


def _list(array: jax.Array) -> Any:
    # float32 widened to float64 prints more digits than needed, and converts back to the same bits.
    return np.asarray(array, np.float64).tolist()


def _no_constant(name: str) -> Any:
    raise FileFormatError(f"{name} is not a number a model file may hold")


def _no_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    seen: dict[str, Any] = {}
    for key, value in pairs:
        if key in seen:
            raise FileFormatError(f"the field {key[:60]} is given twice")
        seen[key] = value
    return seen
