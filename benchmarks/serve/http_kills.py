"""Kills an HTTP server at random times while clients search, edit, configure and run.

After each kill its processes must be gone and the workspace consistent. The next server continues, and the last one
runs undisturbed.

Keys: ``kills``. ``lost``: artifacts reported to a client that are missing. ``kept``: artifacts reported to clients that
exist. ``broken``: inconsistent records, files, catalogue and jobs after a kill. ``left_processes``: of a killed server.
``kill_errors``: failed calls of the last server's clients.
"""

import os
import random
import sys
import uuid
from dataclasses import dataclass, field
from pathlib import Path

import anyio

from plannerforge.engine.workspace import Workspace

from ..faults.http_process import QUIET, HttpProcess, http_client, listening
from ..faults.mixed_load import broken
from ..faults.processes import MARK, command_of, marked, remaining
from ..harness import Figures
from .bench import ServeBench
from .http_load import LoadClient, ReportedArtifact, Tally, token_settings, tokens_of_clients

_SEED = 20261124
_CLIENTS = 4
_EARLIEST_S, _LATEST_S, _LAST_S = 1.0, 12.0, 15.0
"""Range of the time from a server's first call to its kill, and the working time of the last server (chosen)."""


@dataclass
class _Seen:
    """The results of all servers."""

    told: set[ReportedArtifact] = field(default_factory=set)
    faults: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)


def measure(bench: ServeBench) -> Figures:
    """Kill, look, start again."""
    folder = bench.folder("kills")
    workspace = folder / "workspace"
    chance = random.Random(_SEED)  # noqa: S311 - moments, not secrets
    seen, last = _Seen(), Tally()
    for number in range(bench.kills + 1):
        is_last = number == bench.kills
        last = Tally()
        duration_s = _LAST_S if is_last else chance.uniform(_EARLIEST_S, _LATEST_S)
        seen.left += _serve(folder, number, duration_s, last, is_killed=not is_last)
        seen.told |= last.told
        seen.faults += broken(workspace)
        sys.stderr.write(
            f"{number} killed, told of {len(seen.told)}, {len(seen.faults)} faults, {len(seen.left)} left\n"
        )
    lost = lost_of(workspace, seen.told)
    for text in (*seen.faults, *seen.left, *lost, *last.errors):
        sys.stderr.write(f"{text}\n")
    return {
        "kills": bench.kills,
        "lost": len(lost),
        "broken": len(seen.faults),
        "left_processes": len(seen.left),
        "kept": len(seen.told) - len(lost),
        "kill_errors": len(last.errors),
    }


def _serve(folder: Path, number: int, duration_s: float, tally: Tally, *, is_killed: bool) -> list[str]:
    """Load a server of its own for some time, and kill it in the middle of its work; the processes that it left."""
    mark, tokens = uuid.uuid4().hex, tokens_of_clients(_CLIENTS)
    environment = {**os.environ, **QUIET, **token_settings(tokens), MARK: mark}
    arguments = ["-m", "plannerforge", "serve", "--http", "--workspace", str(folder / "workspace")]
    with listening(arguments, folder, environment, folder / f"server{number}.log") as server:
        anyio.run(_load, server, tokens, number, duration_s, tally, is_killed)
    left = remaining(lambda: marked(mark, os.getpid()))
    return [f"after server {number}: {' '.join(command_of(process))}" for process in left]


async def _load(
    server: HttpProcess, tokens: dict[str, str], number: int, duration_s: float, tally: Tally, is_killed: bool
) -> None:
    async with anyio.create_task_group() as tasks:
        for place, token in enumerate(tokens.values()):
            mode = "legacy" if place % 2 else "auto"
            tasks.start_soon(_one_client, server.url, f"{number}-{place}", token, mode, tally)
        await anyio.sleep(duration_s)
        if is_killed:
            server.process.kill()
            with anyio.move_on_after(_EARLIEST_S):  # clients see it
                await anyio.sleep_forever()
        tasks.cancel_scope.cancel()


async def _one_client(url: str, name: str, token: str, mode: str, tally: Tally) -> None:
    async with http_client(url, token, mode) as client:
        await LoadClient(name, client, tally).work_until(float("inf"))


def lost_of(root: Path, told: set[ReportedArtifact]) -> list[str]:
    """Describe what the workspace lacks of these."""
    workspace = Workspace(root)
    try:
        return [f"{one.kind} {one.artifact_id} is gone" for one in sorted(told) if not workspace.find(*one)]
    finally:
        workspace.close()
