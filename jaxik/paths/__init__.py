"""Paths: targets with times, from files or built in."""

from jaxik.paths.example_paths import example_path, example_path_names
from jaxik.paths.path import Path, Placement
from jaxik.paths.path_files import load_path, save_path

__all__ = [
    "Path",
    "Placement",
    "example_path",
    "example_path_names",
    "load_path",
    "save_path",
]
