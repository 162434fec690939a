"""The scene follows from the state: postures, circle, arcs, description."""

from dataclasses import replace

import numpy as np
import pytest

import jaxik
from jaxik.view.arm_scene import ArmState, arm_scene
from jaxik.view.playhead import Playhead
from jaxik.view.skeleton import Skeleton

MODELS = {"paper": jaxik.presets.paper_arm, "iiwa14": jaxik.presets.iiwa14, "meccanoid": jaxik.presets.meccanoid}


@pytest.fixture(params=MODELS, scope="module")
def scene(request):
    return arm_scene(ArmState.start(MODELS[request.param]()))


def test_the_host_arithmetic_agrees_with_the_library(scene):
    arm = scene.state.model.arm
    q = np.random.default_rng(0).uniform(-2, 2, (5, arm.n_joints))
    np.testing.assert_allclose(Skeleton.of(arm).posture(q), jaxik.joint_positions(arm, q), atol=1e-12)
    turns, shifts = Skeleton.of(arm).motions(q)
    pose = jaxik.forward_kinematics(arm, q)
    np.testing.assert_allclose(turns[:, -1] @ np.asarray(arm.tool_rotation), pose.rotation, atol=1e-12)
    tool = np.einsum("kij,j->ki", turns[:, -1], np.asarray(arm.tool_position)) + shifts[:, -1]
    np.testing.assert_allclose(tool, pose.position, atol=1e-12)


def test_the_initial_posture_is_feasible_and_on_its_handle(scene):
    assert scene.status_here == jaxik.Status.OK
    np.testing.assert_allclose(scene.points[3], scene.state.position, atol=1e-9)


def test_the_paper_arm_starts_with_the_paper_example():
    scene = arm_scene(ArmState.start(jaxik.presets.paper_arm()))
    np.testing.assert_allclose(scene.points[1:], [[2.56066, 0.43934, -1.5], [3, 3, -3], [3, 4, -3]], atol=1e-5)
    (shoulder, upper), (wrist, fore) = scene.spheres
    assert upper == pytest.approx(3)
    assert fore == pytest.approx(3)
    np.testing.assert_allclose(np.linalg.norm(scene.circle() - shoulder, axis=-1), 3)
    np.testing.assert_allclose(np.linalg.norm(scene.circle() - wrist, axis=-1), 3)


def test_the_drawn_circle_is_where_the_solver_puts_the_elbow(scene):
    swivels = np.linspace(-3, 3, 7)
    moved = [arm_scene(replace(scene.state, swivel=float(s))).points[1] for s in swivels]
    np.testing.assert_allclose(scene.on_circle(swivels), moved, atol=1e-9)


def test_arcs_are_drawn_where_the_branch_is_feasible(scene):
    branch = scene.state.branch
    assert len(scene.feasible_arcs())
    for start, end in scene.arcs[branch]:
        inside = arm_scene(replace(scene.state, swivel=(start + end) / 2))
        assert branch in inside.feasible_branches
        if end - start < 2 * np.pi - 0.1:
            assert branch not in arm_scene(replace(scene.state, swivel=end + 0.02)).feasible_branches


def test_the_description_names_the_status_and_the_feasible_swivels(scene):
    assert scene.description().startswith("**OK**")
    start, end = scene.arcs[scene.state.branch][0]
    outside = arm_scene(replace(scene.state, swivel=end + 0.05))
    assert outside.description().startswith(("**LIMITS**", "**KEEP_OUT**"))
    assert f"{np.degrees(start):.0f}° to {np.degrees(end):.0f}°" in outside.description()
    far = arm_scene(replace(scene.state, position=10 * scene.state.position + 10))
    assert far.description().startswith("**OUT_OF_REACH**")
    assert np.isfinite(far.points).all()


def test_the_nearest_feasible_swivel_is_just_inside(scene):
    _, end = scene.arcs[scene.state.branch][0]
    outside = arm_scene(replace(scene.state, swivel=end + 0.05))
    found = outside.nearest_feasible()
    assert found.branch == scene.state.branch
    gap = (found.swivel - end + np.pi) % (2 * np.pi) - np.pi
    assert abs(gap) < 1e-9
    assert np.cos(scene.nearest_feasible().swivel - scene.state.swivel) == pytest.approx(1)
    far = arm_scene(replace(scene.state, position=10 * scene.state.position + 10))
    assert far.nearest_feasible() is far.state


def test_the_playhead_plays_pauses_seeks_and_restarts():
    head = Playhead(1.0, 3.0, 1.0)
    assert head.advance(0.5) == 1.0, "it stands until it plays"
    head.playing, head.speed = True, 2.0
    assert head.advance(0.5) == 2.0
    head.seek(9.0)
    assert head.time == 3.0
    assert head.advance(0.1) == 1.0, "from the end back to the start"
    head.seek(-1.0)
    assert head.time == 1.0


@pytest.fixture(scope="module")
def outer_scene():
    return arm_scene(ArmState.start(jaxik.presets.franka_fr3()))


def test_an_arm_with_an_outer_joint_is_shown_over_the_angle_of_this_joint(outer_scene):
    scene, branch = outer_scene, outer_scene.state.branch
    assert scene.status_here == jaxik.Status.OK
    assert not scene.has_circle
    np.testing.assert_allclose(scene.points[3], scene.state.position, atol=1e-9)
    assert scene.joints[6] == pytest.approx(scene.state.swivel)
    ((start, end),) = scene.arcs[branch]
    assert "joint_7" in scene.description()
    assert f"{np.degrees(start):.0f}° to {np.degrees(end):.0f}°" in scene.description()
    (sampled,) = scene.curve.free_intervals()
    step = scene.curve.parameter[1] - scene.curve.parameter[0]
    assert start <= sampled[0] <= start + step
    assert end - step <= sampled[1] <= end
    inside, outside = (arm_scene(replace(scene.state, swivel=end + side)) for side in (-0.02, 0.02))
    assert inside.status_here == jaxik.Status.OK
    assert outside.status_here == jaxik.Status.ORIENTATION
    assert outside.nearest_feasible().swivel == pytest.approx(end)
    sample = len(scene.curve.parameter) // 2 + 5
    there = arm_scene(replace(scene.state, swivel=float(scene.curve.parameter[sample])))
    np.testing.assert_allclose(scene.curve.points[sample], there.points[1], atol=1e-6)


def test_the_skeleton_of_an_arm_without_a_class_is_that_of_its_joints():
    arm = jaxik.presets.g1().arm
    q = np.random.default_rng(0).uniform(-1, 1, (3, 7))
    np.testing.assert_allclose(Skeleton.of(arm).posture(q), jaxik.joint_positions(arm, q), atol=1e-12)
    turns, shifts = Skeleton.of(arm).motions(q)
    pose = jaxik.forward_kinematics(arm, q)
    tool = np.einsum("kij,j->ki", turns[:, -1], np.asarray(arm.tool_position)) + shifts[:, -1]
    np.testing.assert_allclose(tool, pose.position, atol=1e-12)


def test_an_obstacle_blocks_the_circle_and_frees_it_when_it_is_moved():
    model = jaxik.with_body(jaxik.presets.iiwa14(), jaxik.Body.preset("iiwa14"))

    def world(second, table=9.0):
        return jaxik.World([[5.0, 0, 0], second], 0.1, normals=[[0.0, 0.0, -1.0]], offsets=[table])

    free = arm_scene(ArmState.start(model, world([9.0, 0, 0])))
    assert not free.curve.blocked_by()
    at = free.on_circle(np.array([free.state.swivel + 1.5]))[0]
    moved = replace(free.state, world=world(at))
    scene = arm_scene(moved)
    blocked = {code for code, _, _ in scene.curve.runs()}
    assert 1 in blocked
    assert 0 not in blocked
    assert "Blocked by obstacle 1" in scene.description()
    # The samples that are free are those inside the exact arcs.
    arcs = np.array(scene.arcs[scene.state.branch])
    inside = ((scene.curve.parameter[:, None] - arcs[:, 0]) % (2 * np.pi) <= arcs[:, 1] - arcs[:, 0]).any(-1)
    np.testing.assert_array_equal(scene.curve.blocker == -1, inside)
    hit = arm_scene(replace(moved, swivel=moved.swivel + 1.5))
    assert hit.status_here == jaxik.Status.COLLISION
    assert "It meets obstacle 1, " in hit.description()
    assert hit.overlap > 0.1
    table = replace(moved, world=world([9.0, 0, 0], table=-0.9))
    assert "half-space 0 (" in arm_scene(table).description()
