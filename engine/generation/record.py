"""Records a generated scenario: the request and the result, with notes where they differ."""

import logging
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from ...schemas.generation import (
    ABSENCE_REASONS,
    AbsenceCode,
    AbsenceFate,
    Checks,
    DensityFacts,
    GeneratedEgo,
    GeneratedScenario,
    GenerationRequest,
    RequestedEgo,
    SiteFacts,
    VehicleAbsence,
)
from ..commonroad import kept_recording
from ..traffic import FEWEST, PAPER_TRIPS, VEHICLES_PER_LANE_KM, Demand, DroppedVehicle, GeneratedVehicle, lane_km_of
from ..vehicles import PEDESTRIAN
from .people import target_pedestrians
from .planning_problem import PlanningTask
from .site_network import SiteNetwork
from .traffic import GeneratedTraffic, TrafficAim
from .writer import STEP_S

logger = logging.getLogger(__name__)
MISSED_BY = 0.25
"""Relative deviation from the target density above which a note gives the reason (chosen)."""


def record_of(
    request: GenerationRequest,
    site: SiteNetwork,
    demand: Demand,
    aim: TrafficAim,
    task: PlanningTask,
    vehicles: Sequence[GeneratedVehicle],
    people: Sequence[GeneratedVehicle],
    obstacle_ids: Mapping[str, int],
    checks: Checks,
    notes: Iterable[str],
) -> GeneratedScenario:
    """Return the record of a scenario file; class counts exclude the ego.

    Args:
        vehicles: the ego and the others.
        people: the pedestrians, which do not count as vehicles.
        obstacle_ids: the CommonRoad ids of all vehicles except the ego, by the vehicles' ids.
        notes: notes on the traffic and the ego, which precede the notes on differences from the request.
    """
    spot, metadata = site.site, site.metadata
    others = [vehicle for vehicle in vehicles if vehicle is not task.ego]
    counts = Counter(vehicle.vehicle_class.name for vehicle in others)
    density = _density(request, aim, site, vehicles)
    recorded_s = round((max(each.steps for each in (*vehicles, *people)) - 1) * STEP_S, 6)
    pedestrians, requested = len(people), request.people
    wanted = (
        {} if requested is None else {PEDESTRIAN.name: target_pedestrians(requested, request.density, demand.total)}
    )
    signs = site.network.signs if metadata.speed_sign is None else ()
    limits = {key: round(sign.speed_mps * 3.6, 1) for sign in signs for key in sign.lanelet_ids}
    return GeneratedScenario(
        benchmark_id=metadata.benchmark_id,
        site=SiteFacts(
            scenario_type=spot.kind,
            latitude=round(spot.latitude, 6),
            longitude=round(spot.longitude, 6),
            streets=spot.streets,
            radius_m=round(site.radius_m, 1),
            osm_id="" if Path(request.map_path).suffix == ".xml" else spot.osm_id,
        ),
        vehicles_asked=demand.total,
        vehicles_realised=len(vehicles),
        classes_asked=demand.least | wanted,
        classes_realised={name: counts[name] for name in demand.counts if counts[name]}
        | ({PEDESTRIAN.name: pedestrians} if pedestrians else {}),
        density=density,
        duration_s=request.duration_s,
        recorded_s=recorded_s,
        lanelets=len(site.network.lanelets) + len(site.network.walkways),
        traffic_lights=len(site.network.lights),
        ego=_ego_facts(task, vehicles),
        checks=checks,
        notes=(
            *site.notes,
            *notes,
            *density_notes(density, demand, len(vehicles)),
            *_duration_notes(request.duration_s, recorded_s),
            *_limit_notes(limits),
        ),
        netconvert_warnings=tuple(dict.fromkeys(site.warnings)),
        attribution=request.attribution,
        unsigned_limits_kmh=limits,
        vehicle_classes={obstacle_ids[other.vehicle_id]: other.vehicle_class.name for other in others},
    )


def absences_of(
    ego: RequestedEgo,
    requested: Demand,
    traffic: GeneratedTraffic,
    vehicles: Sequence[GeneratedVehicle],
    people: int = 0,
    *,
    stands_in: bool,
) -> tuple[VehicleAbsence, ...]:
    """Return the requested vehicles that are missing or changed, each with the reason.

    A removed vehicle counts as replaced if a spare of its class takes its place. Only cars beyond the requested classes
    can be missing: the traffic is drawn again until it has the classes in ``Demand.least``, or the call is refused.
    Where the reasons are decided: ``not_drivable`` and ``overlap`` in ``engine/traffic/motions.py``, ``file_too_large``
    in ``engine/generation/traffic.py``, ``no_such_goal`` and ``no_ego_class`` in the arguments below. ``no_room``
    is what remains.

    Args:
        ego: the requested ego.
        requested: the number of vehicles that the request implies at this site.
        traffic: the recorded vehicles, and the demand that is still unmet.
        vehicles: the ego and the others in the file.
        people: the number of pedestrians that the request implies.
        stands_in: whether the ego is not the car requested by number.
    """
    found = []
    if stands_in:
        found.append(_absence("replaced", "no_such_goal", "car", 1))
    if ego.other_class is not None:
        found.append(_absence("replaced", "no_ego_class", ego.other_class, 1))
    here = Counter(vehicle.vehicle_class.name for vehicle in vehicles)
    for name, wanted in requested.counts.items():
        missing = wanted - here[name]
        if (fewer := min(wanted - traffic.demand.counts[name], missing)) > 0:
            found.append(_absence("never_there", "file_too_large", name, fewer))
            missing -= fewer
        gone = [one for one in traffic.dropped if one.vehicle.vehicle_class.name == name]
        lost = min(len(gone), max(missing, 0))
        found += [*_absences("left_out", name, gone[:lost]), *_absences("replaced", name, gone[lost:])]
        if missing > lost:
            found.append(_absence("never_there", "no_room", name, missing - lost))
    if people > len(traffic.people):
        found.append(_absence("never_there", "no_room", PEDESTRIAN.name, people - len(traffic.people)))
    return tuple(found)


def _absences(fate: AbsenceFate, name: str, dropped: Sequence[DroppedVehicle]) -> list[VehicleAbsence]:
    """Return the reasons for the absence of a class's recorded vehicles, grouped by code."""
    by_code: dict[AbsenceCode, list[str]] = {}
    for one in dropped:
        by_code.setdefault(one.code, []).append(one.vehicle.vehicle_id)
    return [_absence(fate, code, name, len(ids), tuple(ids)) for code, ids in by_code.items()]


def _absence(fate: AbsenceFate, code: AbsenceCode, name: str, count: int, ids: tuple[str, ...] = ()) -> VehicleAbsence:
    logger.debug("vehicles_absent fate=%s code=%s class=%s count=%d vehicles=%s", fate, code, name, count, ids)
    reason = ABSENCE_REASONS[code]
    return VehicleAbsence(fate=fate, code=code, vehicle_class=name, count=count, vehicles=ids, reason=reason)


def with_scripted(scenario: GeneratedScenario, base: Path, path: Path, added: Mapping[int, str]) -> GeneratedScenario:
    """Return the record of a scenario after edits have added and replaced road users.

    Args:
        scenario: the record of the file before the edits.
        base: the file before the edits.
        path: the file after them.
        added: the class of each road user that they added or replaced, by its id; a replaced one keeps its id.
    """
    classes, density = scenario.vehicle_classes, scenario.density
    counts = Counter(scenario.classes_realised)
    counts.update(added.values())
    counts.subtract(classes[key] for key in added if key in classes)
    on_wheels = {key: name for key, name in added.items() if name != PEDESTRIAN.name}
    vehicles = scenario.vehicles_realised + len(on_wheels.keys() - classes.keys())
    last_step = round(scenario.duration_s / STEP_S)
    more_stay = _staying(path, last_step) - _staying(base, last_step)
    reached = {
        "at_start_per_lane_km": round(vehicles / density.lane_km, 2),
        "at_end_per_lane_km": round(density.at_end_per_lane_km + more_stay / density.lane_km, 2),
    }
    replaced = Counter(classes[key] for key in added if key in classes)
    ids = {name: tuple(str(key) for key in added if classes.get(key) == name) for name in replaced}
    absences = [_absence("replaced", "scripted", name, count, ids[name]) for name, count in replaced.items()]
    return scenario.model_copy(
        update={
            "absences": (*scenario.absences, *absences),
            "vehicles_realised": vehicles,
            "classes_realised": {name: count for name, count in counts.items() if count},
            "vehicle_classes": classes | on_wheels,
            "density": density.model_copy(update=reached),
        }
    )


def _staying(path: Path, last_step: int) -> int:
    """Return how many vehicles in a file are present until the last step."""
    tracks = kept_recording(path).tracks.values()
    return sum(track.kind != PEDESTRIAN.commonroad_type and track.last_step >= last_step - 1 for track in tracks)


def _density(
    request: GenerationRequest, aim: TrafficAim, site: SiteNetwork, vehicles: Sequence[GeneratedVehicle]
) -> DensityFacts:
    """Return the vehicles per kilometre of car lanes at step 0 and at the last step, with the target."""
    lane_km, last_step = lane_km_of(site.net), round(request.duration_s / STEP_S)
    staying = sum(vehicle.steps > last_step - 1 for vehicle in vehicles)
    return DensityFacts(
        wish=request.density,
        paper_trips=PAPER_TRIPS[request.density],
        lane_km=round(lane_km, 3),
        target_per_lane_km=round(aim.per_lane_km or VEHICLES_PER_LANE_KM[request.density], 2),
        at_start_per_lane_km=round(len(vehicles) / lane_km, 2),
        at_end_per_lane_km=round(staying / lane_km, 2),
        at_time=aim.density_source,
    )


def density_notes(density: DensityFacts, demand: Demand, realised: int) -> list[str]:
    """Return notes on the vehicles that found no room and on the reason if the density misses its target."""
    notes = []
    if realised < demand.total:
        notes.append(f"{realised} of {demand.total} requested vehicles are in the file")
    target, reached = density.target_per_lane_km, density.at_start_per_lane_km
    if abs(reached - target) > MISSED_BY * target:
        side = "higher" if reached > target else "lower"
        notes.append(
            f"{side} than the requested {density.requested}: {reached:g} vehicles per lane-km at the start instead of "
            f"{target:g}, because {_miss_reason(density, demand, too_many=reached > target)}"
        )
    return notes


def _miss_reason(density: DensityFacts, demand: Demand, *, too_many: bool) -> str:
    if too_many:
        small = f"the site has only {density.lane_km:g} lane-km, and every site gets at least {FEWEST} vehicles"
        return small if demand.total <= FEWEST else "the request asks for that many vehicles"
    if demand.total >= (1 - MISSED_BY) * density.target_per_lane_km * density.lane_km:
        return "no further vehicle found room"
    return demand.bounded_by or "the number of cars was limited"


def _duration_notes(duration_s: float, recorded_s: float) -> list[str]:
    """Return a note if all vehicles leave before the duration ends."""
    if recorded_s > duration_s - 2 * STEP_S:
        return []
    left = "the last vehicle leaves the site then, and CommonRoad's schema does not allow later arrivals"
    return [f"{recorded_s:g} s of the requested {duration_s:g} s are recorded: {left}"]


def _limit_notes(limits_kmh: Mapping[int, float]) -> list[str]:
    if not limits_kmh:
        return []
    values = ", ".join(f"{value:g}" for value in sorted(set(limits_kmh.values())))
    return [f"the file has no speed-limit signs, because CommonRoad lacks this country's; posted limits: {values} km/h"]


def _ego_facts(task: PlanningTask, vehicles: Sequence[GeneratedVehicle]) -> GeneratedEgo:
    first, last = task.time_steps
    return GeneratedEgo(
        vehicle=task.ego.vehicle_id,
        vehicle_class=task.ego.vehicle_class.name,
        cars_to_choose_from=sum(vehicle.vehicle_class is task.ego.vehicle_class for vehicle in vehicles),
        speed_mps=float(task.ego.motion.speeds_mps[0]),
        goal_step=task.goal_step,
        goal_distance_m=round(task.goal_distance_m, 2),
        goal_lanelet=task.lanelet_id,
        goal_time_s=(round(first * STEP_S, 3), round(last * STEP_S, 3)),
        goal_size_m=task.size_m,
    )
