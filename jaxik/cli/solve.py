"""``jaxik solve``: the eight branches of one target."""

import math
from typing import Annotated

import jax.numpy as jnp
import numpy as np
import tyro

from jaxik.cli.console import Screen
from jaxik.cli.inputs import InputError, find_arm
from jaxik.ik import Status, solve_ik
from jaxik.targets import Pointing, Pose, Target


def solve(
    position: Annotated[tuple[float, float, float], tyro.conf.Positional],
    arm: str = "meccanoid-right",
    base: str | None = None,
    tip: str | None = None,
    direction: tuple[float, float, float] | None = None,
    quaternion: tuple[float, float, float, float] | None = None,
    swivel_deg: float = 0.0,
    json: bool = False,
) -> int:
    """Solve one target and print the joint angles of the eight branches.

    Args:
        position: Tool point in the arm's base frame, in meters.
        arm: Preset (`jaxik info` lists them), model file (.json), URDF (.urdf) or MJCF (.xml).
        base: Base link in a URDF; not needed, as the tip, if it has one arm (see `jaxik info FILE.urdf`). Base body in
            an MJCF, by default the world.
        tip: Tip link in a URDF; site or body of the tool in an MJCF.
        direction: Direction of the tool's z axis, for 6 joints, or 7 of an S-R-S arm with the last one at zero; default
            1 0 0.
        quaternion: Rotation of the tool as w x y z, for arms with 7 joints.
        swivel_deg: Angle of the elbow on its circle, in degrees.
        json: Print one JSON document instead of the table.

    Returns:
        0 if a branch is feasible, else 1.
    """
    screen = Screen(json)
    model = find_arm(arm, base, tip)
    if quaternion is None and model.arm.kinematic_class != "S-R-S":
        raise InputError(
            f"{model.name} needs the whole rotation of the tool, not its direction alone: give --quaternion w x y z, "
            "such as 0 1 0 0 for a tool whose z axis points down"
        )
    target = _target(position, direction, quaternion)
    with screen.step("solving"):
        solution = solve_ik(model.arm, target, jnp.asarray(math.radians(swivel_deg)))
        status = [Status(int(s)) for s in np.asarray(solution.status)]
    q = np.asarray(solution.q)
    rows = [
        (f"{i} {i:03b}", s.name, *(f"{x:.1f}" for x in np.degrees(q[i])), f"{float(solution.residual.position[i]):.0e}")
        for i, s in enumerate(status)
    ]
    numbers = [f"q{i + 1}" for i in range(len(model.joint_names))]
    screen.table(f"{model.name}, joint angles in degrees", ("branch", "status", *numbers, "error\n[m]"), rows)
    screen.say(", ".join(f"{number} {name}" for number, name in zip(numbers, model.joint_names, strict=True)))
    screen.result(
        {
            "arm": model.name,
            "joint_names": list(model.joint_names),
            "branches": [{"branch": i, "status": s.name, "q_rad": q[i].tolist()} for i, s in enumerate(status)],
        }
    )
    feasible = any(s <= Status.NEAR_SINGULAR for s in status)
    if not feasible:
        screen.say(f"no feasible branch: {min(status).name}: {min(status).message}")
    return 0 if feasible else 1


def _target(
    position: tuple[float, ...], direction: tuple[float, ...] | None, quaternion: tuple[float, ...] | None
) -> Target:
    """The target given by the options."""
    if direction is not None and quaternion is not None:
        raise ValueError("give either --direction or --quaternion, not both")
    p = jnp.asarray(position)
    if quaternion is None:
        return Pointing(p, jnp.asarray(direction or (1.0, 0.0, 0.0)))
    return Pose.from_quaternion(p, wxyz=jnp.asarray(quaternion))
