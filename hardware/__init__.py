"""Playing trajectories on servos: boards, calibration and player."""

from hardware.board import Board, BoardStatus, Fault, State, Waypoint
from hardware.board_check import CheckResult, CheckStatus, JointCheck, check
from hardware.boards import SimulatedBoard, connect
from hardware.boards.servo_reading import ServoReading
from hardware.bus_scan import FoundServo, ScanResult, ScanStatus, scan
from hardware.clock import Clock, VirtualClock, WallClock
from hardware.errors import BoardError, CalibrationError, HardwareError, LinkError, PlaybackError, ServoError
from hardware.joint_map import JointCalibration, JointMap, Measured, ideal_joint_map
from hardware.joint_map_file import load_joint_map, save_joint_map
from hardware.playback import Tolerances
from hardware.player import go_to_safe_pose, play
from hardware.report import LogRow, PlayLog, PlayReport, PlayResult, Tracking
from hardware.servo_calibration import CalibrationStatus, ServoCalibrationResult, calibrate_servos
from hardware.stopping import OnStop, keep_holding
from hardware.teaching import record

__all__ = [
    "Board",
    "BoardError",
    "BoardStatus",
    "CalibrationError",
    "CalibrationStatus",
    "CheckResult",
    "CheckStatus",
    "Clock",
    "Fault",
    "FoundServo",
    "HardwareError",
    "JointCalibration",
    "JointCheck",
    "JointMap",
    "LinkError",
    "LogRow",
    "Measured",
    "OnStop",
    "PlayLog",
    "PlayReport",
    "PlayResult",
    "PlaybackError",
    "ScanResult",
    "ScanStatus",
    "ServoCalibrationResult",
    "ServoError",
    "ServoReading",
    "SimulatedBoard",
    "State",
    "Tolerances",
    "Tracking",
    "VirtualClock",
    "WallClock",
    "Waypoint",
    "calibrate_servos",
    "check",
    "connect",
    "go_to_safe_pose",
    "ideal_joint_map",
    "keep_holding",
    "load_joint_map",
    "play",
    "record",
    "save_joint_map",
    "scan",
]
