"""``plannerforge demo``: a real MCP client takes a scenario through every stage of testing a planner.

The server is a process of its own and is spoken to over stdio, as any client does. Nothing is prepared: what is asked
depends on what came back before, and every figure on the answers.
"""

import json
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import anyio
from mcp import Client, StdioServerParameters
from mcp.types import CallToolResult, TextContent
from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.text import Text

from .. import __version__
from ..schemas.errors import NotPossible, PlannerForgeError

_BASE_CONFIG, _OTHER_PRESET = "frenetix:Default", "Safety-Conservative"
_SHOWN_LINES = 12
"""Lines of an answer that are printed; chosen."""
_MOST_TRIES = 12
"""Dry runs at most to find an edit of one kind; chosen."""
_MOST_WAITS = 20
"""Looks at the job of the runs, of 20 s each; chosen."""
_KEPT_DEMOS = 100
"""Numbered folders beside the wanted one; chosen."""


@dataclass(frozen=True)
class _DemoInput:
    """What the demo begins with: a CommonRoad file, an OpenStreetMap extract, or neither (the built-in maps)."""

    scenario: Path | None
    map_file: Path | None
    folder: Path


@dataclass(frozen=True)
class _Step:
    """One call: what was asked, what came back, how long it took."""

    tool: str
    arguments: dict[str, Any]
    text: str
    structured: dict[str, Any]
    seconds: float
    refused: bool


@dataclass(frozen=True)
class _Results:
    """What the runs gave: batch, single runs, and the one worth an animation."""

    batch_id: str
    shown_run: str


class _DemoConsole:
    """Prints stages, questions and answers in plain words."""

    def __init__(self, console: Console | None = None) -> None:
        self.console = console or Console(highlight=False, width=min(Console().width, 118))
        self._stage = 0

    def stage(self, title: str, sentence: str) -> None:
        """Begin a stage of the work."""
        self._stage += 1
        self.console.print()
        self.console.rule(f"[bold]{self._stage}  {escape(title)}[/bold]", align="left")
        self.console.print(escape(sentence))

    def asks(self, tool: str, arguments: dict[str, Any]) -> None:
        """Show a call as it is sent."""
        shown = json.dumps(arguments, ensure_ascii=False)
        self.console.print(Text.assemble(("  ask   ", "bold cyan"), (tool, "cyan"), f" {shown}"))

    def answers(self, text: str, seconds: float, *, refused: bool = False) -> None:
        """Show the answer's text, its first lines, and the time it took."""
        label, style = ("  refused", "bold yellow") if refused else ("  answer", "bold green")
        self.console.print(Text.assemble((label, style), (f"  ({seconds:.2f} s)", "dim")))
        lines = text.strip().splitlines()
        body = "\n".join(lines[:_SHOWN_LINES])
        if len(lines) > _SHOWN_LINES:
            body += f"\n… {len(lines) - _SHOWN_LINES} more lines"
        self.console.print(Padding(Text(body), (0, 0, 0, 4)))

    def says(self, sentence: str) -> None:
        """A sentence of the demo's own."""
        self.console.print(Text(f"  {sentence}", style="dim"))

    def ends(self, lines: list[str]) -> None:
        """The closing lines."""
        self.console.print()
        self.console.rule("[bold]Done[/bold]", align="left")
        for line in lines:
            self.console.print(Text(line))


@dataclass
class _DemoSession:
    """Calls tools through a real client, and prints what it does."""

    client: Client
    console: _DemoConsole
    steps: list[_Step] = field(default_factory=list)

    async def ask(self, tool: str, arguments: dict[str, Any], *, quiet: bool = False) -> _Step:
        """Make a call; a refusal is an answer too."""
        if not quiet:
            self.console.asks(tool, arguments)
        started = time.perf_counter()
        result = await self.client.call_tool(tool, arguments)
        step = _Step(
            tool=tool,
            arguments=arguments,
            text=_text(result),
            structured=result.structured_content or {},
            seconds=time.perf_counter() - started,
            refused=bool(result.is_error),
        )
        self.steps.append(step)
        if not quiet:
            self.console.answers(step.text, step.seconds, refused=step.refused)
        return step

    async def must(self, tool: str, arguments: dict[str, Any]) -> _Step:
        """Make a call that the rest of the demo needs.

        Raises:
            NotPossible: it was refused.
        """
        step = await self.ask(tool, arguments)
        if step.refused:
            raise NotPossible(f"the demo cannot go on: {step.text}")
        return step

    @property
    def seconds(self) -> float:
        """Time spent in calls."""
        return sum(step.seconds for step in self.steps)


def _text(result: CallToolResult) -> str:
    return "\n".join(block.text for block in result.content if isinstance(block, TextContent))


def run_demo(*, scenario: Path | None, map_file: Path | None, folder: Path) -> int:
    """Run the demo and return the exit status: 0, or 1 where a stage that the rest needs was refused."""
    console = _DemoConsole()
    for given in (scenario, map_file):
        if given is not None and not given.is_file():
            console.says(f"There is no file {given}.")
            return 2
    source = _DemoInput(scenario, map_file, _free_folder(folder.resolve()))
    try:
        anyio.run(_demo, source, console)
    except PlannerForgeError as error:
        console.says(error.message)
        return 1
    return 0


def _free_folder(wanted: Path) -> Path:
    """The folder, or one beside it with a number: an earlier demo is never overwritten."""
    for number in range(1, _KEPT_DEMOS):
        folder = wanted if number == 1 else wanted.with_name(f"{wanted.name}-{number}")
        if not folder.exists():
            return folder
    return wanted.with_name(f"{wanted.name}-{time.time_ns()}")


async def _demo(source: _DemoInput, console: _DemoConsole) -> None:
    console.console.print("[bold]PlannerForge MCP[/bold]: one scenario through every stage, by a real MCP client.")
    started = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="plannerforge-demo-") as workspace:
        roots = [source.folder.parent, *(p.resolve().parent for p in (source.scenario, source.map_file) if p)]
        arguments = ["-m", "plannerforge.server", "serve", "--workspace", workspace]
        arguments += [part for root in dict.fromkeys(roots) for part in ("--roots", str(root))]
        async with Client(StdioServerParameters(command=sys.executable, args=arguments)) as client:
            tools = (await client.list_tools()).tools
            console.says(
                f"Connected to plannerforge {__version__} over stdio, protocol {client.protocol_version}, "
                f"{len(tools)} tools, after {time.perf_counter() - started:.1f} s."
            )
            session = _DemoSession(client, console)
            await _stages(session, source)
            console.ends(
                [
                    f"{len(session.steps)} calls took {session.seconds:.1f} s in all.",
                    f"Report:    {source.folder / 'report.html'}",
                    f"Pictures, animation and scenarios: {source.folder}",
                ]
            )


async def _stages(session: _DemoSession, source: _DemoInput) -> None:
    scenario_id = await _begin(session, source.scenario, source.map_file)
    await _choose(session)
    described = await _describe(session, scenario_id)
    modified_id = await _modify(session, described)
    results = await _configure_and_run(session, [scenario_id, *([modified_id] if modified_id else [])])
    await _compare(session, results)
    await _draw_and_export(session, source.folder, scenario_id, modified_id, results)


async def _begin(session: _DemoSession, scenario: Path | None, map_file: Path | None) -> str:
    """Get a scenario: from the given file, from the given map, or from a built-in map. Returns its id."""
    if scenario is not None:
        session.console.stage("Import", f"Take in the CommonRoad file {scenario.name}.")
        step = await session.must("import_files", {"path": str(scenario.resolve())})
        return str(step.structured["items"][0]["artifact_id"])
    wanted: dict[str, Any] = {"scenario_type": "signalised_intersection", "density": "medium"}
    sentence = "Cut a signalised crossing out of a built-in map and fill it with traffic, two trucks among it."
    if map_file is not None:
        session.console.stage("Import", f"Take in the OpenStreetMap extract {map_file.name}.")
        step = await session.must("import_files", {"path": str(map_file.resolve())})
        wanted = {"place": step.structured["items"][0]["artifact_id"], "density": "medium"}
        sentence = "Find a site on that map and fill it with traffic, two trucks among it."
    session.console.stage("Generate", sentence)
    step = await session.must("generate_scenarios", {**wanted, "vehicles": ["truck=2"], "seed": 7})
    return str(step.structured["scenarios"][0]["scenario_id"])


async def _choose(session: _DemoSession) -> None:
    """Search the catalogue, by facts and by text."""
    session.console.stage(
        "Select", "Search the catalogue: at least one truck, best match first for a text (loads the embedding model)."
    )
    await session.ask("describe_catalog", {})
    await session.ask(
        "find_scenarios", {"obstacles": ["truck>=1"], "text": "busy crossing with traffic lights", "limit": 3}
    )


async def _describe(session: _DemoSession, scenario_id: str) -> dict[str, Any]:
    """Look at a scenario; returns the structured answer."""
    session.console.stage("Describe", "What is in the scenario, in words and in ids that an edit can use?")
    step = await session.must("describe_scenario", {"scenario_id": scenario_id, "detail": "vehicles"})
    return step.structured


async def _modify(session: _DemoSession, described: dict[str, Any]) -> str | None:
    """Make one edit of each kind (trajectory, behaviour, population, goal); returns the new scenario's id."""
    session.console.stage(
        "Modify", "One edit of each kind: a new route, an aggressive driver, an added vehicle, another goal."
    )
    edits = await _one_edit_of_each_kind(session, described)
    if not edits:
        session.console.says("No edit is possible here; the runs go on with the scenario as it is.")
        return None
    step = await session.ask("modify_scenario", {"scenario_id": described["scenario_id"], "edits": edits})
    return None if step.refused else str(step.structured["scenario_id"])


async def _one_edit_of_each_kind(session: _DemoSession, described: dict[str, Any]) -> list[dict[str, Any]]:
    """Edits T, B, P and G of which each, and all together, pass a dry run; fewer where the scenario allows fewer."""
    accepted: list[dict[str, Any]] = []
    for kind, candidates in _candidates(described).items():
        edit = await _first_possible(session, described["scenario_id"], accepted, candidates)
        if edit is None:
            session.console.says(f"No {kind} is possible here after {min(len(candidates), _MOST_TRIES)} tries.")
        else:
            accepted.append(edit)
    return accepted


async def _first_possible(
    session: _DemoSession, scenario_id: str, before: list[dict[str, Any]], candidates: list[dict[str, Any]]
) -> dict[str, Any] | None:
    for candidate in candidates[:_MOST_TRIES]:
        arguments = {"scenario_id": scenario_id, "edits": [*before, candidate], "dry_run": True}
        step = await session.ask("modify_scenario", arguments, quiet=True)
        if not step.refused:
            return candidate
        session.console.says(f"tried {candidate}: {step.text}")
    return None


def _candidates(described: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """What may be tried, kind by kind, the best first."""
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


async def _configure_and_run(session: _DemoSession, scenarios: list[str]) -> _Results:
    """Run two configurations on every scenario."""
    session.console.stage(
        "Run", f"Frenetix's default against its {_OTHER_PRESET} preset, on {len(scenarios)} scenarios."
    )
    made = await session.must("configure_planner", {"preset": _OTHER_PRESET})
    grid = {"scenarios": scenarios, "configs": [_BASE_CONFIG, made.structured["config_id"]], "wait_s": 20}
    step = await session.must("run_planner", grid)
    for _ in range(_MOST_WAITS):
        if step.structured["state"] != "running":
            break
        await session.ask("get_job", {"job_id": step.structured["job_id"], "wait_s": 20})
        step = await session.must("run_planner", {**grid, "wait_s": 0})
    runs = step.structured["runs"]
    failed = [run["run_id"] for run in runs if run["outcome"] not in ("goal_reached", "invalid")]
    return _Results(str(step.structured["batch_id"]), str((failed or [run["run_id"] for run in runs])[0]))


async def _compare(session: _DemoSession, results: _Results) -> None:
    """Ask what got better, and what the figures say."""
    session.console.stage("Compare and analyse", "What got better, what got worse, and what is the evidence?")
    await session.ask("compare_results", {"results": [results.batch_id]})
    await session.ask("analyze_results", {"results": [results.batch_id], "detail": "findings"})
    await session.ask("analyze_results", {"results": [results.shown_run], "detail": "timeline"})


async def _draw_and_export(
    session: _DemoSession, folder: Path, scenario_id: str, modified_id: str | None, results: _Results
) -> None:
    """Draw the scenarios and a run, and write everything into the user's folder."""
    session.console.stage("Draw and report", f"Pictures, an animation, and a report, written to {folder}.")
    scenarios = [scenario_id, *([modified_id] if modified_id else [])]
    await session.ask("render", {"ids": scenarios})
    await session.ask("render", {"ids": [results.shown_run], "kind": "animation"})
    files = {"ids": scenarios, "formats": ["xml", "recipe", "png"], "folder": str(folder)}
    await session.ask("export_artifacts", files)
    await session.ask("export_artifacts", {"ids": [results.shown_run], "formats": ["gif"], "folder": str(folder)})
    await session.must(
        "export_artifacts", {"ids": [*scenarios, results.batch_id], "formats": ["html"], "folder": str(folder)}
    )
