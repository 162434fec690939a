"""Simpler motions along the same path, the cursor of the energy map, the meshes of a URDF."""

import numpy as np
import pytest

import jaxik
from jaxik.view import draw_energy_map, urdf_meshes
from jaxik.view.alternatives import fixed_swivel, given_motion, greedy, path_of
from jaxik.view.browser.body import plain_meshes
from jaxik.view.map_image import MapImage
from jaxik.view.skeleton import Skeleton
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


def test_a_urdf_without_shapes_has_no_meshes(tmp_path):
    assert urdf_meshes(urdf(tmp_path, {}), "link_0", "flange") is None


def test_a_link_whose_mesh_is_missing_or_damaged_is_drawn_plain_with_a_warning(tmp_path):
    (tmp_path / "broken.stl").write_bytes(b"solid nothing" + bytes(range(256)))
    broken = LOST.replace("package://nowhere/none.stl", "broken.stl")
    file = urdf(tmp_path, {"link_1": BOX + LOST, "link_3": BOX, "link_4": LOST, "link_7": broken})
    with pytest.warns(jaxik.JaxikWarning, match=r"arm\.urdf: 3 shapes cannot be drawn .*none\.stl.*links .* plain"):
        meshes = urdf_meshes(file, "link_0", "flange")
    plain = plain_meshes(Skeleton.of(jaxik.load_urdf(file, "link_0", "flange").arm))
    assert [mesh is not None for mesh in meshes] == [False, True, False, True, True, False, False, True]
    for drawn in (4, 7):
        np.testing.assert_allclose(meshes[drawn].bounds, plain[drawn].bounds)
    np.testing.assert_allclose(meshes[1].extents, [0.1, 0.2, 0.3], atol=1e-9)
    with pytest.warns(jaxik.JaxikWarning, match="1 shapes cannot be drawn"):
        assert urdf_meshes(urdf(tmp_path, {"link_2": LOST}), "link_0", "flange") is None


def test_capsules_colors_and_shapes_of_other_programs(tmp_path):
    shape = '<visual><geometry><{}/></geometry><material name="a"><color rgba="1 0 0 1"/></material></visual>'
    capsule = shape.format('capsule radius="0.05" length="0.2"')
    file = urdf(tmp_path, {"link_0": capsule, "link_1": shape.format('sphere radius="0.1"')})
    meshes = urdf_meshes(file, "link_0", "flange")
    np.testing.assert_allclose(meshes[0].bounds, [[-0.05, -0.05, -0.15], [0.05, 0.05, 0.15]], atol=1e-3)
    assert (meshes[0].visual.face_colors == [255, 0, 0, 255]).all()
    with pytest.warns(jaxik.JaxikWarning, match=r"link_1: no shape <torus>"):
        urdf_meshes(urdf(tmp_path, {"link_1": shape.format('torus radius="0.1"')}), "link_0", "flange")
