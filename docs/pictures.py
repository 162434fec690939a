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
from jaxik.view.alternatives import fixed_swivel, greedy
from jaxik.view.browser import ArmPage, PlanPage, ShownMotion, close_server, open_server
from jaxik.view.browser.recording import browser_client, drawn_frames
from jaxik.view.browser.stage import Stage

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
    """Return an animation of an arm that writes among obstacles in the viewer, beside its elbow on the energy map."""
    model = jaxik.with_body(jaxik.presets.iiwa14(), jaxik.Body.preset("iiwa14"))
    path = jaxik.fit_path(model.arm, jaxik.example_path("word"))
    world = jaxik.World([[0.38, 0.0, 0.12], [0.45, 0.3, 1.0]], [0.1, 0.1], normals=[[0.0, 0.0, -1.0]], offsets=[0.0])
    plan = jaxik.plan(model, path, world=world).raise_if_invalid()
    costs = jaxik.energy_map(model.arm, path, plan.branch)
    motion, size = plan.trajectory, (460, 380)
    time = np.linspace(motion.time[0], motion.time[-1], 44)
    server = open_server(port=0)
    stage = Stage(server, [ShownMotion(model, motion, "", world=world)])
    with browser_client(server, size) as client:
        shown = list(drawn_frames(stage, client, time, size))
    close_server(server)
    whole = [_beside(frame, _map(motion, plan.swivel, costs, t)) for frame, t in zip(shown, time, strict=True)]
    # One palette for all frames avoids flicker, and only changes are stored. The median cut would spend it on the map.
    palette = whole[len(whole) // 2].quantize(255, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    small = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in whole]
    with io.BytesIO() as file:
        small[0].save(file, "GIF", save_all=True, append_images=small[1:], duration=120, loop=0, optimize=True)
        return file.getvalue()


def _map(motion, swivel, costs, time: float) -> Image.Image:
    """The energy map with the place of the elbow at a time."""
    figure = view.draw_energy_map(costs, motion, size=(5.4, 4.2))
    figure.axes[0].axvline(time, color="#d1495b", linewidth=2.5)
    now, low = np.degrees(np.interp(time, motion.time, np.unwrap(swivel))), figure.axes[0].get_ylim()[0]
    figure.axes[0].plot([time], [low + (now - low) % 360], "o", color="#d1495b", markersize=8)
    return _image(figure, 66)


def _beside(left: Image.Image, right: Image.Image) -> Image.Image:
    """Two pictures side by side, centered."""
    height = max(left.height, right.height)
    whole = Image.new("RGB", (left.width + right.width, height), "white")
    whole.paste(left, (0, (height - left.height) // 2))
    whole.paste(right, (left.width, (height - right.height) // 2))
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
