"""Page of trajectories: playback and, of a single one, the energy map with a cursor and simpler motions beside it."""

import threading
from collections.abc import Sequence
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from jaxik.energy import Energy
from jaxik.planning import energy_map
from jaxik.redundancy import has_swivel
from jaxik.view.alternatives import Motion, fixed_swivel, given_motion, greedy, path_of
from jaxik.view.browser.body import LINK
from jaxik.view.browser.gauges import joint_gauges
from jaxik.view.browser.stage import ShownMotion, Stage
from jaxik.view.map_image import MapImage
from jaxik.view.map_picture import draw_energy_map
from jaxik.view.playhead import Playhead

if TYPE_CHECKING:
    import viser
    from matplotlib.figure import Figure

_FRAME_TIME = 1 / 40  # [s]
_MAP_SIZE = (4.6, 3.7)  # [inch]; text of 9 pt is legible at the width of the panel
_INFEASIBLE = (226, 150, 158, 255)


class PlanPage:
    """Playback of motions, side by side.

    The arms appear at once. A single motion of an S-R-S arm is compared with simpler ones: the map and these follow
    when they are computed.

    Args:
        server: Server by :func:`jaxik.view.browser.open_server`.
        motions: The motions.
        energy: Energy for the map and the comparison; None for :func:`jaxik.energy.joint_motion`.
    """

    def __init__(
        self, server: "viser.ViserServer", motions: Sequence[ShownMotion], energy: Energy | None = None
    ) -> None:
        self.server, self._energy, self._given = server, energy, tuple(motions)
        self.compared = len(motions) == 1 and has_swivel(motions[0].model.arm)
        self.motions: list[Motion] = []
        self.stage = Stage(server, motions, places=3 if self.compared else None)
        self.head = Playhead(self.stage.start, self.stage.end, self.stage.start)
        self._map: MapImage | None = None
        self._lock, self._ended, self.complete = threading.Lock(), threading.Event(), threading.Event()
        self._add_panel()
        self.draw(self.head.time)
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
        self.stage.draw(time)
        with self._lock, self.server.atomic():
            for gauges, motion in zip(self._gauges, self._given, strict=True):
                gauges.content = joint_gauges(motion.model, motion.trajectory.sample(time))
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
        if not self.compared:
            self.complete.set()
            return
        (given,) = self._given
        arm, trajectory = given.model.arm, given.trajectory
        try:
            own = given_motion(arm, trajectory, self._energy)
            self.motions.append(own)
            self._say("drawing the energy map")
            around = None if arm.surroundings is None else given.world  # what it blocks is gray in the map
            path = path_of(arm, trajectory)
            costs = energy_map(arm, path, own.trajectory.branch, energy=self._energy, world=around)  # pyright: ignore
            self._put_map(draw_energy_map(costs, own.trajectory, size=_MAP_SIZE))
            for name, find in (("the best fixed swivel", fixed_swivel), ("the greedy motion", greedy)):
                if self._ended.is_set():
                    return
                self._say(f"computing {name}")
                motion = find(arm, trajectory, self._energy)
                self.motions.append(motion)
                color, caption = LINK if motion.ok else _INFEASIBLE, motion.name.partition(":")[0]
                self.stage.add(replace(given, trajectory=motion.trajectory, caption=caption, color=color))
                self.stage.draw(self.head.time)
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

    def _add_panel(self) -> None:
        gui, head = self.server.gui, self.head
        names = ", ".join(dict.fromkeys(motion.model.name for motion in self._given))
        gui.set_panel_label(f"jaxik: {names}, {head.end - head.start:.1f} s")
        self.play = gui.add_button("Play")
        step = max((head.end - head.start) / 1000, 1e-3)
        self.slider = gui.add_slider("time [s]", head.start, head.end, step, head.start)
        self.speed = gui.add_slider("speed", 0.1, 4.0, 0.1, 1.0)
        self._picture, self._cursor = gui.add_html(""), gui.add_html("")
        if self.compared:
            with gui.add_folder("Comparison"):
                self._comparison = gui.add_markdown("*computing …*")
        self._gauges = []
        for motion in self._given:
            of = "this motion" if len(self._given) == 1 else motion.caption
            with gui.add_folder(f"Joint angles of {of}"):
                self._gauges.append(gui.add_html(""))

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
