"""Making one scenario: map → site → net → lanelets → traffic → ego and goal → CommonRoad file → checks."""

import gc
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from plannerforge.engine.execution.progress import ProgressReporter
from plannerforge.engine.maps.map_file import read_map_file
from plannerforge.engine.maps.osm_reader import OsmMap
from plannerforge.engine.maps.sites import Site
from plannerforge.engine.scenarios.generate_place import build_place
from plannerforge.engine.scenarios.generate_report import describe
from plannerforge.engine.scenarios.generate_traffic import lively_traffic
from plannerforge.engine.scenarios.planning_problem import EgoWish, GoalWish, choose_task, parse_ego, parse_goal
from plannerforge.engine.scenarios.realised_site import why_not_realised
from plannerforge.engine.scenarios.scenario_head import benchmark_id, head_of
from plannerforge.engine.scenarios.scene_order import along_the_site
from plannerforge.engine.scenarios.site_choice import fitting_sites
from plannerforge.engine.scenarios.validate import check_scenario
from plannerforge.engine.scenarios.writer import write_scenario
from plannerforge.engine.traffic.demand import lane_km_of, plan_counts
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.generation import Checks, GeneratedScenario, GenerationRequest, VehicleDemand

STEP_S = 0.1
MOST_TRIES = 5
LEAST_FEASIBLE = 0.97
LEAST_ON_LANELETS = 0.985


@dataclass(frozen=True)
class _Try:
    """A scenario in a folder of its own, and what is wrong with it: nothing, or the reasons in words."""

    scenario: GeneratedScenario
    folder: Path
    faults: tuple[str, ...]
    unusable: bool


def generate(request: GenerationRequest, report: ProgressReporter) -> GeneratedScenario:
    """Make one scenario in the request's folder: ``scenario.xml`` and ``scenario.net.xml``.

    A scenario that fails its checks is made again with other traffic, then at other sites; the notes say so. The same
    request gives the same bytes on one type of machine.

    Raises:
        NotPossible: the map holds no such site, a class finds no road or no room, no car has such a goal.
        UnsafeInput: the map file is broken or hostile.
    """
    with _no_collection():
        return _generate(request, report)


@contextmanager
def _no_collection() -> Iterator[None]:
    """No garbage collection meanwhile: it would look through all states of the traffic again and again."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _generate(request: GenerationRequest, report: ProgressReporter) -> GeneratedScenario:
    ego, goal = parse_ego(request.ego), parse_goal(request.goal)
    report(0.0, "reading the map")
    osm = read_map_file(Path(request.map_path))
    report(0.02, "looking for sites")
    sites = fitting_sites(osm, request)
    if request.site_index >= len(sites):
        raise NotPossible(f"{request.place} ({request.map_id}) holds only {len(sites)} different site(s) for this")
    tried: list[_Try] = []
    refusals: list[NotPossible] = []
    with tempfile.TemporaryDirectory(dir=request.folder) as scratch:
        for number, (site, round_number) in enumerate(_candidates(sites, request)):
            if round_number and any(attempt.scenario.checks.network_errors for attempt in tried):
                continue  # other traffic does not mend the road network
            folder = Path(scratch) / str(number)
            folder.mkdir()
            try:
                tried.append(_attempt(request, osm, site, round_number, (ego, goal), folder, report))
            except NotPossible as refused:
                refusals.append(refused)
                continue
            if not tried[-1].faults:
                break
        usable = [attempt for attempt in tried if not attempt.unusable]
        if not usable:
            raise refusals[0] if refusals else _unusable(tried[0])
        best = min(usable, key=lambda attempt: len(attempt.faults))
        for name in ("scenario.xml", "scenario.net.xml"):
            shutil.move(best.folder / name, Path(request.folder) / name)
    earlier = [fault for attempt in tried if attempt is not best for fault in attempt.faults]
    earlier += [refused.message for refused in refusals]
    notes = [f"an earlier try was given up: {reason}" for reason in dict.fromkeys(earlier)]
    return best.scenario.model_copy(update={"notes": (*best.scenario.notes, *best.faults, *notes)})


def _unusable(attempt: _Try) -> NotPossible:
    return NotPossible(
        f"no scenario passes its checks here: {'; '.join(attempt.faults)}",
        next_step="choose another place, scenario_type, density or seed",
    )


def _candidates(sites: list[Site], request: GenerationRequest) -> list[tuple[Site, int]]:
    """Sites to try with the number of the round of traffic: the site's own twice, then others."""
    own = sites[request.site_index]
    others = sites[request.site_index + request.site_step :: request.site_step]
    return [(own, 0), (own, 1), *((site, 0) for site in others)][:MOST_TRIES]


def _attempt(
    request: GenerationRequest,
    osm: OsmMap,
    site: Site,
    round_number: int,
    task_wish: tuple[EgoWish, GoalWish],
    folder: Path,
    report: ProgressReporter,
) -> _Try:
    """One scenario at one site.

    Raises:
        NotPossible: the site does not hold what was asked for.
    """
    ego, goal = task_wish
    notes, vehicles = _vehicles(request, ego)
    net_path, path = folder / "scenario.net.xml", folder / "scenario.xml"
    place = build_place(osm, site, request, net_path, folder, STEP_S, report)
    if (reason := why_not_realised(site, place.net, place.network)) is not None:
        raise NotPossible(reason)
    lane_km = lane_km_of(place.net)
    demand = plan_counts(request.density, vehicles, lane_km)
    traffic = lively_traffic(request, demand, place, round_number, net_path, folder, STEP_S, report)
    everyone = along_the_site(traffic.everyone, site, place.net, place.network)
    report(0.75, "choosing ego and goal")
    task = choose_task(ego, goal, everyone, place.network, STEP_S)
    others = tuple(vehicle for vehicle in everyone if vehicle is not task.ego)
    report(0.8, "writing the file")
    write_scenario(path, head_of(request, site, place.net, STEP_S), place.network, others, task)
    report(0.85, "reading back and checking")
    checks = check_scenario(path, task.ego.body)
    if traffic.left_out:
        notes.append(
            f"{traffic.left_out} vehicle(s) left out: their motion could not be driven, or overlapped another's"
        )
    scenario = describe(
        request,
        benchmark_id=benchmark_id(request),
        demand=demand,
        site=site,
        radius_m=place.radius_m,
        lane_km=lane_km,
        network=place.network,
        task=task,
        everyone=everyone,
        checks=checks,
        step_s=STEP_S,
        notes=(*place.notes, *notes),
        warnings=place.warnings,
    )
    absent = [name for name, least in demand.least.items() if least and not scenario.classes_realised.get(name)]
    if absent:
        raise NotPossible(
            f"no {' and no '.join(absent)} found room at this site",
            next_step="choose a higher density, another place or another seed",
        )
    broken, weak = _faults(checks)
    return _Try(scenario, folder, (*broken, *weak, *_short(demand.least, scenario)), bool(broken))


def _vehicles(request: GenerationRequest, ego: EgoWish) -> tuple[list[str], tuple[VehicleDemand, ...]]:
    """Notes on the ego, and the vehicles asked for with the class that was asked for as ego."""
    if ego.other_class is None:
        return [], request.vehicles
    notes = [f"the ego is always a car; the asked {ego.other_class} drives in the traffic"]
    named = any(demand.vehicle_class == ego.other_class for demand in request.vehicles)
    return notes, request.vehicles if named else (*request.vehicles, VehicleDemand(vehicle_class=ego.other_class))


def _faults(checks: Checks) -> tuple[list[str], list[str]]:
    """What makes a scenario unusable, and what only makes it worse than it should be."""
    broken = {
        "the file breaks CommonRoad's schema": not checks.schema_valid,
        "the goal cannot be reached": not checks.goal_reachable,
        "vehicles overlap": checks.overlapping_pairs > 0 or checks.collisions_at_start > 0,
        "the ego's recorded way meets another vehicle": not checks.recorded_ego_collision_free,
        f"the road network is wrong: {'; '.join(checks.network_errors)}": bool(checks.network_errors),
    }
    weak = {
        f"{checks.feasible_share:.1%} of the tracks can be driven": checks.feasible_share < LEAST_FEASIBLE,
        f"{checks.centers_on_lanelets:.1%} of the centres lie on lanelets": (
            checks.centers_on_lanelets < LEAST_ON_LANELETS
        ),
    }
    return [text for text, wrong in broken.items() if wrong], [text for text, wrong in weak.items() if wrong]


def _short(least: dict[str, int], scenario: GeneratedScenario) -> list[str]:
    return [
        f"asked for at least {wanted} {name}, {scenario.classes_realised.get(name, 0)} found room"
        for name, wanted in least.items()
        if scenario.classes_realised.get(name, 0) < wanted
    ]
