"""``make bench-generation``: scenarios from real maps, judged by their files.

The bench converts every map as a whole. Worker processes then send 200 requests that the maps can meet, and the ones
that must be refused. Standard error has a line for each scenario as soon as it is judged.

Keys:

- ``maps``, ``maps_converted``; ``requests`` (that can be met).
- Shares of the requested scenarios: ``executable`` (Frenetix finishes, collisions allowed), ``road_type``,
  ``vehicles``, ``place``, ``density`` (vehicles per lane kilometre at the start within 25 % of the target, or a note
  with the reason).
- ``inside_lanelets`` (share of all positions), ``feasible`` (share of a sample of tracks, by the drivability checker),
  ``overlaps`` (pairs).
- ``refused_right``: share of the requests that must be refused (the table has the reasons).
- ``median_low_s``, ``median_high_s``: processor time of a 20 s scenario including netconvert, without the first reading
  of a map; ``median_low_wall_s``, ``median_high_wall_s``: wall time, which other work on the machine increases.

``--fresh SEED`` uses newly created maps (``benchmarks/symmetries/fresh_data.py``: two thirds whole, one third broken)
and requests a scenario on each map that is read, at a site type of its index (``fresh.py``). Keys:

- ``seeds``; ``fresh_maps``, ``fresh_map_crashes`` (ended other than by a named refusal), ``fresh_maps_refused``,
  ``fresh_without_site``.
- ``fresh_scenarios`` (requested) and ``fresh_executable`` (share; a refusal counts as failure); ``fresh_off_road``
  (runs that leave the road).
- For the generated scenarios: ``fresh_road_type`` (share of ``fresh_road_type_judged``, because a SUMO network has no
  tags for town or country), ``fresh_vehicles``, ``fresh_inside_lanelets``, ``fresh_feasible``, ``fresh_overlaps``.
- ``fresh_lost_sites``: sites of the index that the built network does not show.
"""

import argparse
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import TypeVar

from plannerforge.evals.ground_truth.generation import (
    BenchRequest,
    Refusal,
    corpus_refusals,
    corpus_requests,
    left_over_requests,
    missing_requests,
    seeded_requests,
)
from plannerforge.evals.scoring.map_evidence import BenchMaps, read_maps

from ..harness import existing, process_pool, shared_folder
from .cases import convert_whole, make_group, refused_right
from .figures import Made, print_generation
from .fresh import measure_fresh

Item = TypeVar("Item")
REQUESTS, MISSING = 200, 40
"""Number of feasible requests, and of those for a missing type of site."""
SEEDS_APART = 100
"""Distance between the seeds of two requests: larger than the number of scenarios of one."""


def _main() -> None:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description="Measure the generator on real or fresh maps.")
    parser.add_argument("--fresh", type=int, nargs="+", metavar="SEED", help="use new maps from these seeds")
    parser.add_argument("--count", type=int, default=100, help="with --fresh: maps of each seed (default: 100)")
    parser.add_argument("--shared", type=Path, default=shared_folder(), help="folder with data/osm and corpora/dev")
    parser.add_argument("--limit", type=int, default=None, help="only this many requests, refusals and maps")
    parser.add_argument("--offset", type=int, default=0, help="with --limit: offset of the sample")
    parser.add_argument("--workers", type=int, default=2, help="number of worker processes (default: 2)")
    arguments = parser.parse_args()
    if arguments.fresh is not None:
        measure_fresh(arguments.fresh, arguments.count, arguments.workers)
        return
    maps_folder = existing(arguments.shared / "data" / "osm")
    corpus = arguments.shared / "corpora" / "dev" / "generation.jsonl"
    with tempfile.TemporaryDirectory() as scratch:
        maps = read_maps(maps_folder, Path(scratch))
        good, bad = _requests(corpus.read_text(encoding="utf-8").splitlines(), maps)
        names = sorted({*maps.files, *maps.unread})
        if arguments.limit is not None:
            good, bad, names = (_spread(items, arguments.limit, arguments.offset) for items in (good, bad, names))
        with process_pool(arguments.workers) as pool:
            converted = _each(pool, {name: name for name in names}, partial(convert_whole, maps=maps))
            made = _make(pool, good, maps)
            by_name = {refusal.name: refusal for refusal in bad}
            refused = _each(pool, by_name, partial(refused_right, maps=maps.entries))
    print_generation(converted, len(good), made, [(refusal, refused[refusal.name]) for refusal in bad])


def _requests(lines: list[str], maps: BenchMaps) -> tuple[list[BenchRequest], list[Refusal]]:
    """Return the requests that the maps can meet, and those that must be refused."""
    good = corpus_requests(lines, maps.names)
    good += seeded_requests(maps.places, maps.names, REQUESTS - len(good))
    bad = corpus_refusals(lines) + missing_requests(maps.places, maps.names, MISSING)
    return good, bad + left_over_requests(maps.places, maps.names)


def _make(pool: ProcessPoolExecutor, requests: list[BenchRequest], maps: BenchMaps) -> list[Made]:
    """Return all scenarios in the order of the requests; one process handles a map, as a warm worker does."""
    groups: dict[str, list[tuple[BenchRequest, int]]] = {}
    for number, request in enumerate(requests):
        groups.setdefault(request.map_name, []).append((request, SEEDS_APART * number))
    largest_first = sorted(groups.values(), key=_scenario_seconds, reverse=True)
    made = {
        request.name: found
        for group, done in zip(largest_first, pool.map(partial(make_group, maps=maps), largest_first), strict=True)
        for (request, _), found in zip(group, done, strict=True)
    }
    return [one for request in requests for one in made[request.name]]


def _scenario_seconds(group: Sequence[tuple[BenchRequest, int]]) -> float:
    return sum(request.arguments.count * request.arguments.duration_s for request, _ in group)


def _each(pool: ProcessPoolExecutor, items: Mapping[str, Item], job: Callable[[Item], str]) -> dict[str, str]:
    """Return the result of a job for every item, by name."""
    return dict(zip(items, pool.map(job, items.values()), strict=True))


def _spread(items: list[Item], limit: int, offset: int) -> list[Item]:
    """Return ``limit`` evenly spaced items of a list, from ``offset`` on."""
    step = max(1, len(items) // limit)
    return items[offset % step :: step][:limit]


if __name__ == "__main__":
    _main()
