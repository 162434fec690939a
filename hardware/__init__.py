"""Playing trajectories on servos: boards, calibration, clock and player."""
