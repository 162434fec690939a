"""The viewer in a real browser: handle dragged, swivel and branch set, a motion played, without error or network."""

import io
from time import monotonic, sleep

import numpy as np
import pytest
from PIL import Image

import jaxik
from jaxik.targets import matrix_from_wxyz
from jaxik.view.browser import ArmPage, ArmsPage, PlanPage, ShownMotion, close_server, open_server
from tests.helpers import chromium

pytestmark = pytest.mark.slow
MODEL = jaxik.presets.iiwa14()


@pytest.fixture
def server():
    chromium.require()
    server = open_server(port=0)
    yield server
    close_server(server)


@pytest.fixture
def visit(server):
    with chromium.visit(f"http://localhost:{server.get_port()}") as visit:
        visit.page.wait_for_selector("canvas")
        yield visit
        assert not visit.errors
        assert not visit.strangers


def until(condition, what, timeout=20.0):
    """Wait for a condition and return its value."""
    end = monotonic() + timeout
    while not (value := condition()):
        assert monotonic() < end, f"not in {timeout:g} s: {what}"
        sleep(0.05)
    return value


def pixel(server, page, point):
    """Position of a point of the scene on the page."""
    camera = next(iter(server.get_clients().values())).camera
    x, y, z = matrix_from_wxyz(np.asarray(camera.wxyz, float)).T @ (np.asarray(point) - np.asarray(camera.position))
    box = page.locator("canvas").first.bounding_box()
    focal = box["height"] / 2 / np.tan(camera.fov / 2)
    return box["x"] + box["width"] / 2 + focal * x / z, box["y"] + box["height"] / 2 + focal * y / z


def drag(server, page, start, goal):
    """Drag from one point of the scene to another."""
    grip, goal = (np.array(pixel(server, page, point)) for point in (start, goal))
    page.mouse.move(*grip)
    page.mouse.down()
    for fraction in np.linspace(0, 1, 12):
        page.mouse.move(*(grip + fraction * (goal - grip)))
        sleep(0.02)
    page.mouse.up()


def picture(page):
    """The scene without the panel and the notice about software rendering, in a coarse grid."""
    whole = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    scene = whole.crop((0, 200, 600, 700))
    return np.asarray(scene.resize((75, 62), Image.Resampling.BOX), float)


def still_picture(page):
    """The picture once it no longer changes."""
    before = picture(page)
    for _ in range(20):
        sleep(0.5)
        after = picture(page)
        if np.abs(after - before).max() < 2:
            return after
        before = after
    raise AssertionError("the picture never comes to rest")


def test_an_arm_follows_handle_swivel_and_branch(server, visit, repository):
    page, arm = visit.page, ArmPage(server, MODEL)
    until(lambda: jaxik.Status.OK.message in page.inner_text("body"), "the description")
    before = still_picture(page)
    golden = repository / "tests" / "golden" / "viewer.png"
    if not golden.exists():
        Image.fromarray(before.astype(np.uint8)).save(golden)
        pytest.fail(f"{golden} was missing and is written: look at it, commit it, run again")
    wanted = np.asarray(Image.open(golden).convert("RGB"), float)
    # Another version of the browser blends a little differently; an arm elsewhere changes a tenth of the picture.
    assert np.abs(before - wanted).mean() < 3
    assert (np.abs(before - wanted).max(-1) > 40).mean() < 0.02

    start, along = arm.state.position, arm.state.rotation[:, 2]
    size = arm.scene.skeleton.length
    drag(server, page, *(start + reach * size * along for reach in (0.15, 0.25)))
    until(lambda: np.linalg.norm(arm.state.position - start) > 0.05 * size, "the handle moves")
    assert arm.wait()
    moved = arm.state.position - start
    np.testing.assert_allclose(moved - along * (along @ moved), 0, atol=1e-4)
    assert 0.05 * size < along @ moved < 0.2 * size
    assert arm.scene.status_here == jaxik.Status.OK
    np.testing.assert_allclose(arm.scene.points[3], arm.state.position, atol=1e-6)
    assert (np.abs(still_picture(page) - before).max(-1) > 40).mean() > 0.01

    swivel = arm.state.swivel
    page.get_by_role("slider").first.focus()
    for _ in range(20):
        page.keyboard.press("ArrowRight")
    until(
        lambda: np.isclose(arm.state.swivel - swivel, np.radians(10), atol=np.radians(0.6)), "the swivel grows by 10°"
    )
    assert arm.wait()
    other = min({*range(8)} - {*arm.scene.feasible_branches}, default=(arm.state.branch + 1) % 8)
    page.get_by_role("button", name=str(other), exact=True).click()
    until(lambda: arm.state.branch == other, "the branch clicked")
    assert arm.wait()
    until(lambda: arm.scene.status_here.message in page.inner_text("body"), "the description of that branch")
    page.get_by_role("button", name="nearest feasible").click()
    until(lambda: jaxik.Status.OK.message in page.inner_text("body"), "a feasible posture")
    arm.close()


def test_of_two_arms_the_one_moves_whose_handle_is_dragged(server, visit):
    page, arms = visit.page, ArmsPage(server, [MODEL, jaxik.presets.iiwa7()])
    first, second = arms.pages
    until(lambda: jaxik.Status.OK.message in page.inner_text("body"), "the description")
    still_picture(page)
    size = second.scene.skeleton.length
    place = np.array([0.0, first.scene.skeleton.length + size, 0.0])
    start, kept, along = second.state.position, first.state.position, second.state.rotation[:, 2]
    drag(server, page, *(place + start + reach * size * along for reach in (0.15, 0.25)))
    until(lambda: np.linalg.norm(second.state.position - start) > 0.05 * size, "the handle moves")
    assert arms.wait()
    moved = second.state.position - start  # in the arm's own base frame
    np.testing.assert_allclose(moved - along * (along @ moved), 0, atol=1e-4)
    np.testing.assert_allclose(second.scene.points[3], second.state.position, atol=1e-6)
    np.testing.assert_array_equal(first.state.position, kept)
    page.get_by_role("tab", name=MODEL.name).wait_for()
    page.get_by_role("tab", name=second.state.model.name).click()
    until(lambda: page.get_by_role("slider").last.is_visible(), "the panel of the second arm")
    arms.close()


def test_a_motion_is_played_scrubbed_and_compared(server, visit):
    time = np.linspace(0.0, 4.0, 17)
    q = np.array([0.3, 0.5, 0.2, -1.2, 0.1, 0.9, 0.0]) + 0.3 * np.sin(time[:, None] + np.arange(7))
    motion = jaxik.Trajectory(time, q, MODEL.joint_names, MODEL.name)
    page, shown = visit.page, PlanPage(server, [ShownMotion(MODEL, motion, "this motion")])
    until(lambda: "Play" in page.inner_text("body"), "the panel")
    assert shown.complete.wait(300)
    for text in ("this motion", "swivel fixed at", "greedy"):
        until(lambda text=text: text in page.inner_text("body"), text)
    page.get_by_role("img", name="energy map").wait_for()
    before = still_picture(page)
    page.get_by_role("button", name="Play").click()
    until(lambda: shown.head.time > 0.5, "it plays")
    page.get_by_role("button", name="Pause").click()
    until(lambda: not shown.head.playing, "it pauses")
    assert (np.abs(still_picture(page) - before).max(-1) > 40).mean() > 0.005
    start_time = shown.head.time
    page.get_by_role("slider").first.focus()
    for _ in range(50):
        page.keyboard.press("ArrowRight")
    until(lambda: shown.head.time > start_time + 0.15, "it is scrubbed")
    shown.close()


def test_a_port_in_use_is_passed_over(server):
    other = open_server(port=server.get_port())
    assert other.get_port() != server.get_port()
    close_server(other)
