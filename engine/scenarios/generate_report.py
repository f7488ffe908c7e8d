"""What came out of a generation, beside what was asked."""

from collections import Counter

from plannerforge.engine.maps.sites import Site
from plannerforge.engine.network.road_network import RoadNetwork
from plannerforge.engine.scenarios.planning_problem import PlanningTask
from plannerforge.engine.traffic.demand import Demand
from plannerforge.engine.traffic.motions import Participant
from plannerforge.schemas.generation import Checks, EgoFacts, GeneratedScenario, GenerationRequest, SiteFacts

SHOWN_WARNINGS = 12


def describe(
    request: GenerationRequest,
    *,
    benchmark_id: str,
    demand: Demand,
    site: Site,
    radius_m: float,
    network: RoadNetwork,
    task: PlanningTask,
    everyone: tuple[Participant, ...],
    checks: Checks,
    step_s: float,
    notes: tuple[str, ...],
    warnings: tuple[str, ...],
) -> GeneratedScenario:
    """The record of a generated scenario; classes are counted without the ego."""
    counts = Counter(vehicle.vehicle_class.name for vehicle in everyone if vehicle is not task.ego)
    realised = {name: counts[name] for name in demand.counts if counts[name]}
    recorded_s = (max(vehicle.steps for vehicle in everyone) - 1) * step_s
    return GeneratedScenario(
        benchmark_id=benchmark_id,
        site=SiteFacts(
            scenario_type=site.kind,
            latitude=round(site.latitude, 6),
            longitude=round(site.longitude, 6),
            streets=site.streets,
            radius_m=round(radius_m, 1),
        ),
        vehicles_asked=demand.total,
        vehicles_realised=len(everyone),
        classes_asked=demand.least,
        classes_realised=realised,
        duration_s=request.duration_s,
        recorded_s=round(recorded_s, 6),
        lanelets=len(network.lanelets),
        traffic_lights=len(network.lights),
        ego=_ego(task, everyone, step_s),
        checks=checks,
        notes=(*notes, *_shortfalls(demand, realised, len(everyone)), *_collision(task, step_s)),
        netconvert_warnings=_capped(warnings),
        attribution=request.attribution,
    )


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


def _shortfalls(demand: Demand, realised: dict[str, int], total: int) -> list[str]:
    found = [
        f"asked for at least {least} {name}, {realised.get(name, 0)} found room"
        for name, least in demand.least.items()
        if realised.get(name, 0) < least
    ]
    if total < demand.total:
        found.append(
            f"{total} of {demand.total} vehicles found room on the {'' if total else 'full '}roads of the site"
        )
    return found


def _collision(task: PlanningTask, step_s: float) -> list[str]:
    if task.collision is None:
        return []
    step, _ = task.collision
    return [f"the ego's recorded way touches another vehicle at {step * step_s:.1f} s; a planner has to do better"]


def _capped(warnings: tuple[str, ...]) -> tuple[str, ...]:
    """The different warnings, at most a dozen, and how many more there were."""
    different = tuple(dict.fromkeys(warnings))
    more = len(different) - SHOWN_WARNINGS
    return different if more <= 0 else (*different[:SHOWN_WARNINGS], f"{more} more warnings")
