"""Bodies and worlds: checks of their numbers, covers of shapes, and files."""

import itertools
import json

import jax
import numpy as np
import pytest
import trimesh
from scipy.optimize import nnls

import jaxik
from jaxik import Body, World
from jaxik.cli.surroundings import find_body
from jaxik.errors import FileFormatError
from jaxik.obstacles.covers import box_cover, capsule_cover, cylinder_cover
from jaxik.obstacles.hull_cover import hull_cover
from jaxik.obstacles.world_files import points_world

URDF = """<robot name="two">
  <link name="base"><collision><origin xyz="0 0 0.1"/><geometry><sphere radius="0.1"/></geometry></collision></link>
  <link name="upper"><collision><origin xyz="0 0 0.2" rpy="0 1.5707963267948966 0"/>
    <geometry><cylinder radius="0.05" length="0.4"/></geometry></collision></link>
  <link name="side"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <link name="tip">{tip}</link>
  <joint name="j1" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 1"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1"/></joint>
  <joint name="fix" type="fixed"><parent link="upper"/><child link="side"/><origin xyz="1 0 0"/></joint>
  <joint name="j2" type="revolute"><parent link="upper"/><child link="tip"/><origin xyz="0 0 1"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1"/></joint>
</robot>
"""


def covered(cover, points):
    return (np.linalg.norm(points[:, None] - cover.centers, axis=-1) <= cover.radii + 1e-12).any(axis=1)


def overhang(cover, distance, rng):
    """Largest distance of points on the spheres from a shape."""
    away = rng.normal(size=(400, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    return distance((cover.centers[:, None] + cover.radii[:, None, None] * away).reshape(-1, 3)).max()


def test_covers_hold_their_shapes_and_reach_no_farther_than_they_say(rng):
    size = np.array([0.3, 0.2, 0.11])
    box = box_cover(size, 0.02)
    assert box.overhang <= 0.02
    assert covered(box, rng.uniform(-0.5, 0.5, (4000, 3)) * size).all()
    beyond = overhang(box, lambda p: np.linalg.norm(np.maximum(np.abs(p) - size / 2, 0), axis=-1), rng)
    assert 0.5 * box.overhang < beyond <= box.overhang + 1e-12
    ends = rng.normal(size=(2, 3))
    capsule = capsule_cover(*ends, 0.1, 0.01)
    assert capsule.overhang <= 0.01
    shares = rng.uniform(0, 1, (4000, 1))
    ball = rng.normal(size=(4000, 3))
    ball *= 0.1 * rng.uniform(0, 1, (4000, 1)) / np.linalg.norm(ball, axis=1, keepdims=True)
    assert covered(capsule, ends[0] + shares * (ends[1] - ends[0]) + ball).all()
    turn, height = rng.uniform(0, 2 * np.pi, 4000), rng.uniform(-0.2, 0.2, 4000)
    tube = cylinder_cover(0.05, 0.4, 0.01)
    assert covered(tube, np.stack([0.05 * np.cos(turn), 0.05 * np.sin(turn), height], axis=-1)).all()
    assert tube.radii.max() <= 0.06
    with pytest.raises(ValueError, match=r"takes \d+ spheres for an overhang of 0\.1 mm; give a larger overhang"):
        box_cover(size, 1e-4)


@pytest.mark.parametrize("shape", ["box", "tetrahedron", "plate", "stone", "line"])
def test_hulls_are_covered_and_spheres_reach_no_farther_than_they_say(shape, rng):
    turned = np.linalg.qr(rng.normal(size=(3, 3))).Q
    corners = {
        "box": np.array([*itertools.product([0, 0.15], [0, 0.12], [0, 0.3])]),
        "tetrahedron": 0.1 * rng.normal(size=(4, 3)),
        "plate": np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.1, 0], [0.2, 0.1, 0], [0.1, 0.05, 0]]),
        "stone": rng.normal(size=(60, 3)) * [0.03, 0.03, 0.08],
        "line": np.array([[0, 0, 0], [0.1, 0, 0], [0.3, 0, 0]]),
    }[shape] @ turned
    cover = hull_cover(corners, 0.02)
    assert cover.overhang <= 0.02
    inside = rng.dirichlet(np.full(len(corners), 0.1), 3000) @ corners
    assert covered(cover, np.concatenate([inside, corners])).all()

    def distance(points):
        """From the convex combination of corners nearest to each, by least squares without negative weights."""
        rows = np.vstack([corners.T, np.full(len(corners), 100.0)])
        return np.array([nnls(rows, [*p, 100.0])[1] for p in points])

    beyond = overhang(
        cover._replace(centers=cover.centers[:20], radii=cover.radii[:20]), lambda p: distance(p[::20]), rng
    )
    assert 0.005 < beyond <= cover.overhang + 1e-9
    with pytest.raises(ValueError, match="finite vertices"):
        hull_cover(corners * np.nan, 0.02)


def test_a_mesh_that_takes_too_many_spheres_is_refused():
    with pytest.raises(
        ValueError, match=r"a mesh of 0\.2 x 0\.1 x 0\.1 m takes more than 2048 spheres .* of 1 mm; give"
    ):
        hull_cover(np.array([*itertools.product([0, 0.2], [0, 0.1], [0, 0.1])]), 0.001)


def test_a_mesh_is_read_and_scaled_and_placed(tmp_path):
    trimesh.creation.box([100.0, 60.0, 400.0]).export(tmp_path / "tip.stl")
    mesh = '<mesh filename="{}" scale="0.001 0.001 0.001"/>'
    mesh = f'<collision><origin xyz="0 0 0.1"/><geometry>{mesh}</geometry></collision>'
    file = tmp_path / "two.urdf"
    file.write_text(URDF.format(tip=mesh.format("package://tip.stl")))
    body = Body.from_urdf(file, "base", "tip", overhang=0.01)
    hand = np.array(body.link) == 2
    low, high = (np.asarray(body.centers)[hand] + s * np.asarray(body.radii)[hand, None] for s in (-1, 1))
    for end, corner in ((low.min(axis=0), [-0.05, -0.03, 1.9]), (high.max(axis=0), [0.05, 0.03, 2.3])):
        assert (np.abs(end - corner) <= 0.01 + 1e-9).all()
    assert body.notes[1] == "Body: 1 meshes of two.urdf count as their convex hulls."
    of_command = find_body(jaxik.presets.iiwa14(), str(file), "base", "tip").arm.surroundings.body
    assert max(of_command.link) > 1  # commands do not leave the mesh out, which is all there is beyond link 1
    (tmp_path / "bad.stl").write_bytes(b"solid nothing")
    for name, reason in (("bad.stl", ""), ("none.stl", "no mesh file none.stl")):
        file.write_text(URDF.format(tip=mesh.format(name)))
        with pytest.raises(
            FileFormatError, match=rf"link tip is a mesh that cannot be read \({reason}.*skip_meshes=True"
        ):
            Body.from_urdf(file, "base", "tip")


def test_a_body_is_read_from_the_shapes_of_a_urdf(tmp_path):
    file = tmp_path / "two.urdf"
    file.write_text(URDF.format(tip='<collision><geometry><sphere radius="0.03"/></geometry></collision>'))
    body = Body.from_urdf(file, "base", "tip", overhang=0.01)
    assert body.link[0] == 0
    assert body.link.count(2) == 1
    assert set(body.link) == {0, 1, 2}
    np.testing.assert_allclose(body.centers[0], [0, 0, 0.1])
    np.testing.assert_allclose(body.centers[body.link.index(2)], [0, 0, 2])
    tube = np.array([np.allclose(c[1:], [0, 1.2], atol=1e-9) for c in np.asarray(body.centers)])
    assert tube.sum() > 2
    side = np.abs(np.asarray(body.centers) - [1, 0, 1]).max(axis=1) < 0.1
    assert side.any()
    assert "reach" in body.notes[0]
    file.write_text(URDF.format(tip='<collision><geometry><mesh filename="a.stl"/></geometry></collision>'))
    with pytest.raises(FileFormatError, match=r"two\.urdf, line 6: collision 0 of link tip is a mesh that cannot"):
        Body.from_urdf(file, "base", "tip")
    assert "1 meshes" in Body.from_urdf(file, "base", "tip", skip_meshes=True).notes[1]


def test_a_body_is_read_from_curobos_yaml(tmp_path):
    urdf, file = tmp_path / "two.urdf", tmp_path / "two.yml"
    urdf.write_text(URDF.format(tip=""))
    file.write_text(
        "robot_cfg:\n  kinematics:\n    collision_spheres:\n      upper:\n        - center: [0.1, 0.0, 0.2]\n"
        "          radius: 0.05\n      tip:\n        - {center: [0, 0, 0], radius: 0.02}\n"
        "    self_collision_ignore: {base: [upper]}\n"
    )
    body = Body.from_yaml(file, urdf, "base", "tip")
    assert body.link == (1, 2)
    assert body.pairs == ((0, 1),)
    np.testing.assert_allclose(body.centers, [[0.1, 0, 1.2], [0, 0, 2]])
    file.write_text("collision_spheres: spheres/two.yml")
    with pytest.raises(FileFormatError, match=r"they are in spheres/two\.yml: give that file"):
        Body.from_yaml(file, urdf, "base", "tip")
    file.write_text("collision_spheres: {upper: [{center: [0, 0], radius: 1}]}")
    with pytest.raises(FileFormatError, match=r"sphere 0 of link upper needs a center of three numbers and a radius"):
        Body.from_yaml(file, urdf, "base", "tip")


def test_worlds_are_read_from_shapes_and_points_and_saved(tmp_path, rng):
    file = tmp_path / "world.json"
    shapes = {
        "spheres": [{"center": [1, 2, 3], "radius": 0.5}],
        "boxes": [{"center": [0, 0, 1], "size": [0.1, 0.2, 0.3], "rpy": [0, 0, 1.5707963267948966]}],
        "capsules": [{"from": [0, 0, 0], "to": [0, 0, 0.5], "radius": 0.1}],
        "half_spaces": [{"normal": [0, 0, -2], "offset": 1}],
        "overhang": 0.03,
    }
    file.write_text(json.dumps(shapes))
    world = jaxik.load_world(file)
    np.testing.assert_allclose(world.centers[0], [1, 2, 3])
    np.testing.assert_allclose(world.normals, [[0, 0, -1]])
    np.testing.assert_allclose(world.offsets, [0.5])
    inside = [0, 0, 1] + rng.uniform(-0.5, 0.5, (500, 3)) * [0.2, 0.1, 0.3]
    assert (np.linalg.norm(inside[:, None] - world.centers, axis=-1) <= world.radii).any(axis=1).all()
    jaxik.save_world(world, tmp_path / "again.json")
    again = jaxik.load_world(tmp_path / "again.json")
    for one, other in zip(jax.tree.leaves(world), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(one, other)
    points = rng.uniform(0, 1, (200, 3))
    np.save(tmp_path / "points.npy", points)
    np.testing.assert_array_equal(jaxik.load_world(tmp_path / "points.npy", radius=0.1).centers, points)
    (tmp_path / "points.csv").write_text("x,y,z\n" + "\n".join(",".join(map(str, p)) for p in points))
    np.testing.assert_array_equal(jaxik.load_world(tmp_path / "points.csv").centers, points)
    thin = points_world(points, 0.01, 0.25)
    assert len(thin.radii) <= 64
    away = np.linalg.norm(points[:, None] - np.asarray(thin.centers), axis=-1) - np.asarray(thin.radii)
    assert away.min(axis=1).max() <= -0.01 + 1e-12


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[1]", r"expected an object with spheres"),
        ("{", r"not valid JSON"),
        ('{"cones": []}', r"unknown cones; known are spheres"),
        ('{"spheres": [{"center": [0, 0, 0]}]}', r"spheres 0 needs radius, a number"),
        ('{"boxes": [{"center": [0, 0], "size": [1, 1, 1]}]}', r"boxes 0 needs center, three numbers"),
        ('{"half_spaces": [{"normal": [0, 0, 0], "offset": 1}]}', r"half_spaces 0 has a normal without length"),
    ],
)
def test_a_bad_world_file_says_what_is_wrong(tmp_path, content, message):
    file = tmp_path / "world.json"
    file.write_text(content)
    with pytest.raises(FileFormatError, match=message):
        jaxik.load_world(file)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: World([[0, 0]], 0.1), r"expected World\.centers of shape \(\*batch, n, 3\), got \(1, 2\)"),
        (lambda: World([[0, 0, 0]]), r"World\.centers needs World\.radii"),
        (lambda: World([[0, 0, np.nan]], 0.1), r"World\.centers has a number that is not finite"),
        (lambda: World(np.zeros((2, 3)), np.ones(3)), r"World\.radii of shape \(3,\) does not fit centers"),
        (lambda: World(normals=[[0, 0, 2]], offsets=[0]), r"needs unit vectors; got one of length 2"),
        (lambda: Body(np.array([3.5]), [[0, 0, 0]], 1), r"Body\.link needs one whole number per sphere"),
        (lambda: Body([9], [[0, 0, 0]], 1), r"Body\.link counts joints, 0 to 7; got 9 to 9"),
        (lambda: Body([3], [[0, 0]], 1), r"needs centers \(1, 3\) and radii \(1,\); got \(1, 2\)"),
        (lambda: Body([3, 4], np.zeros((2, 3)), 1, [(0, 2)]), r"needs two different spheres of 0 to 1 each"),
        (lambda: Body.preset("iiwa7"), r"no body for 'iiwa7': there are those of iiwa14"),
        (lambda: jaxik.clearance(jaxik.presets.iiwa7(), np.zeros(7)), r"a world needs the arm's body"),
        (
            lambda: jaxik.with_body(jaxik.presets.meccanoid(), Body([7], [[0, 0, 0]], 1)),
            r"Body\.link 7 is no link of an arm with 6 joints",
        ),
    ],
)
def test_bad_numbers_say_what_was_expected(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_spheres_off_their_axes_grow_to_cover_what_they_did():
    arm = jaxik.presets.iiwa14()
    body = Body([1, 2, 5, 6, 7], [[0.1, 0, 0.2], [0, 0.05, 0.5], [0.02, 0, 1.1], [0, 0.03, 1.2], [0.04, 0, 1.3]], 0.05)
    model = jaxik.with_body(arm, body)
    held = model.arm.surroundings.body
    assert held.link == (1, 3, 4, 7, 7)
    np.testing.assert_allclose(held.radii, [0.15, 0.1, 0.07, 0.08, 0.05])
    np.testing.assert_allclose(held.centers[:4, :2], 0, atol=1e-15)
    assert (
        model.notes[-1] == "Body: spheres of links 1, 2, 5 and 6 were moved to their axes and grew by up to 100.0 mm."
    )


def test_a_model_with_a_body_is_not_saved_without_it(tmp_path):
    model = jaxik.with_body(jaxik.presets.iiwa14(), Body.preset("iiwa14"))
    with pytest.raises(ValueError, match=r"a model file holds no body: save the model as it was before"):
        jaxik.save_model(model, tmp_path / "model.json")


@pytest.mark.parametrize("name", ["iiwa14", "meccanoid_left", "meccanoid_right"])
def test_preset_bodies_are_free_at_zero(name):
    model = jaxik.presets.iiwa14() if name == "iiwa14" else jaxik.presets.meccanoid(name.split("_")[1])
    model = jaxik.with_body(model, Body.preset(name))
    assert jaxik.clearance(model, np.zeros(model.arm.n_joints)).distance > 0.01
