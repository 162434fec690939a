"""Latency of the viewer: python -m benchmarks.viewing.

From a new pose of the handle to the last scene update, including solving, arcs and text, but excluding the browser.
Events of a mouse come at most 60 times per second.
"""

from time import perf_counter

import jax
import numpy as np

import jaxik
from benchmarks.common import table
from jaxik.view.browser import ArmPage, PlanPage, ShownMotion, close_server, open_server

jax.config.update("jax_enable_x64", True)

MOVES = 300


def main() -> None:
    """Print a table."""
    rows = []
    for model in (jaxik.presets.iiwa14(), jaxik.presets.meccanoid(), jaxik.presets.paper_arm()):
        server = open_server(port=0)
        page = ArmPage(server, model)
        size = page.scene.skeleton.length
        rows.append((f"drag the handle, {model.name}", *_timed(page, size)))
        page.close()
        close_server(server)
    rows.append(("play a motion beside two others, iiwa14", *_played()))
    table(
        "Viewer, from an event to the last update",
        ("action", "median [ms]", "99th percentile [ms]", "frames per second"),
        rows,
    )


def _timed(page: ArmPage, size: float) -> tuple[str, str, str]:
    """Move the handle in a circle and wait for each drawing."""
    start, times = page.state, []
    for k in range(MOVES):
        turn = 2 * np.pi * k / MOVES
        offset = 0.08 * size * np.array([np.cos(turn) - 1, np.sin(turn), 0.0])
        began = perf_counter()
        page.change(position=start.position + offset)
        page.wait()
        times.append(perf_counter() - began)
    return _row(times)


def _played() -> tuple[str, str, str]:
    """Draw the frames of a motion as fast as possible."""
    model = jaxik.presets.iiwa14()
    time = np.linspace(0.0, 4.0, 17)
    q = np.array([0.3, 0.5, 0.2, -1.2, 0.1, 0.9, 0.0]) + 0.3 * np.sin(time[:, None] + np.arange(7))
    server = open_server(port=0)
    page = PlanPage(
        server, [ShownMotion(model, jaxik.Trajectory(time, q, model.joint_names, model.name), "this motion")]
    )
    page.complete.wait(300)
    times = []
    for moment in np.linspace(0.0, 4.0, MOVES):
        began = perf_counter()
        page.draw(float(moment))
        times.append(perf_counter() - began)
    page.close()
    close_server(server)
    return _row(times)


def _row(times: list[float]) -> tuple[str, str, str]:
    median, worst = np.quantile(times, [0.5, 0.99])
    return f"{1e3 * median:.2f}", f"{1e3 * worst:.2f}", f"{1 / worst:.0f} to {1 / median:.0f}"


if __name__ == "__main__":
    main()
