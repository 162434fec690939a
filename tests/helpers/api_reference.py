"""The generator of the API reference, docs/api_reference.py, as a module."""

import importlib.util
from pathlib import Path

_FILE = Path(__file__).resolve().parents[2] / "docs" / "api_reference.py"
_SPEC = importlib.util.spec_from_file_location("api_reference", _FILE)
assert _SPEC is not None
assert _SPEC.loader is not None
REFERENCE = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(REFERENCE)
