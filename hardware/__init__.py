"""Playing trajectories on servos: boards, calibration, clock and player."""

from hardware.boards import SimulatedBoard, connect
from hardware.clock import Clock, VirtualClock, WallClock
from hardware.device import Device, DeviceStatus, Fault, State, Waypoint
from hardware.errors import BoardError, CalibrationError, HardwareError, LinkError
from hardware.joint_map import JointCalibration, JointMap, ideal_joint_map, load_joint_map, save_joint_map
from hardware.player import play
from hardware.report import PlayLog, PlayReport, PlayResult, Tracking
from hardware.teaching import record

__all__ = [
    "BoardError",
    "CalibrationError",
    "Clock",
    "Device",
    "DeviceStatus",
    "Fault",
    "HardwareError",
    "JointCalibration",
    "JointMap",
    "LinkError",
    "PlayLog",
    "PlayReport",
    "PlayResult",
    "SimulatedBoard",
    "State",
    "Tracking",
    "VirtualClock",
    "WallClock",
    "Waypoint",
    "connect",
    "ideal_joint_map",
    "load_joint_map",
    "play",
    "record",
    "save_joint_map",
]
