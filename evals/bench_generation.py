"""``make bench-generation``: scenarios from real maps, judged from the made files.

All maps are converted whole; then 200 requests that the maps can meet and those that must be refused are put to the
generator in this process. Keys: ``maps``, ``maps_converted``; ``requests`` (that can be met), and of the scenarios
asked for by them the shares ``executable`` (Frenetix finishes, collisions allowed), ``road_type``, ``vehicles``,
``place``, ``inside_lanelets`` (of all positions), ``feasible`` (of a sample of tracks, by the drivability checker);
``overlaps`` (pairs), ``refused_right`` (share of the requests to be refused), ``median_low_s`` and ``median_high_s`` (a
scenario of 20 s, processor time of this process and its children, without the reading of the map).
"""

import argparse
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from rich.progress import track

from plannerforge.engine.execution.progress import silent
from plannerforge.engine.maps.facts import read_map
from plannerforge.engine.maps.index import MapEntry
from plannerforge.engine.network.lanelet_builder import build_road_network
from plannerforge.engine.network.net_parser import read_net
from plannerforge.engine.planners.registry import make_planner
from plannerforge.engine.planners.simulation import simulate
from plannerforge.engine.scenarios.generate import generate
from plannerforge.engine.scenarios.generate_place import convert_map
from plannerforge.engine.scenarios.reader import LoadedScenario, read_scenario
from plannerforge.engine.scenarios.site_choice import count_sites
from plannerforge.engine.scenarios.validate import schema_errors
from plannerforge.engine.tuning.configurations import named_configuration
from plannerforge.evals.generation_figures import Made, Stages, print_generation, tell
from plannerforge.evals.generation_judge import MadeFiles, holds_vehicles, lies_at, shows_type
from plannerforge.evals.generation_motion import measure_motion
from plannerforge.evals.generation_requests import (
    BenchRequest,
    corpus_requests,
    missing_requests,
    read_places,
    seeded_requests,
)
from plannerforge.schemas.errors import InvalidRequest, NotPossible, PlannerForgeError, UnknownName
from plannerforge.schemas.generation import GeneratedScenario, GenerationRequest, ReadMapRequest
from plannerforge.tools.generation_plan import plan_maps, request_for

Item = TypeVar("Item")
REQUESTS, REFUSALS = 200, 60
CHECKED_TRACKS = 3


def convert_whole(path: Path, folder: Path) -> str:
    """Convert a map without cutting; empty, or why it failed."""
    try:
        convert_map(path, folder / "whole.net.xml", lefthand=False)
        network = build_road_network(read_net(folder / "whole.net.xml"), step_s=0.1, elapsed_s=0.0)
    except PlannerForgeError as error:
        return error.message
    return "" if network.lanelets else "no lanelets"


def wished_vehicles(request: GenerationRequest) -> dict[str, tuple[int, int | None]]:
    """(least, most) of every class that has to be there, that of a wished ego included."""
    wished = {demand.vehicle_class: (demand.least, demand.most) for demand in request.vehicles}
    other = request.ego.removeprefix("type:")
    return wished | ({other: (1, None)} if request.ego.startswith("type:") and other not in (*wished, "car") else {})


def asked_of(request: BenchRequest, maps: Sequence[MapEntry]) -> list[GenerationRequest]:
    """What the tool asks of the engine for a request."""
    match = plan_maps(request.arguments, maps).matches[0]
    first = request_for(request.arguments, match, 0, 0)
    count = request.arguments.count if request.arguments.count == 1 else count_sites(first, silent).count
    indices = range(min(max(count, 1), request.arguments.count))
    return [request_for(request.arguments, match, index, index) for index in indices]


def drive(loaded: LoadedScenario) -> tuple[bool, str]:
    """Whether Frenetix with its default weights finishes a trajectory, and the outcome."""
    configuration = named_configuration("frenetix:Default")
    if configuration is None:
        raise RuntimeError("the built-in configuration is gone")
    planner = make_planner("frenetix")
    run = simulate(loaded.scenario, loaded.problem(), configuration, planner, "constant_velocity", silent)
    return run.final.outcome not in ("invalid", "infeasible"), run.final.outcome


def make(request: BenchRequest, wish: GenerationRequest, places: Mapping[str, Any], number: int) -> Made:
    """Make one scenario and judge it."""
    with tempfile.TemporaryDirectory() as text:
        folder, stages = Path(text), Stages()
        try:
            report = generate(wish.model_copy(update={"folder": text, "benchmark_number": number + 1}), stages)
        except PlannerForgeError as error:
            return Made(request, fault=f"{type(error).__name__}: {error.message}")
        stages(1.0)
        faults = schema_errors(folder / "scenario.xml")
        if faults:
            return Made(request, fault=f"breaks the schema: {faults[0]}")
        loaded = read_scenario(folder / "scenario.xml")
        files = MadeFiles.read(folder)
        executable, outcome = drive(loaded)
        return Made(
            request,
            executable=executable,
            outcome=outcome,
            road_type=shows_type(files, wish.scenario_type),
            vehicles=holds_vehicles(files, wished_vehicles(wish)),
            place=_place_is_right(request, wish, report, files, places),
            motion=measure_motion(loaded, CHECKED_TRACKS, number),
            stages=stages,
        )


def _place_is_right(
    request: BenchRequest,
    wish: GenerationRequest,
    report: GeneratedScenario,
    files: MadeFiles,
    places: Mapping[str, Any],
) -> bool:
    """On the map meant, or on another one of the same place; in the country; near the street."""
    path, country = Path(wish.map_path), request.arguments.country
    meant = path.name == request.map_name or request.arguments.place in places[path.name]["places"]
    there = lies_at(files, path, places[path.name]["bbox"], request.street)
    return meant and there and country in (None, report.benchmark_id[:3])


def refused_right(request: BenchRequest, maps: Sequence[MapEntry]) -> str:
    """Empty where a request is refused for the right reason, otherwise what happened."""
    try:
        wish = asked_of(request, maps)[0]
        with tempfile.TemporaryDirectory() as folder:
            generate(wish.model_copy(update={"folder": folder}), silent)
    except UnknownName as error:
        return "" if request.refusal == "unknown_place" else error.message
    except (NotPossible, InvalidRequest) as error:
        right = request.refusal == "no_such_site" and ("holds no" in error.message or "is lost when" in error.message)
        return "" if right else error.message
    return f"was made in {wish.map_id}"


def main() -> None:
    """Read the command line and measure."""
    beside = Path(__file__).resolve().parent.parent.parent / "shared"
    shared = Path(os.environ.get("PLANNERFORGE_SHARED", beside))
    parser = argparse.ArgumentParser(description="Measure the generator on real maps.")
    parser.add_argument("--shared", type=Path, default=shared, help="folder with data/osm and corpora/dev")
    parser.add_argument("--limit", type=int, default=None, help="only so many requests, refusals and maps")
    arguments = parser.parse_args()
    maps_folder = arguments.shared / "data" / "osm"
    if not maps_folder.is_dir():
        parser.error(f"there is no folder {maps_folder}: name one with --shared, or set PLANNERFORGE_SHARED")
    measure(maps_folder, arguments.shared / "corpora" / "dev" / "generation.jsonl", arguments.limit)


def measure(maps_folder: Path, corpus: Path, limit: int | None) -> None:
    """Convert, generate, judge, print."""
    places = read_places(maps_folder)
    entries, unread = _entries(maps_folder, places)
    files = sorted(path for path in maps_folder.iterdir() if path.name in places)
    names = frozenset(entry.path.name for entry in entries)
    lines = corpus.read_text(encoding="utf-8").splitlines()
    from_corpus = corpus_requests(lines, names)
    good = [request for request in from_corpus if request.refusal is None]
    good = [*good, *seeded_requests(places, names, REQUESTS - len(good))]
    bad = [request for request in from_corpus if request.refusal is not None]
    bad = [*bad, *missing_requests(places, names, REFUSALS - len(bad))]
    if limit is not None:
        good, bad, files = (_spread(found, limit) for found in (good, bad, files))
    converted = {}
    with tempfile.TemporaryDirectory() as folder:
        for path in track(files, description="maps"):
            converted[path.name] = unread.get(path.name) or convert_whole(path, Path(folder))
    made: list[Made] = []
    for request in track(good, description="requests"):
        try:
            wishes = asked_of(request, entries)
        except PlannerForgeError as error:
            made.append(Made(request, fault=f"{type(error).__name__}: {error.message}"))
            tell(len(made), made[-1])
            continue
        for wish in wishes:
            made.append(make(request, wish, places, len(made)))
            tell(len(made), made[-1])
    refusals = {request.name: refused_right(request, entries) for request in track(bad, description="refusals")}
    print_generation(converted, len(good), made, refusals)


def _spread(found: list[Item], limit: int) -> list[Item]:
    """So many of a list, evenly chosen."""
    step = max(1, len(found) // limit)
    return found[::step][:limit]


def _entries(folder: Path, places: dict[str, dict[str, object]]) -> tuple[list[MapEntry], dict[str, str]]:
    """The maps as a user adds them, with the names of their places; and why some cannot be read."""
    entries: list[MapEntry] = []
    unread: dict[str, str] = {}
    for name in sorted(places):
        known = [str(place) for place in places[name]["places"]]  # type: ignore[attr-defined]
        request = ReadMapRequest(path=str(folder / name), place=known[0], country=str(places[name]["country"]))
        try:
            facts = read_map(request, silent)
        except PlannerForgeError as error:
            unread[name] = error.message
            continue
        entries.append(MapEntry(facts.model_copy(update={"places": (*known, *facts.places)}), folder / name))
    return entries, unread


if __name__ == "__main__":
    main()
