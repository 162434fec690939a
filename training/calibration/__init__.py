"""Kinematic calibration: an arm's real geometry from measured tip points."""
