"""Trajectories: joint angles over time, with the names a controller needs."""

import os
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from jaxik.trajectories import ros_trajectory, trajectory_files
from jaxik.trajectories.retiming import Limits, fastest_times


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Joint angles at increasing times, linear in between.

    It holds plain float64 NumPy arrays and strings, ready for files and controllers.

    Attributes:
        time: Strictly increasing times, ``(K,)`` [s].
        q: Joint angles, ``(K, joint)`` [rad].
        joint_names: One name per joint.
        arm_name: Name of the arm it was planned for.
        swivel: Swivel angle at every waypoint, ``(K,)`` [rad]; None if unknown.
        branch: Branch number 0-7 at every waypoint, ``(K,)``; None if unknown.
        notes: Remarks for a reader, one sentence each.

    Raises:
        ValueError: Shapes that do not fit, values that are not finite, times that do not increase, names that repeat.
    """

    time: np.ndarray
    q: np.ndarray
    joint_names: tuple[str, ...]
    arm_name: str = ""
    swivel: np.ndarray | None = None
    branch: np.ndarray | None = None
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        """Convert every field to its stored form and check them."""
        put = lambda name, value: object.__setattr__(self, name, value)  # noqa: E731 - frozen, and used right here
        put("time", _array("time", self.time, np.float64))
        put("q", _array("q", self.q, np.float64))
        put("joint_names", tuple(str(name) for name in self.joint_names))
        put("notes", tuple(str(note) for note in self.notes))
        if self.swivel is not None:
            put("swivel", _array("swivel", self.swivel, np.float64))
        if self.branch is not None:
            branch = _array("branch", self.branch, np.float64)
            if not np.isin(branch, np.arange(8)).all():
                raise ValueError("branch numbers are 0 to 7")
            put("branch", branch.astype(np.int64))
        self._check()

    def _check(self) -> None:
        """Raise where the fields do not make a trajectory."""
        count, joints = self.time.shape[0] if self.time.ndim else 0, len(self.joint_names)
        if self.time.ndim != 1 or count < 1:
            raise ValueError(f"a trajectory needs time (K,) with K >= 1; got {self.time.shape}")
        if self.q.shape != (count, joints):
            raise ValueError(
                f"a trajectory of {count} times and {joints} joints needs q {(count, joints)}; got {self.q.shape}"
            )
        if len(set(self.joint_names)) != joints or "" in self.joint_names:
            raise ValueError(f"joint names must differ and not be empty; got {self.joint_names}")
        for name, values in (("time", self.time), ("q", self.q), ("swivel", self.swivel), ("branch", self.branch)):
            if values is None:
                continue
            if values.shape[:1] != (count,) or (name in ("swivel", "branch") and values.ndim != 1):
                raise ValueError(f"{name} needs one value per waypoint, {(count,)}; got {values.shape}")
            bad = ~np.isfinite(values.reshape(count, -1)).all(-1)
            if bad.any():
                raise ValueError(f"{name} of waypoint {int(np.argmax(bad))} of {count} is not finite")
        stuck = np.diff(self.time) <= 0
        if stuck.any():
            raise ValueError(f"time does not increase at waypoint {int(np.argmax(stuck)) + 1} of {count}")

    def __len__(self) -> int:
        """Number of waypoints."""
        return len(self.time)

    def __eq__(self, other: object) -> bool:
        """Compare to the last bit, names and notes included."""
        if not isinstance(other, Trajectory):
            return NotImplemented
        same = lambda a, b: (a is None) == (b is None) and (a is None or np.array_equal(a, b))  # noqa: E731
        texts = (self.joint_names, self.arm_name, self.notes) == (other.joint_names, other.arm_name, other.notes)
        return texts and all(same(getattr(self, n), getattr(other, n)) for n in ("time", "q", "swivel", "branch"))

    __hash__ = None  # type: ignore[assignment]  # holds arrays

    @property
    def duration(self) -> float:
        """Time from the first to the last waypoint [s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def qd(self) -> np.ndarray:
        """Joint velocities between waypoints, ``(K - 1, joint)`` [rad/s]."""
        return np.diff(self.q, axis=0) / np.diff(self.time)[:, None]

    def sample(self, time: np.ndarray | float) -> np.ndarray:
        """Return the joint angles at any times; before the start and after the end they are held.

        Args:
            time: Times, ``(*batch,)`` [s].

        Returns:
            Joint angles, ``(*batch, joint)`` [rad].
        """
        return np.stack([np.interp(time, self.time, column) for column in self.q.T], axis=-1)

    def retimed(self, *, velocity: Limits, acceleration: Limits) -> "Trajectory":
        """Return the same waypoints in the shortest time, from rest to rest, within limits.

        The limits hold for the motion as it is played: for the velocities between waypoints, and for their change at
        every waypoint over half of the steps beside it, with rest before the first and after the last.

        Args:
            velocity: Largest joint speeds, a number or ``(joint,)`` [rad/s].
            acceleration: Largest joint accelerations, a number or ``(joint,)`` [rad/s²].

        Returns:
            A trajectory that begins at the same time, with a note of the change.

        Raises:
            ValueError: A limit is not positive, or not one per joint.
        """
        time = self.time[0] + fastest_times(self.q, velocity, acceleration)
        note = f"retimed from {self.duration:.6g} s to {time[-1] - time[0]:.6g} s"
        return replace(self, time=time, notes=(*self.notes, note))

    def save(self, file: str | os.PathLike[str]) -> None:
        """Save the trajectory as :func:`jaxik.save_trajectory` does.

        Args:
            file: File name; see there for its endings.
        """
        save_trajectory(self, file)


def save_trajectory(trajectory: Trajectory, file: str | os.PathLike[str]) -> None:
    """Save a trajectory to a file in the form that its ending names.

    - ``.npz`` for programs, ``.csv`` for spreadsheets, ``.json`` for everything else: they read back equal to the last
      bit.
    - ``.yaml``: a trajectory_msgs/JointTrajectory of ROS 2 (see :func:`joint_trajectory_message`); ``.ros.json``: the
      same as JSON.
    - ``.mcap``: a recording of ROS 2 with JointTrajectory and JointState, for ``ros2 bag play`` and Foxglove.

    Messages and recordings hold names, angles, and times in whole nanoseconds from the first waypoint on; arm, swivel,
    branches and notes are left out.

    Args:
        trajectory: The trajectory.
        file: File name, whose ending chooses the form; an existing file is replaced as a whole, so that a reader never
            sees half of it.

    Raises:
        FileFormatError: Another ending.
        MissingExtraError: The form needs ``pip install "jaxik[ros]"``.
        OSError: The file cannot be written.
        ValueError: The first argument is no trajectory, or its times are no times of a message.
    """
    if not isinstance(trajectory, Trajectory):
        raise ValueError(
            f"expected a jaxik.Trajectory, got {type(trajectory).__name__}; the order is "
            "save_trajectory(trajectory, file), and a plan has its trajectory in plan.trajectory"
        )
    trajectory_files.write(os.fspath(file), _fields(trajectory))


def load_trajectory(file: str | os.PathLike[str]) -> Trajectory:
    """Load a trajectory that :func:`save_trajectory` wrote, or a message or recording of ROS 2.

    From messages (``.yaml``, ``.json``) a JointTrajectory is read, or the one in a FollowJointTrajectory goal. From
    recordings (``.mcap``, or a folder that ``ros2 bag record`` wrote) the first JointTrajectory is read, else the
    JointStates of the topic with most of them.

    Args:
        file: File name, see :func:`save_trajectory` for its endings.

    Returns:
        The trajectory; from ``.npz``, ``.csv`` and ``.json`` equal to the saved one to the last bit.

    Raises:
        FileFormatError: Not a trajectory file; the message names the file and what was expected.
        MissingExtraError: The form needs ``pip install "jaxik[ros]"``.
        OSError: The file cannot be read.
    """
    name = os.fspath(file)
    fields = trajectory_files.read(name)
    try:
        return Trajectory(**fields)
    except (TypeError, ValueError) as error:
        raise trajectory_files.FileFormatError(f"{name}: {error}") from error


def joint_trajectory_message(trajectory: Trajectory) -> dict[str, Any]:
    """Return a trajectory as a trajectory_msgs/JointTrajectory of ROS 2, in plain dictionaries, lists and numbers.

    Velocities and accelerations are those of the cubic spline through the waypoints that begins and ends at rest, which
    a ros2_control joint trajectory controller then plays. Between waypoints it differs from the straight motion of
    :meth:`Trajectory.sample` and can be faster: leave a margin below the velocity limits.

    In a node, ``rosidl_runtime_py.set_message_fields(JointTrajectory(), message)`` makes the message of it.

    Args:
        trajectory: The trajectory.

    Returns:
        The message, with times from the first waypoint on.

    Raises:
        ValueError: Two waypoints are less than a nanosecond apart.

    Example:
        >>> motion = Trajectory(np.array([0.0, 1.5]), np.array([[0.0], [0.3]]), ("elbow",))
        >>> joint_trajectory_message(motion)["points"][1]["time_from_start"]
        {'sec': 1, 'nanosec': 500000000}
    """
    return ros_trajectory.message_of(_fields(trajectory))


def trajectory_from_message(message: Any) -> Trajectory:
    """Return the trajectory in a JointTrajectory message.

    Args:
        message: The message as a dictionary or as the object of a ROS package; or a FollowJointTrajectory goal.

    Returns:
        The trajectory, with times from the start of the message on; its velocities and accelerations are not kept.

    Raises:
        FileFormatError: It is no such message, or no trajectory.
    """
    fields = ros_trajectory.fields_of(message)
    try:
        return Trajectory(**fields)
    except (TypeError, ValueError) as error:
        raise trajectory_files.FileFormatError(f"the message holds no trajectory: {error}") from error


def follow_joint_trajectory_goal(
    trajectory: Trajectory, *, tolerance: float | None = None, goal_time_tolerance: float | None = None
) -> str:
    """Return the goal of a control_msgs/action/FollowJointTrajectory as text for ``ros2 action send_goal``.

    Args:
        trajectory: The trajectory.
        tolerance: Largest position error of every joint at the end [rad]; None for the controller's own.
        goal_time_tolerance: Time that the controller may take longer [s]; None for the controller's own.

    Returns:
        One line of YAML.

    Raises:
        MissingExtraError: PyYAML is absent.
        ValueError: Two waypoints are less than a nanosecond apart.
    """
    return ros_trajectory.goal_text(_fields(trajectory), tolerance, goal_time_tolerance)


def _fields(trajectory: Trajectory) -> dict[str, Any]:
    return {name: getattr(trajectory, name) for name in trajectory.__dataclass_fields__}


def _array(name: str, value: Any, dtype: DTypeLike) -> np.ndarray:
    try:
        return np.array(value, dtype)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"expected numbers for {name}; got {value!r:.80}") from None
