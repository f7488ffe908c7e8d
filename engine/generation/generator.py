"""Making one scenario: map → site → net → lanelets → traffic → ego and goal → CommonRoad file → checks."""

import gc
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ...schemas.errors import InvalidRequest, NotPossible
from ...schemas.generation import (
    Checks,
    DensityFacts,
    EgoFacts,
    GeneratedScenario,
    GenerationRequest,
    SiteFacts,
    VehicleDemand,
)
from ..execution import ProgressReporter
from ..maps import OsmMap, Site, SiteFinder, is_net, read_map_file
from ..network import RoadNetwork
from ..traffic import FEWEST, PAPER_TRIPS, VEHICLES_PER_LANE_KM, Demand, Participant, lane_km_of, plan_counts
from .checks import check_scenario
from .metadata import benchmark_id, limits_without_sign
from .planning_problem import EgoWish, GoalWish, PlanningTask, choose_task, parse_ego, parse_goal
from .site_network import ANOTHER_TYPE, Ground, prepare_ground
from .sites import SiteHeart, fitting_sites, held_types
from .traffic import along_the_site, lively_traffic, without_spares
from .writer import write_scenario

# ---------- generate_density
# The density of generated traffic beside the one that was asked for, and why it is another where it is.

MISSED_BY = 0.25
"""Share of the target by which the density may differ before a note tells why."""


def _density_facts(
    request: GenerationRequest, lane_km: float, everyone: Sequence[Participant], step_s: float
) -> DensityFacts:
    """Vehicles per kilometre of lane at step 0 and at the last step, beside the target."""
    last = round(request.duration_s / step_s)
    staying = sum(vehicle.steps > last - 1 for vehicle in everyone)
    return DensityFacts(
        wish=request.density,
        paper_trips=PAPER_TRIPS[request.density],
        lane_km=round(lane_km, 3),
        target_per_lane_km=VEHICLES_PER_LANE_KM[request.density],
        at_start_per_lane_km=round(len(everyone) / lane_km, 2),
        at_end_per_lane_km=round(staying / lane_km, 2),
    )


def density_notes(density: DensityFacts, demand: Demand, realised: int) -> list[str]:
    """What found no room, and why the density misses its target, where it does."""
    notes = []
    if realised < demand.total:
        notes.append(f"{realised} of {demand.total} vehicles found room on the roads of the site")
    target, found = density.target_per_lane_km, density.at_start_per_lane_km
    if abs(found - target) > MISSED_BY * target:
        notes.append(
            f"{density.wish} density missed: {found:g} vehicles per lane-km at the start instead of {target:g}, "
            f"because {_reason(density, demand, too_many=found > target)}"
        )
    return notes


def _reason(density: DensityFacts, demand: Demand, *, too_many: bool) -> str:
    if too_many:
        small = f"the site has only {density.lane_km:g} lane-km, and no fewer than {FEWEST} vehicles are put on one"
        return small if demand.total <= FEWEST else "so many vehicles were asked for by number"
    if demand.total >= (1 - MISSED_BY) * density.target_per_lane_km * density.lane_km:
        return "no more found room"
    return demand.bounded_by or "the number of cars was bounded"


# ---------- generate_report
# What came out of a generation, beside what was asked.


def describe(
    request: GenerationRequest,
    *,
    benchmark_id: str,
    demand: Demand,
    site: Site,
    radius_m: float,
    lane_km: float,
    network: RoadNetwork,
    task: PlanningTask,
    everyone: tuple[Participant, ...],
    obstacle_ids: Mapping[str, int],
    checks: Checks,
    step_s: float,
    notes: tuple[str, ...],
    warnings: tuple[str, ...],
) -> GeneratedScenario:
    """The record of a generated scenario; classes are counted without the ego.

    ``obstacle_ids``: CommonRoad's id by the vehicle's id, the ego left out.
    """
    counts = Counter(vehicle.vehicle_class.name for vehicle in everyone if vehicle is not task.ego)
    realised = {name: counts[name] for name in demand.counts if counts[name]}
    recorded_s = round((max(vehicle.steps for vehicle in everyone) - 1) * step_s, 6)
    density = _density_facts(request, lane_km, everyone, step_s)
    told = (*notes, *density_notes(density, demand, len(everyone)), *_cut_short(request, recorded_s, step_s))
    limits = limits_without_sign(request.country, network)
    return GeneratedScenario(
        benchmark_id=benchmark_id,
        site=SiteFacts(
            scenario_type=site.kind,
            latitude=round(site.latitude, 6),
            longitude=round(site.longitude, 6),
            streets=site.streets,
            radius_m=round(radius_m, 1),
            osm_id="" if is_net(Path(request.map_path)) else site.osm_id,
        ),
        vehicles_asked=demand.total,
        vehicles_realised=len(everyone),
        classes_asked=demand.least,
        classes_realised=realised,
        density=density,
        duration_s=request.duration_s,
        recorded_s=recorded_s,
        lanelets=len(network.lanelets),
        traffic_lights=len(network.lights),
        ego=_ego(task, everyone, step_s),
        checks=checks,
        notes=(*told, *_limits_told(limits)),
        netconvert_warnings=tuple(dict.fromkeys(warnings)),
        attribution=request.attribution,
        unsigned_limits_kmh=limits,
        vehicle_classes={
            obstacle_ids[vehicle.vehicle_id]: vehicle.vehicle_class.name
            for vehicle in everyone
            if vehicle is not task.ego
        },
    )


def _limits_told(limits_kmh: dict[int, float]) -> list[str]:
    if not limits_kmh:
        return []
    values = ", ".join(f"{value:g}" for value in sorted(set(limits_kmh.values())))
    return [f"the file holds no speed-limit signs: CommonRoad has none for this country; posted are {values} km/h"]


def _ego(task: PlanningTask, everyone: tuple[Participant, ...], step_s: float) -> EgoFacts:
    first, last = task.time_steps
    return EgoFacts(
        vehicle=task.ego.vehicle_id,
        cars_to_choose_from=sum(vehicle.vehicle_class.name == "car" for vehicle in everyone),
        speed_mps=float(task.ego.motion.speeds_mps[0]),
        goal_step=task.goal_step,
        goal_distance_m=round(task.goal_distance_m, 2),
        goal_lanelet=task.lanelet_id,
        goal_time_s=(round(first * step_s, 3), round(last * step_s, 3)),
        goal_size_m=task.size_m,
    )


def _cut_short(request: GenerationRequest, recorded_s: float, step_s: float) -> list[str]:
    """A note where all vehicles have left before the time is up."""
    if recorded_s > request.duration_s - 2 * step_s:
        return []
    left = "the last vehicle has left the site by then, and CommonRoad's schema lets none come later"
    return [f"{recorded_s:g} s of the asked {request.duration_s:g} s are recorded: {left}"]


# ---------- generate
# Making one scenario: map → site → net → lanelets → traffic → ego and goal → CommonRoad file → checks.

STEP_S = 0.1
OWN_ROUNDS, MOST_TRIES, MOST_SITES = 2, 5, 10
"""Rounds of traffic at the site's own place, rounds of traffic in all, sites looked at in all."""
LEAST_FEASIBLE = 0.97
LEAST_ON_LANELETS = 0.985


@dataclass(frozen=True)
class _Try:
    """A scenario in a file of its own, and what is wrong with it: nothing, or the reasons in words."""

    scenario: GeneratedScenario
    path: Path
    net_path: Path
    faults: tuple[str, ...]
    unusable: bool


def generate_scenario(request: GenerationRequest, report: ProgressReporter) -> GeneratedScenario:
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
    ego_notes, vehicles = _vehicles(request, ego)
    request = request.model_copy(update={"vehicles": vehicles})
    report(0.0, "reading the map")
    osm = read_map_file(Path(request.map_path))
    report(0.02, "looking for sites")
    sites = fitting_sites(osm, request)
    if request.site_index >= len(sites):
        raise NotPossible(f"{request.place} ({request.map_id}) holds only {len(sites)} different site(s) for this")
    with tempfile.TemporaryDirectory(dir=request.folder) as scratch:
        tried, refusals = _try_sites(request, osm, sites, (ego, goal), Path(scratch), report)
        usable = [attempt for attempt in tried if not attempt.unusable]
        if not usable:
            raise _refusal(refusals[0], osm, request) if refusals else _unusable(tried[0])
        best = min(usable, key=lambda attempt: len(attempt.faults))
        shutil.move(best.path, Path(request.folder) / "scenario.xml")
        shutil.move(best.net_path, Path(request.folder) / "scenario.net.xml")
    earlier = [fault for attempt in tried if attempt is not best for fault in attempt.faults]
    earlier += [refused.message for refused in refusals]
    notes = [f"an earlier try was given up: {reason}" for reason in dict.fromkeys(earlier)]
    told = (*ego_notes, *best.scenario.notes, *best.faults, *notes)
    return best.scenario.model_copy(update={"notes": told})


def _try_sites(
    request: GenerationRequest,
    osm: OsmMap,
    sites: list[Site],
    task_wish: tuple[EgoWish, GoalWish],
    scratch: Path,
    report: ProgressReporter,
) -> tuple[list[_Try], list[NotPossible]]:
    """Attempts until one has no fault, and the refusals on the way: the site's own twice, then other sites.

    Where there is no other site, all attempts are made at its own.
    """
    tried: list[_Try] = []
    refusals: list[NotPossible] = []
    rounds = 0
    own_and_others = sites[request.site_index :: request.site_step][:MOST_SITES]
    own_rounds = OWN_ROUNDS if len(own_and_others) > 1 else MOST_TRIES
    for number, site in enumerate(own_and_others):
        folder = scratch / str(number)
        folder.mkdir()
        try:
            ground = prepare_ground(request, osm, site, folder, STEP_S, report)
        except NotPossible as refused:
            refusals.append(refused)
            continue
        for round_number in range(1 if number else own_rounds):
            rounds += 1
            try:
                tried.append(_attempt(request, ground, round_number, task_wish, folder, report))
            except NotPossible as refused:
                refusals.append(refused)
            else:
                if not tried[-1].faults:
                    return tried, refusals
            if rounds == MOST_TRIES:
                return tried, refusals
        if task_wish[1].lanelet is not None:  # an id means another lanelet elsewhere
            break
    return tried, refusals


def _refusal(first: NotPossible, osm: OsmMap, request: GenerationRequest) -> NotPossible:
    """The first reason; where the site was lost on its way to the net, with the other types that the map holds."""
    if first.next_step != ANOTHER_TYPE:
        return first
    held = [
        kind for kind in held_types(SiteFinder(osm, request.road_classes), request) if kind != request.scenario_type
    ]
    return NotPossible(first.message, valid=held, next_step=first.next_step)


def _unusable(attempt: _Try) -> NotPossible:
    return NotPossible(
        f"no scenario passes its checks here: {'; '.join(attempt.faults)}",
        next_step="choose another place, scenario_type, density or seed",
    )


def _attempt(
    request: GenerationRequest,
    ground: Ground,
    round_number: int,
    task_wish: tuple[EgoWish, GoalWish],
    folder: Path,
    report: ProgressReporter,
) -> _Try:
    """One scenario at one site.

    Raises:
        NotPossible: the site does not hold what was asked for.
    """
    (ego, goal), place = task_wish, ground.place
    notes: list[str] = []
    path = folder / f"scenario_{round_number}.xml"
    lane_km = lane_km_of(place.net)
    demand = plan_counts(request.density, request.vehicles, lane_km)
    traffic = lively_traffic(request, demand, place, round_number, ground.net_path, folder, STEP_S, report)
    demand = traffic.demand
    ranked = along_the_site(traffic.everyone, place.site, place.net, place.network)
    report(0.75, "choosing ego and goal")
    to_choose_from = ranked if ego.index is None else without_spares(ranked, demand)
    heart = SiteHeart(place.site, place.net, place.network)
    task = choose_task(ego, goal, to_choose_from, place.network, heart, STEP_S)
    everyone = without_spares((task.ego, *(vehicle for vehicle in ranked if vehicle is not task.ego)), demand)
    others = everyone[1:]
    if not others and demand.total > 1:
        raise NotPossible(
            "no vehicle but the ego found room on the roads of this site",
            next_step="choose a higher density, another place or other road_classes",
        )
    report(0.8, "writing the file")
    obstacle_ids = write_scenario(path, ground.head, place.network, others, task)
    report(0.85, "reading back and checking")
    checks = check_scenario(path, task.ego.body, ground.findings)
    if not task.heart_passed:
        notes.append(heart.missed(only_car=ego.index is not None))
    if traffic.left_out:
        notes.append(
            f"{traffic.left_out} vehicle(s) left out: their motion could not be driven, or overlapped another's"
        )
    scenario = describe(
        request,
        benchmark_id=benchmark_id(request),
        demand=demand,
        site=place.site,
        radius_m=place.radius_m,
        lane_km=lane_km,
        network=place.network,
        task=task,
        everyone=everyone,
        obstacle_ids=obstacle_ids,
        checks=checks,
        step_s=STEP_S,
        notes=(*place.notes, *notes),
        warnings=place.warnings,
    )
    broken, weak = _faults(checks)
    return _Try(scenario, path, ground.net_path, (*broken, *weak), bool(broken))


def _vehicles(request: GenerationRequest, ego: EgoWish) -> tuple[list[str], tuple[VehicleDemand, ...]]:
    """Notes on the ego, and the vehicles asked for with the class that was asked for as ego.

    Raises:
        InvalidRequest: that class is kept out of the traffic.
    """
    other = ego.other_class
    if other is None:
        return [], request.vehicles
    notes = [f"the ego is always a car; the asked {other} drives in the traffic"]
    asked = next((demand for demand in request.vehicles if demand.vehicle_class == other), None)
    if asked is None:
        return notes, (*request.vehicles, VehicleDemand(vehicle_class=other))
    if asked.most == 0:
        raise InvalidRequest(
            f"ego type:{other} puts a {other} into the traffic, because the ego is always a car; vehicles ask for none",
            next_step=f"leave {other}=0 out of vehicles, or choose the ego with first or index:N",
        )
    one = asked.model_copy(update={"least": 1})
    return notes, tuple(one if demand is asked and asked.least == 0 else demand for demand in request.vehicles)


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
