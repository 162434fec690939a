"""Simpler motions along the same path, the cursor of the energy map, the meshes of a URDF."""

import numpy as np
import pytest

import jaxik
from jaxik.view import draw_energy_map, urdf_meshes
from jaxik.view.alternatives import fixed_swivel, given_motion, greedy, path_of
from jaxik.view.map_image import MapImage
from tests.helpers.urdf_text import iiwa_urdf

MODEL = jaxik.presets.iiwa14()
TIME = np.linspace(0.0, 2.0, 9)
Q = np.array([0.3, 0.5, 0.2, -1.2, 0.1, 0.9, 0.0]) + 0.2 * np.sin(TIME[:, None] + np.arange(7))
TRAJECTORY = jaxik.Trajectory(TIME, Q, MODEL.joint_names, MODEL.name)


def test_simpler_motions_follow_the_same_path():
    own, held, walked = (find(MODEL.arm, TRAJECTORY) for find in (given_motion, fixed_swivel, greedy))
    for motion in (own, held, walked):
        reached = jaxik.forward_kinematics(MODEL.arm, motion.trajectory.q)
        np.testing.assert_allclose(reached.position, path_of(MODEL.arm, TRAJECTORY).target.position, atol=1e-7)
        cost = jaxik.energy.joint_motion()(MODEL.arm, motion.trajectory.q, TIME)
        assert motion.energy == pytest.approx(float(cost))
        assert motion.ok
        assert "rad²/s" in motion.caption()
    np.testing.assert_allclose(own.trajectory.q, Q)
    turns = np.exp(1j * held.trajectory.swivel)
    np.testing.assert_allclose(turns, turns[0], atol=1e-6)
    first, second = walked.trajectory.q[:2]
    nearest = jaxik.solve_nearest(MODEL.arm, jaxik.forward_kinematics(MODEL.arm, Q[1]), first)
    np.testing.assert_allclose(second, nearest.q, atol=1e-9)


def test_the_cursor_stands_where_its_time_is():
    costs = jaxik.EnergyMap(TIME, np.linspace(-np.pi, np.pi, 24, endpoint=False), np.ones((9, 24)), "J")
    motion = given_motion(MODEL.arm, TRAJECTORY).trajectory
    image = MapImage.of(draw_energy_map(costs, motion, {"other": motion}, size=(4.6, 3.7)))
    assert image.png[:4] == b"\x89PNG"
    assert image.aspect == pytest.approx(3.7 / 4.6)
    places = [image.place(t) for t in (-5.0, 0.0, 1.0, 2.0, 7.0)]
    assert places[0] == places[1] < places[2] < places[3] == places[4] < 1
    assert f"left:{100 * places[2]:.2f}%" in image.cursor_html(1.0)


LOST = '<visual><geometry><mesh filename="package://nowhere/none.stl"/></geometry></visual>'
BOX = '<visual><origin xyz="0 0 0.1"/><geometry><box size="0.1 0.2 0.3"/></geometry></visual>'


def urdf(tmp_path, shapes):
    """An iiwa whose links show what is given for them, and nothing else."""
    text = iiwa_urdf(14)
    assert text.count(LOST) == 9
    for name in ("link_0", *(f"link_{i}" for i in range(1, 8)), "flange"):
        start = text.index(f'<link name="{name}">')
        text = text[:start] + text[start:].replace(LOST, shapes.get(name, ""), 1)
    file = tmp_path / "arm.urdf"
    file.write_text(text)
    return file


def test_a_urdf_s_shapes_hang_on_the_links_that_carry_them(tmp_path):
    meshes = urdf_meshes(urdf(tmp_path, {"link_3": BOX, "flange": BOX}), "link_0", "flange")
    assert [mesh is not None for mesh in meshes] == [False] * 3 + [True] + [False] * 3 + [True]
    # At zero angles the iiwa stands upright, its flange at 1.306 m.
    np.testing.assert_allclose(meshes[7].bounds[:, 2], [1.306 - 0.05, 1.306 + 0.25], atol=1e-6)


def test_a_urdf_without_shapes_has_no_meshes_and_a_missing_mesh_is_said(tmp_path):
    assert urdf_meshes(urdf(tmp_path, {}), "link_0", "flange") is None
    with pytest.raises(jaxik.FileFormatError, match=r"none\.stl"):
        urdf_meshes(urdf(tmp_path, {"link_2": LOST}), "link_0", "flange")
