"""The set-up script takes torch for the CPU where it can, and says where it was had from."""

import functools
import http.server
import os
import subprocess
import sys
import threading
import tomllib
import venv
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.tree import CHECKOUT


def pinned_torch() -> str:
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return next(line.partition("==")[2] for line in project["dependencies"] if line.startswith("torch=="))


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


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the usual index has the build for the CPU")
def test_torch_is_had_for_the_cpu_and_otherwise_from_the_usual_index(tmp_path: Path) -> None:
    version = pinned_torch()
    put_wheel(tmp_path / "indexes" / "usual", version)
    environment = tmp_path / "venv"
    venv.create(environment, with_pip=True, symlinks=True)
    with serving(tmp_path / "indexes") as address:
        told, installed = set_up(environment, address)
        assert "from the usual index" in told
        assert installed == version
        put_wheel(tmp_path / "indexes" / "cpu", f"{version}+cpu")
        told, installed = set_up(environment, address)
        assert f"from {address}/cpu" in told
        assert "from the usual index" not in told
        assert installed == f"{version}+cpu"
