"""``jaxik view``: an arm to play with, or a motion to watch, in the browser."""

import os
import signal
import sys
import webbrowser
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import tyro

from jaxik import energy as energies
from jaxik.arm import ArmModel, load_urdf
from jaxik.cli.console import Screen
from jaxik.cli.inputs import ARMS, InputError, find_arm
from jaxik.trajectories import Trajectory, load_trajectory
from jaxik.view.browser import ArmPage, PlanPage, close_server, open_server
from jaxik.view.urdf_meshes import urdf_meshes

_ENERGIES = {"joint-motion": energies.joint_motion, "holding": energies.holding, "servo": energies.servo}


def view(
    trajectory: Annotated[FilePath | None, tyro.conf.Positional] = None,
    arm: str | None = None,
    base_link: str | None = None,
    tip_link: str | None = None,
    energy: Literal["joint-motion", "holding", "servo"] = "joint-motion",
    host: str = "localhost",
    port: int = 8080,
    browser: bool = False,
) -> int:
    """Show an arm to play with, or a trajectory to watch, in the browser; needs no network.

    Args:
        trajectory: Trajectory file, such as `jaxik plan` writes; without one the arm alone, with a handle to drag.
        arm: Preset (meccanoid-right, meccanoid-left, iiwa7, iiwa14, paper), model file (.json) or URDF (.urdf); by
            default the trajectory's own, or meccanoid-right.
        base_link: Of a URDF: the link whose frame is the base.
        tip_link: Of a URDF: the link whose frame is the tool.
        energy: What the energy map of a trajectory shows: joint-motion (rad²/s), holding (N²m²s) or servo (J).
        host: Where to listen: localhost for this machine only, 0.0.0.0 for the network too.
        port: Where to begin looking for a free port.
        browser: Open the browser too.

    Returns:
        0 when ended by Ctrl-C.
    """
    screen = Screen()
    motion = None if trajectory is None else load_trajectory(trajectory)
    model, meshes = _arm(arm, motion, base_link, tip_link)
    if motion is not None and motion.joint_names != model.joint_names:
        raise InputError(
            f"{trajectory} moves {', '.join(motion.joint_names)}; {model.name} has {', '.join(model.joint_names)}: "
            f"name the arm it was made for with --arm"
        )
    server = open_server(host, port)
    with screen.step("getting ready"):
        if motion is None:
            page: Any = ArmPage(server, model, meshes)
        else:
            page = PlanPage(server, model, motion, _ENERGIES[energy](), meshes)
    address = f"http://{'localhost' if host == '0.0.0.0' else host}:{server.get_port()}"
    try:
        screen.say(f"open {address} in a browser; Ctrl-C ends")
        if browser:
            webbrowser.open(address)
        server.sleep_forever()
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # it is ending; hurrying it changes nothing
        screen.say("ended")
    finally:
        page.close()
        close_server(server)
    if page.busy:
        # Nobody waits for a comparison that is no longer looked at. A compilation cannot be interrupted, though, and
        # Python would tear everything down under it: leave without.
        sys.stdout.flush()
        os._exit(0)
    return 0


def _arm(
    name: str | None, motion: Trajectory | None, base_link: str | None, tip_link: str | None
) -> tuple[ArmModel, list[Any] | None]:
    """The arm and, from a URDF, its meshes."""
    if name is not None and name.endswith(".urdf"):
        if base_link is None or tip_link is None:
            raise InputError(f"{name}: say which part is the arm with --base-link and --tip-link")
        return load_urdf(name, base_link, tip_link), urdf_meshes(name, base_link, tip_link)
    if name is None and motion is not None and motion.arm_name:
        for make in ARMS.values():
            if (model := make()).name == motion.arm_name:
                return model, None
        raise InputError(f"the trajectory is of {motion.arm_name!r}, which is no preset: name its file with --arm")
    return find_arm(name or "meccanoid-right"), None
