"""Draws every picture of the documentation into docs/pictures: python docs/pictures.py [NAME ...]."""

import io
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from PIL import Image

import hardware
import jaxik
from jaxik import view
from jaxik.view.alternatives import as_it_is, fixed_swivel, greedy

FOLDER = Path(__file__).with_name("pictures")
DPI = 100


@cache
def planned(arm: str = "meccanoid", name: str = "word"):
    """A model, a path in its reach, and the plan on it."""
    model = {"meccanoid": jaxik.presets.meccanoid, "iiwa14": jaxik.presets.iiwa14}[arm]()
    path = jaxik.fit_path(jaxik.example_path(name), model.arm)
    return model, path, jaxik.plan(model, path)


def construction():
    return view.draw_construction()


def arcs():
    model = jaxik.presets.iiwa14()
    q = jnp.radians(jnp.array([30.0, 60.0, 20.0, -90.0, 40.0, 70.0, 0.0]))
    found = jaxik.swivel_arcs(model.arm, jaxik.forward_kinematics(model.arm, q))
    swivel, branch = jaxik.swivel_of(model.arm, q)
    return view.draw_arcs(found, swivel=float(swivel), branch=int(branch))


def arm():
    model, path, plan = planned()
    return view.draw_arm(model, plan.trajectory, path)


def energy_map():
    model, path, plan = planned()
    return view.draw_energy_map(jaxik.energy_map(model.arm, path, plan.branch), plan)


def alternatives():
    model, path, plan = planned()
    motions = [find(model.arm, plan.trajectory) for find in (fixed_swivel, greedy)]
    others = {motion.caption(): motion.trajectory for motion in motions}
    return view.draw_energy_map(jaxik.energy_map(model.arm, path, plan.branch), plan, others)


def joints():
    model, _, plan = planned()
    return view.draw_joints(model, plan.trajectory)


def velocities():
    model, _, plan = planned()
    return view.draw_velocities(model, plan.trajectory)


def torques():
    model, _, plan = planned("iiwa14", "wave")
    return view.draw_torques(model, plan.trajectory)


def tracking():
    _, _, plan = planned()
    with hardware.connect("simulated") as robot:
        report = hardware.play(plan.trajectory, robot)
    return view.draw_tracking(report.log)


def overview():
    """The first thing a reader sees: the arm writes, and beside it where its elbow goes on the energy map."""
    model, path, plan = planned()
    motion = as_it_is(model.arm, plan.trajectory)
    costs = jaxik.energy_map(model.arm, path, plan.branch)
    frames = []
    for share in np.linspace(0, 1, 54):
        at_s = motion.trajectory.time_s[0] + share * motion.trajectory.duration_s
        frames.append(_side_by_side(model, motion.trajectory, path, costs, at_s))
    # One palette for all frames, so that nothing flickers and only what moves is stored.
    palette = frames[len(frames) // 2].quantize(96, dither=Image.Dither.NONE)
    small = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    with io.BytesIO() as file:
        small[0].save(file, "GIF", save_all=True, append_images=small[1:], duration=110, loop=0, optimize=True)
        return file.getvalue()


def _side_by_side(model, trajectory, path, costs, at_s: float) -> Image.Image:
    """One moment: the arm on the left, the map on the right."""
    k = int(np.searchsorted(trajectory.time_s, at_s, side="right"))
    left = view.draw_arm(model, trajectory, path, at_s=at_s)
    right = view.draw_energy_map(costs, trajectory, size=(5.4, 4.2))
    right.axes[0].axvline(at_s, color="#d1495b", linewidth=2.5)
    right.axes[0].plot([at_s], [np.degrees(trajectory.swivel[max(k - 1, 0)])], "o", color="#d1495b", markersize=8)
    images = [_image(figure, 66) for figure in (left, right)]
    height = max(image.height for image in images)
    whole = Image.new("RGB", (sum(image.width for image in images), height), "white")
    x = 0
    for image in images:
        whole.paste(image, (x, (height - image.height) // 2))
        x += image.width
    return whole


def _image(figure, dpi: int) -> Image.Image:
    with io.BytesIO() as file:
        figure.savefig(file, format="png", dpi=dpi)
        return Image.open(io.BytesIO(file.getvalue())).convert("RGB")


PICTURES: dict[str, Callable] = {
    f.__name__: f
    for f in (construction, arcs, arm, energy_map, alternatives, joints, velocities, torques, tracking, overview)
}


def main(names: list[str]) -> None:
    """Draws the pictures named, or all."""
    jax.config.update("jax_enable_x64", True)
    FOLDER.mkdir(exist_ok=True)
    for name in names or PICTURES:
        made = PICTURES[name]()
        if isinstance(made, bytes):
            (FOLDER / f"{name}.gif").write_bytes(made)
        else:
            made.savefig(FOLDER / f"{name}.png", dpi=DPI)
        print(name)


if __name__ == "__main__":
    main(sys.argv[1:])
