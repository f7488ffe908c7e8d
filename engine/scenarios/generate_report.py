"""What came out of a generation, beside what was asked."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from plannerforge.engine.maps.sites import Site
from plannerforge.engine.maps.unpacking import is_net
from plannerforge.engine.network.road_network import RoadNetwork
from plannerforge.engine.scenarios.generate_density import density_facts, density_notes
from plannerforge.engine.scenarios.planning_problem import PlanningTask
from plannerforge.engine.scenarios.scenario_head import limits_without_sign
from plannerforge.engine.traffic.motions import Participant
from plannerforge.engine.traffic.vehicle_counts import Demand
from plannerforge.schemas.generation import (
    Checks,
    EgoFacts,
    GeneratedScenario,
    GenerationRequest,
    SiteFacts,
)


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
    density = density_facts(request, lane_km, everyone, step_s)
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
