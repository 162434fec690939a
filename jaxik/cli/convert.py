"""``jaxik convert``: trajectories and paths between files, and the goal of a ROS 2 controller."""

from pathlib import Path as FilePath
from typing import Annotated

import tyro

from jaxik.cli.console import Screen
from jaxik.cli.inputs import InputError, parse_columns
from jaxik.errors import FileFormatError
from jaxik.paths import load_path, save_path
from jaxik.trajectories import follow_joint_trajectory_goal, load_trajectory


def convert(
    file: Annotated[FilePath, tyro.conf.Positional],
    out: Annotated[FilePath | None, tyro.conf.Positional] = None,
    path: bool = False,
    columns: str | None = None,
    goal: bool = False,
    json: bool = False,
) -> int:
    """Convert a trajectory or a path to another kind of file, or print a goal for `ros2 action send_goal`.

    Args:
        file: Trajectory (.npz, .csv, .json; ROS 2: .yaml, .ros.json, .mcap, or the folder of a recording), or path.
        out: File to write; its ending says the kind: the same ones.
        path: The file is a path: .csv; ROS 2: .yaml, .ros.json.
        columns: The columns of a path in a table of another program, such as time=stamp,x=tool_x; implies --path.
        goal: Print the goal of a FollowJointTrajectory action instead of writing a file.
        json: Print one JSON document instead of a sentence.

    Returns:
        0.
    """
    screen = Screen(json)
    if goal:
        text = follow_joint_trajectory_goal(load_trajectory(file))
        if json:
            screen.result({"goal": text.rstrip("\n")})
        else:
            print(text, end="")  # without the line breaks of a screen
        return 0
    if out is None:
        raise InputError("name a file to write after the one to read, or give --goal")
    if path or columns is not None:
        content = load_path(file, columns=parse_columns(columns))
        save_path(content, out)
        what, waypoints = "path", len(content)
    else:
        try:
            motion = load_trajectory(file)
        except FileFormatError as error:
            raise FileFormatError(f"{error} (for a path give --path)") from None
        motion.save(out)
        what, waypoints = "trajectory", len(motion)
    screen.say(f"saved {out}: {what} of {waypoints} waypoints")
    screen.result({"file": str(out), "kind": what, "waypoints": waypoints})
    return 0
