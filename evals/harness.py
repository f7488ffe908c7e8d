"""What all benchmarks share: the form of their output, their files, their server and its client.

Each prints a table for people and, as its last line, one JSON object for comparison.
"""

import hashlib
import json
import os
import statistics
import sys
from argparse import ArgumentParser
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from mcp import Client
from rich.console import Console
from rich.table import Table

from ..engine.analysis import rate
from ..engine.execution import Operation, Request, Response, silent
from ..engine.tuning import named_configuration
from ..schemas.planning import PlannerConfiguration
from ..server.settings import Settings
from ..tools.call import ToolCall

_POLL_S = 50
"""For which the server is asked to wait for a job: the most that it accepts."""


def print_figures(title: str, rows: Sequence[tuple[str, str]], figures: Mapping[str, float | int | str]) -> None:
    """Print a table of ``(what, figure)`` rows and the figures as the last line."""
    table = Table("figure", "value", title=title)
    for what, value in rows:
        table.add_row(what, value)
    Console(width=110).print(table)
    sys.stdout.write(json.dumps(dict(figures)) + "\n")


def spread(values: Sequence[float], unit: str, digits: int = 2) -> str:
    """Median with minimum and maximum, in words."""
    middle = statistics.median(values)
    return f"{middle:.{digits}f} {unit} (min {min(values):.{digits}f}, max {max(values):.{digits}f}, n {len(values)})"


def rate_text(count: int, of: int) -> str:
    """A share with its 95 % Wilson interval, in words; a dash without trials."""
    share = rate(count, of)
    return "-" if share.share is None else f"{share.share:.1%} ({share.low:.1%} to {share.high:.1%})"


def shared_folder() -> Path:
    """The folder of public scenarios, maps and corpora: ``PLANNERFORGE_SHARED``, or ``shared`` beside the checkout."""
    beside = Path(__file__).resolve().parent.parent.parent / "shared"
    return Path(os.environ.get("PLANNERFORGE_SHARED", beside))


def shared_scenarios() -> Path:
    """The folder of public CommonRoad scenarios in the shared folder."""
    return shared_folder() / "data" / "commonroad"


def existing(folder: Path, parser: ArgumentParser, option: str) -> Path:
    """A folder that a benchmark needs; where there is none, the program ends with the option that names it."""
    if not folder.is_dir():
        parser.error(f"there is no folder {folder}: name one with {option}, or set PLANNERFORGE_SHARED")
    return folder.resolve()


def built_in(name: str) -> PlannerConfiguration:
    """A configuration that comes with the package, such as ``frenetix:Default``.

    Raises:
        RuntimeError: there is none of this name any more.
    """
    configuration = named_configuration(name)
    if configuration is None:
        raise RuntimeError(f"the built-in configuration {name} is gone")
    return configuration


def drawn(names: Sequence[str], limit: int | None) -> list[str]:
    """At most ``limit`` of the names, always the same ones and in the same order; all of them without a limit."""
    return sorted(names, key=lambda name: hashlib.sha256(name.encode()).hexdigest())[:limit]


def scenario_files(folder: Path, limit: int | None) -> list[Path]:
    """The scenario files of a folder; with a limit, always the same sample."""
    found = {path.name: path for path in sorted(folder.rglob("*.xml")) if not path.name.endswith(".net.xml")}
    return [found[name] for name in (sorted(found) if limit is None else drawn(list(found), limit))]


def settings_for(workspace: Path, folder: Path, workers: int) -> Settings:
    """A server on the benchmark's own workspace."""
    return Settings(workspace=workspace, roots=(folder,), workers=workers, starter=False, warm_up=False, journal=False)


async def ask(client: Client, tool: str, **arguments: Any) -> Any:
    """The structured answer of a tool.

    Raises:
        RuntimeError: the tool refused.
    """
    result = await client.call_tool(tool, arguments)
    if result.is_error or result.structured_content is None:
        raise RuntimeError(f"{tool}: {result.content}")
    return result.structured_content


async def import_scenarios(client: Client, files: Sequence[Path]) -> None:
    """Import files; one that is refused is named and left out."""
    for path in files:
        result = await client.call_tool("import_files", {"path": str(path)})
        if result.is_error:
            sys.stderr.write(f"{path.name} is left out: {result.content}\n")


async def finished_batch(client: Client, **arguments: Any) -> str:
    """Run a grid to its end and give the id of the batch.

    Raises:
        RuntimeError: the grid could not be run to its end.
    """
    result = await ask(client, "run_planner", wait_s=0, **arguments)
    while result.get("batch_id") is None:
        job = await ask(client, "get_job", job_id=result["job_id"], wait_s=_POLL_S)
        sys.stderr.write(f"{arguments['prediction']}: {job['message']}\n")
        if job["state"] not in ("running", "done"):
            raise RuntimeError(f"the batch ended as {job['state']}: {job['error']}")
        if job["state"] == "done":
            return str(job["results"][-1])
    return str(result["batch_id"])


class InProcess:
    """An executor that carries operations out in this process, one at a time and without a time limit."""

    capacity = 1

    async def run(self, operation: Operation[Request, Response], request: Request, **options: object) -> Response:
        """The operation's response."""
        del options
        return operation.load()(request, silent)


def call_in_process() -> ToolCall:
    """A tool's call without server and workers, for timing what a tool plans; it can do nothing but run operations."""
    return cast("ToolCall", InProcess())
