"""The commands that add maps to the library, fetch them, and list them."""

import math
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, closing
from pathlib import Path

import anyio
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn
from rich.table import Column, Table

from ..engine.execution import CallThreads
from ..schemas.artifacts import ImportedItem
from ..schemas.errors import InvalidRequest, PlannerForgeError, UnsafeInput
from ..schemas.generation import MapFacts, ScenarioType
from ..schemas.text import counted
from ..server.assembly import open_services
from ..server.settings import Settings
from ..workflows.context import Services, WorkflowContext
from ..workflows.generation.online import fetch_to_keep
from ..workflows.maps import MapInventory, import_map, known_country, maps_at_hand

_SHOWN_STREETS = 3
"""Streets that a row lists (chosen)."""


def add_maps(settings: Settings, paths: Sequence[Path], *, place: str | None, country: str | None) -> int:
    """Import map files; return 0, or 1 if one was refused."""
    refused = 0
    try:
        code = known_country(country)
    except InvalidRequest as error:
        _print_error(error.text)
        return 2
    for path, item in anyio.run(_add, settings, paths, place, code):
        if isinstance(item, ImportedItem):
            line = f"{path.name} → {item.artifact_id}: {item.summary}{' (already stored)' if item.reused else ''}"
            Console().print(escape(line), highlight=False, soft_wrap=True)
        else:
            refused += 1
            _print_error(f"{path.name}: {item.text}")
    return 1 if refused else 0


def fetch_map(settings: Settings, place: str, *, country: str | None, scenario_type: ScenarioType) -> int:
    """Fetch a place's map into the library and show the progress on stderr; return 0, or 1 if the settings forbid it.

    Raises:
        PlannerForgeError: The map is not available; it may be inside an exception group of the tasks that it ended.
    """
    if settings.maps_online == "offline":
        _print_error("maps_online is offline, so nothing is fetched; set it to online")
        return 1
    errors = Console(stderr=True)
    errors.print(f"Asks {', '.join(settings.map_services().hosts)}", style="dim", highlight=False)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn())
    with Progress(*columns, console=errors, transient=True) as bars:
        facts, notes = anyio.run(_fetch, settings, place, known_country(country), scenario_type, bars)
    sites = ", ".join(counted(count, f"{kind.replace('_', ' ')} site") for kind, count in sorted(facts.sites.items()))
    summary = f"{facts.place} ({facts.country or 'country unknown'}): {facts.road_km:.1f} km of roads, {sites}"
    for line in (f"{facts.map_id}: {summary}", *notes, facts.attribution):
        Console().print(escape(line), highlight=False, soft_wrap=True)
    return 0


def list_maps(settings: Settings) -> int:
    """Print a table of all available maps with their places and sites."""
    at_hand = anyio.run(_all, settings)
    longest = max((len(entry.facts.map_id) for entry in at_hand.entries), default=0)
    identity = Column("id", no_wrap=True, min_width=longest)  # never truncated, since other commands take it
    table = Table(identity, "place", "country", "south, west, north, east", "road km", "sites", "streets", title="Maps")
    for facts in (entry.facts for entry in at_hand.entries):
        box = ", ".join(f"{value:.4f}" for value in (facts.south, facts.west, facts.north, facts.east))
        sites = ", ".join(f"{count} {kind}" for kind, count in sorted(facts.sites.items()))
        roads = ", ".join((*facts.streets, *facts.refs)[:_SHOWN_STREETS])
        cells = (facts.map_id, facts.place, facts.country or "unknown", box, f"{facts.road_km:.1f}", sites, roads)
        table.add_row(*(escape(cell) for cell in cells))
    Console().print(table)
    for note in at_hand.notes:
        _print_error(note)
    return 0


@asynccontextmanager
async def _services(settings: Settings) -> AsyncIterator[Services]:
    with closing(CallThreads()) as threads:
        async with open_services(settings, Path.cwd(), threads) as services:
            yield services


async def _add(
    settings: Settings, paths: Sequence[Path], place: str | None, country: str | None
) -> list[tuple[Path, ImportedItem | PlannerForgeError]]:
    with Console(stderr=True).status("") as status:

        async def show(share: float, message: str) -> None:
            status.update(escape(f"{message} ({share:.0%})"))

        async with _services(settings) as services:
            call = WorkflowContext(services, show)
            return [(path, await _add_one(call, path, place, country)) for path in paths]


async def _add_one(
    call: WorkflowContext, path: Path, place: str | None, country: str | None
) -> ImportedItem | PlannerForgeError:
    try:
        added = await import_map(call, path, place, country, wait_s=math.inf)
    except PlannerForgeError as error:
        return error
    if isinstance(added, ImportedItem):
        return added
    return UnsafeInput(
        added.error or f"the job {added.job_id} was {added.state}", next_step="add the map again to continue"
    )


async def _fetch(
    settings: Settings, place: str, country: str | None, scenario_type: ScenarioType, bars: Progress
) -> tuple[MapFacts, list[str]]:
    bar = bars.add_task(place, total=1.0)

    async def show(share: float, message: str) -> None:
        bars.update(bar, completed=share, description=message or place)

    async with _services(settings) as services:
        return await fetch_to_keep(WorkflowContext(services, show), place, country, scenario_type)


async def _all(settings: Settings) -> MapInventory:
    async with _services(settings) as services:
        return await maps_at_hand(WorkflowContext(services))


def _print_error(text: str) -> None:
    Console(stderr=True).print(escape(text), style="red", highlight=False, soft_wrap=True)
