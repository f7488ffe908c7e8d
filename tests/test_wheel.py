"""What is installed from a package index: a wheel out of the sdist, with all data files, that needs no checkout."""

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from support.tree import CHECKOUT

CODE = {".py", ".pyc"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel that is built out of the sdist."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(CHECKOUT)]
    subprocess.run(command, check=True, capture_output=True)
    return next(folder.glob("*.whl"))


def data_files() -> set[str]:
    """Files of the packages that are no code, by their names in a wheel."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=CHECKOUT, capture_output=True, text=True, check=True)
    folders = {path.name for path in (CHECKOUT / "plannerforge").iterdir() if path.is_dir()}
    return {
        f"plannerforge/{name}"
        for name in listed.stdout.split("\0")
        if name.partition("/")[0] in folders and "/" in name and Path(name).suffix not in CODE
    }


@pytest.mark.skipif(not (CHECKOUT / ".git").exists(), reason="what belongs to the package is read from git")
def test_the_wheel_contains_exactly_the_files_of_the_packages(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert data_files() - set(names) == set()
    assert {name.partition("/")[0] for name in names if ".dist-info/" not in name} == {"plannerforge"}


def test_the_page_of_the_package_has_no_link_that_leads_nowhere(wheel: Path) -> None:
    archive = zipfile.ZipFile(wheel)
    (name,) = [name for name in archive.namelist() if name.endswith(".dist-info/METADATA")]
    page = archive.read(name).decode("utf-8").partition("\n\n")[2]
    assert page.startswith("# PlannerForge MCP")
    assert "| `run_planner` |" in page
    assert "(`docs/tutorial.md`)" in page
    assert re.findall(r"\]\((?!https?://)[^)]*\)", page) == []


def test_the_wheel_works_without_the_checkout(wheel: Path, tmp_path: Path) -> None:
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    site = tmp_path / "site"
    program = (
        "import plannerforge, runpy; print(plannerforge.__file__); runpy.run_module('plannerforge', None, '__main__')"
    )
    told = subprocess.run(
        [sys.executable, "-P", "-c", program, "call", "describe_catalog"],
        cwd=tmp_path,
        env={"PLANNERFORGE_WORKSPACE": str(tmp_path / "workspace"), "PATH": "/usr/bin:/bin", "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert told.returncode == 0, told.stderr
    assert told.stdout.startswith(str(site))
    assert "32 scenarios" in told.stdout
