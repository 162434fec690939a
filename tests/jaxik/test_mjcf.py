"""Arms in MJCF: MuJoCo loads what is written, agrees with the kinematics, and is read back."""

import jax
import mujoco
import numpy as np
import pytest

import jaxik
from jaxik.cli import run

PRESETS = {
    "iiwa14": jaxik.presets.iiwa14,
    "meccanoid": jaxik.presets.meccanoid,
    "paper": jaxik.presets.paper_arm,
    "franka": jaxik.presets.franka_fr3,
}
by_preset = pytest.mark.parametrize("name", PRESETS)


def postures(arm):
    lower, upper = np.maximum(arm.lower, -3), np.minimum(arm.upper, 3)
    return lower + np.random.default_rng(0).uniform(size=(8, arm.n_joints)) * (upper - lower)


def simulated_tools(model, site, rows):
    data, tools = mujoco.MjData(model), np.zeros((len(rows), 4, 4))
    for i, q in enumerate(rows):
        data.qpos[: len(q)] = q
        mujoco.mj_kinematics(model, data)
        frame = data.site(site) if isinstance(site, str) else data.xpos[site]
        tools[i] = np.block([[frame.xmat.reshape(3, 3), frame.xpos[:, None]], [np.zeros(3), np.ones(1)]])
    return tools


@by_preset
def test_mujoco_has_the_same_forward_kinematics(name):
    model = PRESETS[name]()
    simulated = mujoco.MjModel.from_xml_string(jaxik.to_mjcf(model))
    q = postures(model.arm)
    tools = simulated_tools(simulated, "tool", q)
    np.testing.assert_allclose(tools, jaxik.forward_kinematics(model, q).matrix(), atol=1e-9)
    assert tuple(simulated.joint(i).name for i in range(simulated.njnt)) == model.joint_names


@by_preset
def test_an_arm_reads_back(name):
    model = PRESETS[name]()
    back = jaxik.from_mjcf(jaxik.to_mjcf(model))
    q = postures(model.arm)
    np.testing.assert_allclose(
        jaxik.forward_kinematics(back, q).matrix(), jaxik.forward_kinematics(model, q).matrix(), atol=1e-9
    )
    for field in ("lower", "upper", "velocity_limit", "torque_limit", "gravity"):
        np.testing.assert_allclose(getattr(back.arm, field), getattr(model.arm, field), atol=1e-12, err_msg=field)
    weight = [jaxik.gravity_torque(m.arm, q) for m in (back, model)]
    np.testing.assert_allclose(*weight, atol=1e-9 if float(model.arm.links.mass.min()) > 0 else 1e-4)  # 1 mg
    assert (back.joint_names, back.name) == (model.joint_names, model.name)
    assert back.arm.kinematic_class == model.arm.kinematic_class


def test_servos_hold_and_motors_push():
    model = jaxik.presets.iiwa14()
    servos = mujoco.MjModel.from_xml_string(jaxik.to_mjcf(model))
    np.testing.assert_allclose(servos.actuator_forcerange[:, 1], model.arm.torque_limit)
    data, wanted = mujoco.MjData(servos), np.array([0.1, 0.3, -0.2, -0.5, 0.1, 0.4, 0.2])
    data.qpos[:] = data.ctrl[:] = wanted
    mujoco.mj_step(servos, data, 200)
    np.testing.assert_allclose(data.qpos, wanted, atol=1e-3)
    motors = mujoco.MjModel.from_xml_string(jaxik.to_mjcf(model, bandwidth=None))
    data = mujoco.MjData(motors)
    data.qpos[:] = wanted
    data.ctrl[:] = jaxik.gravity_torque(model.arm, wanted)
    mujoco.mj_step(motors, data, 200)
    np.testing.assert_allclose(data.qpos, wanted, atol=1e-3)


ROBOT = """
<mujoco model="torso"><compiler angle="degree"/><option gravity="0 0 -9.81"/><worldbody>
<body name="chest" pos="0.1 0.2 1" quat="0.7071067811865476 0.7071067811865476 0 0"><joint name="lift" type="slide" axis="0 1 0"/>
<geom type="box" size="0.1 0.1 0.1" mass="3"/>
{}<site name="hand" pos="0 0 0.1"/><site name="eye"/><body name="finger" pos="0 0 0.1"><joint name="grip" type="slide"/>
<geom type="sphere" size="0.01" mass="0.2"/></body>{}
</body></worldbody></mujoco>
"""  # noqa: E501
LINKS = "".join(
    f'<body name="b{i}" pos="0 0 {height}" ><joint name="j{i}" axis="{axis}" range="-90 {80 + i}" '
    f'actuatorfrcrange="-{10 + i} {10 + i}"/><geom type="capsule" size="0.02" fromto="0 0 0 0 0 0.1" mass="{1 + i}"/>'
    for i, (axis, height) in enumerate(
        zip(["0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1"], [0.2, 0, 0, 0.3, 0.25, 0, 0], strict=True)
    )
)
TORSO = ROBOT.format(LINKS, "</body>" * 7)


def test_an_arm_of_a_larger_robot_is_read(tmp_path):
    (tmp_path / "torso.xml").write_text(TORSO)
    model = jaxik.from_mjcf(tmp_path / "torso.xml", "hand", "chest")
    assert model.joint_names == tuple(f"j{i}" for i in range(7))
    np.testing.assert_allclose(model.arm.upper, np.radians([80, 81, 82, 83, 84, 85, 86]))
    np.testing.assert_allclose(model.arm.torque_limit, np.arange(10, 17))
    np.testing.assert_allclose(model.arm.links.mass, [1, 2, 3, 4, 5, 6, 7.2])
    np.testing.assert_allclose(model.arm.gravity, [0, -9.81, 0], atol=1e-12)
    simulated = mujoco.MjModel.from_xml_string(TORSO)
    data, q = mujoco.MjData(simulated), postures(model.arm)
    chest = np.zeros((8, 4, 4))
    weight = np.zeros((8, 7))
    for i in range(8):
        data.qpos[1:8] = q[i]
        mujoco.mj_forward(simulated, data)
        base, hand = data.body("chest"), data.site("hand")
        turn = base.xmat.reshape(3, 3).T
        chest[i] = np.eye(4)
        chest[i, :3, :3], chest[i, :3, 3] = turn @ hand.xmat.reshape(3, 3), turn @ (hand.xpos - base.xpos)
        weight[i] = data.qfrc_bias[1:8]
    np.testing.assert_allclose(jaxik.forward_kinematics(model, q).matrix(), chest, atol=1e-9)
    np.testing.assert_allclose(jaxik.gravity_torque(model.arm, q), weight, atol=1e-9)


@pytest.mark.parametrize(
    ("tip", "base", "said"),
    [
        (None, None, r"does not say which site or body is the tool; name one \(sites: hand, eye\)"),
        ("nose", None, "has no site or body 'nose'; its bodies are world, chest, b0"),
        ("hand", "finger", "finger does not carry b6"),
        ("hand", None, "joint 'lift' on the chain does not turn"),
        ("b3", "chest", "expected 6 or 7 joints between base and tip; got 4"),
    ],
)
def test_what_is_no_arm_is_said(tip, base, said):
    with pytest.raises(ValueError, match=said):
        jaxik.from_mjcf(TORSO, tip, base)


def test_other_files_are_refused(tmp_path, without_type_checks):
    (tmp_path / "x.xml").write_text("<mujoco><arm/></mujoco>")
    with pytest.raises(jaxik.FileFormatError, match=r"x.xml: MuJoCo does not load it"):
        jaxik.from_mjcf(tmp_path / "x.xml")
    with pytest.raises(FileNotFoundError):
        jaxik.from_mjcf(tmp_path / "no.xml")
    with pytest.raises(jaxik.ArmClassError, match="the text: "):
        jaxik.from_mjcf(TORSO.replace('axis="0 1 0" range', 'axis="0 0 1" range'), "hand", "chest")
    with pytest.raises(ValueError, match=r"expected a jaxik.ArmModel"):
        jaxik.to_mjcf(jaxik.presets.iiwa7().arm)
    with pytest.raises(ValueError, match="expected a positive bandwidth"):
        jaxik.to_mjcf(jaxik.presets.iiwa7(), bandwidth=0.0)


def test_float32_arms_are_written():
    model = jaxik.presets.iiwa7()
    single = jaxik.ArmModel(jax.tree.map(lambda x: x.astype(np.float32), model.arm), model.joint_names, "single", "")
    assert mujoco.MjModel.from_xml_string(jaxik.to_mjcf(single)).nu == 7


def test_commands_take_mjcf(tmp_path, capsys):
    (tmp_path / "arm.xml").write_text(jaxik.to_mjcf(jaxik.presets.iiwa14()))
    assert run(["info", "--arm", str(tmp_path / "arm.xml")]) == 0
    assert "S-R-S" in capsys.readouterr().out
    (tmp_path / "torso.xml").write_text(TORSO)
    assert run(["info", "--arm", str(tmp_path / "torso.xml"), "--base", "chest", "--tip", "hand"]) == 0
    assert run(["info", "--arm", str(tmp_path / "torso.xml")]) == 1
    assert "name one (sites: hand, eye)" in capsys.readouterr().err
