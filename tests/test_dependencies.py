"""What the code imports and what the package asks for agree, so that a fresh install works like a lived-in one."""

import ast
import re
import sys
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.metadata import packages_distributions

from support.tree import CHECKOUT, LAYERS, import_statements

COMES_WITH = {
    "pydantic-core": "pydantic",
    "sumolib": "eclipse-sumo",
    "transformers": "sentence-transformers",
    "werkzeug": "pytest-httpserver",
}
SHARED_NAMES = {"opentelemetry": {"sdk": "opentelemetry-sdk", "exporter": "opentelemetry-exporter-otlp-json-http"}}
"""Top-level names that several packages share: which one a module below them is of, where it is not ``NAME-api``."""
RUN_ELSEWHERE = {
    "benchmarks/analysis/crime_driver.py": "runs in the environment of CriMe, which is set beside our measures",
    "benchmarks/failures/peers.py": "NSGA-II needs the package of benchmarks/failures/peers_requirements.txt",
    "benchmarks/maps/factory_driver.py": "runs in the other generator's environment, which a bench makes for it",
    "benchmarks/tuning/reference_driver.py": "runs in the environment of the loop that is set beside ours",
    **{
        str(path.relative_to(CHECKOUT)): "runs in the environment of the client that it uses"
        for path in (CHECKOUT / "benchmarks" / "serve" / "hosts" / "drivers").glob("*_driver.py")
    },
}
ASKED_FOR_UNIMPORTED = {
    "commonroad-clcs": "commonroad-drivability-checker imports it without asking for it",
    "cmaes": "optuna imports it without asking for it",
}


def normalised(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def asked_for(*, with_extras: bool = False, for_developers: bool = False) -> set[str]:
    settings = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))
    project = settings["project"]
    extras = [line for lines in project["optional-dependencies"].values() for line in lines] if with_extras else []
    lines = [*project["dependencies"], *extras, *(settings["dependency-groups"]["dev"] if for_developers else [])]
    return {normalised(re.split(r"[<>=~!\[; ]", line, maxsplit=1)[0]) for line in lines}


def module_of(name: str) -> str:
    """The top-level name, or the package where several share that."""
    first, _, rest = name.partition(".")
    shared = SHARED_NAMES.get(first)
    return first if shared is None else shared.get(rest.partition(".")[0], f"{first}-api")


@cache
def imported_modules(folders: tuple[str, ...] = LAYERS) -> set[str]:
    modules: set[str] = set()
    files = {file for folder in folders for file in (CHECKOUT / folder).rglob("*.py")}
    for path in files - {CHECKOUT / script for script in RUN_ELSEWHERE}:
        for node in import_statements(path.read_text(encoding="utf-8")):
            if isinstance(node, ast.Import):
                modules.update(module_of(alias.name) for alias in node.names)
            elif node.level == 0 and node.module:
                modules.add(module_of(node.module))
    return modules - set(sys.stdlib_module_names) - {"plannerforge", "benchmarks"}


@cache
def owners() -> Mapping[str, list[str]]:
    """The distributions of each importable package; reading the lists of all installed files takes seconds."""
    return packages_distributions()


def imported_distributions(folders: tuple[str, ...] = LAYERS) -> set[str]:
    found = {normalised(owners().get(module, [module])[0]) for module in imported_modules(folders)}
    return {COMES_WITH.get(name, name) for name in found}


def test_every_imported_package_is_declared() -> None:
    assert imported_distributions() - asked_for(with_extras=True) == set()


def test_every_declared_package_is_imported() -> None:
    assert asked_for() - imported_distributions() == set(ASKED_FOR_UNIMPORTED)


def test_every_package_of_the_benchmarks_is_declared_for_developers() -> None:
    assert imported_distributions(("benchmarks",)) - asked_for(with_extras=True, for_developers=True) == set()
