"""Imports: they run one way and through faces, start-up stays light, no common name is taken."""

import json
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
from support.tree import CHECKOUT, LAYERS, dotted_name, engine_packages, face_names, imports_of, source_files

HEAVY = {
    "chromadb",
    "commonroad",
    "commonroad_clcs",
    "commonroad_dc",
    "frenetix",
    "libsumo",
    "lxml",
    "matplotlib",
    "numpy",
    "osmium",
    "PIL",
    "pyarrow",
    "pyproj",
    "scipy",
    "sentence_transformers",
    "shapely",
    "torch",
}
LIGHT = [
    ("catalog", "Search", {"maps", "vehicles"}),
    ("commonroad", "derived_benchmark_id", set()),
    ("cosimulation", "presets", {"vehicles"}),
    ("execution", "Executor", set()),
    ("maps", "MAP_ENDINGS", set()),
    ("network", "station_m", set()),
    ("planners", "PLANNERS", set()),
    ("rendering", "report_image", {"execution", "workspace"}),
    ("traffic", "plan_counts", {"vehicles"}),
    ("tuning", "DEFAULT_CONFIGURATION", {"planners", "vehicles"}),
    ("vehicles", "vehicle_classes", set()),
    ("workspace", "Recipe", set()),
]
"""A name on each face that the server's process may ask for, and other packages of which it may load modules."""


def run(program: str, folder: Path = CHECKOUT) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=False)


def loaded_after(program: str) -> set[str]:
    """The names of all modules that a program leaves loaded in a process of its own."""
    done = run(f"{program}\nimport sys\nprint(*sys.modules)")
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


def heavy(modules: set[str]) -> set[str]:
    return {module.partition(".")[0] for module in modules} & HEAVY


def telemetry(modules: set[str]) -> set[str]:
    """The modules that only a server with telemetry needs."""
    return {
        name
        for name in modules
        if (name.startswith("opentelemetry.") and ".sdk" in name)
        or name.startswith("opentelemetry.exporter")
        or name == "plannerforge.server.observing.telemetry"
    }


def beside_the_face(module: str, source: str, faces: Mapping[str, list[str]]) -> list[str]:
    """What a module imports of engine packages that it is not part of, other than a name on the package's face."""
    wrong = []
    for origin, name in imports_of(module, source):
        package = ".".join(origin.split(".")[:3])
        elsewhere = package in faces and not module.startswith(f"{package}.")
        if elsewhere and (origin != package or name not in faces[package]):
            wrong.append(f"{module} imports {name or 'all'} of {origin}")
    return wrong


def test_imports_run_one_way() -> None:
    program = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))"
    done = run(program)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 broken" in done.stdout


def test_an_engine_package_is_imported_through_its_face_only() -> None:
    faces = {f"plannerforge.engine.{package}": face_names(package) for package in engine_packages()}
    sources = {dotted_name(path): path.read_text(encoding="utf-8") for path in source_files()}
    assert len(sources) > 100
    assert [wrong for module, source in sources.items() for wrong in beside_the_face(module, source, faces)] == []


@pytest.mark.parametrize(
    ("statement", "wrong"),
    [
        ("from ..engine.edits import apply_edits", False),
        ("from ..engine.edits.apply import apply_edits", True),
        ("from ..engine.edits import apply", True),
        ("import plannerforge.engine.edits", True),
        ("from ..engine.criticality import gaps_m", False),
    ],
)
def test_an_import_past_the_face_is_detected(statement: str, wrong: bool) -> None:
    faces = {"plannerforge.engine.edits": ["apply_edits"]}
    assert bool(beside_the_face("plannerforge.tools.made_up", statement, faces)) is wrong
    assert beside_the_face("plannerforge.engine.edits.made_up", statement.replace("..engine.edits", ".."), faces) == []


@pytest.mark.parametrize("package", engine_packages())
def test_a_face_explains_each_name_and_no_name_equals_a_module(package: str) -> None:
    folder = CHECKOUT / "engine" / package
    text = (folder / "__init__.py").read_text(encoding="utf-8").split('"""')[1]
    explained = dict(re.findall(r"^``(\w+)``: (.+?\.)$(?=\n``|\n*\Z)", text, re.MULTILINE | re.DOTALL))
    names = face_names(package)
    assert {name for name in names if explained.get(name, "TODO.") == "TODO."} == set()
    assert set(explained) == set(names)
    assert set(names) & {path.stem for path in folder.iterdir()} == set()


def test_the_faces_load_no_module_behind_them() -> None:
    faces = {f"plannerforge.engine.{package}" for package in engine_packages()}
    loaded = loaded_after("\n".join(f"import {face}" for face in sorted(faces)))
    ours = {name for name in loaded if name.startswith("plannerforge")}
    assert ours == {"plannerforge", "plannerforge.engine", *faces}
    assert heavy(loaded) == set()


@pytest.mark.parametrize(("package", "name", "others"), LIGHT, ids=[f"{package}.{name}" for package, name, _ in LIGHT])
def test_a_light_name_on_a_face_loads_no_other_package(package: str, name: str, others: set[str]) -> None:
    loaded = loaded_after(f"from plannerforge.engine.{package} import {name}")
    parts = [module.split(".") for module in loaded if module.startswith("plannerforge.engine.")]
    behind = {other for _, _, other, *module in parts if module}
    assert behind <= {package, *others}
    assert heavy(loaded) == set()


@pytest.mark.parametrize("module", ["plannerforge.cli.program", "plannerforge.engine.execution.worker"])
def test_start_loads_no_heavy_modules(module: str) -> None:
    loaded = loaded_after(f"import {module}")
    assert module in loaded
    assert heavy(loaded) == set()


def test_server_and_tools_load_no_heavy_modules() -> None:
    loaded = loaded_after(
        "from plannerforge.server.assembly import create_server\n"
        "from plannerforge.server.settings import Settings\n"
        "from plannerforge.tools.registry import TOOLS\n"
        "from plannerforge.server.tool_schema import tool_description\n"
        "for spec in TOOLS:\n"
        "    tool_description(spec), spec.load_function()\n"
        "create_server(Settings())\n"
    )
    assert heavy(loaded) == set()
    assert telemetry(loaded) == set()


def test_common_names_stay_free_in_other_folders(tmp_path: Path) -> None:
    imports = "\n".join(f"import plannerforge.{name}" for name in LAYERS)
    done = run(
        f"import importlib.util, json, sys\n{imports}\n"
        f"sys.path = [folder for folder in sys.path if folder != {str(CHECKOUT)!r}]\n"  # where PYTHONPATH names it
        f"found = {{name: importlib.util.find_spec(name) for name in {LAYERS!r}}}\n"
        "print(json.dumps({name: [*(spec.submodule_search_locations or ()), spec.origin]"
        " for name, spec in found.items() if spec}))",
        tmp_path,
    )
    assert done.returncode == 0, done.stderr
    ours = {name: places for name, places in json.loads(done.stdout).items() if str(CHECKOUT / name) in str(places)}
    assert ours == {}, "other packages may have the name, we may not"
