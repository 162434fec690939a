"""A ROS 2 node that answers every pose on a topic with the nearest posture of the arm: python examples/ros_node.py ARM.

It subscribes to geometry_msgs/PoseStamped on ``~/target`` and sensor_msgs/JointState on ``/joint_states``, and
publishes trajectory_msgs/JointTrajectory for a joint trajectory controller. Only running it needs rclpy and the message
packages of an installation of ROS; ``answer`` and its test do not.
"""

import sys
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np

import jaxik
from jaxik.cli import find_arm

CONTROLLER = "/joint_trajectory_controller/joint_trajectory"
SPEED = 0.5  # fraction of the joints' velocity limits
SHORTEST = 0.1  # s


def answer(
    model: jaxik.ArmModel, position: Sequence[float], xyzw: Sequence[float], angles: Mapping[str, float]
) -> jaxik.Trajectory | None:
    """Return the motion from the present posture to the nearest one that reaches a pose, or None if there is none.

    Args:
        model: The arm.
        position: Tool point in the arm's base frame, ``(3,)`` [m].
        xyzw: Rotation of the tool as a quaternion in the order of ROS, ``(4,)``.
        angles: Present joint angles by name [rad].
    """
    now = np.array([angles[name] for name in model.joint_names])
    target = jaxik.Pose.from_quaternion(jnp.asarray(position), xyzw=jnp.asarray(xyzw))
    found = jaxik.solve_nearest(model, target, jnp.asarray(now))
    if not bool(found.ok):
        return None
    q = np.stack([now, np.asarray(found.q, np.float64)])
    fastest = (np.abs(q[1] - q[0]) / np.asarray(model.arm.velocity_limit)).max()
    # The spline between two postures at rest is 1.5 times as fast as the straight motion.
    return jaxik.Trajectory(np.array([0.0, max(1.5 * fastest / SPEED, SHORTEST)]), q, model.joint_names)


def main() -> None:
    """Run the node until Ctrl-C."""
    import rclpy  # pyright: ignore[reportMissingImports]
    from geometry_msgs.msg import PoseStamped  # pyright: ignore[reportMissingImports]
    from rclpy.node import Node  # pyright: ignore[reportMissingImports]
    from rosidl_runtime_py import set_message_fields  # pyright: ignore[reportMissingImports]
    from sensor_msgs.msg import JointState  # pyright: ignore[reportMissingImports]
    from trajectory_msgs.msg import JointTrajectory  # pyright: ignore[reportMissingImports]

    jax.config.update("jax_enable_x64", True)
    model = find_arm(sys.argv[1] if len(sys.argv) > 1 else "iiwa14")
    angles: dict[str, float] = {}
    rclpy.init()
    node = Node("jaxik")
    publisher = node.create_publisher(JointTrajectory, CONTROLLER, 1)

    def on_state(state: JointState) -> None:
        angles.update(zip(state.name, state.position, strict=False))

    def on_target(stamped: PoseStamped) -> None:
        if not set(model.joint_names) <= angles.keys():
            node.get_logger().warning("no joint states so far; the target is left out")
            return
        p, r = stamped.pose.position, stamped.pose.orientation
        motion = answer(model, (p.x, p.y, p.z), (r.x, r.y, r.z, r.w), angles)
        if motion is None:
            node.get_logger().warning("the target is out of reach within the joint limits")
            return
        message = JointTrajectory()
        set_message_fields(message, jaxik.joint_trajectory_message(motion))
        publisher.publish(message)

    node.create_subscription(JointState, "/joint_states", on_state, 10)
    node.create_subscription(PoseStamped, "~/target", on_target, 1)
    answer(model, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), dict.fromkeys(model.joint_names, 0.0))  # compiles
    node.get_logger().info("ready")
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()


if __name__ == "__main__":
    main()
