"""The set-up script: by uv where that is, else by pip, with torch for the CPU where it can be had; it says which."""

import ensurepip
import functools
import http.server
import os
import shutil
import subprocess
import sys
import threading
import tomllib
import venv
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from support.tree import CHECKOUT

from benchmarks.serve.install import LEFT_OUT


def pinned_torch() -> str:
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return next(
        line.partition("==")[2] for line in project["optional-dependencies"]["embeddings"] if line.startswith("torch==")
    )


def put_wheel(index: Path, version: str) -> None:
    """Put an empty ``torch`` of a version into a simple package index."""
    folder = index / "torch"
    folder.mkdir(parents=True)
    head = f"torch-{version}.dist-info"
    name = f"torch-{version}-py3-none-any.whl"
    with zipfile.ZipFile(folder / name, "w") as wheel:
        wheel.writestr("torch.py", f"__version__ = '{version}'\n")
        wheel.writestr(f"{head}/METADATA", f"Metadata-Version: 2.1\nName: torch\nVersion: {version}\n")
        wheel.writestr(
            f"{head}/WHEEL", "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        wheel.writestr(f"{head}/RECORD", "")
    (folder / "index.html").write_text(f'<a href="{name.replace("+", "%2B")}">{name}</a>', encoding="utf-8")


@contextmanager
def serving(folder: Path) -> Iterator[str]:
    """A package index on the loopback."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *args: object) -> None:
            del args

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def set_up(folder: Path, address: str) -> tuple[str, str]:
    """What the script says while it installs torch into an environment, and the version that is there afterwards."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PIP_")}
    indexes = {"PIP_INDEX_URL": f"{address}/usual", "PLANNERFORGE_TORCH_INDEX": f"{address}/cpu"}
    script = ["bash", "scripts/setup.sh", str(folder), "torch"]
    environment = kept | indexes | {"PIP_CONFIG_FILE": os.devnull}
    told = subprocess.run(script, cwd=CHECKOUT, env=environment, capture_output=True, text=True, check=True)
    look = [folder / "bin" / "python", "-c", "import torch; print(torch.__version__)"]
    return told.stdout, subprocess.run(look, capture_output=True, text=True, check=True).stdout.strip()


@pytest.fixture(scope="module")
def new_environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with pip alone, made once: tests copy it.

    The wheel of pip that comes with Python is unpacked, because pip needs seconds to install itself. Its first use
    leaves bytecode for the copies.
    """
    folder = tmp_path_factory.mktemp("environment") / "venv"
    wheels = sorted((Path(ensurepip.__file__).parent / "_bundled").glob("pip-*.whl"))
    venv.create(folder, with_pip=not wheels, symlinks=True)
    python = folder / "bin" / "python"
    if wheels:
        with zipfile.ZipFile(wheels[-1]) as wheel:
            wheel.extractall(next((folder / "lib").glob("python3*")) / "site-packages")
        (folder / "bin" / "pip").write_text(f'#!/bin/sh\nexec "{python}" -m pip "$@"\n', encoding="utf-8")
        (folder / "bin" / "pip").chmod(0o755)
    subprocess.run([python, "-m", "pip", "install", "--no-index", "absent"], capture_output=True, check=False)
    return folder


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the usual index has the build for the CPU")
def test_torch_comes_for_the_cpu_and_otherwise_from_the_usual_index(tmp_path: Path, new_environment: Path) -> None:
    version = pinned_torch()
    put_wheel(tmp_path / "indexes" / "usual", version)
    environment = shutil.copytree(new_environment, tmp_path / "venv", symlinks=True)
    with serving(tmp_path / "indexes") as address:
        told, installed = set_up(environment, address)
        assert "from the usual index" in told
        assert installed == version
        put_wheel(tmp_path / "indexes" / "cpu", f"{version}+cpu")
        told, installed = set_up(environment, address)
        assert f"from {address}/cpu" in told
        assert "from the usual index" not in told
        assert installed == f"{version}+cpu"


def stand_in_uv(folder: Path, status: int, new_environment: Path) -> Path:
    """A program ``uv`` that writes down its arguments, gives a new environment and ends so."""
    folder.mkdir()
    program = folder / "uv"
    program.write_text(
        f"""#!/bin/bash
echo "$*" >> {folder}/asked
if [ "$1" = venv ]; then cp -a {new_environment} "${{@: -1}}"; exit; fi
exit {status}
""",
        encoding="utf-8",
    )
    program.chmod(0o755)
    return folder


def set_up_by_uv(folder: Path, uv: Path) -> subprocess.CompletedProcess[str]:
    nowhere = {"PIP_CONFIG_FILE": os.devnull, "PIP_INDEX_URL": "http://127.0.0.1:9/", "PIP_NO_INDEX": "1"}
    environment = os.environ | nowhere | {"PATH": f"{uv}{os.pathsep}{os.environ['PATH']}"}
    script = ["bash", "scripts/setup.sh", str(folder)]
    return subprocess.run(script, cwd=CHECKOUT, env=environment, capture_output=True, text=True, check=False)


def test_uv_installs_exactly_the_pinned_versions_if_it_is_available(tmp_path: Path, new_environment: Path) -> None:
    uv = stand_in_uv(tmp_path / "bin", 0, new_environment)
    told = set_up_by_uv(tmp_path / "venv", uv)
    assert told.returncode == 0, told.stderr
    assert "by uv" in told.stdout
    asked = (uv / "asked").read_text(encoding="utf-8").splitlines()
    assert [line.split()[0] for line in asked] == ["venv", "pip"]
    assert "--no-deps -r packaging/requirements.txt -e ." in asked[1]


def test_pip_continues_if_uv_fails_and_chooses_if_versions_are_missing(tmp_path: Path, new_environment: Path) -> None:
    told = set_up_by_uv(tmp_path / "venv", stand_in_uv(tmp_path / "bin", 2, new_environment))
    steps = [
        "by uv",
        "uv failed; trying pip",
        "by pip",
        "pip chooses others",
        "Installing PlannerForge and its dependencies (two",
    ]
    places = [told.stdout.find(step) for step in steps]
    assert -1 not in places, told.stdout
    assert places == sorted(places), told.stdout
    assert told.returncode != 0


def pinned() -> dict[str, list[Requirement]]:
    """What the file of versions names, by package; more than one where systems or Pythons differ."""
    found: dict[str, list[Requirement]] = {}
    for line in (CHECKOUT / "packaging" / "requirements.txt").read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            one = Requirement(line)
            found.setdefault(canonicalize_name(one.name), []).append(one)
    return found


def pinned_here() -> dict[str, str]:
    here = [one for several in pinned().values() for one in several if one.marker is None or one.marker.evaluate()]
    return {canonicalize_name(one.name): str(one.specifier).removeprefix("==") for one in here}


def test_the_file_of_versions_names_all_requirements_except_unimported_ones() -> None:
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    versions = pinned_here()
    assert not set(LEFT_OUT) & set(pinned())
    for asked in map(Requirement, project["dependencies"]):
        name = canonicalize_name(asked.name)
        if name not in LEFT_OUT:
            assert versions[name] in asked.specifier, f"{asked}: run make requirements"


def test_the_file_of_versions_has_all_requirements_of_its_packages() -> None:
    versions = pinned_here()
    compared = 0
    for name, version in versions.items():
        with suppress(PackageNotFoundError):
            package = distribution(name)
            if package.version != version:
                continue
            compared += 1
            for asked in map(Requirement, package.requires or ()):
                wanted = canonicalize_name(asked.name)
                if wanted not in LEFT_OUT and (asked.marker is None or asked.marker.evaluate({"extra": ""})):
                    assert versions[wanted] in asked.specifier, f"{name} asks for {asked}"
    assert compared > len(versions) / 2
