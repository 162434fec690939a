"""Interactive page of an arm: a handle to drag, swivel, branches, and the paper's construction in three dimensions."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jaxik.ik import Status, branch_bits
from jaxik.obstacles import World
from jaxik.targets import matrix_from_wxyz, wxyz_from_matrix
from jaxik.view.arm_scene import ArmScene, ArmState, arm_scene
from jaxik.view.browser.body import Body
from jaxik.view.browser.gauges import joint_gauges
from jaxik.view.browser.server import Latest
from jaxik.view.browser.world_view import BodySpheres, WorldView, blocker_color
from jaxik.view.elbow_curve import ITSELF, parameter_range
from jaxik.view.skeleton import Skeleton

if TYPE_CHECKING:
    import trimesh
    import viser

    from jaxik.arm import ArmModel

PALE, GREEN, WARM, COOL = (150, 160, 168), (34, 150, 84), (209, 73, 91), (42, 111, 151)
_NOTHING = np.zeros((1, 2, 3), np.float32)  # one segment of zero length, since the browser requires at least one


class ArmPage:
    """An interactive arm, of any class, among obstacles if there are some.

    Events change the state, and a single thread draws the scene that follows from it
    (:func:`jaxik.view.arm_scene.arm_scene`).

    Args:
        server: Server by :func:`jaxik.view.browser.open_server`.
        model: The arm.
        meshes: One mesh or None per link, starting at the base, at zero joint angles in the base frame (see
            :func:`jaxik.view.urdf_meshes`); plain links by default.
        world: Obstacles to drag, for an arm with a body.
        root: Node of the scene below which everything is drawn, such as ``"/place_1"``; the scene itself by default.
    """

    def __init__(
        self,
        server: "viser.ViserServer",
        model: "ArmModel",
        meshes: "list[trimesh.Trimesh | None] | None" = None,
        world: World | None = None,
        root: str = "",
    ) -> None:
        self.server, self.state, self._root = server, ArmState.start(model, world), root
        self.scene: ArmScene = arm_scene(self.state)
        self._drawing = Latest[ArmState](self.draw)
        skeleton = Skeleton.of(model.arm)
        self._body = Body(server, f"{root}/arm", skeleton, meshes)
        self._add_construction(skeleton.length)
        self._add_handle(skeleton.length)
        self._covers = None if model.arm.surroundings is None else BodySpheres(server, f"{root}/body", model.arm)
        self.world = None
        if world is not None:
            self.world = WorldView(
                server, world, skeleton.length, lambda moved: self.change(world=moved), f"{root}/world"
            )
        self._add_panel()
        _set_camera(server, self.scene)
        self.draw(self.state)

    def wait(self) -> bool:
        """Return True once everything is drawn, or False after 30 s."""
        return self._drawing.wait()

    def close(self) -> None:
        """Stop drawing."""
        self._drawing.close()

    @property
    def busy(self) -> bool:
        """True while a computation is running; always False after :meth:`close`."""
        return False

    def change(self, **fields: object) -> None:
        """Change fields of the state and draw it.

        Args:
            **fields: Fields of the state (position, rotation, swivel, branch, world) and their new values.
        """
        self.state = replace(self.state, **fields)  # pyright: ignore[reportArgumentType]
        self._drawing.put(self.state)

    def draw(self, state: ArmState) -> None:
        """Draw a state.

        Args:
            state: The user's input.
        """
        scene = self.scene = arm_scene(state)
        reached = scene.status_here <= Status.NEAR_SINGULAR
        with self.server.atomic():
            self._body.move(scene.joints)
            self._circle.points = _drawable(scene.circle())
            self._arcs.points = _drawable(scene.feasible_arcs())
            self._draw_blocked(scene)
            if self._covers is not None:
                self._covers.move(scene.joints)
            self._elbow.position = scene.points[1]
            self._elbow_feasible.visible, self._elbow_infeasible.visible = reached, not reached
            self._error.points = np.stack([scene.points[3], state.position])[None].astype(np.float32)
            if scene.has_circle:
                for ball, (center, radius) in zip(self._spheres, scene.spheres, strict=True):
                    ball.position, ball.scale = center, radius
            self._description.content = scene.description()
            self._gauges.content = joint_gauges(state.model, scene.joints)
            self._table.content = _branch_table(scene)

    def _draw_blocked(self, scene: ArmScene) -> None:
        """Color the parts of the circle that the body cannot take, by what is in the way."""
        curve = scene.curve
        blocked = (curve.blocker >= 0) | (curve.blocker == ITSELF)
        pieces, colors = curve.where(blocked), np.array([blocker_color(int(b)) for b in curve.blocker], np.uint8)
        ends = np.stack([colors[:-1], colors[1:]], axis=1)[blocked[:-1] & blocked[1:]]
        self._blocked.points = _drawable(pieces)
        self._blocked.colors = ends if len(ends) else np.zeros((1, 2, 3), np.uint8)

    def _add_construction(self, size: float) -> None:
        """Add the circle, the arcs, the elbow and the two spheres."""
        add, root = self.server.scene, self._root
        # The floor under the arm; below its reach if the base frame is in the shoulder.
        floor = min(0.0, float(self.scene.skeleton.points[0, 2]) - size)
        add.add_grid(
            f"{root}/floor", 2 * size, 2 * size, plane="xy", cell_size=size / 8, section_size=size / 2,
            position=(0, 0, floor),
        )  # fmt: skip
        self._circle = add.add_line_segments(f"{root}/circle", _NOTHING, PALE, thickness=0.004 * size)
        self._arcs = add.add_line_segments(f"{root}/feasible", _NOTHING, GREEN, thickness=0.014 * size)
        self._blocked = add.add_line_segments(
            f"{root}/blocked", _NOTHING, np.zeros((1, 2, 3), np.uint8), thickness=0.014 * size
        )
        self._error = add.add_line_segments(f"{root}/error", _NOTHING, WARM, thickness=0.006 * size)
        self._elbow = add.add_frame(f"{root}/elbow", show_axes=False)
        radius = 0.045 * size
        self._elbow_feasible = add.add_icosphere(f"{root}/elbow/feasible", radius, GREEN, cast_shadow=False)
        self._elbow_infeasible = add.add_icosphere(
            f"{root}/elbow/infeasible", radius, WARM, cast_shadow=False, visible=False
        )
        self._spheres = [
            add.add_icosphere(
                f"{root}/sphere_{name}",
                1.0,
                color,
                opacity=0.13,
                subdivisions=4,
                cast_shadow=False,
                receive_shadow=False,
            )
            for name, color in (("shoulder", COOL), ("wrist", WARM))
            if self.scene.has_circle
        ]

    def _add_handle(self, size: float) -> None:
        handle = self.server.scene.add_transform_controls(
            f"{self._root}/target",
            scale=0.22 * size,
            position=self.state.position,
            wxyz=wxyz_from_matrix(self.state.rotation),
            depth_test=False,
        )

        @handle.on_update
        async def _(event: "viser.TransformControlsEvent") -> None:  # async handlers run in order
            self.change(position=np.array(handle.position), rotation=matrix_from_wxyz(np.asarray(handle.wxyz, float)))

        self.handle = handle

    def _add_panel(self) -> None:
        gui, model = self.server.gui, self.state.model
        gui.set_panel_label(f"jaxik: {model.name}")
        self._description = gui.add_markdown("")
        name, (least, most) = self.state.parameter_name, np.round(2 * np.degrees(parameter_range(model.arm))) / 2
        self.swivel = gui.add_slider(f"{name} [°]", least, most, 0.5, self._shown_swivel())
        self.branch = gui.add_button_group("branch", tuple(str(b) for b in range(len(self.scene.q))))
        self.branch.value = str(self.state.branch)
        nearest = gui.add_button(f"Go to the nearest feasible {'swivel' if name == 'swivel' else 'angle'}")
        self._table = gui.add_html("")
        with gui.add_folder("Joint angles"):
            self._gauges = gui.add_html("")
        with gui.add_folder("Show"):
            if self.scene.has_circle:
                spheres = gui.add_checkbox("the paper's two spheres", self.world is None)
                self._show_spheres(spheres.value)
                spheres.on_update(lambda event: self._show_spheres(spheres.value))
            circle = gui.add_checkbox(f"{'circle' if self.scene.has_circle else 'curve'} and feasible arcs", True)
            if (covers := self._covers) is not None:
                cover = gui.add_checkbox("the spheres that cover the arm", False)
                cover.on_update(lambda event: setattr(covers.handle, "visible", cover.value))
        with gui.add_folder("Help", expand_by_default=False):
            gui.add_markdown(_help(self.scene))

        @self.swivel.on_update
        async def _(event: "viser.GuiEvent") -> None:
            if event.client is not None:  # ignore changes made by this page
                self.change(swivel=float(np.radians(self.swivel.value)))

        @self.branch.on_click
        async def _(event: "viser.GuiEvent") -> None:
            self.change(branch=int(self.branch.value))

        @nearest.on_click
        async def _(event: "viser.GuiEvent") -> None:
            found = self.scene.nearest_feasible()
            self.branch.value = str(found.branch)
            self.change(swivel=found.swivel, branch=found.branch)
            self.swivel.value = self._shown_swivel()

        @circle.on_update
        async def _(event: "viser.GuiEvent") -> None:
            self._circle.visible = self._arcs.visible = self._blocked.visible = circle.value

    def _shown_swivel(self) -> float:
        """Swivel of the slider, to its step [°]."""
        least, most = np.round(2 * np.degrees(parameter_range(self.state.model.arm))) / 2
        return min(max(round(2 * np.degrees(self.state.swivel)) / 2, least), most)

    def _show_spheres(self, visible: bool) -> None:
        for ball in self._spheres:
            ball.visible = visible


def _drawable(pieces: np.ndarray) -> np.ndarray:
    """Line segments for the browser, never none."""
    return pieces.astype(np.float32) if len(pieces) else _NOTHING


def _set_camera(server: "viser.ViserServer", scene: ArmScene) -> None:
    """View the arm from the side, centered in the area left of the panel."""
    size, middle = scene.skeleton.length, scene.points[:3].mean(0)
    ahead = scene.points[2] - scene.points[0]
    ahead[2] = 0.0
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    side = np.array([ahead[1], -ahead[0], 0.0])
    camera = server.initial_camera
    camera.position = tuple(middle + size * (1.45 * side + 0.55 * ahead + np.array([0.0, 0.0, 0.55])))
    camera.look_at = tuple(middle)


def _branch_table(scene: ArmScene) -> str:
    """Table of the branches with bits and status as HTML; the selected one is highlighted."""
    rows = []
    for b, status in enumerate(scene.status):
        if b >= 8 and status >= Status.UNSOLVED:  # places for second solutions, mostly empty
            continue
        name = Status(int(status)).name.lower().replace("_", " ")
        color = "#229654" if status <= Status.NEAR_SINGULAR else "#8a949b"
        highlight = "background:#e8eef3;font-weight:600;" if b == scene.state.branch else ""
        bits = "".join(f"<td style='padding:0 .5em'>{bit}</td>" for bit in map(int, branch_bits(b % 8)))
        rows.append(
            f"<tr style='{highlight}'><td>{b}</td>{bits}<td style='color:{color};padding-left:.5em'>{name}</td></tr>"
        )
    head = "<tr style='color:#667'><td>#</td><td>shoulder</td><td>elbow</td><td>wrist</td><td>&nbsp;status</td></tr>"
    style = "font-size:12px;line-height:1.35;width:100%;border-collapse:collapse;text-align:left"
    return f"<div style='padding:0 .8em .3em'><table style='{style}'>{head}{''.join(rows)}</table></div>"


def _help(scene: ArmScene) -> str:
    state, world = scene.state, _WORLD_HELP if scene.state.world is not None else ""
    if scene.has_circle:
        return _CIRCLE_HELP + world
    kind = "exact feasible" if state.model.arm.closed_form else "feasible"
    return _CURVE_HELP.format(name=state.parameter_name, kind=kind)


_CIRCLE_HELP = """
Drag the handle; the arm follows by the closed-form solution. The **swivel** moves the elbow on the gray circle, the
intersection of two spheres: one around the shoulder with the radius of the upper arm (blue), one around the wrist with
the radius of the forearm (red). The **green** arcs are the exact feasible swivels of the selected branch: all joints
are within their limits and the elbow is outside the keep-out. A red elbow marks an infeasible posture; the text above
gives the reason.
"""
_WORLD_HELP = """
Click an obstacle and drag its arrows. Parts of the circle that the arm's body cannot take have the color of the
obstacle in the way, or are black where the arm would meet itself.
"""
_CURVE_HELP = """
Drag the handle; the arm follows. The slider sets the angle of **{name}**, this arm's redundancy parameter, with the
tool held: the elbow moves on the gray curve, which is no circle for this arm. The **green** parts are the {kind} angles
of the selected branch, with all joints within their limits. A red elbow marks an infeasible posture; the text above
gives the reason.
"""
