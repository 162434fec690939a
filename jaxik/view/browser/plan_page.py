"""Page of a trajectory: playback, the energy map with a cursor, and simpler motions for comparison."""

import threading
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from jaxik.energy import Energy
from jaxik.planning import energy_map
from jaxik.trajectories import Trajectory
from jaxik.view.alternatives import Motion, fixed_swivel, given_motion, greedy, path_of
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

_FRAME_TIME = 1 / 40  # [s]
_MAP_SIZE = (4.6, 3.7)  # [inch]; text of 9 pt is legible at the width of the panel
_INFEASIBLE = (226, 150, 158, 255)
COOL, WARM = (42, 111, 151), (209, 73, 91)


class PlanPage:
    """Playback of a trajectory. The arm appears at once; the map and simpler motions follow when they are computed.

    Args:
        server: Server by :func:`jaxik.view.browser.open_server`.
        model: The arm.
        trajectory: The motion.
        energy: Energy for the map and the comparison; None for :func:`jaxik.energy.joint_motion`.
        meshes: One mesh or None per link, as for :class:`jaxik.view.browser.ArmPage`.
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
        self._offset = _offset_between(self._skeleton, tool)
        self._shown: list[tuple[Trajectory, Body]] = []
        self._map: MapImage | None = None
        self._lock, self._ended, self.complete = threading.Lock(), threading.Event(), threading.Event()
        self._add_panel()
        self._show(trajectory, "/planned", "this motion", LINK)
        _set_camera(server, self._skeleton, tool, self._offset)
        self._threads = [threading.Thread(target=f, daemon=True) for f in (self._compute, self._run)]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Stop the playback, and stop computing simpler motions after the current one, see :attr:`busy`."""
        self._ended.set()
        self._threads[1].join(5.0)

    @property
    def busy(self) -> bool:
        """True while simpler motions are being computed."""
        return self._threads[0].is_alive()

    def draw(self, time: float) -> None:
        """Draw every arm at a given time.

        Args:
            time: Time of the trajectory [s].
        """
        with self._lock, self.server.atomic():
            for trajectory, body in self._shown:
                body.move(trajectory.sample(time))
            self._gauges.content = joint_gauges(self.model, self.trajectory.sample(time))
            if self._map is not None:
                self._cursor.content = self._map.cursor_html(time)

    def _run(self) -> None:
        """Advance the playhead and draw changes."""
        before, drawn = perf_counter(), np.nan
        while not self._ended.wait(max(0.0, before + _FRAME_TIME - perf_counter())):
            now = perf_counter()
            time, before = self.head.advance(now - before), now
            if time != drawn:
                self.draw(time)
                drawn = time
                if abs(self.slider.value - time) > self.slider.step:  # leave a slider that is being dragged alone
                    self.slider.value = time

    def _compute(self) -> None:
        """Compute the map and the simpler motions, and show each as soon as it is done."""
        arm = self.model.arm
        try:
            own = given_motion(arm, self.trajectory, self._energy)
            self.motions.append(own)
            self._say("drawing the energy map")
            costs = energy_map(arm, path_of(arm, self.trajectory), own.trajectory.branch, energy=self._energy)  # pyright: ignore
            self._put_map(draw_energy_map(costs, own.trajectory, size=_MAP_SIZE))
            for name, find in (("the best fixed swivel", fixed_swivel), ("the greedy motion", greedy)):
                if self._ended.is_set():
                    return
                self._say(f"computing {name}")
                motion = find(arm, self.trajectory, self._energy)
                self.motions.append(motion)
                color = LINK if motion.ok else _INFEASIBLE
                self._show(motion.trajectory, f"/other_{len(self.motions)}", motion.name.partition(":")[0], color)
            others = {m.name: m.trajectory for m in self.motions[1:]}
            self._put_map(draw_energy_map(costs, own.trajectory, others, size=_MAP_SIZE))
            self._say("")
        except Exception as error:  # the playback goes on; report what is missing
            self._say(f"comparison failed: {error}")
        self.complete.set()

    def _put_map(self, figure: "Figure") -> None:
        """Show a map."""
        with self._lock:
            self._map = MapImage.of(figure)
            self._picture.content = self._map.html()
        self.draw(self.head.time)

    def _say(self, doing: str) -> None:
        """Show the motions computed so far and the current activity."""
        lines = [f"- {motion.caption()}" for motion in self.motions]
        self._comparison.content = "\n".join([*lines, "", f"*{doing} …*" if doing else ""])

    def _show(self, trajectory: Trajectory, name: str, caption: str, color: tuple[int, int, int, int]) -> None:
        """Add an arm beside the others, with the paths of its tool and elbow."""
        offset = len(self._shown) * self._offset
        body = Body(self.server, name, self._skeleton, self._meshes, tuple(offset), color)
        points, size = self._skeleton.posture(trajectory.q), self._skeleton.length
        for part, line, tint in (("tool", points[:, 3], COOL), ("elbow", points[:, 1], WARM)):
            pieces = np.stack([line[:-1], line[1:]], axis=1)
            self.server.scene.add_line_segments(f"{name}/path_of_{part}", pieces, tint, thickness=0.006 * size)
        top = points.reshape(-1, 3).max(0)[2] + 0.22 * size
        self.server.scene.add_label(
            f"{name}/label", caption, position=(*points[0, 0, :2], top), anchor="bottom-center", font_screen_scale=0.9
        )
        with self._lock:
            self._shown.append((trajectory, body))
        self.draw(self.head.time)

    def _add_panel(self) -> None:
        gui, head = self.server.gui, self.head
        gui.set_panel_label(f"jaxik: {self.model.name}, {head.end - head.start:.1f} s")
        self.play = gui.add_button("Play")
        step = max((head.end - head.start) / 1000, 1e-3)
        self.slider = gui.add_slider("time [s]", head.start, head.end, step, head.start)
        self.speed = gui.add_slider("speed", 0.1, 4.0, 0.1, 1.0)
        self._picture, self._cursor = gui.add_html(""), gui.add_html("")
        with gui.add_folder("Comparison"):
            self._comparison = gui.add_markdown("*computing …*")
        with gui.add_folder("Joint angles of this motion"):
            self._gauges = gui.add_html("")
        size = self._skeleton.length
        self.server.scene.add_grid(
            "/floor", 4 * size, 4 * size, plane="xy", cell_size=size / 8, section_size=size / 2,
            position=(*self._offset[:2], min(0.0, float(self._skeleton.points[0, 2]) - size)),
        )  # fmt: skip

        @self.play.on_click
        async def _(event: "viser.GuiEvent") -> None:
            head.playing = not head.playing
            self.play.label = "Pause" if head.playing else "Play"

        @self.slider.on_update
        async def _(event: "viser.GuiEvent") -> None:
            if event.client is not None:  # ignore changes made by this page
                head.seek(float(self.slider.value))

        @self.speed.on_update
        async def _(event: "viser.GuiEvent") -> None:
            head.speed = float(self.speed.value)


def _offset_between(skeleton: Skeleton, tool: np.ndarray) -> np.ndarray:
    """Offset between neighboring arms: perpendicular to their reach, and wide enough that they do not overlap."""
    ahead = tool.mean(0)[:2] - skeleton.points[0, :2]
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    across = np.array([ahead[1], -ahead[0], 0.0])
    spread = np.concatenate([tool @ across, [skeleton.points[0] @ across]])
    return across * max(float(np.ptp(spread)) + 0.35 * skeleton.length, 0.8 * skeleton.length)


def _set_camera(server: "viser.ViserServer", skeleton: Skeleton, tool: np.ndarray, offset: np.ndarray) -> None:
    """View the arms from behind, so that writing is not mirrored, centered on the second one."""
    middle = (tool.mean(0) + skeleton.points[0]) / 2 + offset
    across = offset / np.linalg.norm(offset)
    ahead = np.array([-across[1], across[0], 0.0])
    width = 2 * float(np.linalg.norm(offset)) + 0.8 * skeleton.length
    server.initial_camera.position = tuple(middle - 0.82 * width * ahead + np.array([0.0, 0.0, 0.25 * width]))
    server.initial_camera.look_at = tuple(middle)
