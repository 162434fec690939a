"""Poses as rigid motions, and targets from whatever callers have."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.spatial.transform import RigidTransform, Rotation

from jaxik import Path, Pointing, Pose, presets, solve_ik
from jaxik.targets import as_target, check_target


def random_poses(rng, *batch):
    count = int(np.prod(batch))
    rotation = Rotation.random(count, rng=rng).as_matrix().reshape(*batch, 3, 3)
    return Pose(jnp.asarray(rng.normal(size=(*batch, 3))), jnp.asarray(rotation))


def random_pointings(rng, *batch):
    return Pointing(*jnp.asarray(rng.normal(size=(2, *batch, 3))))


def close(a, b, atol=1e-14):
    leaves = zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    return type(a) is type(b) and all(x.shape == y.shape and np.allclose(x, y, rtol=0, atol=atol) for x, y in leaves)


@pytest.mark.parametrize("batch", [(), (1,), (3, 1, 2, 1)])
def test_matrices_there_and_back(batch, rng):
    pose = random_poses(rng, *batch)
    matrix = pose.matrix()
    assert matrix.shape == (*batch, 4, 4)
    assert np.all(np.asarray(matrix)[..., 3, :] == [0, 0, 0, 1])
    assert close(Pose.from_matrix(matrix), pose, 0)


@pytest.mark.parametrize("batch", [(), (1,), (3, 1, 2, 1)])
def test_quaternions_there_and_back(batch, rng):
    pose = random_poses(rng, *batch)
    wxyz = pose.wxyz()
    assert wxyz.shape == (*batch, 4)
    assert close(Pose.from_quaternion(pose.position, wxyz=wxyz), pose)
    assert close(Pose.from_quaternion(pose.position, xyzw=np.roll(wxyz, -1, -1)), pose)
    assert close(Pose.from_quaternion(pose.position, xyzw=-3.0 * np.roll(wxyz, -1, -1)), pose)


def test_quaternion_and_position_broadcast():
    pose = Pose.from_quaternion(np.zeros((5, 3)), wxyz=[1.0, 0, 0, 0])
    assert pose.matrix().shape == (5, 4, 4)
    assert len(pose) == 5
    assert pose[4].rotation.shape == (3, 3)


@pytest.mark.parametrize("batch", [(), (1,), (3, 1, 2, 1)])
def test_products_and_inverses_are_those_of_matrices(batch, rng):
    a, b = random_poses(rng, *batch), random_poses(rng, *batch)
    assert close((a @ b).matrix(), a.matrix() @ b.matrix())
    assert close(a.inverse().matrix(), jnp.linalg.inv(a.matrix()))
    assert close(a @ a.inverse(), Pose.from_matrix(jnp.eye(4) + 0 * a.matrix()))
    point = rng.normal(size=(*batch, 3))
    assert close(a @ point, (a.matrix() @ np.append(point, np.ones((*batch, 1)), -1)[..., None])[..., :3, 0])
    hand = Pointing(jnp.asarray(point), b.rotation[..., 2])
    assert close(a @ hand, Pointing(a @ point, (a @ b).rotation[..., 2]))


def test_pointing_is_the_position_and_the_z_axis(rng):
    pose = random_poses(rng, 2, 3)
    assert close(pose.pointing(), Pointing(pose.position, pose.rotation @ jnp.array([0.0, 0, 1])))


def test_products_broadcast_and_take_lists(rng):
    one, many = random_poses(rng), random_poses(rng, 4)
    assert close((one @ many)[2], one @ many[2])
    assert close((many @ one)[2], many[2] @ one)
    assert close(one @ [1.0, 2.0, 3.0], one @ jnp.array([1.0, 2.0, 3.0]))
    assert (many[:, None] @ rng.normal(size=(7, 3))).shape == (4, 7, 3)


@pytest.mark.parametrize("make", [random_poses, random_pointings])
@pytest.mark.parametrize(
    "index",
    [
        2,
        -4,
        np.int64(1),
        slice(1, 3),
        (slice(None), 1),
        (..., 0),
        (Ellipsis, -1, slice(None)),
        np.array([3, 0, 0]),
        np.array([True, False, True, True]),
        None,
        (np.array([0, 3]), slice(None), np.array([1, 2])),
        (slice(None), slice(None), np.array([[1, 2]])),
    ],
)
def test_indexing_is_that_of_an_array_of_the_batch_shape(make, index, rng):
    target = make(rng, 4, 2, 3)
    rows = np.arange(24).reshape(4, 2, 3)[index]
    found = target[index]
    for part, whole in zip(jax.tree.leaves(found), jax.tree.leaves(target), strict=True):
        assert np.array_equal(part, np.reshape(whole, (24, *whole.shape[3:]))[rows])


@pytest.mark.parametrize("make", [random_poses, random_pointings])
def test_length_and_iteration(make, rng):
    target = make(rng, 3, 2)
    assert len(target) == 3
    parts = list(target)
    assert len(parts) == 3
    assert all(close(part, target[i]) for i, part in enumerate(parts))
    with pytest.raises(IndexError, match="index 3 is out of range for 3 targets"):
        target[3]
    for wrong in (len, iter, lambda t: t[0]):
        with pytest.raises(TypeError, match="no batch axes"):
            wrong(make(rng))


def test_everything_maps_and_compiles(rng):
    a, b = random_poses(rng, 5), random_poses(rng, 5)

    def every(a, b):
        return a @ b, a.inverse(), a.matrix(), a.wxyz(), Pose.from_quaternion(a.position, wxyz=b.wxyz())

    assert close(list(jax.jit(jax.vmap(every))(a, b)), list(every(a, b)))


def test_derivatives(rng):
    a, b = random_poses(rng), random_poses(rng)

    def every(a, b, wxyz):
        return a @ b, a.inverse() @ b.position, Pose.from_quaternion(a.position, wxyz=wxyz).matrix(), (a @ b).matrix()

    check_grads(every, (a, b, 1.3 * b.wxyz()), 2, ("fwd", "rev"), rtol=1e-6, eps=1e-4)


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_the_dtype_is_kept(dtype, rng):
    pose = jax.tree.map(lambda x: x.astype(dtype), random_poses(rng, 2))
    made = Pose.from_quaternion(pose.position, wxyz=pose.wxyz())
    for value in jax.tree.leaves((pose.matrix(), pose.wxyz(), pose.inverse(), pose @ pose, pose[0], made)):
        assert value.dtype == dtype


class Jaxlie(SimpleNamespace):
    """Has the one method of jaxlie's SE3 that counts."""

    def as_matrix(self):
        return self.matrix


def test_what_stands_for_a_pose(rng):
    pose = random_poses(rng, 2)
    for same in (pose, pose.matrix(), np.asarray(pose.matrix()), pose.matrix().tolist(), Jaxlie(matrix=pose.matrix())):
        assert close(as_target(same), pose)
    assert close(as_target(RigidTransform.from_matrix(np.asarray(pose.matrix()))), pose)
    assert as_target(pose) is pose
    lists = Pose(pose.position.tolist(), pose.rotation.tolist())
    assert close(as_target(lists), pose)


def test_an_se3_maps_and_compiles(rng):
    pose, model = random_poses(rng, 3), presets.iiwa7()
    expected = solve_ik(model.arm, pose, 0.0)
    solve = jax.jit(jax.vmap(lambda matrix: solve_ik(model.arm, as_target(Jaxlie(matrix=matrix)), 0.0).q))
    assert np.allclose(solve(pose.matrix()), expected.q, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (None, "got NoneType"),
        ("pose", "got str"),
        (3.0, "got float"),
        (np.zeros(3), r"got an array of shape \(3,\)"),
        (np.zeros((4, 3)), r"got an array of shape \(4, 3\)"),
        ([[1, 2], [3]], r"got \[\[1, 2\], \[3\]\]"),
        ((np.zeros(3), np.eye(3)), r"got \(array"),
        (Jaxlie(matrix=np.eye(3)), r"Jaxlie.as_matrix\(\) to give shape \(\*batch, 4, 4\), got \(3, 3\)"),
        (Path(Pose(np.zeros((2, 3)), np.zeros((2, 3, 3))), np.arange(2.0)), "got a Path: pass its .target"),
        (Pose(np.zeros(3), None), "expected numbers for Pose.rotation, got NoneType"),
        (Pose([0, 0, "up"], np.eye(3)), r"expected numbers for Pose.position, got \[0, 0, 'up'\]"),
        (Pointing("here", np.ones(3)), "expected numbers for Pointing.position, got str"),
        (Pointing(np.array(["a"]), np.ones(3)), "expected numbers for Pointing.position, got an array of <U1"),
    ],
)
def test_anything_else_is_refused_in_our_words(wrong, words):
    with pytest.raises(ValueError, match=words):
        as_target(wrong)


@pytest.mark.usefixtures("without_type_checks")
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Pose.from_matrix(np.eye(3)), r"shape \(\*batch, 4, 4\), got \(3, 3\)"),
        (lambda: Pose.from_matrix("eye"), r"matrices of shape \(\*batch, 4, 4\), got str"),
        (lambda: Pose.from_quaternion(np.zeros(3)), "exactly one quaternion"),
        (lambda: Pose.from_quaternion(np.zeros(3), wxyz=np.ones(4), xyzw=np.ones(4)), "exactly one quaternion"),
        (lambda: Pose.from_quaternion(np.zeros(3), xyzw=np.ones(3)), r"xyzw of shape \(\*batch, 4\), got \(3,\)"),
        (lambda: Pose.from_quaternion(np.zeros(2), wxyz=np.ones(4)), r"position of shape \(\*batch, 3\), got \(2,\)"),
        (lambda: Pose(np.zeros(3), np.eye(3)) @ np.zeros(4), r"points of shape \(\*batch, 3\), got \(4,\)"),
        (lambda: Pose(np.zeros(3), np.eye(3)) @ "x", "a Pose, a Pointing or points"),
        (lambda: check_target(presets.meccanoid().arm, Pose(np.zeros(3), np.eye(3))), r"take pose.pointing\(\)"),
        (lambda: check_target(presets.iiwa7().arm, np.eye(4)), "expected a jaxik.Pose"),
    ],
)
def test_wrong_arguments_are_refused_in_our_words(call, words):
    with pytest.raises(ValueError, match=words):
        call()
