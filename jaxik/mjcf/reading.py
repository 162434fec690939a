"""Arms from MJCF: the chain between two bodies, as MuJoCo itself places it at zero joint angles."""

import os
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from jaxik.arm import ArmModel, HalfSpaces, LinkInertia, SwivelReference, arm_from_axes
from jaxik.errors import ArmClassError, FileFormatError, MissingExtraError
from jaxik.mjcf.writing import VELOCITY_LIMIT

_LARGEST = 1e9  # m, kg, kg m²; squares add up in float32


def from_mjcf(
    file: str | os.PathLike[str],
    tip: str | None = None,
    base: str | None = None,
    *,
    reference: SwivelReference | None = None,
    keep_out: HalfSpaces | None = None,
    tolerance: float = 1e-5,
) -> ArmModel:
    """Load the arm between two frames of an MJCF file, or of MJCF text.

    MuJoCo compiles the file, so that defaults, includes and frames hold, and its meshes have to be there. Joints off
    the chain stay where the model begins, and the masses of their bodies are added to the link that carries them.

    Args:
        file: File name, or text that begins with ``<``.
        tip: Name of the site or body that is the tool; None for the model's only site.
        base: Name of the body whose frame becomes the base frame; None for the world.
        reference: Zero of the swivel angle; default as in :func:`jaxik.make_arm`.
        keep_out: Half-spaces the elbow must stay in; default none.
        tolerance: Largest deviation from a class taken for rounding, as for :func:`jaxik.load_urdf`.

    Returns:
        The arm with the model's joint names, ranges, inertias, and torque limits of joints or actuators.

    Raises:
        ArmClassError: The chain is not an arm of a class that is solved.
        FileFormatError: MuJoCo does not load the file; with its message.
        MissingExtraError: MuJoCo is absent.
        OSError: The file cannot be opened.
        ValueError: A name is unknown, the tip is not carried by the base, or a joint does not turn.
    """
    try:
        mujoco: Any = import_module("mujoco")
    except ImportError as error:
        raise MissingExtraError('MJCF is read by MuJoCo: pip install "jaxik[mujoco]"') from error
    text = os.fspath(file)
    name = "the text" if text.lstrip().startswith("<") else text
    try:
        if name == text:
            Path(text).open("rb").close()  # for the error of the system
            model = mujoco.MjModel.from_xml_path(text)
        else:
            model = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise FileFormatError(f"{name}: MuJoCo does not load it: {' '.join(str(error).split())[:200]}") from None
    data = mujoco.MjData(model)
    last, tool_of = _tip(mujoco, model, tip, name)
    first = 0 if base is None else _named(mujoco, model, "body", base, name)
    joints = _joints_between(mujoco, model, first, last, name)
    data.qpos[model.jnt_qposadr[joints]] = 0.0
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    _check_numbers(model, data, name)
    origin, turn = data.xpos[first].copy(), data.xmat[first].reshape(3, 3).copy()
    tool_position, tool_rotation = tool_of(data)
    effort, limited = _efforts(model, joints), model.jnt_limited[joints].astype(bool)
    lower, upper = (np.where(limited, model.jnt_range[joints, k], end) for k, end in enumerate((-np.inf, np.inf)))
    names = tuple(model.joint(int(joint)).name or f"joint_{i + 1}" for i, joint in enumerate(joints))
    try:
        arm = arm_from_axes(
            data.xaxis[joints] @ turn,
            (data.xanchor[joints] - origin) @ turn,
            turn.T @ (tool_position - origin),
            turn.T @ tool_rotation,
            lower=lower,
            upper=upper,
            velocity_limit=_velocities(mujoco, model, len(joints)),
            torque_limit=effort,
            links=_links(model, data, joints, origin, turn),
            gravity=turn.T @ model.opt.gravity,
            reference=reference,
            keep_out=keep_out,
            tolerance=tolerance,
        )
    except ArmClassError as error:
        raise ArmClassError(f"{name}: {error}") from None
    except ValueError as error:
        raise FileFormatError(f"{name}: {str(error)[:300]}") from None
    ends = f"{base or 'world'} to {tip or 'its only site'}"
    return ArmModel(arm=arm, joint_names=names, name=_name(model), source=f"{Path(name).name}, {ends}")


def _check_numbers(model: Any, data: Any, name: str) -> None:
    """Raise an error where MuJoCo takes numbers of which it can make no poses."""
    used = [data.xpos, data.xmat, data.xipos, data.ximat, model.body_mass, model.body_inertia, model.opt.gravity]
    used += [
        data.xanchor,
        data.xaxis,
        data.site_xpos,
        data.site_xmat,
        model.jnt_range,
        model.jnt_actfrcrange,
        model.actuator_forcerange,
        model.actuator_gear,
        model.numeric_data,
    ]
    if not all((np.abs(x) <= _LARGEST).all() for x in used):
        raise FileFormatError(f"{name}: expected finite numbers in SI units below {_LARGEST:g}; MuJoCo reads others")


def _tip(mujoco: Any, model: Any, tip: str | None, name: str) -> tuple[int, Any]:
    """Return the body that carries the tool, and a function of the data that returns the tool's pose."""
    if tip is None:
        if model.nsite != 1:
            sites = ", ".join(model.site(i).name for i in range(model.nsite)) or "none"
            raise ValueError(f"{name} does not say which site or body is the tool; name one (sites: {sites})")
        site = 0
    else:
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, tip)
    if site >= 0:
        return int(model.site_bodyid[site]), lambda data: (data.site_xpos[site], data.site_xmat[site].reshape(3, 3))
    body = _named(mujoco, model, "site or body", str(tip), name)
    return body, lambda data: (data.xpos[body], data.xmat[body].reshape(3, 3))


def _named(mujoco: Any, model: Any, kind: str, wanted: str, name: str) -> int:
    found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, wanted)
    if found < 0:
        names = ", ".join(model.body(i).name for i in range(model.nbody))
        raise ValueError(f"{name} has no {kind} {wanted!r}; its bodies are {names[:300]}")
    return found


def _joints_between(mujoco: Any, model: Any, first: int, last: int, name: str) -> np.ndarray:
    """Return the joints between two bodies, from base to tip."""
    chain, body = [], last
    while body != first:
        if body == 0:
            raise ValueError(f"{name}: {model.body(first).name} does not carry {model.body(last).name}")
        start, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        chain += [start + k for k in reversed(range(count))]
        body = int(model.body_parentid[body])
    joints = np.array(chain[::-1], int)
    for joint in joints:
        if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
            raise ValueError(f"{name}: joint {model.joint(int(joint)).name!r} on the chain does not turn about an axis")
    if len(joints) not in (6, 7):
        raise ValueError(f"{name}: expected 6 or 7 joints between base and tip; got {len(joints)}")
    return joints


def _links(model: Any, data: Any, joints: np.ndarray, origin: np.ndarray, turn: np.ndarray) -> LinkInertia:
    """Return masses, centers and inertias of everything that each joint carries up to the next."""
    owner = np.full(model.nbody, -1)
    for body in range(1, model.nbody):  # parents come first
        owner[body] = owner[model.body_parentid[body]]
        for i, joint in enumerate(joints):
            if model.jnt_bodyid[joint] == body:
                owner[body] = i
    mass, center, inertia = np.zeros(len(joints)), np.zeros((len(joints), 3)), np.zeros((len(joints), 3, 3))
    for i in range(len(joints)):
        bodies = np.flatnonzero(owner == i)
        weight = model.body_mass[bodies]
        mass[i] = weight.sum()
        places = (data.xipos[bodies] - origin) @ turn
        if mass[i] > 0:
            center[i] = weight @ places / mass[i]
        for body, kg, place in zip(bodies, weight, places, strict=True):
            axes = turn.T @ data.ximat[body].reshape(3, 3)
            off = place - center[i]
            inertia[i] += (axes * model.body_inertia[body]) @ axes.T
            inertia[i] += kg * (off @ off * np.eye(3) - np.outer(off, off))
    return LinkInertia(mass, center, inertia)  # pyright: ignore[reportArgumentType]


def _efforts(model: Any, joints: np.ndarray) -> np.ndarray:
    """Return the largest torque of every joint: its own limit, else that of its actuators."""
    found = np.full(len(joints), np.inf)
    for i, joint in enumerate(joints):
        if model.jnt_actfrclimited[joint]:
            found[i] = np.abs(model.jnt_actfrcrange[joint]).max()
            continue
        driving = [k for k in range(model.nu) if model.actuator_trnid[k, 0] == joint and model.actuator_trntype[k] == 0]
        if driving and all(model.actuator_forcelimited[k] for k in driving):
            found[i] = sum(np.abs(model.actuator_forcerange[k] * model.actuator_gear[k, 0]).max() for k in driving)
    return np.where(found > 0, found, np.inf)


def _velocities(mujoco: Any, model: Any, count: int) -> np.ndarray:
    """Return the velocity limits that jaxik wrote, or none."""
    numbers = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, VELOCITY_LIMIT)
    if numbers < 0 or model.numeric_size[numbers] != count:
        return np.full(count, np.inf)
    start = int(model.numeric_adr[numbers])
    return model.numeric_data[start : start + count].copy()


def _name(model: Any) -> str:
    """Return the name of the model, which MuJoCo keeps first among all names."""
    return bytes(model.names).split(b"\0", 1)[0].decode(errors="replace") or "arm"
