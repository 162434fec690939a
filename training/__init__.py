"""Learning with the solver: elbow policies, natural elbows from people, kinematic calibration."""

from training.calibration import Calibration, CalibrationError, calibrate
from training.kinematic_errors import KinematicErrors, deviating_arm
