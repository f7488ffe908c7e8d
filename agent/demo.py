"""``plannerforge demo``: a real MCP client takes a scenario through every stage of testing a planner.

The server is a process of its own and is spoken to over stdio, as any client does. Nothing is prepared: what is asked
depends on what came back before, and every figure on the answers.
"""

import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import anyio
from mcp import Client, StdioServerParameters

from plannerforge import __version__
from plannerforge.agent.demo_console import DemoConsole
from plannerforge.agent.demo_session import DemoSession
from plannerforge.agent.demo_stages import begin, choose, compare, configure_and_run, describe, draw_and_export, modify
from plannerforge.schemas.errors import PlannerForgeError

KEPT_DEMOS = 100


@dataclass(frozen=True)
class DemoInput:
    """What the demo begins with: a CommonRoad file, an OpenStreetMap extract, or neither (the built-in maps)."""

    scenario: Path | None
    map_file: Path | None
    folder: Path


def run_demo(*, scenario: Path | None, map_file: Path | None, folder: Path) -> int:
    """Run the demo and give the exit status: 0, or 1 where a stage that the rest needs was refused."""
    console = DemoConsole()
    for given in (scenario, map_file):
        if given is not None and not given.is_file():
            console.says(f"There is no file {given}.")
            return 2
    source = DemoInput(scenario, map_file, _free_folder(folder.resolve()))
    try:
        anyio.run(_demo, source, console)
    except PlannerForgeError as error:
        console.says(error.message)
        return 1
    return 0


async def _demo(source: DemoInput, console: DemoConsole) -> None:
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
            session = DemoSession(client, console)
            await _stages(session, source)
            console.ends(
                [
                    f"{len(session.steps)} calls took {session.seconds:.1f} s in all.",
                    f"Report:    {source.folder / 'report.html'}",
                    f"Pictures, animation and scenarios: {source.folder}",
                ]
            )


async def _stages(session: DemoSession, source: DemoInput) -> None:
    scenario_id = await begin(session, source.scenario, source.map_file)
    await choose(session)
    picture_of = await describe(session, scenario_id)
    modified_id = await modify(session, picture_of)
    results = await configure_and_run(session, [scenario_id, *([modified_id] if modified_id else [])])
    await compare(session, results)
    await draw_and_export(session, source.folder, scenario_id, modified_id, results)


def _free_folder(wanted: Path) -> Path:
    """The folder, or one beside it with a number: an earlier demo is never overwritten."""
    for number in range(1, KEPT_DEMOS):
        folder = wanted if number == 1 else wanted.with_name(f"{wanted.name}-{number}")
        if not folder.exists():
            return folder
    return wanted.with_name(f"{wanted.name}-{time.time_ns()}")
