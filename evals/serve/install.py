"""From nothing to the first answer in a host: a wheel, a new environment, the host's settings, a call as it makes it.

Keys: ``install_s`` (all of it, with packages from pip's cache where it has them), ``install_packages_s`` (environment,
torch for the CPU and the wheel with all that it needs), ``install_host_s`` (``plannerforge install`` into a host's
settings), ``install_answer_s`` (the server started as those settings say, to the answer of a search), ``install_mb``
(what the environment takes). The wheel itself is built before the clock starts: a user downloads it.
"""

import os
import subprocess
import sys
import time
import tomllib
from importlib.metadata import requires
from pathlib import Path

import anyio
from mcp import Client, StdioServerParameters
from mcp.client.stdio import stdio_client

from ..faults.http_process import QUIET
from ..harness import Figures, LeftOut
from .bench import ServeBench

_CHECKOUT = Path(__file__).resolve().parents[2]
_TORCH_INDEX = "https://download.pytorch.org/whl/cpu"
_HOST = ("codex", ".codex/config.toml", "mcp_servers")
"""A host whose settings are one file in the home folder."""
_BYTES = 1024**2


def measure(bench: ServeBench) -> Figures:
    """Build a wheel, install it into a new environment and a new home folder, and ask what a host asks.

    Raises:
        LeftOut: there is no checkout to build a wheel from.
        RuntimeError: a step failed, with what it said.
    """
    if not (_CHECKOUT / "pyproject.toml").is_file():
        raise LeftOut("it builds a wheel, and there is no checkout to build it from")
    folder = bench.folder("install")
    wheel = _built(folder / "dist")
    environment, home = folder / "venv", folder / "home"
    home.mkdir()
    begun = time.perf_counter()
    _run([sys.executable, "-m", "venv", str(environment)])
    _install_torch(environment)
    _run([*_pip(environment), str(wheel)])
    installed = time.perf_counter()
    program = environment / "bin" / "plannerforge"
    told = _clean() | {"HOME": str(home), **QUIET}
    _run([str(program), "install", _HOST[0], "--workspace", str(folder / "workspace")], environment=told, cwd=home)
    settled = time.perf_counter()
    entry = tomllib.loads((home / _HOST[1]).read_text(encoding="utf-8"))[_HOST[2]]["plannerforge"]
    anyio.run(_ask, entry["command"], entry["args"], told, home)
    answered = time.perf_counter()
    taken = sum(file.stat().st_size for file in environment.rglob("*") if file.is_file() and not file.is_symlink())
    return {
        "install_s": round(answered - begun, 1),
        "install_packages_s": round(installed - begun, 1),
        "install_host_s": round(settled - installed, 2),
        "install_answer_s": round(answered - settled, 2),
        "install_mb": round(taken / _BYTES),
    }


def _built(folder: Path) -> Path:
    _run([sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(_CHECKOUT)])
    return next(folder.glob("*.whl"))


def _install_torch(environment: Path) -> None:
    """Torch for the CPU, from PyTorch's own index where that can be reached; else what the usual index has."""
    wanted = next(line for line in requires("plannerforge-mcp") or () if line.startswith("torch=="))
    index = os.environ.get("PLANNERFORGE_TORCH_INDEX", _TORCH_INDEX)
    own = [*_pip(environment), "--no-deps", "--retries", "0", "--timeout", "10", "--index-url", index, f"{wanted}+cpu"]
    if sys.platform != "linux" or subprocess.run(own, capture_output=True, env=_clean(), check=False).returncode:
        sys.stderr.write("install: torch from the usual index\n")
        _run([*_pip(environment), wanted])


def _pip(environment: Path) -> list[str]:
    return [str(environment / "bin" / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]


def _clean() -> dict[str, str]:
    """The environment without what would let a new one find packages of this one."""
    return {name: value for name, value in os.environ.items() if name not in {"PYTHONPATH", "VIRTUAL_ENV"}}


def _run(command: list[str], *, environment: dict[str, str] | None = None, cwd: Path | None = None) -> None:
    """Run a command.

    Raises:
        RuntimeError: it failed, with the end of what it said.
    """
    ended = subprocess.run(command, capture_output=True, text=True, env=environment or _clean(), cwd=cwd, check=False)
    if ended.returncode:
        raise RuntimeError(
            f"{' '.join(command)} ended with {ended.returncode}: {(ended.stderr + ended.stdout)[-2000:]}"
        )


async def _ask(command: str, arguments: list[str], environment: dict[str, str], folder: Path) -> None:
    """What a host asks first, and a search in the starter catalogue."""
    server = StdioServerParameters(command=command, args=arguments, env=environment, cwd=folder)
    async with Client(stdio_client(server)) as client:
        await client.list_tools()
        answer = await client.call_tool("find_scenarios", {"limit": 1})
    if answer.is_error or not (answer.structured_content or {}).get("matches"):
        raise RuntimeError(f"the first answer is none: {answer.content}")
