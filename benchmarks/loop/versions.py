"""Checks that comparisons of two versions of a user's planner name both versions, using only the tools.

Four planners are edited between batches: a package that declares its version, one in a git checkout with tags, commits
and uncommitted edits, one known only by its source, and a program of the settings file. Each version drives the same
scenarios under the same configuration. Then the bench compares every batch with every earlier one, and lists and
analyses both together.

A comparison is right if its headline names both versions by the author's text (a declared version, or git's answer) and
a digest that changes exactly with the source. It must pair every scenario and use the first batch given as baseline.
The list of batches and an analysis of both must keep them apart under the same names.

Keys: ``versions_told``: share of the comparisons that are right; ``version_comparisons``: their number.
"""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import anyio
from mcp import Client

from plannerforge.schemas.planning import CommandPlanner
from plannerforge.server.assembly import create_server

from ..harness import Figures, SeededBench, finished_batch, import_scenarios, scenario_files, settings_for, share

SCENARIOS, VERSIONS = 3, 5
"""Scenarios of a batch, and versions of each planner (chosen: four planners give 40 comparisons)."""
_PACKAGE = """
import numpy as np
from plannerforge.engine.planners import OwnPlanner, Plan, PlannedTrajectory
from plannerforge.schemas.planning import PlannerDeclaration


class Slowing:
    def reset(self, task):
        self.task = task

    def plan(self, observation):
        ego, times = observation.ego, self.task.step_s * np.arange(21)
        speeds = np.maximum(ego.speed_mps - SLOWER_MPS2 * times, 0.0)
        gone = np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 * self.task.step_s)])
        ahead = np.array([np.cos(ego.heading_rad), np.sin(ego.heading_rad)])
        headings = np.full(21, ego.heading_rad)
        return Plan(PlannedTrajectory(ego.position + gone[:, None] * ahead, headings, speeds, np.zeros(21)))


PLANNER = OwnPlanner(Slowing, PlannerDeclaration(summary="gets slower"DECLARED))
"""
_DIGEST = re.compile(r"\b[0-9a-f]{7}\b")
_PROGRAM = Path(__file__).parents[1] / "tuning" / "faulty_program.py"


@dataclass
class _Author:
    """The author of a planner; ``folder`` holds its source."""

    name: str
    folder: Path

    def edited(self, number: int) -> str:
        """Write a version and return the author's text for it; empty if only the source identifies it."""
        declared = f', version="v1.{number}"' if self.name == "declaring" else ""
        source = _PACKAGE.replace("SLOWER_MPS2", str(0.1 * number)).replace("DECLARED", declared)
        (self.folder / f"own_{self.name}.py").write_text(source, encoding="utf-8")
        if self.name == "tracked":
            return self._committed(number)
        return f"v1.{number}" if declared else ""

    def installed(self) -> None:
        """Write the metadata by which the package is found."""
        metadata = self.folder / f"own_{self.name}-0.dist-info"
        metadata.mkdir(parents=True)
        text = f"Metadata-Version: 2.1\nName: own_{self.name}\nVersion: 0\n"
        (metadata / "METADATA").write_text(text, encoding="utf-8")
        entry = f"[plannerforge.planners]\n{self.name} = own_{self.name}:PLANNER\n"
        (metadata / "entry_points.txt").write_text(entry, encoding="utf-8")

    def _committed(self, number: int) -> str:
        """Commit every other version, the first with a tag, and return git's description."""
        if number == 0:
            self._git("init", "--quiet")
        if number % 2 == 0:
            self._git("add", f"own_{self.name}.py")
            self._git("commit", "--quiet", "--message", f"version {number}")
        if number == 0:
            self._git("tag", "v1")
        return self._git("describe", "--tags", "--always", "--dirty").strip()

    def _git(self, *arguments: str) -> str:
        identity = ("-c", "user.name=bench", "-c", "user.email=bench@localhost", "-c", "commit.gpgsign=false")
        command = ["git", "-C", str(self.folder), *identity, *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout


class _ProgramAuthor(_Author):
    """Edits a program that the settings name."""

    def edited(self, number: int) -> str:
        """Return a comment more: another source, the same drive."""
        text = _PROGRAM.read_text(encoding="utf-8") + f"# {number}\n"
        (self.folder / "program.py").write_text(text, encoding="utf-8")
        return ""


@dataclass(frozen=True)
class _Version:
    """A version as its author knows it, and the batch that it drove."""

    planner: str
    words: str
    batch_id: str


def measure(bench: SeededBench) -> Figures:
    """Return the figures of the keys above, over all pairs of versions or the bench's limit."""
    told = anyio.run(_judge_versions, bench)
    return {"versions_told": share(told), "version_comparisons": len(told)}


async def _judge_versions(bench: SeededBench) -> list[bool]:
    authors = [_Author(name, bench.folder(name)) for name in ("declaring", "tracked", "plain")]
    if shutil.which("git") is None:
        sys.stderr.write("git is not installed: the planner in a checkout is left out\n")
        authors = [author for author in authors if author.name != "tracked"]
    for author in authors:
        author.installed()
    program = _ProgramAuthor("program", bench.folder("program"))
    program.edited(0)
    command = CommandPlanner(
        summary="drives straight on", command=(sys.executable, "-S", str(program.folder / "program.py"), "drives")
    )
    settings = settings_for(bench.scratch / "versions", bench.shared, 1)
    settings = settings.model_copy(update={"planners": {"program": command}})
    with _found([author.folder for author in authors]):
        async with Client(create_server(settings)) as client:
            await import_scenarios(client, scenario_files(bench.shared / "data" / "commonroad", SCENARIOS))
            told: list[bool] = []
            for author in (*authors, program):
                told += await _versions_of(author, client, None if bench.limit is None else bench.limit - len(told))
            return told


@contextmanager
def _found(folders: Sequence[Path]) -> Iterator[None]:
    """Make packages in these folders importable here and by the workers while the block runs."""
    before, path = os.environ.get("PYTHONPATH"), list(sys.path)
    texts = [str(folder) for folder in folders]
    sys.path[:0] = texts
    os.environ["PYTHONPATH"] = os.pathsep.join([*texts, *([before] if before else [])])
    try:
        yield
    finally:
        sys.path[:] = path
        os.environ.pop("PYTHONPATH")
        if before is not None:
            os.environ["PYTHONPATH"] = before


async def _versions_of(author: _Author, client: Client, limit: int | None) -> list[bool]:
    """Return whether each comparison of two versions of a planner is reported correctly."""
    if limit is not None and limit <= 0:
        return []
    made = []
    for number in range(VERSIONS):
        words = author.edited(number)
        batch_id = await finished_batch(client, scenarios=["preset:500"], configs=[author.name])
        made.append(_Version(author.name, words, batch_id))
    digests: dict[str, str] = {}
    couples = list(combinations(made, 2))[:limit]
    return [await _is_reported(before, after, digests, client) for before, after in couples]


async def _is_reported(before: _Version, after: _Version, digests: dict[str, str], client: Client) -> bool:
    """Return True if the comparison of two versions, the list of batches and an analysis of both name them
    correctly.
    """
    ids = [before.batch_id, after.batch_id]
    compared = await client.call_tool("compare_results", {"results": ids})
    text = _text(compared)
    found: list[dict[str, str]] = (compared.structured_content or {}).get("sides", [])
    if len(found) != 2 or [side["result_id"] for side in found] != ids:
        sys.stderr.write(f"{before} → {after}: {text}\n")
        return False
    names = [side["label"] for side in found]
    comparison = (compared.structured_content or {})["comparisons"][0]
    headline = text.splitlines()[0]
    analysed = _text(await client.call_tool("analyze_results", {"results": ids, "breakdown": "config"}))
    listed = _text(await client.call_tool("list_artifacts", {"kind": "batch", "limit": 50}))
    lines = {line.split()[1].rstrip(","): line for line in listed.splitlines() if line.startswith("batch ")}
    is_right = [
        headline.startswith(f"{names[1]} against {names[0]}: "),
        comparison["success"]["pairs"] + comparison["invalid_pairs"] == SCENARIOS and comparison["unpaired"] == 0,
        (comparison["before"], comparison["after"]) == (names[0], names[1]),
        all(_is_named(version, name, digests) for version, name in zip((before, after), names, strict=True)),
        all(name in lines[version.batch_id] for version, name in zip((before, after), names, strict=True)),
        all(name in analysed for name in names),
    ]
    if not all(is_right):
        sys.stderr.write(f"{before} → {after}: {is_right}\n{text}\n{analysed}\n{listed}\n")
    return all(is_right)


def _is_named(version: _Version, name: str, digests: dict[str, str]) -> bool:
    """Return True if a name holds the author's text and a digest that belongs to this source alone."""
    if not name.startswith(f"{version.planner}:Default ") or version.words not in name:
        return False
    found = _DIGEST.findall(name.rpartition("(")[2] if version.words else name)
    if len(found) != 1:
        return False
    known = digests.setdefault(version.batch_id, found[0])
    others = {digest for batch_id, digest in digests.items() if batch_id != version.batch_id}
    return known == found[0] and known not in others


def _text(answer: object) -> str:
    return "\n".join(getattr(part, "text", "") for part in getattr(answer, "content", ()))
