"""Paths: targets with times, from files or built in."""

from jaxik.paths.example_paths import example_path, example_path_names
from jaxik.paths.path import Path, Placement, as_pointing
from jaxik.paths.path_files import load_path, matrix_from_wxyz, save_path

__all__ = [
    "Path",
    "Placement",
    "as_pointing",
    "example_path",
    "example_path_names",
    "load_path",
    "matrix_from_wxyz",
    "save_path",
]
