"""Arms as MuJoCo describes them: MJCF written from an arm, and arms read from MJCF."""

from jaxik.mjcf.reading import from_mjcf
from jaxik.mjcf.writing import to_mjcf

__all__ = ["from_mjcf", "to_mjcf"]
