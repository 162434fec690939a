"""The arm that all peers get: as arrays, as a URDF file, and with independent forward kinematics."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import jaxik

TIP = "tool"


@dataclass(frozen=True)
class SharedArm:
    """An arm as peers take it.

    Attributes:
        name: Name in tables.
        arm: The arm of jaxik.
        axes: Unit joint axes at zero angles in the base frame, ``(joint, 3)``.
        points: A point on each axis, ``(joint, 3)`` [m].
        tool: Tool pose at zero angles, ``(4, 4)``.
        lower: Lower joint limits, ``(joint,)`` [rad].
        upper: Upper joint limits, ``(joint,)`` [rad].
        speed: Largest joint speeds, ``(joint,)`` [rad/s].
        urdf: The same as URDF; all frames are parallel to the base frame at zero angles, the tip is ``TIP``.
    """

    name: str
    arm: jaxik.Arm
    axes: np.ndarray
    points: np.ndarray
    tool: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    speed: np.ndarray
    urdf: str

    def urdf_file(self) -> str:
        """Return the name of a file with the URDF."""
        path = Path(tempfile.mkdtemp(prefix="jaxik-bench-")) / f"{self.name}.urdf"
        path.write_text(self.urdf)
        return str(path)

    def forward(self, q: np.ndarray) -> np.ndarray:
        """Return tool poses ``(n, 4, 4)`` of joint angles ``(n, joint)``, by pinocchio."""
        import pinocchio

        model = pinocchio.buildModelFromXML(self.urdf)
        data, frame = model.createData(), model.getFrameId(TIP)
        poses = np.empty((len(q), 4, 4))
        for pose, angles in zip(poses, q, strict=True):
            pinocchio.framesForwardKinematics(model, data, angles)
            pose[:] = data.oMf[frame].homogeneous
        return poses


def iiwa14() -> SharedArm:
    """Return the KUKA LBR iiwa 14 R820, an arm that most peers can solve."""
    arm = jaxik.presets.iiwa14().arm.astype("float64")
    axes = np.asarray(arm.axes)
    points = np.array([arm.shoulder] * 3 + [arm.elbow] + [arm.wrist] * 3)
    tool = np.eye(4)
    tool[:3, 3], tool[:3, :3] = arm.tool_position, arm.tool_rotation
    assert np.allclose(tool[:3, :3], np.eye(3)), "the URDF below has no rotations"
    lower, upper, speed = np.asarray(arm.lower), np.asarray(arm.upper), np.asarray(arm.velocity_limit)
    urdf = _urdf("iiwa14", axes, np.vstack([points, tool[:3, 3]]), lower, upper, speed)
    return SharedArm("iiwa14", arm, axes, points, tool, lower, upper, speed, urdf)


def _urdf(name, axes, points, lower, upper, speed) -> str:
    steps = np.diff(points, axis=0, prepend=np.zeros((1, 3)))
    links = ["base", *[f"link_{i + 1}" for i in range(len(axes))], TIP]
    # Some readers drop links without mass.
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    text = [f'<robot name="{name}">', *[f'<link name="{link}">{mass}</link>' for link in links]]
    for i, step in enumerate(steps):
        kind = "revolute" if i < len(axes) else "fixed"
        text.append(f'<joint name="joint_{i + 1}" type="{kind}">')
        text.append(f'<parent link="{links[i]}"/><child link="{links[i + 1]}"/>')
        text.append(f'<origin xyz="{_numbers(step)}" rpy="0 0 0"/>')
        if kind == "revolute":
            text.append(f'<axis xyz="{_numbers(axes[i])}"/>')
            limits = f'lower="{lower[i]:.17g}" upper="{upper[i]:.17g}" velocity="{speed[i]:.17g}"'
            text.append(f'<limit {limits} effort="99"/>')
        text.append("</joint>")
    return "\n".join([*text, "</robot>"])


def _numbers(values) -> str:
    return " ".join(f"{x:.17g}" for x in values)
