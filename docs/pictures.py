"""Draw the pictures of the documentation into docs/pictures: python docs/pictures.py [NAME ...]."""

import io
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from PIL import Image

import hardware
import jaxik
from jaxik import view
from jaxik.view.alternatives import fixed_swivel, given_motion, greedy
from jaxik.view.browser import ArmPage, PlanPage, ShownMotion, close_server, open_server

FOLDER = Path(__file__).with_name("pictures")
DPI = 100


@cache
def planned(arm: str = "meccanoid", name: str = "word"):
    """Return a model, a path in its workspace, and the plan."""
    model = {"meccanoid": jaxik.presets.meccanoid, "iiwa14": jaxik.presets.iiwa14}[arm]()
    path = jaxik.fit_path(model.arm, jaxik.example_path(name))
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


def learning():
    """Draw the curves of a small fit of link lengths by gradient descent."""
    model, rng = jaxik.presets.iiwa14(), np.random.default_rng(0)
    q = rng.uniform(model.arm.lower, model.arm.upper, (64, 7))
    measured = jaxik.forward_kinematics(model.arm, q).position + 1e-3 * rng.normal(size=(64, 3))
    guess = replace(model.arm, elbow=model.arm.elbow + jnp.array([0.0, 0.0, 0.03]))

    def loss(shift, rows):
        arm = replace(guess, elbow=guess.elbow + shift)
        off = jaxik.forward_kinematics(arm, q[rows]).position - measured[rows]
        return jnp.sqrt(jnp.mean(jnp.sum(off**2, axis=-1)))

    shift, curves = jnp.zeros(3), {"fitted points": [], "held-out points": []}
    slope = jax.jit(jax.grad(lambda s: loss(s, np.arange(48))))
    for _ in range(60):
        for name, rows in (("fitted points", np.arange(48)), ("held-out points", np.arange(48, 64))):
            curves[name].append(1e3 * float(loss(shift, rows)))
        shift = shift - 2e-3 * slope(shift)
    return view.draw_learning(curves, levels={"noise of the measurement": 1e3 * float(np.sqrt(3)) * 1e-3}, unit="mm")


def viewer_arm():
    """Return a screenshot of the viewer with an arm; needs chromium and playwright."""
    server = open_server(port=0)
    page = ArmPage(server, jaxik.presets.iiwa14())
    shot = _screenshot(server, page.wait)
    page.close()
    return shot


def viewer_world():
    """Return a screenshot of the viewer with an arm among obstacles."""
    model = jaxik.with_body(jaxik.presets.iiwa14(), jaxik.Body.preset("iiwa14"))
    world = jaxik.World([[0.2, 0.4, 0.6], [0.35, -0.3, 0.75]], [0.12, 0.1], normals=[[0.0, 0.0, -1.0]], offsets=[0.0])
    server = open_server(port=0)
    page = ArmPage(server, model, world=world)
    shot = _screenshot(server, page.wait)
    page.close()
    return shot


def viewer_motion():
    """Return a screenshot of the viewer with a motion."""
    model, _, plan = planned()
    server = open_server(port=0)
    page = PlanPage(server, [ShownMotion(model, plan.trajectory, "this motion")])
    page.complete.wait(300)
    page.head.seek(0.45 * plan.trajectory.duration)
    shot = _screenshot(server, lambda: None)
    page.close()
    return shot


def _screenshot(server, wait) -> Image.Image:
    """Screenshot of the browser, without the notice about software rendering."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=arguments)
        page = browser.new_page(viewport={"width": 1100, "height": 740})
        page.goto(f"http://localhost:{server.get_port()}")
        page.wait_for_selector("canvas")
        wait()
        page.wait_for_timeout(6000)
        notice = page.get_by_role("alert").get_by_role("button")
        if notice.count():
            notice.first.click()
            page.wait_for_timeout(1500)
        shot = page.screenshot()
        browser.close()
    close_server(server)
    return Image.open(io.BytesIO(shot)).convert("RGB")


def overview():
    """Return an animation of the arm on its path, beside its elbow on the energy map."""
    model, path, plan = planned()
    motion = given_motion(model.arm, plan.trajectory)
    costs = jaxik.energy_map(model.arm, path, plan.branch)
    frames = []
    for fraction in np.linspace(0, 1, 54):
        time = motion.trajectory.time[0] + fraction * motion.trajectory.duration
        frames.append(_side_by_side(model, motion.trajectory, path, costs, time))
    # One palette for all frames avoids flicker, and only changes are stored.
    palette = frames[len(frames) // 2].quantize(96, dither=Image.Dither.NONE)
    small = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    with io.BytesIO() as file:
        small[0].save(file, "GIF", save_all=True, append_images=small[1:], duration=110, loop=0, optimize=True)
        return file.getvalue()


def _side_by_side(model, trajectory, path, costs, time: float) -> Image.Image:
    """One frame: the arm on the left, the map on the right."""
    k = int(np.searchsorted(trajectory.time, time, side="right"))
    left = view.draw_arm(model, trajectory, path, at=time)
    right = view.draw_energy_map(costs, trajectory, size=(5.4, 4.2))
    right.axes[0].axvline(time, color="#d1495b", linewidth=2.5)
    right.axes[0].plot([time], [np.degrees(trajectory.swivel[max(k - 1, 0)])], "o", color="#d1495b", markersize=8)
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
    for f in (
        construction,
        arcs,
        arm,
        energy_map,
        alternatives,
        joints,
        velocities,
        torques,
        tracking,
        learning,
        overview,
        viewer_arm,
        viewer_world,
        viewer_motion,
    )
}


def main(names: list[str]) -> None:
    """Draw the named pictures, or all."""
    jax.config.update("jax_enable_x64", True)
    FOLDER.mkdir(exist_ok=True)
    for name in names or PICTURES:
        made = PICTURES[name]()
        if isinstance(made, bytes):
            (FOLDER / f"{name}.gif").write_bytes(made)
        elif isinstance(made, Image.Image):
            made.quantize(200, dither=Image.Dither.NONE).save(FOLDER / f"{name}.png", optimize=True)
        else:
            made.savefig(FOLDER / f"{name}.png", dpi=DPI)
        print(name)


if __name__ == "__main__":
    main(sys.argv[1:])
