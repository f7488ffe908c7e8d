"""Kills coverage plans, optimisations and imports of archives until each has finished nevertheless.

A piece of work is one command in its own process on the same workspace. It is killed (SIGKILL to the process and its
workers) at a random time and restarted with the same arguments. Everything in the workspace before a kill must be there
unchanged after it, an import must be complete or absent, and the work must finish in the end.

Keys: ``killed`` (processes killed during their work); ``lost`` (artifacts, rows of plans and files that vanished or
changed, partial imports, and work that never finished); ``pieces_done``.
"""

import hashlib
import itertools
import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import uuid
import zipfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ...faults.http_process import QUIET
from ...faults.processes import MARK, kill, marked, remaining
from ...harness import Figures
from .bench import StreetBench

_MOST_KILLS = 6
"""Kills of one piece of work after which it may finish (chosen)."""
_GUARD_S = 600.0
_PLANNERFORGE = (sys.executable, "-m", "plannerforge")
_TIMED = {"timing.json", "planner.log"}
"""Files of a run that differ between repetitions."""


@dataclass
class _Seen:
    killed: Counter[str] = field(default_factory=Counter)
    done: int = 0
    lost: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Piece:
    """A command, the time range of its kill, and for an import its artifacts, which arrive together or not at all."""

    name: str
    words: tuple[str, ...]
    earliest_s: float
    latest_s: float
    artifacts: int = 0


def measure(bench: StreetBench) -> Figures:
    """Kill pieces of work in turn until there were enough kills."""
    folder, seen = bench.folder("kills"), _Seen()
    chance = random.Random(bench.seed)  # noqa: S311 - moments, no secret
    archive = folder / "others.zip"
    _make_archive(folder, archive)
    pieces = _pieces(archive)
    while seen.killed.total() < bench.kills:
        piece = next(pieces)
        # a repeated import takes no time
        workspace = folder / (f"imported-{seen.killed.total()}" if piece.artifacts else "workspace")
        _carry_out(piece, workspace, chance, seen, bench.kills)
        sys.stderr.write(f"{piece.name}: {dict(seen.killed)} killed, {len(seen.lost)} lost\n")
    for text in seen.lost:
        sys.stderr.write(f"{text}\n")
    return {
        "killed": seen.killed.total(),
        "lost": len(seen.lost),
        "pieces_done": seen.done,
        **{f"killed_{name}": count for name, count in sorted(seen.killed.items())},
    }


def _pieces(archive: Path) -> Iterator[_Piece]:
    """Yield endless pieces of work, each of them new."""
    with zipfile.ZipFile(archive) as packed:
        artifacts = int(json.loads(packed.read("workspace.json"))["artifacts"])
    for number in itertools.count(1):
        plan = {"cover": ["density=low|high", "vehicles=truck|bus"], "scenario_type": "intersection", "count": 10}
        yield _Piece("plan", _call("generate_scenarios", **plan, seed=number), 2.5, 14.0)
        study = {"scenarios": ["preset:4"], "base": "idm:Default", "max_trials": 24, "method": "random"}
        yield _Piece("study", _call("optimize_planner", **study, seed=number, wait_s=50), 2.5, 14.0)
        yield _Piece("import", ("workspace", "import", str(archive)), 1.0, 3.5, artifacts)


def _call(tool: str, **arguments: object) -> tuple[str, ...]:
    return ("call", tool, json.dumps(arguments), "--json")


def _make_archive(folder: Path, archive: Path) -> None:
    """Create an archive of a workspace with the starter scenarios and runs of some of them."""
    source = folder / "source"
    _to_the_end(_call("run_planner", scenarios=["preset:8"], configs=["idm:Default"], wait_s=50), source)
    _to_the_end(("workspace", "export", str(archive)), source)


def _environment(workspace: Path, mark: str = "") -> dict[str, str]:
    own = {"PLANNERFORGE_WORKSPACE": str(workspace), "PLANNERFORGE_WARM_UP": "false", MARK: mark}
    return {**os.environ, **QUIET, **own}


def _to_the_end(words: Sequence[str], workspace: Path) -> None:
    subprocess.run([*_PLANNERFORGE, *words], env=_environment(workspace), check=True, capture_output=True)


def _carry_out(piece: _Piece, workspace: Path, chance: random.Random, seen: _Seen, most: int) -> None:
    """Begin a piece of work again and again, with a kill each time, until it has ended."""
    for number in range(_MOST_KILLS + 1):
        is_last = number == _MOST_KILLS or seen.killed.total() >= most
        before, mark = _contents(workspace), uuid.uuid4().hex
        process = subprocess.Popen(
            [*_PLANNERFORGE, *piece.words],
            env=_environment(workspace, mark),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        moment_s = _GUARD_S if is_last else chance.uniform(piece.earliest_s, piece.latest_s)
        try:
            told, errors = process.communicate(timeout=moment_s)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            for other in marked(mark, process.pid):
                kill(other)
            process.communicate()
            remaining(lambda mark=mark, pid=process.pid: marked(mark, pid))  # type: ignore[misc]
            seen.killed[piece.name] += 1
            seen.lost += _missing(piece, before, _contents(workspace))
            if is_last:
                seen.lost.append(f"{piece.name}: it does not end")
                return
            continue
        seen.lost += _missing(piece, before, _contents(workspace))
        if process.returncode != 0:
            seen.lost.append(f"{piece.name}: it ended with {process.returncode}: {errors[-500:]}")
            return
        if '"state": "running"' in told or '"state":"running"' in told:
            continue  # the call has waited for as long as it may; the next one takes the work up
        seen.done += 1
        return


def _missing(piece: _Piece, before: dict[str, str], after: dict[str, str]) -> list[str]:
    """Describe missing and changed content, and partial imports."""
    gone = [f"{piece.name}: {name} is gone" for name in before.keys() - after.keys()]
    others = [
        f"{piece.name}: {name} is another" for name in before.keys() & after.keys() if before[name] != after[name]
    ]
    records = sum(name.startswith("record ") for name in after)
    is_half = piece.artifacts and records not in (0, piece.artifacts)
    return gone + others + ([f"{piece.name}: {records} of {piece.artifacts} artifacts are there"] if is_half else [])


def _contents(workspace: Path) -> dict[str, str]:
    """Return digests of all records, of rows of plans, and of the files of records."""
    database = workspace / "workspace.sqlite"
    if not database.is_file():
        return {}
    connection = sqlite3.connect(f"file:{database}?mode=ro", uri=True, timeout=30.0)
    try:
        whole = connection.execute("PRAGMA quick_check").fetchone()[0]
        seen = {} if whole == "ok" else {f"the database says {whole}": ""}
        rows = connection.execute("SELECT kind, artifact_id, record FROM artifacts").fetchall()
    except sqlite3.OperationalError:  # its tables are not made yet
        return {}
    finally:
        connection.close()
    for kind, artifact_id, record in rows:
        seen[f"record {kind} {artifact_id}"] = _digest(str(record).encode()) if kind not in _GROWING else ""
        for file in sorted((workspace / f"{kind}s" / artifact_id).glob("*")):
            if file.is_file() and file.name not in _TIMED:
                seen[f"file {kind}s/{artifact_id}/{file.name}"] = _digest(file.read_bytes())
    return seen


_GROWING = ("plan", "study", "search")
"""Kinds with a record that changes during the work: it must exist, with any content."""


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
