"""Kinematic calibration of an arm from measured tip positions."""
