"""Paths: validation, files, the project's own examples, placement in reach."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxik

POSE = "time,x,y,z,qw,qx,qy,qz"
ROW0, ROW1 = "0,0,0,0,1,0,0,0", "1,0.1,0,0,0.6,0.8,0,0"


def write(folder, *lines):
    file = folder / "path.csv"
    file.write_text("\n".join(lines))
    return file


def straight(count=5):
    x = jnp.linspace(0.0, 1.0, count)[:, None] * jnp.array([0.1, 0.0, 0.0])
    return jaxik.Path(jaxik.Pose(x, jnp.broadcast_to(jnp.eye(3), (count, 3, 3))), jnp.linspace(0.0, 1.0, count))


def test_pose_file_is_read_with_the_scalar_first(tmp_path):
    path = jaxik.load_path(write(tmp_path, POSE, "# a remark", ROW0, "", ROW1))
    assert len(path) == 2
    # 2 acos(0.6) about x takes y to (0, 0.36 - 0.64, 2 * 0.6 * 0.8)
    np.testing.assert_allclose(path.target.rotation[1, :, 1], [0, -0.28, 0.96], atol=1e-12)


def test_pointing_file_is_read_and_normalized(tmp_path):
    path = jaxik.load_path(write(tmp_path, "time,x,y,z,dx,dy,dz", "0,0,0,0,0,0,2", "0.5,0,0,1,3,4,0"))
    np.testing.assert_allclose(path.target.direction, [[0, 0, 1], [0.6, 0.8, 0]])


@pytest.mark.parametrize(
    ("lines", "angle"),
    [
        (["x,y,z,qw,qx,qy,qz", "0,0,0,1,0,0,0", ".03,.04,0,1,0,0,0", ".03,.04,0,.8,.6,0,0"], 2 * np.arccos(0.8)),
        (["x,y,z,dx,dy,dz", "0,0,0,0,0,1", ".03,.04,0,0,0,2", ".03,.04,0,0,1,0", ".03,.04,0,0,3,0"], np.pi / 2),
    ],
)
def test_a_file_without_times_is_paced_by_way_and_turn(tmp_path, lines, angle):
    path = jaxik.load_path(write(tmp_path, *lines)).checked()
    turn = angle / 0.5
    np.testing.assert_allclose(path.time[:3], [0, 0.5, 0.5 + turn], rtol=1e-9)
    np.testing.assert_allclose(path.time[3:] - path.time[2], [0.001] * (len(path) - 3))
    twice = jaxik.Path.paced(path.target, speed=0.2, turn_speed=1.0)
    np.testing.assert_allclose(twice.time[1:3], path.time[1:3] / 2, rtol=1e-12)


@pytest.mark.parametrize("name", jaxik.example_path_names())
def test_example_paths_are_valid_start_at_the_origin_and_survive_a_file(name, tmp_path):
    path = jaxik.example_path(name).checked()
    np.testing.assert_allclose(path.target.position[0], 0, atol=1e-15)
    jaxik.save_path(path, tmp_path / "x.csv")
    again = jaxik.load_path(tmp_path / "x.csv")
    np.testing.assert_array_equal(again.target.position, path.target.position)
    np.testing.assert_array_equal(again.time, path.time)
    np.testing.assert_allclose(again.target.rotation, path.target.rotation, atol=1e-14)


def test_half_turns_survive_a_file(tmp_path):
    turns = jnp.asarray([np.diag(d) for d in ([1.0, -1, -1], [-1.0, 1, -1], [-1.0, -1, 1], [1.0, 1, 1])])
    path = jaxik.Path(jaxik.Pose(jnp.zeros((4, 3)), turns), jnp.arange(4.0))
    jaxik.save_path(path, tmp_path / "x.csv")
    np.testing.assert_allclose(jaxik.load_path(tmp_path / "x.csv").target.rotation, turns, atol=1e-14)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([], "path.csv: the file is empty; expected the header time,x,y,z,qw"),
        (["t,x,y,z", ROW0, ROW1], "path.csv:1: expected the header"),
        ([POSE, ROW0], "at least 2 rows below the header; got 1"),
        ([POSE, ROW0, "1,0,0,0,1,0,0"], "path.csv:3: expected 8 numbers"),
        ([POSE, ROW0, "1,0,zero,0,1,0,0,0"], "path.csv:3: expected a number for y; got 'zero'"),
        ([POSE, ROW0, "1,nan,0,0,1,0,0,0"], "path.csv:3: expected a finite number for x; got 'nan'"),
        ([POSE, ROW0, "1,0,0,inf,1,0,0,0"], "path.csv:3: expected a finite number for z; got 'inf'"),
        ([POSE, ROW0, "# no row", "0,0,0,0,1,0,0,0"], "path.csv:4: expected a time after 0.0 s; got 0.0 s"),
        ([POSE, ROW0, "1,0,0,0,1,1,0,0"], "path.csv:3: expected a unit quaternion qw,qx,qy,qz; its length is 1.41421"),
        (["time,x,y,z,dx,dy,dz", "0,0,0,0,0,0,1", "1,0,0,0,0,0,0"], "expected a direction dx,dy,dz with some length"),
    ],
)
def test_a_bad_file_is_refused_in_one_sentence_with_its_line(tmp_path, lines, said):
    with pytest.raises(jaxik.FileFormatError, match=r"path.csv") as caught:
        jaxik.load_path(write(tmp_path, *lines))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_binary_file_is_refused(tmp_path):
    (tmp_path / "path.csv").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(jaxik.FileFormatError, match=r"expected a text file"):
        jaxik.load_path(tmp_path / "path.csv")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda p: jaxik.Path(p.target, p.time.at[2].set(0.25)), "waypoint 2 of 5: time does not increase"),
        (lambda p: jaxik.Path(p.target, p.time.at[3].set(jnp.nan)), "waypoint 3 of 5: time is not finite"),
        (lambda p: jaxik.Path(jaxik.Pose(p.target.position, 1.1 * p.target.rotation), p.time), "is not a rotation"),
        (lambda p: jaxik.Path(jaxik.Pose(p.target.position, -p.target.rotation), p.time), "is not a rotation"),
        (lambda p: jaxik.Path(p.target, p.time[:-1]), "needs time (K,)"),
        (lambda p: jaxik.Path(jaxik.Pointing(p.target.position, jnp.zeros((5, 3))), p.time), "has no length"),
    ],
)
def test_what_is_no_path_is_refused(change, said):
    with pytest.raises(ValueError, match=r".") as caught:
        change(straight()).checked()
    assert said in str(caught.value)


def test_unknown_example_lists_the_known():
    with pytest.raises(ValueError, match=r"there are word, figure-eight, reach, wave, spiral"):
        jaxik.example_path("loop")


@pytest.mark.parametrize("model", [jaxik.presets.meccanoid("right"), jaxik.presets.iiwa14()], ids=lambda m: m.name)
def test_a_fitted_path_is_the_stated_transform_and_every_waypoint_is_in_reach(model):
    path = jaxik.example_path("figure-eight")
    fitted = jaxik.fit_path(model.arm, path)
    p = fitted.placement
    moved = p.translation + p.scale * path.target.position @ p.rotation.T
    np.testing.assert_allclose(fitted.target.position, moved, atol=1e-12)
    hand = jnp.einsum("ij,kjl,lm->kim", p.rotation, path.target.rotation, p.tool)
    if model.arm.n_joints == 6:
        np.testing.assert_allclose(fitted.target.direction, hand[..., 2], atol=1e-12)
    else:
        np.testing.assert_allclose(fitted.target.rotation, hand, atol=1e-12)
    assert 0 < float(p.scale) <= 1
    assert f"{float(p.scale):.3f}" in p.describe()
    grid = jaxik.planning.swivel_grid(model.arm, fitted.target, 24)
    assert grid.ok.any(axis=1).all(axis=0).any(), "no branch serves the whole path"
    again = jaxik.fit_path(model.arm, path)
    np.testing.assert_array_equal(again.target.position, fitted.target.position)


def test_a_path_that_cannot_fit_is_refused_with_the_room_left():
    with pytest.raises(jaxik.UnreachableError, match=r"no placement at scale 40 keeps"):
        jaxik.fit_path(jaxik.presets.meccanoid("right").arm, jaxik.example_path("wave"), scale=40.0)
