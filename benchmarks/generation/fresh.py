"""Scenarios from newly created maps, for ``--fresh SEED``.

Two thirds of the maps are whole (``fresh_maps``), one third is broken (``mutated_maps``). Each takes the path of a
user's file: it is read and searched for sites, and its roads are converted as a whole. If it can be read, a scenario is
generated at a site type of its index, with type, traffic and ego drawn by the seed. A map must be read or refused by
name; any other exception is a crash.
"""

import random
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from plannerforge.engine.execution import silent
from plannerforge.engine.generation.site_network import convert_map
from plannerforge.engine.maps import LINKS, ROADS, MapEntry, cut_map, is_net, read_map, read_map_file
from plannerforge.engine.network import build_road_network, read_net
from plannerforge.engine.vehicles import vehicle_classes
from plannerforge.evals.ground_truth.generation import DENSITIES, BenchRequest, barred
from plannerforge.evals.scoring.map_evidence import BenchMaps
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.generation import GenerateScenariosArguments, MapFacts, ReadMapRequest, SiteType

from ..harness import print_figures, process_pool, share
from ..symmetries.fresh_data import fresh_maps, mutated_maps
from .cases import Session, make_all
from .figures import DEFECT, Made, motion_figures

WHOLE_M = 5_000.0
"""Radius around the middle road, which contains a fresh map; a mutated one may span the world (chosen)."""
_EGOS = ("first", "first", "type:car", "index:0", "index:1")
"""Drawn egos (chosen): every site has two cars."""
_MOST_OF_A_CLASS = 2
"""Largest number of vehicles of a drawn class (chosen): a box of 500 m has room for them."""
_LOST = re.compile(r"(\d+) sites? lost when the road network is built")
"""Matches the number of skipped sites in a note or refusal, which the built network does not show."""


@dataclass(frozen=True)
class FreshMap:
    """The result for a map: ``crash`` if it failed, ``refusal`` if it was refused by name, otherwise it was read.

    ``conversion``: why its roads cannot be converted as a whole; ``made``: the scenario of one of its sites, or None if
    the index names no site.
    """

    name: str
    crash: str = ""
    refusal: str = ""
    conversion: str = ""
    made: tuple[Made, ...] = ()

    @property
    def was_read(self) -> bool:
        """Neither refused nor broken off."""
        return not self.refusal and not self.crash

    @property
    def lost_sites(self) -> int:
        """Sites that the index names and that the scenario could not come from, because the network lost them."""
        texts = [text for one in self.made for text in (one.fault, *one.notes)]
        return sum(int(count) for text in texts for count in _LOST.findall(text))


def measure_fresh(seeds: Sequence[int], count: int, workers: int) -> None:
    """Make ``count`` maps of each seed, try each in worker processes, and print the figures of all."""
    found: list[FreshMap] = []
    for seed in seeds:
        with tempfile.TemporaryDirectory() as text:
            folder, mutated = Path(text), count // 3
            paths = [*fresh_maps(seed, folder, count - mutated), *mutated_maps(seed, folder, mutated)]
            found += _tried(paths, partial(try_map, seed=seed), workers)
    print_fresh(seeds, found)


def _tried(paths: Sequence[Path], attempt: Callable[[Path], FreshMap], workers: int) -> list[FreshMap]:
    """Return the result for every map; a map that kills a worker process running it alone is a crash."""
    found: dict[Path, FreshMap] = {}
    with process_pool(workers) as pool:
        waiting = {path: pool.submit(attempt, path) for path in paths}
        for path, future in waiting.items():
            try:
                found[path] = future.result()
            except BrokenProcessPool:
                continue
    for path in (path for path in paths if path not in found):
        with process_pool(1) as pool:
            try:
                found[path] = pool.submit(attempt, path).result()
            except BrokenProcessPool:
                found[path] = FreshMap(path.name, crash="the worker process died")
    return [found[path] for path in paths]


def try_map(path: Path, seed: int) -> FreshMap:
    """Read a map, convert it, and make and judge a scenario from one of its sites."""
    try:
        facts = read_map(ReadMapRequest(path=str(path)), silent)
    except PlannerForgeError as error:
        return _report_map(FreshMap(path.name, refusal=error.message))
    except Exception as error:  # noqa: BLE001 - a crash is what is looked for
        return _report_map(FreshMap(path.name, crash=repr(error)))
    try:
        conversion = _why_not_converted(path)
    except Exception as error:  # noqa: BLE001
        return _report_map(FreshMap(path.name, crash=repr(error)))
    made = _made(path, facts, seed) if facts.sites else []
    crash = next((one.fault for one in made if one.fault.startswith(DEFECT)), "")
    return _report_map(FreshMap(path.name, crash=crash, conversion=conversion, made=tuple(made)))


def _report_map(found: FreshMap) -> FreshMap:
    """Return a line on a map without a scenario, next to the lines on scenarios."""
    said = [("crash", found.crash), ("refused", found.refusal), ("not converted", found.conversion)]
    said += [("read", "no site")] if found.was_read and not found.made else []
    sys.stderr.writelines(f"{found.name} {what}: {why}\n" for what, why in said if why)
    sys.stderr.flush()
    return found


def _why_not_converted(path: Path) -> str:
    """Return an empty text if all roads of a map become lanelets, otherwise the refusal."""
    with tempfile.TemporaryDirectory() as folder:
        cut, net_path = Path(folder) / "whole.osm", path
        try:
            if not is_net(path):
                osm = read_map_file(path)
                roads, net_path = osm.roads(), Path(folder) / "whole.net.xml"
                line = roads[len(roads) // 2].node_ids
                cut_map(osm, osm.nodes[line[len(line) // 2]].position, WHOLE_M, ROADS + LINKS, cut)
                convert_map(cut, net_path, lefthand=False)
            network = build_road_network(read_net(net_path), step_s=0.1, elapsed_s=0.0)
        except PlannerForgeError as error:
            return error.message
    return "" if network.lanelets else "no lanelets"


def _made(path: Path, facts: MapFacts, seed: int) -> list[Made]:
    shown = {"places": [], "bbox": (facts.south, facts.west, facts.north, facts.east)}
    maps = BenchMaps((MapEntry(facts, path),), {facts.file_name: path}, {}, {facts.file_name: shown})
    request = drawn_request(facts, random.Random(f"{seed} {path.name}"))  # noqa: S311 - reproducible, not secret
    return make_all(request, Session(maps), seed)


def drawn_request(facts: MapFacts, choice: random.Random) -> BenchRequest:
    """Return a request for a site type that the index names; type, density, classes and ego are drawn."""
    kind: SiteType = choice.choice(sorted(facts.sites))
    others = sorted({*vehicle_classes()} - barred(kind) - {"car"})
    given = {
        "scenario_type": kind,
        "density": choice.choice(DENSITIES),
        "vehicles": [
            f"{name}={choice.randint(1, _MOST_OF_A_CLASS)}" for name in choice.sample(others, choice.choice((0, 1, 2)))
        ],
        "ego": choice.choice(_EGOS),
        "seed": choice.randrange(1_000),
    }
    return BenchRequest(facts.map_id, GenerateScenariosArguments.model_validate(given), facts.file_name)


def print_fresh(seeds: Sequence[int], found: Sequence[FreshMap]) -> None:
    """Print the table and the figures."""
    made = [one for each in found for one in each.made]
    whole = [one for one in made if not one.fault]
    typed = [one for one in whole if one.road_type is not None]
    outcomes = Counter(one.outcome for one in whole)
    figures: dict[str, float | int | str] = {
        "seeds": " ".join(map(str, seeds)),
        "fresh_maps": len(found),
        "fresh_map_crashes": sum(bool(each.crash) for each in found),
        "fresh_maps_refused": sum(bool(each.refusal) for each in found),
        "fresh_without_site": sum(each.was_read and not each.made for each in found),
        "fresh_scenarios": len(made),
        "fresh_executable": share(one.executable for one in made),
        "fresh_off_road": outcomes["off_road"],
        "fresh_road_type": share(one.road_type for one in typed),
        "fresh_road_type_judged": len(typed),
        "fresh_vehicles": share(one.vehicles for one in whole),
        **{f"fresh_{key}": figure for key, figure in motion_figures(one.motion for one in whole).items()},
        "fresh_lost_sites": sum(each.lost_sites for each in found),
    }
    print_figures("Generation from fresh maps", figures, more_rows=_more_rows(found, outcomes))


def _more_rows(found: Sequence[FreshMap], outcomes: Counter[str]) -> Iterator[tuple[str, str]]:
    """Return rows on conversions, outcomes and requested types, and each crash and missing scenario with its reason."""
    read = [each for each in found if each.was_read]
    yield "maps converted as a whole", f"{sum(not each.conversion for each in read)} of {len(read)}"
    for outcome, count in outcomes.most_common():
        yield f"outcome {outcome}", str(count)
    kinds = Counter(one.request.arguments.scenario_type for each in found for one in each.made)
    for kind, count in kinds.most_common():
        yield f"asked for: {kind}", str(count)
    for each in found:
        faults = [("crash", each.crash)] + [("no scenario", one.fault) for one in each.made if one.fault]
        yield from ((f"{what}: {each.name}", why) for what, why in faults if why)
