"""The source tree for tests of its layout: files, imports, engine packages and their public names."""

import ast
from collections.abc import Iterator
from importlib.util import module_from_spec, resolve_name, spec_from_file_location
from pathlib import Path
from types import ModuleType

CHECKOUT = Path(__file__).resolve().parents[2]
LAYERS = (
    "schemas",
    "engine",
    "workflows",
    "tools",
    "resources",
    "prompts",
    "server",
    "library",
    "agent",
    "evals",
    "cli",
)
"""The folders that are packages of ``plannerforge``."""


def source_files() -> list[Path]:
    """Return all Python files of the package, in the order of their paths."""
    return [path for folder in LAYERS for path in sorted((CHECKOUT / folder).rglob("*.py"))]


def bench_files() -> list[Path]:
    """Return all Python files of the benchmarks, which are not part of the package."""
    return sorted((CHECKOUT / "benchmarks").rglob("*.py"))


def dotted_name(path: Path) -> str:
    """Return the import name of a source file, with ``__init__`` as its last part for a package's."""
    return ".".join(("plannerforge", *path.relative_to(CHECKOUT).with_suffix("").parts))


def imports_of(module: str, source: str) -> Iterator[tuple[str, str]]:
    """Return every import in a module's source: the absolute module, and the imported name (empty for a whole module).

    Args:
        module: from ``dotted_name``.
        source: the text of the module.
    """
    package = module.rpartition(".")[0]
    for node in import_statements(source):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        else:
            origin = resolve_name("." * node.level + (node.module or ""), package) if node.level else str(node.module)
            yield from ((origin, alias.name) for alias in node.names)


def import_statements(source: str) -> Iterator[ast.Import | ast.ImportFrom]:
    """Return the import statements of a source text, wherever they stand.

    Only statements are visited: ``ast.walk`` visits each expression too, and takes as long as parsing.
    """
    waiting: list[ast.AST] = [ast.parse(source)]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            inner = getattr(node, part, None)
            waiting += inner if isinstance(inner, list) else ()


def loaded_script(name: str) -> ModuleType:
    """Return a script of the checkout as a module, without running it."""
    spec = spec_from_file_location(name, CHECKOUT / "scripts" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def engine_packages() -> list[str]:
    """Return the names of the engine's packages; a module next to them is its own interface."""
    return sorted(init.parent.name for init in (CHECKOUT / "engine").glob("*/__init__.py"))


def face_names(package: str) -> list[str]:
    """Return the public names of an engine package: the imports of its ``__init__`` for type checkers."""
    tree = ast.parse((CHECKOUT / "engine" / package / "__init__.py").read_bytes())
    checked = [node for block in tree.body if isinstance(block, ast.If) for node in block.body]
    return sorted(alias.name for node in checked if isinstance(node, ast.ImportFrom) for alias in node.names)
