"""The structure holds: imports run one way, files stay small, start-up stays light, no common name is taken."""

import subprocess
import sys
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parent.parent
LAYERS = ("schemas", "engine", "tools", "resources", "prompts", "server", "agent", "evals")
MOST_SOURCE_LINES, MOST_TEST_LINES = 300, 400
HEAVY = (
    "chromadb",
    "commonroad",
    "commonroad_clcs",
    "commonroad_dc",
    "frenetix",
    "libsumo",
    "lxml",
    "matplotlib",
    "numpy",
    "osmnx",
    "PIL",
    "pyproj",
    "scipy",
    "sentence_transformers",
    "shapely",
    "torch",
)


def run(program: str, folder: Path = CHECKOUT) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=False)


def python_files(*folders: str) -> list[Path]:
    return [path for folder in folders for path in sorted((CHECKOUT / folder).rglob("*.py"))]


def too_long(files: list[Path], most: int) -> dict[str, int]:
    lengths = {str(path.relative_to(CHECKOUT)): len(path.read_text(encoding="utf-8").splitlines()) for path in files}
    return {path: lines for path, lines in lengths.items() if lines > most}


def test_imports_run_one_way() -> None:
    program = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))"
    done = run(program)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 broken" in done.stdout


def test_source_files_are_short() -> None:
    files = python_files(*LAYERS)
    assert len(files) > 100
    assert too_long(files, MOST_SOURCE_LINES) == {}


def test_test_files_are_short() -> None:
    assert too_long(python_files("tests"), MOST_TEST_LINES) == {}


def test_every_package_is_installed() -> None:
    import tomllib

    settings = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    found = {"plannerforge." + ".".join(path.parent.relative_to(CHECKOUT).parts) for path in python_files(*LAYERS)}
    assert found | {"plannerforge"} == set(settings["packages"])


def test_every_folder_of_source_is_a_package() -> None:
    missing = {path.parent for path in python_files(*LAYERS) if not (path.parent / "__init__.py").is_file()}
    assert missing == set()


@pytest.mark.parametrize(
    "module",
    ["plannerforge.server.command_line", "plannerforge.server.assembly", "plannerforge.engine.execution.worker"],
)
def test_start_loads_nothing_heavy(module: str) -> None:
    done = run(f"import sys, {module}; print(sorted({{name.partition('.')[0] for name in sys.modules}}))")
    assert done.returncode == 0, done.stderr
    loaded = {name.strip(" '") for name in done.stdout.strip("[]\n").split(",")}
    assert "plannerforge" in loaded
    assert loaded & set(HEAVY) == set()


def test_all_schemas_and_tools_load_nothing_heavy() -> None:
    done = run(
        "import sys\n"
        "from plannerforge.tools.registry import TOOLS\n"
        "from plannerforge.server.tool_schema import tool_description\n"
        "for spec in TOOLS:\n"
        "    tool_description(spec), spec.load_function()\n"
        "print(sorted({name.partition('.')[0] for name in sys.modules}))\n"
    )
    assert done.returncode == 0, done.stderr
    assert {name.strip(" '") for name in done.stdout.strip("[]\n").split(",")} & set(HEAVY) == set()


@pytest.mark.parametrize("name", LAYERS)
def test_common_names_are_not_taken_in_other_folders(name: str, tmp_path: Path) -> None:
    done = run(
        f"import plannerforge.{name}, importlib.util\n"
        f"found = importlib.util.find_spec('{name}')\n"
        "print(list(found.submodule_search_locations or [found.origin]) if found else [])",
        tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert str(CHECKOUT / name) not in done.stdout, "other packages may have the name, we may not"
