"""The page of a motion: play, pause, scrub and speed, the energy map with a cursor, and simpler motions beside it."""

import threading
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from jaxik.energy import Energy
from jaxik.planning.energy_map import energy_map
from jaxik.trajectories import Trajectory
from jaxik.view.alternatives import Motion, as_it_is, fixed_swivel, greedy, path_of
from jaxik.view.browser.body import LINK, Body
from jaxik.view.browser.gauges import joint_gauges
from jaxik.view.map_image import MapImage
from jaxik.view.map_picture import draw_energy_map
from jaxik.view.playhead import Playhead
from jaxik.view.skeleton import Skeleton

if TYPE_CHECKING:
    import trimesh
    import viser
    from matplotlib.figure import Figure

    from jaxik.arm import ArmModel

_FRAME_S = 1 / 40  # a little faster than the eye asks for
_MAP_SIZE = (4.6, 3.7)  # inch: letters of 9 pt are legible at the panel's width
_BROKEN = (226, 150, 158, 255)
COOL, WARM = (42, 111, 151), (209, 73, 91)


class PlanPage:
    """A motion to watch. The arm is there at once; map and simpler motions follow as they are worked out.

    Args:
        server: From :func:`jaxik.view.browser.open_server`.
        model: The arm.
        trajectory: The motion.
        energy: What the map shows and motions are compared by; None for :func:`jaxik.energy.joint_motion`.
        meshes: The links' meshes, as for :class:`jaxik.view.browser.body.Body`.
    """

    def __init__(
        self,
        server: "viser.ViserServer",
        model: "ArmModel",
        trajectory: Trajectory,
        energy: Energy | None = None,
        meshes: "list[trimesh.Trimesh | None] | None" = None,
    ) -> None:
        self.server, self.model, self._energy, self._meshes = server, model, energy, meshes
        self.trajectory = trajectory
        self.motions: list[Motion] = []
        first, last = float(trajectory.time[0]), float(trajectory.time[-1])
        self.head = Playhead(first, last, first)
        self._skeleton = Skeleton.of(model.arm)
        tool = self._skeleton.posture(trajectory.q)[:, 3]
        self._aside = _side_step(self._skeleton, tool)
        self._shown: list[tuple[Trajectory, Body]] = []
        self._map: MapImage | None = None
        self._lock, self._ended, self.complete = threading.Lock(), threading.Event(), threading.Event()
        self._add_panel()
        self._show(trajectory, "/planned", "this motion", LINK)
        _look_from(server, self._skeleton, tool, self._aside)
        self._threads = [threading.Thread(target=f, daemon=True) for f in (self._work_out, self._run)]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Stops playing, and working out simpler motions as soon as the one at hand is done: see :attr:`busy`."""
        self._ended.set()
        self._threads[1].join(5.0)

    @property
    def busy(self) -> bool:
        """Whether simpler motions are still worked out."""
        return self._threads[0].is_alive()

    def draw(self, at_s: float) -> None:
        """Draws every arm as it is at a time [s]."""
        with self._lock, self.server.atomic():
            for trajectory, body in self._shown:
                body.move(trajectory.sample(at_s))
            self._gauges.content = joint_gauges(self.model, self.trajectory.sample(at_s))
            if self._map is not None:
                self._cursor.content = self._map.cursor_html(at_s)

    def _run(self) -> None:
        """Moves the playhead on and draws what has changed."""
        before, drawn = perf_counter(), np.nan
        while not self._ended.wait(max(0.0, before + _FRAME_S - perf_counter())):
            now = perf_counter()
            at_s, before = self.head.advance(now - before), now
            if at_s != drawn:
                self.draw(at_s)
                drawn = at_s
                if abs(self.slider.value - at_s) > self.slider.step:  # not while a hand moves it: it is there already
                    self.slider.value = at_s

    def _work_out(self) -> None:
        """Map and simpler motions, one after the other, each shown when it is there."""
        arm = self.model.arm
        try:
            own = as_it_is(arm, self.trajectory, self._energy)
            self.motions.append(own)
            self._say("drawing the energy map")
            costs = energy_map(arm, path_of(arm, self.trajectory), own.trajectory.branch, energy=self._energy)  # pyright: ignore
            self._put_map(draw_energy_map(costs, own.trajectory, size=_MAP_SIZE))
            for what, find in (("the best fixed swivel", fixed_swivel), ("the greedy walk", greedy)):
                if self._ended.is_set():
                    return
                self._say(f"working out {what}")
                motion = find(arm, self.trajectory, self._energy)
                self.motions.append(motion)
                color = LINK if motion.ok else _BROKEN
                self._show(motion.trajectory, f"/other_{len(self.motions)}", motion.name.partition(":")[0], color)
            others = {m.name: m.trajectory for m in self.motions[1:]}
            self._put_map(draw_energy_map(costs, own.trajectory, others, size=_MAP_SIZE))
            self._say("")
        except Exception as error:  # the motion itself is still worth watching; say what is missing
            self._say(f"not all could be worked out: {error}")
        self.complete.set()

    def _put_map(self, figure: "Figure") -> None:
        """Shows a map."""
        with self._lock:
            self._map = MapImage.of(figure)
            self._picture.content = self._map.html()
        self.draw(self.head.at_s)

    def _say(self, doing: str) -> None:
        """What there is to compare, and what is being done."""
        lines = [f"- {motion.caption()}" for motion in self.motions]
        self._words.content = "\n".join([*lines, "", f"*{doing} …*" if doing else ""])

    def _show(self, trajectory: Trajectory, name: str, caption: str, color: tuple[int, int, int, int]) -> None:
        """Adds an arm beside those that are there, with the ways of its tool and elbow."""
        offset = len(self._shown) * self._aside
        body = Body(self.server, name, self._skeleton, self._meshes, tuple(offset), color)
        points, size = self._skeleton.posture(trajectory.q), self._skeleton.length
        for part, way, tint in (("tool", points[:, 3], COOL), ("elbow", points[:, 1], WARM)):
            pieces = np.stack([way[:-1], way[1:]], axis=1)
            self.server.scene.add_line_segments(f"{name}/way_of_{part}", pieces, tint, thickness=0.006 * size)
        top = points.reshape(-1, 3).max(0)[2] + 0.22 * size
        self.server.scene.add_label(
            f"{name}/label", caption, position=(*points[0, 0, :2], top), anchor="bottom-center", font_screen_scale=0.9
        )
        with self._lock:
            self._shown.append((trajectory, body))
        self.draw(self.head.at_s)

    def _add_panel(self) -> None:
        gui, head = self.server.gui, self.head
        gui.set_panel_label(f"jaxik: {self.model.name}, {head.end_s - head.start_s:.1f} s")
        self.play = gui.add_button("Play")
        step = max((head.end_s - head.start_s) / 1000, 1e-3)
        self.slider = gui.add_slider("time [s]", head.start_s, head.end_s, step, head.start_s)
        self.speed = gui.add_slider("speed", 0.1, 4.0, 0.1, 1.0)
        self._picture, self._cursor = gui.add_html(""), gui.add_html("")
        with gui.add_folder("Motions side by side"):
            self._words = gui.add_markdown("*working …*")
        with gui.add_folder("Joint angles of this motion"):
            self._gauges = gui.add_html("")
        size = self._skeleton.length
        self.server.scene.add_grid(
            "/floor", 4 * size, 4 * size, plane="xy", cell_size=size / 8, section_size=size / 2,
            position=(*self._aside[:2], min(0.0, float(self._skeleton.points[0, 2]) - size)),
        )  # fmt: skip

        @self.play.on_click
        async def _(event: "viser.GuiEvent") -> None:
            head.playing = not head.playing
            self.play.label = "Pause" if head.playing else "Play"

        @self.slider.on_update
        async def _(event: "viser.GuiEvent") -> None:
            if event.client is not None:  # not what this page set itself
                head.seek(float(self.slider.value))

        @self.speed.on_update
        async def _(event: "viser.GuiEvent") -> None:
            head.speed = float(self.speed.value)


def _side_step(skeleton: Skeleton, tool: np.ndarray) -> np.ndarray:
    """From one arm to the next: across the way the arm reaches, far enough that they do not meet."""
    ahead = tool.mean(0)[:2] - skeleton.points[0, :2]
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    across = np.array([ahead[1], -ahead[0], 0.0])
    spread = np.concatenate([tool @ across, [skeleton.points[0] @ across]])
    return across * max(float(np.ptp(spread)) + 0.35 * skeleton.length, 0.8 * skeleton.length)


def _look_from(server: "viser.ViserServer", skeleton: Skeleton, tool: np.ndarray, aside: np.ndarray) -> None:
    """A camera behind the arms, from where a drawing reads the right way round, the middle one in the middle."""
    middle = (tool.mean(0) + skeleton.points[0]) / 2 + aside
    across = aside / np.linalg.norm(aside)
    ahead = np.array([-across[1], across[0], 0.0])
    width = 2 * float(np.linalg.norm(aside)) + 0.8 * skeleton.length
    server.initial_camera.position = tuple(middle - 0.82 * width * ahead + np.array([0.0, 0.0, 0.25 * width]))
    server.initial_camera.look_at = tuple(middle)
