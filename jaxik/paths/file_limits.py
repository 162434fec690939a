"""Bounds on the numbers in path files of every form."""

UNIT_TOLERANCE = 1e-3
"""Deviation of a quaternion's length from 1: three decimals are the coarsest rounding in published paths."""

LARGEST = 1e19
"""Largest number [m, s]: far beyond any path, and squares of three add up in float32 still."""
