"""``make bench-import-crashes``: 30 kills at random times during imports of real scenarios.

Keys: ``blows`` (kills), ``disagreements`` (between database, files, catalogue and text index after each restart, plus
files missing at the end). The bench needs the real scenarios in ``PLANNERFORGE_SHARED`` or ``../shared``.

``python -m benchmarks.faults.imports WORKSPACE FOLDER`` is the server that gets killed: it imports the folder while a
thread rebuilds the text index. The vectors are hashes, because loading a language model takes ten times as long as the
import.
"""

import hashlib
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import anyio
import numpy as np
import psutil
from mcp import Client

from plannerforge.engine.catalog import is_ready
from plannerforge.engine.catalog.tables import descriptions, listed_version, refresh
from plannerforge.engine.catalog.vector_index import COMPLETE, Vectors, ensure_generation, query
from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.scenarios import ScenarioRecord
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings
from plannerforge.workflows.context import INDEX_FOLDER

from ..harness import existing, print_figures, shared_scenarios

_KILLS, _FILES, _SEED = 30, 40, 20261121
_MODEL = "hashes"
_ALL = 1_000_000
"""A number larger than the artifacts of any test workspace."""
_LATEST_S = 0.4
"""Longest delay of the kill after the chosen file is stored (chosen)."""
_GUARD_S = 300.0
"""Longest wait for a server (chosen): an import of 40 files takes seconds."""


@dataclass
class _KillTally:
    """Kills by target (or finished before), and disagreements afterwards."""

    kills: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)


def kill_imports(workspace: Path, folder: Path, chance: random.Random, kills: int) -> _KillTally:
    """Import the folder repeatedly, each time with a kill at a random time, then once undisturbed.

    Each kill hits the server or, one time in three, only one of its processes. After each the workspace is opened and
    checked. A new workspace replaces a full one.
    """
    tally, number = _KillTally(), 0
    total = len(list(folder.glob("*.xml")))
    while tally.kills.total() < kills:
        root = workspace / str(number)
        killed = _kill_once(root, folder, chance, total)
        tally.kills[killed] += 1
        tally.faults += disagreements(root)
        if _stored(root) == total:
            number += 1
    _wait(_server(workspace / str(number), folder))
    tally.faults += disagreements(workspace / str(number))
    if (left := total - _stored(workspace / str(number))) > 0:
        tally.faults.append(f"{left} files are missing in the end")
    return tally


def _stored(root: Path) -> int:
    """Count the scenarios in a workspace's database, 0 if there is no database yet."""
    if not (root / "workspace.sqlite").is_file():
        return 0
    connection = sqlite3.connect(f"file:{root / 'workspace.sqlite'}?mode=ro", uri=True, timeout=10.0)
    try:
        return int(connection.execute("SELECT count(*) FROM artifacts WHERE kind = 'scenario'").fetchone()[0])
    except sqlite3.OperationalError:
        return 0  # the server has not made its tables yet
    finally:
        connection.close()


def disagreements(root: Path) -> list[str]:
    """Return the inconsistencies of a workspace after a restart: database, files, catalogue and text index."""
    workspace = Workspace(root)
    try:
        faults, texts = store_disagreements(workspace)
    finally:
        workspace.close()
    return faults + (_index_faults(root / INDEX_FOLDER, texts) if texts else [])


def store_disagreements(workspace: Workspace) -> tuple[list[str], dict[str, str]]:
    """Return the inconsistencies between database, files and catalogue, and the catalogue's texts.

    Everything is read as of one point in time, because another server may be working.
    """
    connection = workspace.database.connection()
    whole = connection.execute("PRAGMA integrity_check").fetchone()[0]
    refresh(workspace.database)
    connection.execute("BEGIN")
    try:
        artifacts = workspace.newest(kind="scenario", limit=_ALL)
        faults = [] if whole == "ok" else [f"SQLite says {whole}"]
        for artifact in artifacts:
            file = workspace.folder("scenario", artifact.artifact_id) / "scenario.xml"
            content = hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else "no file"
            if content != artifact.read(ScenarioRecord).content:
                faults.append(f"{artifact.artifact_id}: the file is not what was recorded ({content[:12]})")
        texts = descriptions(connection)
        listed = {listed_version(connection, artifact.artifact_id) for artifact in artifacts}
        if {key.partition("#")[0] for key in texts} != listed:
            faults.append(f"the catalogue lists {len(texts)} entries of {len(listed)} scenarios")
    finally:
        connection.execute("ROLLBACK")
    return faults, texts


def _index_faults(index: Path, texts: dict[str, str]) -> list[str]:
    """Check that every complete generation can be searched and that the current one holds the listed catalogue."""
    vector = _hash_vectors(["a busy road"])[0]
    faults = [
        f"the index {marker.parent.name} is empty"
        for marker in sorted(index.glob(f"*/{COMPLETE}"))
        if not query(marker.parent, vector, None, 1)
    ]
    folder, _ = ensure_generation(index, texts, _MODEL, _hash_vectors)
    held = {key for key, _ in query(folder, vector, None, len(texts))}
    return faults if held == set(texts) else [*faults, f"the index holds {len(held)} of {len(texts)} entries"]


def _hash_vectors(texts: Sequence[str]) -> Vectors:
    """Return unit vectors that depend only on the texts, shape (n, 384)."""
    made = [
        np.random.default_rng(int(hashlib.sha256(text.encode()).hexdigest(), 16)).standard_normal(384) for text in texts
    ]
    vectors = np.array(made, dtype=np.float32).reshape(len(texts), 384)
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True), dtype=np.float32)


def _kill_once(root: Path, folder: Path, chance: random.Random, total: int) -> str:
    """Start an import and kill it, or one of its processes, when a random number of files more is in."""
    moment = chance.randint(_stored(root), total - 1)
    delay_s, spares_the_server = chance.uniform(0.0, _LATEST_S), chance.random() < 1 / 3
    process = _server(root, folder)
    while _stored(root) < moment and process.poll() is None:
        time.sleep(0.01)
    time.sleep(delay_s)
    workers = [] if process.poll() is not None else psutil.Process(process.pid).children()
    if spares_the_server and workers:
        os.kill(chance.choice(workers).pid, signal.SIGKILL)
        _wait(process)
        return "worker"
    process.kill()
    _wait(process)
    return "server" if process.returncode == -signal.SIGKILL else "nothing, it had ended"


def _server(root: Path, folder: Path) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", "benchmarks.faults.imports", str(root), str(folder)])


def _wait(process: subprocess.Popen[bytes]) -> None:
    """Wait for the end of a server.

    Raises:
        RuntimeError: it failed by itself.
    """
    if process.wait(_GUARD_S) not in (0, -signal.SIGKILL):
        raise RuntimeError(f"an import ended with status {process.returncode}")


async def _import_and_index(root: Path, folder: Path) -> None:
    settings = Settings(workspace=root, roots=(folder,), starter=False, warm_up=False, maps_online="offline")
    ended = threading.Event()
    async with Client(create_server(settings, start_folder=folder)) as client, anyio.create_task_group() as tasks:
        tasks.start_soon(anyio.to_thread.run_sync, _keep_indexing, root, ended)
        result = await client.call_tool("import_files", {"path": str(folder)})
        ended.set()
    if result.is_error:
        raise RuntimeError(str(result.content))


def _keep_indexing(root: Path, ended: threading.Event) -> None:
    """Build the text index for whatever the catalogue lists, without a pause."""
    while not ended.is_set():
        texts = _listed_texts(root / "workspace.sqlite")
        if texts:
            ensure_generation(root / INDEX_FOLDER, texts, _MODEL, _hash_vectors)
        time.sleep(0.01)


def _listed_texts(database: Path) -> dict[str, str]:
    if not database.is_file():
        return {}
    connection = sqlite3.connect(f"file:{database}?mode=ro", uri=True, timeout=10.0)
    try:
        return descriptions(connection) if is_ready(connection) else {}
    finally:
        connection.close()


def _measure(source: Path, scratch: Path) -> int:
    """Kill, print, and return the number of disagreements."""
    folder = scratch / "files"
    folder.mkdir()
    paths = sorted(source.glob("*.xml"))
    for path in paths[:: max(len(paths) // _FILES, 1)]:
        shutil.copyfile(path, folder / path.name)
    chance = random.Random(_SEED)  # noqa: S311 - moments, not secrets
    tally = kill_imports(scratch / "workspaces", folder, chance, _KILLS)
    for fault in tally.faults:
        sys.stderr.write(f"{fault}\n")
    figures = {"blows": tally.kills.total(), "disagreements": len(tally.faults)}
    rows = [(f"killed: {what}", str(count)) for what, count in sorted(tally.kills.items())]
    print_figures("Imports that are killed", figures, rows, [("disagreements", str(len(tally.faults)))])
    return len(tally.faults)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        anyio.run(_import_and_index, Path(sys.argv[1]), Path(sys.argv[2]))
    else:
        with tempfile.TemporaryDirectory() as name:
            sys.exit(min(_measure(existing(shared_scenarios()), Path(name)), 1))
