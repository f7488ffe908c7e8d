"""``plannerforge demo``: a real MCP client takes a scenario through every stage of testing a planner.

The server is a separate process that communicates over stdio, as with any client. Nothing is prepared: each request
depends on earlier answers, and every figure comes from an answer.
"""

import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio
from mcp import Client, StdioServerParameters
from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.text import Text

from .. import __version__
from ..schemas.errors import NotPossible, PlannerForgeError
from ..server.tool_calls import answer_text

_BASE_CONFIG, _OTHER_PRESET = "frenetix:Default", "Safety-Conservative"
_SHOWN_LINES = 12
"""Maximum number of printed lines of an answer (chosen)."""
_MOST_TRIES = 12
"""Maximum number of dry runs to find an edit of one kind (chosen)."""
_MOST_WAITS = 20
"""Maximum number of checks of a job, of 20 s each (chosen)."""
_FAILURE_SEARCH: dict[str, Any] = {
    "scenario_id": "ZAM_Fahrhausen-4_1_T-1",
    "config": "idm:Default",
    "runs": 40,
    "until_first": True,
    "shrink": True,
    "wait_s": 20,
}
"""The search for a failure: near a scenario of the starter catalogue, where it takes seconds with the fastest planner
(chosen)."""
_KEPT_DEMOS = 100
"""Maximum number of numbered folders next to the requested one (chosen)."""


@dataclass(frozen=True)
class _Answer:
    """The answer to a call."""

    text: str
    structured: dict[str, Any]
    refused: bool


class _DemoSession:
    """Calls tools through a real client, and prints stages, requests and answers."""

    def __init__(self, client: Client, console: Console) -> None:
        self._client, self._console = client, console
        self._stages = self.calls = 0
        self.seconds = 0.0

    def stage(self, title: str, sentence: str) -> None:
        """Start a stage of the work."""
        self._stages += 1
        self._console.print()
        self._console.rule(f"[bold]{self._stages}  {escape(title)}[/bold]", align="left")
        self._console.print(escape(sentence))

    def says(self, sentence: str) -> None:
        """Print a sentence of the demo itself."""
        _say(self._console, sentence)

    async def ask(self, tool: str, arguments: dict[str, Any], *, quiet: bool = False) -> _Answer:
        """Make a call, and print it with its answer unless ``quiet``; a refusal is also an answer."""
        if not quiet:
            shown = json.dumps(arguments, ensure_ascii=False)
            self._console.print(Text.assemble(("  ask   ", "bold cyan"), (tool, "cyan"), f" {shown}"))
        started = time.perf_counter()
        result = await self._client.call_tool(tool, arguments)
        seconds = time.perf_counter() - started
        self.calls += 1
        self.seconds += seconds
        answer = _Answer(answer_text(result), result.structured_content or {}, bool(result.is_error))
        if not quiet:
            self._show(answer, seconds)
        return answer

    async def must(self, tool: str, arguments: dict[str, Any]) -> dict[str, Any]:
        """Make a call that the rest of the demo needs, and return the structured answer.

        Raises:
            NotPossible: The call was refused.
        """
        answer = await self.ask(tool, arguments)
        if answer.refused:
            raise NotPossible(f"the demo cannot continue: {answer.text}")
        return answer.structured

    def _show(self, answer: _Answer, seconds: float) -> None:
        label, style = ("  refused", "bold yellow") if answer.refused else ("  answer", "bold green")
        self._console.print(Text.assemble((label, style), (f"  ({seconds:.2f} s)", "dim")))
        lines = answer.text.strip().splitlines()
        more = [f"… {len(lines) - _SHOWN_LINES} more lines"] if len(lines) > _SHOWN_LINES else []
        self._console.print(Padding(Text("\n".join(lines[:_SHOWN_LINES] + more)), (0, 0, 0, 4)))


def _say(console: Console, sentence: str) -> None:
    console.print(Text(f"  {sentence}", style="dim"))


def run_demo(*, scenario: Path | None, map_file: Path | None, folder: Path) -> int:
    """Run the demo, from a CommonRoad file, an OpenStreetMap extract, or neither (the built-in maps).

    Returns the exit status: 0, 1 if a necessary stage was refused, or 2 if a given file is missing.
    """
    console = Console(highlight=False, width=min(Console().width, 118))
    for given in (scenario, map_file):
        if given is not None and not given.is_file():
            _say(console, f"There is no file {given}.")
            return 2
    try:
        anyio.run(_demo, scenario, map_file, _free_folder(folder.resolve()), console)
    except PlannerForgeError as error:
        _say(console, error.message)
        return 1
    return 0


def _free_folder(wanted: Path) -> Path:
    """Return the folder, or a numbered folder next to it if it exists, so that an earlier demo is never overwritten."""
    numbered = (wanted.with_name(f"{wanted.name}-{number}") for number in range(2, _KEPT_DEMOS))
    free = (folder for folder in (wanted, *numbered) if not folder.exists())
    return next(free, wanted.with_name(f"{wanted.name}-{time.time_ns()}"))


async def _demo(scenario: Path | None, map_file: Path | None, folder: Path, console: Console) -> None:
    console.print("[bold]PlannerForge MCP[/bold]: one scenario through every stage, by a real MCP client.")
    started = time.perf_counter()
    workspace = folder / "workspace"
    roots = [folder.parent, *(path.resolve().parent for path in (scenario, map_file) if path)]
    arguments = ["-P", "-m", "plannerforge", "serve", "--workspace", str(workspace)]
    arguments += [part for root in dict.fromkeys(roots) for part in ("--roots", str(root))]
    async with Client(StdioServerParameters(command=sys.executable, args=arguments)) as client:
        tools = (await client.list_tools()).tools
        session = _DemoSession(client, console)
        session.says(
            f"Connected to plannerforge {__version__} over stdio, protocol {client.protocol_version}, "
            f"{len(tools)} tools, after {time.perf_counter() - started:.1f} s."
        )
        await _stages(session, scenario, map_file, folder)
        console.print()
        console.rule("[bold]Done[/bold]", align="left")
        console.print(Text(f"{session.calls} calls took {session.seconds:.1f} s in total."))
        console.print(Text(f"Report:    {folder / 'report.html'}"))
        console.print(Text(f"Pictures, animation and scenarios: {folder}"))
        console.print(Text(f"All artifacts are in {workspace}; continue with:"))
        console.print(Text(f"  plannerforge call list_artifacts --workspace {workspace}"))


async def _stages(session: _DemoSession, scenario: Path | None, map_file: Path | None, folder: Path) -> None:
    scenario_id = await _begin(session, scenario, map_file)
    await _choose(session)
    modified_id = await _modify(session, await _describe(session, scenario_id))
    scenarios = [scenario_id, *([modified_id] if modified_id else [])]
    batch_id, shown_run = await _configure_and_run(session, scenarios)
    await _compare(session, batch_id, shown_run)
    await _draw_and_export(session, folder, scenarios, batch_id)
    await _find_failure(session, folder)


async def _begin(session: _DemoSession, scenario: Path | None, map_file: Path | None) -> str:
    """Import or generate a scenario from the given file, the given map, or a built-in map, and return its id."""
    if scenario is not None:
        session.stage("Import", f"Import the CommonRoad file {scenario.name}.")
        imported = await session.must("import_files", {"path": str(scenario.resolve())})
        return str(imported["items"][0]["artifact_id"])
    wanted: dict[str, Any] = {"scenario_type": "signalised_intersection", "density": "medium"}
    sentence = "Cut a signalised crossing out of a built-in map and fill it with traffic, including two trucks."
    if map_file is not None:
        session.stage("Import", f"Import the OpenStreetMap extract {map_file.name}.")
        imported = await session.must("import_files", {"path": str(map_file.resolve())})
        wanted = {"place": imported["items"][0]["artifact_id"], "density": "medium"}
        sentence = "Find a site on that map and fill it with traffic, including two trucks."
    session.stage("Generate", sentence)
    made = await session.must("generate_scenarios", {**wanted, "vehicles": ["truck=2"], "seed": 7})
    return str(made["scenarios"][0]["scenario_id"])


async def _choose(session: _DemoSession) -> None:
    """Search the catalogue by facts and by text."""
    session.stage(
        "Select", "Search the catalogue: at least one truck, best match for a text first (loads the embedding model)."
    )
    await session.ask("describe_catalog", {})
    await session.ask(
        "find_scenarios", {"obstacles": ["truck>=1"], "text": "busy crossing with traffic lights", "limit": 3}
    )


async def _describe(session: _DemoSession, scenario_id: str) -> dict[str, Any]:
    """Describe a scenario, and return the structured answer."""
    session.stage("Describe", "The content of the scenario, with the ids that edits need.")
    return await session.must("describe_scenario", {"scenario_id": scenario_id, "detail": "vehicles"})


async def _modify(session: _DemoSession, described: dict[str, Any]) -> str | None:
    """Make one edit of each kind (trajectory, behaviour, population, goal), and return the new scenario's id."""
    session.stage("Modify", "One edit of each kind: a new route, an aggressive driver, an added vehicle, another goal.")
    edits = await _one_edit_of_each_kind(session, described)
    if not edits:
        session.says("No edit is possible here; the runs use the unchanged scenario.")
        return None
    step = await session.ask("modify_scenario", {"scenario_id": described["scenario_id"], "edits": edits})
    return None if step.refused else str(step.structured["scenario_id"])


async def _one_edit_of_each_kind(session: _DemoSession, described: dict[str, Any]) -> list[dict[str, Any]]:
    """Return edits T, B, P and G that pass a dry run separately and together; fewer if the scenario allows fewer."""
    accepted: list[dict[str, Any]] = []
    for kind, candidates in _candidates(described).items():
        edit = await _first_possible(session, described["scenario_id"], accepted, candidates)
        if edit is None:
            session.says(f"No {kind} is possible here, after {min(len(candidates), _MOST_TRIES)} tries.")
        else:
            accepted.append(edit)
    return accepted


async def _first_possible(
    session: _DemoSession, scenario_id: str, before: list[dict[str, Any]], candidates: list[dict[str, Any]]
) -> dict[str, Any] | None:
    refusals: list[str] = []
    possible = None
    for candidate in candidates[:_MOST_TRIES]:
        arguments = {"scenario_id": scenario_id, "edits": [*before, candidate], "dry_run": True}
        step = await session.ask("modify_scenario", arguments, quiet=True)
        if not step.refused:
            possible = candidate
            break
        refusals.append(f"{json.dumps(candidate)}: {step.text}")
    if refusals:
        more = f" ({len(refusals)} refused tries in total)" if len(refusals) > 1 else ""
        session.says(f"Refused in a dry run: {refusals[0]}{more}")
    return possible


def _candidates(described: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """Return candidate edits by kind, best first."""
    description = described["description"]
    moving = [str(vehicle["vehicle_id"]) for vehicle in description["vehicles"] if vehicle["moves"]]
    ego = description["ego"] or {"goal_lanelets": [], "route": []}
    goals = [*ego["goal_lanelets"], *reversed(ego["route"])]
    return {
        "reroute": [
            {"op": "reroute", "vehicles": [vehicle], "turn": turn}
            for vehicle in moving[:4]
            for turn in ("left", "right", "straight")
        ],
        "change of behaviour": [
            {"op": "set_behaviour", "vehicles": [which], "preset": "aggressive"}
            for which in ("lead", "nearest:1", *moving)
        ],
        "added vehicle": [
            {"op": "add_vehicle", "vehicle_class": kind, "at": "ego", "lane": lane, "offset_m": offset}
            for kind, lane, offset in (
                ("truck", "same", 35),
                ("car", "same", 25),
                ("car", "left", 15),
                ("car", "same", -20),
                ("car", "same", 60),
            )
        ],
        "new goal": [
            {"op": "set_goal", "to": [str(lanelet)], "position": position, "goal_time": "4..14s"}
            for lanelet in dict.fromkeys(goals)
            for position in ("final", "middle")
        ],
    }


async def _configure_and_run(session: _DemoSession, scenarios: list[str]) -> tuple[str, str]:
    """Run two configurations on every scenario; return the id of the batch, and of the run for the timeline."""
    session.stage("Run", f"Frenetix's default against its {_OTHER_PRESET} preset, on {len(scenarios)} scenarios.")
    made = await session.must("configure_planner", {"preset": _OTHER_PRESET})
    grid = {"scenarios": scenarios, "configs": [_BASE_CONFIG, made["config_id"]], "wait_s": 20}
    batch = await session.must("run_planner", grid)
    for _ in range(_MOST_WAITS):
        if batch["state"] != "running":
            break
        await session.ask("get_job", {"job_id": batch["job_id"], "wait_s": 20})
        batch = await session.must("run_planner", {**grid, "wait_s": 0})
    failed = [run["run_id"] for run in batch["runs"] if run["outcome"] not in ("goal_reached", "invalid")]
    return str(batch["batch_id"]), str((failed or [run["run_id"] for run in batch["runs"]])[0])


async def _compare(session: _DemoSession, batch_id: str, shown_run: str) -> None:
    """Compare the configurations, and analyse the figures."""
    session.stage("Compare and analyse", "What improved, what got worse, and what is the evidence?")
    await session.ask("compare_results", {"results": [batch_id]})
    analysed = await session.ask("analyze_results", {"results": [batch_id]})
    if trivial := analysed.structured.get("trivial"):
        session.says(f"Goals reached without driving say nothing about a planner: {', '.join(trivial['run_ids'])}.")
    await session.ask("analyze_results", {"results": [shown_run], "detail": "timeline"})


async def _draw_and_export(session: _DemoSession, folder: Path, scenarios: list[str], batch_id: str) -> None:
    """Draw the scenarios, and write everything to the user's folder."""
    session.stage("Draw and report", f"Pictures and a report, written to {folder}.")
    await session.ask("render", {"ids": scenarios})
    files = {"ids": scenarios, "formats": ["xml", "recipe", "png"], "folder": str(folder)}
    await session.ask("export_artifacts", files)
    await session.must(
        "export_artifacts", {"ids": [scenarios[-1], batch_id], "formats": ["html"], "folder": str(folder)}
    )


async def _find_failure(session: _DemoSession, folder: Path) -> None:
    """Search for a failure near a scenario of the starter catalogue, and draw it after its reduction."""
    session.stage(
        "Find a failure",
        "Change a scenario until a planner fails where a careful driver would not, and leave out what the failure does "
        "not need.",
    )
    found = await session.must("find_failures", _FAILURE_SEARCH)
    for _ in range(_MOST_WAITS):
        if found["state"] != "running":
            break
        found = await session.must("find_failures", _FAILURE_SEARCH)
    for failure in (found["search"] or {"failures": []})["failures"]:
        run = {"ids": [failure["shrunk"]["run_id"]]}
        await session.ask("render", run)
        await session.ask("render", {**run, "kind": "animation"})
        await session.ask("export_artifacts", {**run, "formats": ["png", "gif"], "folder": str(folder)})
