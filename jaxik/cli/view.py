"""``jaxik view``: an interactive arm, or the playback of trajectories, in the browser or as a file to pass on."""

import contextlib
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
from jaxik.cli.surroundings import find_body
from jaxik.obstacles import World, load_world
from jaxik.trajectories import Trajectory, load_trajectory
from jaxik.view import urdf_meshes
from jaxik.view.browser import ArmPage, ArmsPage, PlanPage, ShownMotion, close_server, open_server, save_recording

_FORMATS = (".html", ".gif", ".mp4")


def view(
    trajectories: Annotated[tuple[FilePath, ...], tyro.conf.Positional] = (),
    arm: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    base: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    tip: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    world: FilePath | None = None,
    out: FilePath | None = None,
    energy: Literal["joint-motion", "holding", "servo"] = "joint-motion",
    host: str = "localhost",
    port: int = 8080,
    browser: bool = False,
    json: bool = False,
) -> int:
    """Show an interactive arm, or play trajectories side by side, in the browser; works offline.

    Args:
        trajectories: Trajectory files, as written by `jaxik plan`; without any, the arm alone with a hand to drag.
        arm: Preset (`jaxik info` lists them), model file (.json), URDF (.urdf) or MJCF (.xml); by default the
            trajectory's own, or meccanoid-right. Give it again for a second arm beside the first.
        base: Base link in a URDF; not needed, as the tip, if it has one arm (see `jaxik info FILE.urdf`). Base body in
            an MJCF, by default the world. With several arms, once per arm or not at all.
        tip: Tip link in a URDF; site or body of the tool in an MJCF. With several arms, as the base.
        world: Obstacles: shapes (.json) or points (.csv, .npy). About an arm alone they can be dragged; it needs a body
            then: iiwa14, Franka and the Meccanoid have one, and URDF files with collision shapes.
        out: Save the trajectories instead: as a page that plays without a server or network (.html), or as a film
            (.gif, .mp4), which needs Chromium or Chrome.
        energy: Energy shown in the energy map of a trajectory: joint-motion (rad²/s), holding (N²m²s) or servo (J).
        host: Address to listen on: localhost for this machine only, 0.0.0.0 for the network too.
        port: First port to try.
        browser: Open the page in a browser.
        json: Print one JSON document with the address, or the file, instead of text.

    Returns:
        0 when stopped by Ctrl-C, or when the file is saved.
    """
    screen = Screen(json)
    around = None if world is None else load_world(world)
    given = _given(arm, base, tip)
    if len(given) > 1 and (trajectories or around is not None):
        raise InputError(f"trajectories and --world go with one --arm; got {', '.join(arm)}")
    motions = [_motion(file, *given[0], around, len(trajectories), out is None) for file in trajectories]
    if out is not None:
        return _save(screen, motions, out)
    arms = [] if motions else [_arm(name, None, *ends) for name, *ends in given]
    models = [motion.model for motion in motions[:1]] or [model for model, _ in arms]
    if arms and around is not None:
        models = [find_body(models[0], given[0][0] or models[0].name, *given[0][1:])]
    server = open_server(host, port)
    with screen.step("preparing the page"):
        if motions:
            page: Any = PlanPage(server, motions, ENERGIES[energy]())
        elif len(models) > 1:
            page = ArmsPage(server, models, [meshes for _, meshes in arms])
        else:
            page = ArmPage(server, models[0], arms[0][1], around)
    address = f"http://{'localhost' if host == '0.0.0.0' else host}:{server.get_port()}"
    try:
        screen.say(f"open {address} in a browser; stop with Ctrl-C")
        screen.result({"address": address, "arm": ", ".join(model.name for model in models)})
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


def _given(
    arms: tuple[str, ...], bases: tuple[str, ...], tips: tuple[str, ...]
) -> list[tuple[str | None, str | None, str | None]]:
    """The arms as typed, each with its base and tip; at least one."""
    count = max(len(arms), 1)
    if len(bases) not in (0, count) or len(tips) not in (0, count):
        raise InputError(
            f"expected no --base and --tip, or one per arm; got {len(bases)} and {len(tips)} for {len(arms)} arms"
        )
    return list(zip(arms or (None,), bases or (None,) * count, tips or (None,) * count, strict=True))


def _save(screen: Screen, motions: list[ShownMotion], out: FilePath) -> int:
    """Save motions as a file."""
    if not motions:
        raise InputError("--out saves trajectories: name one, as written by `jaxik plan`")
    if out.suffix.lower() not in _FORMATS:
        raise InputError(f"expected --out to end in {', '.join(_FORMATS)}, got {out}")
    with screen.step(f"recording {out}") as progress:
        save_recording(motions, out, progress=progress)
    screen.say(f"saved {out}, {out.stat().st_size / 1e6:.1f} MB")
    screen.result({"file": str(out), "arm": motions[0].model.name})
    return 0


def _motion(
    file: FilePath, arm: str | None, base: str | None, tip: str | None, world: World | None, count: int, live: bool
) -> ShownMotion:
    """The motion of a file, with its arm; files that are passed on are captioned by the file's name."""
    motion = load_trajectory(file)
    model, meshes = _arm(arm, motion, base, tip)
    if motion.joint_names != model.joint_names:
        raise InputError(
            f"{file} moves {', '.join(motion.joint_names)}; {model.name} has {', '.join(model.joint_names)}: "
            f"pass the arm it was made for with --arm"
        )
    if world is not None:
        with contextlib.suppress(InputError):  # without a body the energy map does not show what obstacles block
            model = find_body(model, arm or model.name, base, tip)
    return ShownMotion(model, motion, "this motion" if live and count == 1 else file.stem, meshes, world)


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
