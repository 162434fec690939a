"""``jaxik view``: an interactive arm, or the playback of a trajectory, in the browser."""

import os
import signal
import sys
import webbrowser
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import tyro

from jaxik.arm import ArmModel
from jaxik.cli.console import Screen
from jaxik.cli.inputs import ARMS, ENERGIES, InputError, find_arm, is_urdf, urdf_ends
from jaxik.trajectories import Trajectory, load_trajectory
from jaxik.view import urdf_meshes
from jaxik.view.browser import ArmPage, PlanPage, close_server, open_server


def view(
    trajectory: Annotated[FilePath | None, tyro.conf.Positional] = None,
    arm: str | None = None,
    base: str | None = None,
    tip: str | None = None,
    energy: Literal["joint-motion", "holding", "servo"] = "joint-motion",
    host: str = "localhost",
    port: int = 8080,
    browser: bool = False,
    json: bool = False,
) -> int:
    """Show an interactive arm, or play a trajectory, in the browser; works offline.

    Args:
        trajectory: Trajectory file, as written by `jaxik plan`; without it, the arm alone with a hand to drag.
        arm: Preset (`jaxik info` lists them), model file (.json), URDF (.urdf) or MJCF (.xml); by default the
            trajectory's own, or meccanoid-right.
        base: Base link in a URDF; not needed, as the tip, if it has one arm (see `jaxik info FILE.urdf`). Base body in
            an MJCF, by default the world.
        tip: Tip link in a URDF; site or body of the tool in an MJCF.
        energy: Energy shown in the energy map of a trajectory: joint-motion (rad²/s), holding (N²m²s) or servo (J).
        host: Address to listen on: localhost for this machine only, 0.0.0.0 for the network too.
        port: First port to try.
        browser: Open the page in a browser.
        json: Print one JSON document with the address instead of text.

    Returns:
        0 when stopped by Ctrl-C.
    """
    screen = Screen(json)
    motion = None if trajectory is None else load_trajectory(trajectory)
    model, meshes = _arm(arm, motion, base, tip)
    if motion is not None and motion.joint_names != model.joint_names:
        raise InputError(
            f"{trajectory} moves {', '.join(motion.joint_names)}; {model.name} has {', '.join(model.joint_names)}: "
            f"pass the arm it was made for with --arm"
        )
    server = open_server(host, port)
    with screen.step("preparing the page"):
        if motion is None:
            page: Any = ArmPage(server, model, meshes)
        else:
            page = PlanPage(server, model, motion, ENERGIES[energy](), meshes)
    address = f"http://{'localhost' if host == '0.0.0.0' else host}:{server.get_port()}"
    try:
        screen.say(f"open {address} in a browser; stop with Ctrl-C")
        screen.result({"address": address, "arm": model.name})
        if browser:
            webbrowser.open(address)
        server.sleep_forever()
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C must not interrupt the cleanup
        screen.say("stopped")
    finally:
        page.close()
        close_server(server)
    if page.busy:
        # A thread is still computing the comparison. Its compilation cannot be interrupted, and a normal exit would
        # tear down the interpreter under it.
        sys.stdout.flush()
        os._exit(0)
    return 0


def _arm(
    name: str | None, motion: Trajectory | None, base: str | None, tip: str | None
) -> tuple[ArmModel, list[Any] | None]:
    """The arm and, for a URDF, its meshes."""
    if name is not None and is_urdf(name):
        ends = urdf_ends(name, base, tip)
        return find_arm(name, *ends), urdf_meshes(name, *ends)
    if name is None and motion is not None and motion.arm_name:
        for make in ARMS.values():
            if (model := make()).name == motion.arm_name:
                return model, None
        raise InputError(
            f"the trajectory is of {motion.arm_name!r}, which is not a preset: pass its model file or URDF with --arm"
        )
    return find_arm(name or "meccanoid-right", base, tip), None
