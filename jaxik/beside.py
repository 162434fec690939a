"""The packages beside jaxik under names that no folder of a user can take: ``jaxik.training`` and ``jaxik.hardware``.

``training`` and ``hardware`` are words that projects use for folders of their own. Where such a folder stands first on
the import path, ``import training`` finds it. The names under jaxik always mean the installed packages: as the same
modules where nothing stands before them, else loaded once more from their folder, with their imports of each other
renamed.
"""

import ast
import importlib.util
import sys
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

HOME = Path(__file__).resolve().parents[1]
BESIDE = ("hardware", "training")
_PREFIX = "jaxik."


def adopt(alias: str) -> None:
    """Put an installed package in the place of the module that is being imported.

    Args:
        alias: Name of the module, such as ``jaxik.training``.

    Raises:
        ImportError: The package is not installed.
    """
    name = alias.removeprefix(_PREFIX)
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())
    if standing_before(name) is None:
        sys.modules[alias] = importlib.import_module(name)
        return
    file = HOME / name / "__init__.py"
    if not file.exists():
        raise ImportError(f"the package {name} is not installed; pip install --force-reinstall --no-deps jaxik")
    spec = importlib.util.spec_from_file_location(
        alias, file, loader=_RenamingLoader(alias, str(file)), submodule_search_locations=[str(file.parent)]
    )
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[alias] = module
    _RenamingLoader(alias, str(file)).exec_module(module)


def standing_before(name: str) -> str | None:
    """Return the file or folder that ``import name`` finds in the place of the installed package, or None.

    Args:
        name: ``training`` or ``hardware``.
    """
    loaded = sys.modules.get(name)
    spec = getattr(loaded, "__spec__", None) if loaded is not None else PathFinder.find_spec(name)
    places = [str(place) for place in (spec.submodule_search_locations or ())] if spec is not None else []
    if any(Path(place).resolve() == HOME / name for place in places):
        return None
    origin = getattr(loaded, "__file__", None) or (spec.origin if spec is not None else None)
    return origin or next(iter(places), "nothing")


class _Finder(MetaPathFinder):
    """Finder of the modules in the adopted packages."""

    def find_spec(self, fullname: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Return how to load ``jaxik.training.x``; None for other modules."""
        package, _, rest = fullname.removeprefix(_PREFIX).partition(".")
        if not fullname.startswith(_PREFIX) or package not in BESIDE or not rest:
            return None
        if sys.modules[_PREFIX + package].__name__ == package:  # nothing stands before it: one set of modules
            real = importlib.import_module(f"{package}.{rest}")
            return ModuleSpec(fullname, _SameModule(real), is_package=hasattr(real, "__path__"))
        spec = PathFinder.find_spec(fullname, path)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _RenamingLoader(fullname, spec.loader.path)
        return spec


class _SameModule(Loader):
    """Loader of a module that is loaded already, under a further name."""

    def __init__(self, module: ModuleType) -> None:
        self._module, self._spec = module, module.__spec__

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Return the module."""
        return self._module

    def exec_module(self, module: ModuleType) -> None:
        """Give the module back its own description, which the import has replaced."""
        module.__spec__ = self._spec


class _RenamingLoader(SourceFileLoader):
    """Loader of a source file whose imports of ``training`` mean ``jaxik.training``, likewise ``hardware``."""

    def get_code(self, fullname: str) -> Any:
        """Return the compiled source; not from its cache, which holds the names as written."""
        return self.source_to_code(self.get_data(self.path), self.path)

    def source_to_code(self, data: Any, path: Any, *, _optimize: int = -1) -> Any:
        """Compile a source with its imports renamed."""
        return compile(_Renamed().visit(ast.parse(data, path)), path, "exec", dont_inherit=True, optimize=_optimize)


class _Renamed(ast.NodeTransformer):
    """Imports of the packages beside jaxik under their names in it."""

    def visit_ImportFrom(self, node: ast.ImportFrom) -> ast.AST:
        """Rename ``from training.x import y``."""
        if node.level == 0 and node.module is not None and node.module.partition(".")[0] in BESIDE:
            node.module = _PREFIX + node.module
        return node

    def visit_Import(self, node: ast.Import) -> ast.AST:
        """Refuse ``import training.x``, which binds the first of its names."""
        for name in node.names:
            if name.name.partition(".")[0] in BESIDE:
                raise ImportError(f"{name.name} is imported as a whole; write `from {name.name} import ...`")
        return node
