"""Imports forged archives (:mod:`.archive_grammar`) by the command line, and queries the imported content.

Each goes into a copy of a workspace with work of its own. A refusal must have a name and leave the workspace unchanged.
Imported content must be marked: an answer that names a run of the archive says that it was imported. Then tools are
called on the archive's content and on the original work, and ``workspace verify`` must agree with them.

Keys: ``forged_archives``; ``archives_right`` (share refused by name without traces, or imported and marked);
``archives_taken`` (imported); ``tools_broken_after`` (tools that answer wrongly afterwards); ``forged_lines``,
``unexpected`` (in all answers).
"""

import itertools
import json
import random
import re
import shutil
import sqlite3
import sys
from collections import Counter
from dataclasses import dataclass, field
from importlib.resources import files as package_files
from pathlib import Path
from typing import Any

import anyio
from mcp import Client, MCPError
from typer.testing import CliRunner

from plannerforge.cli.program import application
from plannerforge.engine.workspace import ARTIFACT_KINDS
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

from ...harness import Figures, ask, ask_to_the_end, share
from ..judges import faults_of
from .archive_grammar import ForgedArchive, forged_archives
from .bench import StreetBench

_MOST_LISTED = 40
_RUN_EVERY = 6
"""A planner also runs after one in this many accepted archives (chosen), because it takes seconds."""
_NAMED = re.compile(r"\[(\w+)\] ")
_OWN, _OTHERS = "ZAM_Landmoor-31_1_T-1", ("ZAM_Landmoor-17_1_T-1", "ZAM_Landmoor-18_1_T-1")
"""Starter scenarios of the original work, and of the archive."""
_LIMIT_S = 60.0
_MAPS = Path(str(package_files("plannerforge.engine.maps"))) / "library"


@dataclass
class _Seen:
    were_right: list[bool] = field(default_factory=list)
    taken: int = 0
    broken: Counter[str] = field(default_factory=Counter)
    laws: Counter[str] = field(default_factory=Counter)
    told: list[str] = field(default_factory=list)

    def tell(self, forged: ForgedArchive, message: str) -> None:
        self.told.append(f"{'+'.join(forged.productions)}: {message[:300]}")

    def judge(self, forged: ForgedArchive, what: str, text: str) -> None:
        """Count the laws that a text broke."""
        for fault in faults_of(text):
            if fault.law in ("unexpected", "forged"):
                self.laws[fault.law] += 1
                self.tell(forged, f"{what}: {fault.law}: {fault.details}")


def measure(bench: StreetBench) -> Figures:
    """Import forged archives and ask about them."""
    folder = bench.folder("archives")
    own, others, archive = folder / "own", folder / "others", folder / "others.zip"
    anyio.run(_make, own, [_OWN], False)
    anyio.run(_make, others, list(_OTHERS), True)
    _command("workspace", "export", str(archive), "--workspace", str(others))
    seen, chance = _Seen(), random.Random(bench.seed)  # noqa: S311 - forged content, no secret
    drawn = itertools.islice(forged_archives(archive.read_bytes(), chance), bench.archives)
    for number, forged in enumerate(drawn):
        if number % 50 == 49:
            sys.stderr.write(f"{number + 1} archives, {seen.taken} taken in\n")
        copy, file = folder / "copy", folder / "forged.zip"
        shutil.copytree(own, copy)
        file.write_bytes(forged.content)
        seen.were_right.append(_is_right(copy, file, forged, seen))
        shutil.rmtree(copy)
    for text in seen.told[:_MOST_LISTED]:
        sys.stderr.write(f"{text}\n")
    return {
        "forged_archives": len(seen.were_right),
        "archives_right": share(seen.were_right),
        "archives_taken": seen.taken,
        "tools_broken_after": seen.broken.total(),
        "forged_lines": seen.laws["forged"],
        "unexpected": seen.laws["unexpected"],
    }


def _settings(workspace: Path) -> Settings:
    return Settings(workspace=workspace, starter=False, warm_up=False, maps_online="offline", journal=False, workers=1)


async def _make(workspace: Path, scenarios: list[str], is_rich: bool) -> None:
    """Create a workspace with runs of starter scenarios, and with more kinds of artifacts in a rich one."""
    starter = workspace.with_name(f"{workspace.name}-starter")
    files = workspace.with_name(f"{workspace.name}-files")
    async with Client(create_server(_settings(starter).model_copy(update={"starter": True}))) as client:
        await ask(client, "find_scenarios", limit=1)
    files.mkdir()
    for name in scenarios:
        shutil.copy(starter / "scenarios" / name / "scenario.xml", files / f"{name}.xml")
    settings = _settings(workspace).model_copy(update={"roots": (files,)})
    async with Client(create_server(settings, start_folder=files)) as client:
        await ask(client, "import_files", path=str(files))
        ids = [each["scenario_id"].partition("#")[0] for each in (await ask(client, "find_scenarios"))["matches"]]
        await ask_to_the_end(client, "run_planner", scenarios=ids, configs=["idm:Default"], wait_s=50)
        if is_rich:
            edit = {"op": "set_goal", "goal": "through"}
            await client.call_tool("modify_scenario", {"scenario_id": ids[0], "edits": [edit]})
            await ask(client, "configure_planner", planner="frenetix", preset="Default", weights=["jerk=0.5"])
            map_file = files / "quadratstadt.osm"
            shutil.copy(_MAPS / map_file.name, map_file)
            await ask(client, "import_files", path=str(map_file))
            await ask_to_the_end(
                client, "generate_scenarios", place="quadratstadt", cover=["turn=left|right"], count=2, duration_s=5
            )
            await ask_to_the_end(
                client, "optimize_planner", scenarios=ids, base="idm:Default", max_trials=4, method="random"
            )
    if is_rich and (lacking := set(ARTIFACT_KINDS) - {kind for kind, _ in _contents(workspace)}):
        raise RuntimeError(f"the archive to forge has no {', '.join(sorted(lacking))}")


def _command(*words: str) -> tuple[int, str]:
    """Return the exit code and the output of a command, with a defect's exception as ``[unexpected]``."""
    result = CliRunner().invoke(application, list(words))
    error = result.exception
    if error is None or isinstance(error, SystemExit):
        return result.exit_code, result.output
    if isinstance(error, PlannerForgeError):  # the program's own entry prints its text
        return 1, result.output + error.text
    return 1, f"{result.output}[unexpected] {type(error).__name__}: {error}"


def _is_right(workspace: Path, file: Path, forged: ForgedArchive, seen: _Seen) -> bool:
    before = _contents(workspace)
    code, said = _command("workspace", "import", str(file), "--workspace", str(workspace))
    seen.judge(forged, "import", said)
    if code != 0:
        is_named = bool(_NAMED.search(said)) and "[unexpected]" not in said
        is_same = _contents(workspace) == before
        if not (is_named and is_same):
            seen.tell(forged, f"refused without a code, or left traces: {said}")
        return is_named and is_same
    seen.taken += 1
    with_run = seen.taken % _RUN_EVERY == 1
    own_runs = sorted(artifact_id for kind, artifact_id in before if kind == "run")
    brought = sorted(_contents(workspace) - before)
    return anyio.run(_ask_about, workspace, forged, seen, with_run, own_runs, brought)


def _contents(workspace: Path) -> set[tuple[str, str]]:
    """Return kind and id of everything in the workspace's database."""
    connection = sqlite3.connect(f"file:{workspace / 'workspace.sqlite'}?mode=ro", uri=True)
    try:
        return set(connection.execute("SELECT kind, artifact_id FROM artifacts").fetchall())
    finally:
        connection.close()


async def _ask_about(
    workspace: Path,
    forged: ForgedArchive,
    seen: _Seen,
    with_run: bool,
    own_runs: list[str],
    brought: list[tuple[str, str]],
) -> bool:
    """Call tools about an imported archive; return True if all of its content is marked."""
    runs = [artifact_id for kind, artifact_id in brought if kind == "run"]
    others = [(kind, artifact_id) for kind, artifact_id in brought if kind != "run"]
    own: list[tuple[str, dict[str, Any]]] = [
        ("find_scenarios", {"limit": 20}),
        ("describe_catalog", {}),
        ("list_planners", {}),
        *(("list_artifacts", {"kind": kind}) for kind in ARTIFACT_KINDS),
        ("list_artifacts", {}),
        *(("analyze_results", {"results": [run]}) for run in own_runs),
    ]
    if with_run:
        own += [
            ("run_planner", {"scenarios": [_OWN], "configs": ["idm:Default"], "prediction": "lane", "wait_s": 50}),
            ("describe_scenario", {"scenario_id": _OWN}),
            ("configure_planner", {"planner": "frenetix", "preset": "Default"}),
        ]
    theirs: list[tuple[str, dict[str, Any]]] = [("analyze_results", {"results": [run]}) for run in runs]
    theirs += [("analyze_results", {"results": [key]}) for kind, key in others if kind in ("batch", "study")]
    if with_run:
        theirs += [("describe_scenario", {"scenario_id": key}) for kind, key in others if kind == "scenario"][:2]
    is_marked = True
    async with Client(create_server(_settings(workspace), start_folder=workspace.parent)) as client:
        for is_own, (tool, arguments) in [*((True, call) for call in own), *((False, call) for call in theirs)]:
            has_failed, text = await _answer(client, tool, arguments)
            seen.judge(forged, tool, text)
            if "[unexpected]" in text or (is_own and has_failed):
                seen.broken[tool] += 1
                seen.tell(forged, f"{tool} {json.dumps(arguments)[:80]} is broken: {text}")
            if not has_failed and any(run in text for run in runs) and "mported" not in text:  # refusals state nothing
                is_marked = False
                seen.tell(forged, f"{tool} does not say that a run was imported: {text}")
        for kind, key in brought[:20]:
            try:
                read = await client.read_resource(f"plannerforge://{kind}/{key}/record")
                text = "".join(getattr(part, "text", "") for part in read.contents)
            except MCPError as error:
                text = str(error)
            seen.judge(forged, f"resource {kind}", text)
            is_marked &= kind != "run" or "imported" in text
    code, said = _command("workspace", "verify", "--workspace", str(workspace))
    if code != 0:
        seen.tell(forged, f"verify finds faults in imported content: {said}")
        return False
    return is_marked


async def _answer(client: Client, tool: str, arguments: dict[str, Any]) -> tuple[bool, str]:
    try:
        with anyio.fail_after(_LIMIT_S):
            result = await client.call_tool(tool, arguments)
    except (MCPError, TimeoutError) as error:
        return True, f"[unexpected] {type(error).__name__}: {error}"
    return bool(result.is_error), "\n".join(getattr(block, "text", "") for block in result.content)
