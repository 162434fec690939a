"""Sphinx: the pages of docs/, the notebooks as they are committed, and README, CONTRIBUTING and CHANGELOG, as a site.

The source folder is the repository, so that links between texts hold as they are written.
"""

import tomllib
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]

project = "jaxik"
author = "the jaxik authors"
copyright = f"{author}, Apache License 2.0"
version = release = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]

extensions = ["myst_nb"]
root_doc = "docs/index"
include_patterns = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/**", "notebooks/**"]
exclude_patterns = ["docs/site", "notebooks/sources", ".*", "build", "demo", "**/__pycache__"]

nb_execution_mode = "off"  # tests execute the notebooks, which are committed with their outputs
myst_heading_anchors = 4
html_theme = "furo"
html_title = f"jaxik {release}"
html_static_path = ["static"]
html_css_files = ["jaxik.css"]
html_copy_source = html_show_sourcelink = False
html_additional_pages = {"index": "to_start.html"}
templates_path = ["templates"]
html_theme_options = {"navigation_with_keys": True}
pygments_style, pygments_dark_style = "friendly", "monokai"
