"""``make bench-kills``: 50 kills at random times of two servers that import, edit, run and generate in one workspace.

Keys:

- ``kills``.
- ``broken_after_restart``: inconsistencies after each kill and at the end: records, files, catalogue, jobs that seem to
  run, loads that do not finish undisturbed, and defects.
- ``orphans``: processes that outlived the server or worker that started them.

The bench needs the real scenarios in ``PLANNERFORGE_SHARED`` or ``../shared``.

``python -m benchmarks.faults.mixed_load WORKSPACE FOLDER NUMBER`` is one of the servers: it carries out the load with
this number, all kinds of work at once, and exits. The next server resumes the load of a killed one.
"""

import argparse
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import anyio
import psutil
from mcp import Client
from mcp.types import CallToolResult

from plannerforge.engine.execution import JobStore
from plannerforge.engine.workspace import Artifact, Workspace
from plannerforge.schemas.errors import WorkerFailure, WorkerTimeout
from plannerforge.schemas.runs import BatchRecord
from plannerforge.server.assembly import create_server
from plannerforge.server.tool_calls import answer_text

from ..harness import drawn, existing, print_figures, settings_for, shared_scenarios
from .imports import store_disagreements
from .processes import MARK, alive, command_of, descendants, kill, marked, remaining

_SEED, _SERVERS, _BASES, _COPIES = 20261122, 2, 3, 4
"""Number of real scenarios for a load, and of copies of each under unique ids (chosen)."""
_LARGEST_BYTES = 400_000
"""Largest size of a load's file in bytes (chosen): reading is most of the time of a short run."""
_LATEST_S = 10.0
"""Longest delay of the kill after a server's first worker (chosen)."""
_GUARD_S = 900.0
"""Longest wait for an undisturbed load (chosen): it takes less than a minute."""
_ALL = 1_000_000
_STORED = {"scenario": ("scenario.xml",), "config": ("config.yaml",), "run": ("steps.json", "timing.json"), "batch": ()}
_OWN_FAULTS = tuple(f"[{error.code}]" for error in (WorkerFailure, WorkerTimeout))
"""Errors that a killed worker explains, after which the call is repeated."""


@dataclass
class _Tally:
    """Kills by target, inconsistencies afterwards, and processes left behind."""

    kills: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    orphans: list[str] = field(default_factory=list)


@dataclass
class _Server:
    """A server with its load; all its processes carry ``mark``."""

    process: subprocess.Popen[str]
    load: int
    mark: str

    @classmethod
    def start(cls, root: Path, folder: Path, load: int) -> "_Server":
        """Start one."""
        mark = uuid.uuid4().hex
        command = [sys.executable, "-m", "benchmarks.faults.mixed_load", str(root), str(folder), str(load)]
        process = subprocess.Popen(command, env={**os.environ, MARK: mark}, stderr=subprocess.PIPE, text=True)
        return cls(process, load, mark)

    def descendants(self) -> list[psutil.Process]:
        """Return its workers and their descendants; empty if it has ended."""
        try:
            return descendants(psutil.Process(self.process.pid))
        except psutil.NoSuchProcess:
            return []

    def left(self) -> list[psutil.Process]:
        """Return running processes with its mark, except the server itself."""
        return marked(self.mark, self.process.pid)


def kill_servers(root: Path, folder: Path, chance: random.Random, kills: int) -> _Tally:
    """Keep two servers at work, kill them or one of their processes until ``kills`` is reached, and let both finish."""
    tally = _Tally()
    servers = [_Server.start(root, folder, number) for number in range(_SERVERS)]
    next_load = _SERVERS
    try:
        while tally.kills.total() < kills:
            slot = chance.randrange(_SERVERS)
            server = servers[slot]
            if _wait_for_work(server, chance):
                tally.kills[_strike(server, chance, tally)] += 1
                sys.stderr.write(f"{dict(tally.kills)}, faults {len(tally.faults)}, orphans {len(tally.orphans)}\n")
                tally.faults += broken(root)
            if server.process.poll() is None:  # a worker was killed: the server goes on
                continue
            load = server.load
            if server.process.returncode != -signal.SIGKILL:
                _end(server, tally)
                load, next_load = next_load, next_load + 1
            servers[slot] = _Server.start(root, folder, load)
        for server in servers:
            _end(server, tally)
        tally.faults += broken(root)
    finally:
        for server in servers:
            server.process.kill()
            server.process.communicate()
    return tally


def _wait_for_work(server: _Server, chance: random.Random) -> bool:
    """Wait until the server has workers and then for a random time; return False if it ended meanwhile."""
    moment = None
    while server.process.poll() is None and (moment is None or time.monotonic() < moment):
        if moment is None and server.descendants():
            moment = time.monotonic() + chance.uniform(0.0, _LATEST_S)
        time.sleep(0.02)
    return server.process.poll() is None


def _strike(server: _Server, chance: random.Random, tally: _Tally) -> str:
    """Kill the server or, one time in three, a descendant process; return the target."""
    others = server.descendants()
    if others and chance.random() < 1 / 3:
        victim = chance.choice(others)
        started = descendants(victim)
        what = "worker" if "execution.worker" in " ".join(command_of(victim)) else "program of a worker"
        kill(victim)
        tally.orphans += [f"after a {what}: {command_of(process)}" for process in remaining(lambda: alive(started))]
        return what
    server.process.kill()
    server.process.communicate()
    tally.orphans += [f"after a server: {command_of(process)}" for process in remaining(server.left)]
    return "server"


def _end(server: _Server, tally: _Tally) -> None:
    """Wait for the end of an undisturbed load, and record its faults."""
    try:
        _, errors = server.process.communicate(timeout=_GUARD_S)
    except subprocess.TimeoutExpired:
        tally.faults.append(f"load {server.load} does not end")
        return
    if server.process.returncode != 0:
        tally.faults.append(f"load {server.load} ended with {server.process.returncode}: {errors[-1500:]}")
    tally.orphans += [f"after a server that ended: {command_of(process)}" for process in remaining(server.left)]


def broken(root: Path) -> list[str]:
    """Return the inconsistencies of a workspace after kills of its servers, even while another one works on it."""
    if not (root / "workspace.sqlite").is_file():
        return []
    workspace = Workspace(root)
    try:
        faults, _ = store_disagreements(workspace)
        for artifact in workspace.newest(limit=_ALL):
            faults += _faults_of(workspace, artifact)
        for job in JobStore(workspace.database).newest(_ALL):
            if job.state == "failed" and not re.match(r"\[(?!unexpected)\w+\]", job.error):
                faults.append(f"{job.job_id} failed and does not say why: {job.error[:300]}")
            if job.state == "running" and not _is_served(workspace, job.job_id):
                faults.append(f"{job.job_id} seems to run, but no process carries it out")
    finally:
        workspace.close()
    return faults


def _faults_of(workspace: Workspace, artifact: Artifact) -> list[str]:
    folder, faults = workspace.folder(artifact.kind, artifact.artifact_id), []
    for name in _STORED.get(artifact.kind, ()):
        path = folder / name
        content = path.read_bytes() if path.is_file() else b""
        if not content or (name.endswith(".json") and not _is_json(content)):
            faults.append(f"{artifact.artifact_id}: {name} is missing or half-written")
    if artifact.kind == "batch":
        runs = artifact.read(BatchRecord).runs
        faults += [f"{artifact.artifact_id}: {key} is gone" for key in runs if workspace.find("run", key) is None]
    return faults


def _is_json(content: bytes) -> bool:
    try:
        json.loads(content)
    except ValueError:
        return False
    return True


def _is_served(workspace: Workspace, job_id: str) -> bool:
    """Return True if the process of a running job is one of the servers."""
    query = "SELECT owner_pid FROM jobs WHERE job_id = ?"
    (owner,) = workspace.database.connection().execute(query, (job_id,)).fetchone()
    try:
        return "plannerforge" in " ".join(psutil.Process(owner).cmdline())
    except psutil.NoSuchProcess:
        return JobStore(workspace.database).get(job_id).ended  # it ended between the two looks


async def _carry_out(root: Path, folder: Path, number: int) -> None:
    """Carry out the load with this number: an import, edits, a grid of runs and a generation, all at once."""
    files = sorted((folder / "bases").glob("*.xml"))
    own = _copies(files, folder / f"load{number}", number)
    async with Client(create_server(settings_for(root, folder, 2), start_folder=folder)) as client:
        first = await _done(client, "import_files", {"path": str(files[number % len(files)]), "kind": "scenario"})
        scenario = first["items"][0]["artifact_id"]
        grid = {"scenarios": [scenario], "configs": ["idm:Default", "frenetix:Default"], "seed": number, "wait_s": 50}
        edits = [{"op": "set_behaviour", "vehicles": ["nearest:1"], "preset": "aggressive"}]
        edited = {"scenario_id": scenario, "edits": edits, "seed": number}
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(_done, client, "import_files", {"path": str(own)})
            tasks.start_soon(_done, client, "generate_scenarios", {"duration_s": 6, "seed": number})
            tasks.start_soon(_done, client, "modify_scenario", edited)
            tasks.start_soon(_whole_grid, client, grid)


async def _whole_grid(client: Client, grid: dict[str, Any]) -> None:
    """Ask until every run of a grid is there."""
    while True:
        result = await _done(client, "run_planner", grid)
        if result["batch_id"] and not result["lost"]:
            return


async def _done(client: Client, tool: str, arguments: dict[str, Any]) -> Any:
    """Return the answer of a call; repeat it if a worker died meanwhile.

    Raises:
        RuntimeError: it was refused.
    """
    while True:
        result: CallToolResult = await client.call_tool(tool, arguments)
        text = answer_text(result)
        if not result.is_error:
            return result.structured_content
        if not text.startswith(_OWN_FAULTS):
            raise RuntimeError(f"{tool}: {text}")


def _copies(bases: list[Path], folder: Path, number: int) -> Path:
    """Return a folder with copies of scenarios under ids that no other load uses."""
    folder.mkdir(exist_ok=True)
    for base in bases:
        text = base.read_text(encoding="utf-8")
        for copy in range(_COPIES):
            renamed = re.sub(r'benchmarkID="([^"]+?)_T-\d+"', rf'benchmarkID="\1_T-{1000 * (number + 1) + copy}"', text)
            (folder / f"{base.stem}_{copy}.xml").write_text(renamed, encoding="utf-8")
    return folder


def _measure(source: Path, scratch: Path, kills: int, seed: int) -> int:
    """Kill, print, and give the number of faults and orphans."""
    bases = scratch / "files" / "bases"
    bases.mkdir(parents=True)
    small = [path.name for path in source.glob("*_T-*.xml") if path.stat().st_size < _LARGEST_BYTES]
    for name in drawn(small, _BASES):
        shutil.copyfile(source / name, bases / name)
    chance = random.Random(seed)  # noqa: S311 - moments, not secrets
    tally = kill_servers(scratch / "workspace", scratch / "files", chance, kills)
    for text in (*tally.faults, *tally.orphans):
        sys.stderr.write(f"{text}\n")
    figures = {"kills": tally.kills.total(), "broken_after_restart": len(tally.faults), "orphans": len(tally.orphans)}
    rows = [(f"killed: {what}", str(count)) for what, count in sorted(tally.kills.items())]
    print_figures("A mixed load that is killed", figures, more_rows=rows)
    return len(tally.faults) + len(tally.orphans)


if __name__ == "__main__":
    if len(sys.argv) == 4 and sys.argv[3].isdecimal():
        anyio.run(_carry_out, Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
    else:
        parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.add_argument("--kills", type=int, default=50)
        parser.add_argument("--seed", type=int, default=_SEED)
        given = parser.parse_args()
        with tempfile.TemporaryDirectory() as name:
            sys.exit(min(_measure(existing(shared_scenarios()), Path(name), given.kills, given.seed), 1))
