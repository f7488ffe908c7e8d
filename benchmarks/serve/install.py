"""From nothing to the first answer in a host: a wheel, a new environment, the host's settings, a call.

Keys:

- ``install_s``: everything by pip, with packages from pip's cache if available.
- ``install_packages_s``: environment, wheel and pinned versions of all dependencies.
- ``install_host_s``: ``plannerforge install`` into a host's settings.
- ``install_answer_s``: from the server's start by those settings to the answer of a search.
- ``install_mb``: size of the environment.
- ``install_cold_s``: everything without pip's cache.
- ``install_uv_s``, ``install_uv_cold_s``, ``install_uv_mb``: the same by uv, which chooses versions itself, with its
  cache and with an empty one.

Neither installs what docs/install.md leaves out. The wheel is built before the clock starts, and uv comes from PyPI,
because users have both.
"""

import os
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import anyio
from mcp import Client, StdioServerParameters
from mcp.client.stdio import stdio_client

from ..faults.http_process import QUIET
from ..harness import Figures, LeftOut
from .bench import ServeBench

_CHECKOUT = Path(__file__).resolve().parents[2]
_VERSIONS = _CHECKOUT / "packaging" / "requirements.txt"
"""A package that pip installs next to the wheel, because it is published with it."""
_HOST = ("codex", ".codex/config.toml", "mcp_servers")
"""A host with all settings in one file of the home folder."""
_BYTES = 1024**2
LEFT_OUT = ("polygon3",)
"""Dependencies that nothing imports (docs/install.md)."""


class InstallTimes(NamedTuple):
    """Seconds of the packages, of the host's settings and of the first answer; megabytes of the environment."""

    packages_s: float
    host_s: float
    answer_s: float
    megabytes: int

    @property
    def all_s(self) -> float:
        """From nothing to the first answer."""
        return round(self.packages_s + self.host_s + self.answer_s, 1)


def measure(bench: ServeBench) -> Figures:
    """Build a wheel, install it into new environments and home folders, and make a host's calls.

    Raises:
        LeftOut: there is no checkout to build a wheel from.
        RuntimeError: a step failed, with its output.
    """
    if not (_CHECKOUT / "pyproject.toml").is_file():
        raise LeftOut("it needs a checkout to build a wheel from")
    folder = bench.folder("install")
    wheel = _built(folder / "dist")
    uv = _uv(folder)
    cold = _measured(folder / "cold", lambda place: _by_pip(place, wheel, "--no-cache-dir"))
    warm = _measured(folder / "warm", lambda place: _by_pip(place, wheel))
    figures: dict[str, float | int | str] = {
        "install_s": warm.all_s,
        "install_packages_s": warm.packages_s,
        "install_host_s": warm.host_s,
        "install_answer_s": warm.answer_s,
        "install_mb": warm.megabytes,
        "install_cold_s": cold.all_s,
    }
    if uv is not None:
        figures["install_uv_cold_s"] = _measured(folder / "uv-cold", lambda place: _by_uv(place, wheel, uv)).all_s
        by_uv = _measured(folder / "uv-warm", lambda place: _by_uv(place, wheel, uv))
        figures |= {"install_uv_s": by_uv.all_s, "install_uv_mb": by_uv.megabytes}
    return figures


def _measured(folder: Path, install: Callable[[Path], None]) -> InstallTimes:
    """Install in one way from nothing to the first answer, and remove the environment afterwards."""
    environment, home = folder / "venv", folder / "home"
    home.mkdir(parents=True)
    begun = time.perf_counter()
    install(environment)
    installed = time.perf_counter()
    program = environment / "bin" / "plannerforge"
    told = _clean() | {"HOME": str(home), **QUIET}
    _run([str(program), "install", _HOST[0], "--workspace", str(folder / "workspace")], environment=told, cwd=home)
    settled = time.perf_counter()
    entry = tomllib.loads((home / _HOST[1]).read_text(encoding="utf-8"))[_HOST[2]]["plannerforge"]
    anyio.run(_ask, entry["command"], entry["args"], told, home)
    answered = time.perf_counter()
    size = sum(file.stat().st_size for file in environment.rglob("*") if file.is_file() and not file.is_symlink())
    shutil.rmtree(environment)
    sys.stderr.write(f"install: {folder.name}: {answered - begun:.1f} s\n")
    return InstallTimes(
        round(installed - begun, 1), round(settled - installed, 2), round(answered - settled, 2), round(size / _BYTES)
    )


def _by_pip(environment: Path, wheel: Path, *options: str) -> None:
    _run([sys.executable, "-m", "venv", str(environment)])
    _run([*_pip(environment), *options, "--no-deps", "-r", str(_VERSIONS), str(wheel)])


def _by_uv(environment: Path, wheel: Path, uv: Path) -> None:
    """Install as docs/install.md says, with a cache that only this measurement fills."""
    overrides = environment.with_name("overrides.txt")
    overrides.write_text("".join(f"{name} ; python_version < '3'\n" for name in LEFT_OUT), encoding="utf-8")
    own = [str(uv), "--quiet", "--cache-dir", str(environment.parents[1] / "uv-cache")]
    _run([*own, "venv", "--python", sys.executable, str(environment)])
    python = str(environment / "bin" / "python")
    _run([*own, "pip", "install", "--python", python, "--overrides", str(overrides), str(wheel)])


def _uv(folder: Path) -> Path | None:
    """Return the program, or None with a note if PyPI does not provide it."""
    _run([sys.executable, "-m", "venv", str(folder / "uv")])
    try:
        _run([*_pip(folder / "uv"), "uv"])
    except RuntimeError as error:
        sys.stderr.write(f"install: uv is not available: {error}\n")
        return None
    return folder / "uv" / "bin" / "uv"


def _built(folder: Path) -> Path:
    _run([sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(_CHECKOUT)])
    return next(folder.glob("*.whl"))


def _pip(environment: Path) -> list[str]:
    return [str(environment / "bin" / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]


def _clean() -> dict[str, str]:
    """Return the environment without variables that let a new one find packages of this one."""
    return {name: value for name, value in os.environ.items() if name not in {"PYTHONPATH", "VIRTUAL_ENV"}}


def _run(command: list[str], *, environment: dict[str, str] | None = None, cwd: Path | None = None) -> None:
    """Run a command.

    Raises:
        RuntimeError: it failed, with the end of its output.
    """
    ended = subprocess.run(command, capture_output=True, text=True, env=environment or _clean(), cwd=cwd, check=False)
    if ended.returncode:
        raise RuntimeError(
            f"{' '.join(command)} ended with {ended.returncode}: {(ended.stderr + ended.stdout)[-2000:]}"
        )


async def _ask(command: str, arguments: list[str], environment: dict[str, str], folder: Path) -> None:
    """Make a host's first calls, and a search in the starter catalogue."""
    server = StdioServerParameters(command=command, args=arguments, env=environment, cwd=folder)
    async with Client(stdio_client(server)) as client:
        await client.list_tools()
        answer = await client.call_tool("find_scenarios", {"limit": 1})
    if answer.is_error or not (answer.structured_content or {}).get("matches"):
        raise RuntimeError(f"the first answer is not a valid one: {answer.content}")
