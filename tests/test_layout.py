"""The tree is whole: every package and data file is installed, no bench is, and tests keep to what is public."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

import pytest
from support.tree import CHECKOUT, LAYERS, bench_files, source_files


def setuptools_settings() -> dict[str, dict[str, dict[str, list[str]]]]:
    settings: dict[str, dict[str, dict[str, list[str]]]] = tomllib.loads(
        (CHECKOUT / "pyproject.toml").read_text(encoding="utf-8")
    )["tool"]["setuptools"]
    return settings


def packages() -> set[Path]:
    return {path.parent for path in source_files()}


def test_every_folder_of_source_is_a_package() -> None:
    assert {folder for folder in packages() if not (folder / "__init__.py").is_file()} == set()


def test_every_package_of_the_tree_is_installed() -> None:
    program = "from distutils.core import run_setup; print(*run_setup('setup.py', stop_after='init').packages)"
    command = [sys.executable, "-W", "ignore", "-c", f"import setuptools; {program}"]
    found = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, check=True).stdout.split()
    names = {".".join(("plannerforge", *folder.relative_to(CHECKOUT).parts)) for folder in packages()}
    assert set(found) == {"plannerforge", *names}
    assert set(setuptools_settings()["package-dir"]) == {"plannerforge", *(f"plannerforge.{name}" for name in LAYERS)}


def test_every_data_file_of_the_tree_is_installed() -> None:
    patterns = [
        f"{package.removeprefix('plannerforge.').replace('.', '/')}/{pattern}"
        for package, patterns in setuptools_settings()["package-data"].items()
        for pattern in patterns
    ]
    data = [
        path.relative_to(CHECKOUT).as_posix()
        for folder in LAYERS
        for path in (CHECKOUT / folder).rglob("*")
        if path.is_file() and path.suffix not in {".py", ".pyc"}
    ]
    assert data
    assert [name for name in data if not any(fnmatch(name, pattern) for pattern in patterns)] == []


def trees_of_tests_that_replace() -> Iterator[tuple[str, ast.Module]]:
    for path in sorted((CHECKOUT / "tests").rglob("*.py")):
        if re.search(rb"setattr|delattr|patch|object", source := path.read_bytes()):
            yield path.relative_to(CHECKOUT).as_posix(), ast.parse(source)


def foreign_modules(tree: ast.AST) -> set[str]:
    """The names under which a test imports modules that are neither ours nor its helpers."""
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    foreign = [
        node
        for node in imports
        if not (isinstance(node, ast.ImportFrom) and re.match(r"(plannerforge|support)\b", node.module or ""))
    ]
    return {alias.asname or alias.name for node in foreign for alias in node.names if "plannerforge" not in alias.name}


def patched_private_names(tree: ast.AST) -> list[str]:
    """The names of ours that begin with an underscore and that a test sets on an object or in a module.

    Where a library has no public place to set something, its private one may be used.
    """
    foreign = foreign_modules(tree)
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)]
    calls = [node for node in calls if not (node.args and ast.unparse(node.args[0]) in foreign)]
    setters = [node for node in calls if node.func.attr in {"setattr", "delattr", "patch", "object"}]  # type: ignore[attr-defined]
    targets = [target for node in setters for target in node.args[:2]]
    words = [target.value for target in targets if isinstance(target, ast.Constant)]
    return [word for word in words if isinstance(word, str) and re.search(r"(^|\.)_(?!_)", word)]


def test_no_test_replaces_a_private_name() -> None:
    found = {name: words for name, tree in trees_of_tests_that_replace() if (words := patched_private_names(tree))}
    assert found == {}


@pytest.mark.parametrize(
    ("statement", "count"),
    [
        ("monkeypatch.setattr(module, '_private', None)", 1),
        ("monkeypatch.setattr('plannerforge.engine.edits.apply._scene', None)", 1),
        ("mock.patch.object(module, '_private')", 1),
        ("import library; monkeypatch.setattr(library, '_private', None)", 0),
        ("from plannerforge.engine import edits; monkeypatch.setattr(edits, '_private', None)", 1),
        ("monkeypatch.setattr(module, 'public', None)", 0),
    ],
)
def test_a_replaced_private_name_is_seen(statement: str, count: int) -> None:
    assert len(patched_private_names(ast.parse(statement))) == count


def functions_of(tree: ast.Module) -> set[str]:
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_a_module_that_has_a_main_runs_it_when_it_is_run() -> None:
    trees = {
        path.relative_to(CHECKOUT).as_posix(): ast.parse(path.read_bytes())
        for path in (*source_files(), *bench_files())
        if b"\ndef main(" in path.read_bytes()
    }
    mains = {name: tree for name, tree in trees.items() if "main" in functions_of(tree)}
    assert len(mains) > 5
    guarded = {
        name for name, tree in mains.items() if ast.unparse(tree.body[-1]).startswith("if __name__ == '__main__'")
    }
    assert set(mains) - guarded == set()
