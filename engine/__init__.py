"""The domain library; it does not depend on MCP.

import-linter enforces the order of its packages (``pyproject.toml``): each imports only those below it, and only their
public names, which are those in ``__init__.py`` (the *face*). ``criticality`` is a package of one file.
"""

import ast
import importlib
import sys
from collections.abc import Callable
from pathlib import Path


def lazy_face(package: str, file: str) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Return ``__getattr__`` and ``__dir__`` for a package that imports a name's module on first use of the name.

    The names are those that the package imports by relative paths under ``TYPE_CHECKING``, where type checkers, editors
    and import graphs read them too. The server's process imports many faces, and these imports must not load numpy.

    Args:
        package: the package's ``__name__``.
        file: its ``__file__``.
    """
    modules = _names_on_face(Path(file))

    def get(name: str) -> object:
        if name not in modules:
            raise AttributeError(f"{package} has no {name!r} on its face; it has {', '.join(sorted(modules))}")
        value = getattr(importlib.import_module(modules[name], package), name)
        setattr(sys.modules[package], name, value)
        return value

    return get, lambda: sorted(modules)


def _names_on_face(file: Path) -> dict[str, str]:
    """Return the relative module of each name that a face imports."""
    checked = (node for node in ast.parse(file.read_bytes()).body if isinstance(node, ast.If))
    imports = (node for block in checked for node in block.body if isinstance(node, ast.ImportFrom) and node.level)
    return {alias.name: "." * node.level + (node.module or "") for node in imports for alias in node.names}
