"""A generated scenario in the words of the answer, and the report on it that is kept for ``describe_scenario``."""

from collections.abc import Iterator, Sequence

from ...engine.vehicles import PEDESTRIAN, ego_class, refused_by_planners
from ...engine.workspace import Artifact
from ...schemas.generation import (
    NATURAL_SHARES,
    SHARES_SOURCE,
    Checks,
    DensityFacts,
    GeneratedEgo,
    GeneratedScenario,
    GenerationRequest,
    RoadFlow,
    ScenarioSummary,
    TrafficConditions,
)
from ...schemas.scenarios import DescribedGeneration, DescribedVehicle, Detail
from ...schemas.text import cited_all, counted
from ..context import WorkflowContext

REPORT = "generation.json"
"""What came out of the generation, kept with the scenario for when it is asked for again."""
_IN_FULL: tuple[Detail, ...] = ("checks", "recipe")
"""Details that list notes and warnings."""
_SHOWN_STREETS, _SHOWN_FLOWS = 4, 8
"""Streets of a site, and counted flows, that an answer names (chosen)."""


def summarise(
    scenario: GeneratedScenario, request: GenerationRequest, scenario_id: str, *, reused: bool
) -> ScenarioSummary:
    """What was asked beside what came out, for one scenario."""
    site, ego = scenario.site, scenario.ego
    streets = cited_all(site.streets[:_SHOWN_STREETS], " / ") or "unnamed roads"
    passed, failed = verdicts(scenario.checks)
    return ScenarioSummary(
        scenario_id=scenario_id,
        reused=reused,
        map_id=request.map_id,
        place=request.place,
        site=f"{site.scenario_type} at {streets}" + _unlike(site.scenario_type, request.scenario_type),
        latitude=site.latitude,
        longitude=site.longitude,
        osm_id=site.osm_id,
        vehicles_asked=scenario.vehicles_asked,
        vehicles_realised=scenario.vehicles_realised,
        classes_asked=scenario.classes_asked,
        classes_realised=scenario.classes_realised,
        density=_density(scenario.density),
        recorded_s=scenario.recorded_s,
        ego=_ego_words(ego, request),
        goal=(
            f"{ego.goal_distance_m:.0f} m ahead on lanelet {ego.goal_lanelet} within "
            f"{ego.goal_time_s[0]:g} to {ego.goal_time_s[1]:g} s ({request.goal})"
        ),
        ego_speed_mps=ego.speed_mps,
        goal_lanelet=ego.goal_lanelet,
        goal_distance_m=ego.goal_distance_m,
        goal_time_s=ego.goal_time_s,
        feasible_share=scenario.checks.feasible_share,
        checks_passed=passed,
        checks_failed=failed,
        planners_refuse=refused_by_planners(ego.vehicle_class),
        others=scenario.others,
        notes=[*_shares(scenario, request), *scenario.notes],
    )


def _ego_words(ego: GeneratedEgo, request: GenerationRequest) -> str:
    """Return which vehicle of its class the ego is and its speed; if it is not a car, also its size and limits."""
    one_of = f"one of {counted(ego.cars_to_choose_from, ego.vehicle_class)} ({request.ego})"
    if ego.vehicle_class == "car":
        return f"Ego: {one_of}, at {ego.speed_mps:.1f} m/s"
    known = ego_class(ego.vehicle_class)
    return f"Ego: {known.in_words}, {one_of}, at {ego.speed_mps:.1f} m/s, limits: {known.source}"


def _shares(scenario: GeneratedScenario, request: GenerationRequest) -> Iterator[str]:
    """What the share of each class was that was asked for without a number, and whose statistics say so."""
    for demand in request.vehicles:
        name, share = demand.vehicle_class, demand.share
        if share is None or (name == PEDESTRIAN.name and not share):  # as many people as the density asks for
            continue
        if share == NATURAL_SHARES.get(name):
            yield f"{name}: its share of traffic, {100 * share:g} % of all vehicles ({SHARES_SOURCE}), one at least"
        elif share == 0:
            yield f"{name}: one at least; how many there are in traffic is not known here, {name}=30% asks for a share"
        else:
            realised = scenario.classes_realised.get(name, 0) / max(scenario.vehicles_realised, 1)
            yield f"{name}: {share:.0%} of all vehicles asked, {realised:.0%} realised"


def _unlike(realised: str, asked: str) -> str:
    """What was asked for, where it is another type of site."""
    return "" if asked in ("any", realised) else f" (for the {asked} that was asked for)"


def _density(density: DensityFacts) -> str:
    return (
        f"{density.at_start_per_lane_km:g} vehicles per lane-km at the start, "
        f"{density.at_end_per_lane_km:g} at the end ({density.at_time or density.wish}: {density.target_per_lane_km:g})"
    )


def verdicts(checks: Checks) -> tuple[list[str], list[str]]:
    """The checks that a scenario passed, and those that it failed, in words. One that was not made is in neither."""
    by_name = {
        "schema-valid": checks.schema_valid,
        "goal reachable": checks.goal_reachable,
        "no collision at the start": checks.collisions_at_start == 0,
        "no vehicles overlap": checks.overlapping_pairs == 0,
        "recorded ego free of collisions": checks.recorded_ego_collision_free,
        "no error in the road network": not checks.network_errors,
    }
    return [name for name, good in by_name.items() if good], [name for name, good in by_name.items() if good is False]


def kept_report(artifact: Artifact, context: WorkflowContext) -> GeneratedScenario | None:
    """What was kept when a scenario was generated; None for scenarios of other origin."""
    path = context.workspace.folder("scenario", artifact.artifact_id) / REPORT
    return GeneratedScenario.model_validate_json(path.read_bytes()) if path.is_file() else None


def described_generation(report: GeneratedScenario, artifact: Artifact, detail: Detail) -> DescribedGeneration:
    """What was asked beside what came out; notes and warnings as the detail asks for."""
    full = detail in _IN_FULL
    return DescribedGeneration(
        site=report.site,
        scenario_type_asked=artifact.recipe.arguments["scenario_type"],
        vehicles_asked=report.vehicles_asked,
        vehicles_realised=report.vehicles_realised,
        classes_asked=report.classes_asked,
        classes_realised=report.classes_realised,
        density=report.density,
        duration_asked_s=report.duration_s,
        recorded_s=report.recorded_s,
        feasible_share=report.checks.feasible_share,
        checks_failed=tuple(verdicts(report.checks)[1]),
        notes_total=len(report.notes),
        warnings_total=len(report.netconvert_warnings) + len(report.checks.network_warnings),
        notes=report.notes if full else (),
        network_warnings=report.checks.network_warnings if full else (),
        netconvert_warnings=report.netconvert_warnings if full else (),
        conditions=_conditions(artifact),
    )


def _conditions(artifact: Artifact) -> tuple[str, ...]:
    """The conditions of the request as they are written in a call."""
    kept, others = (artifact.recipe.arguments.get(name) for name in ("conditions", "others"))
    asked = TrafficConditions.model_validate(kept or {})
    words = {
        "time": asked.time,
        "weather": asked.weather,
        "drivers": asked.drivers,
        "mix": "natural" * asked.natural_mix,
        "counts": _flows([flow for flow in asked.flows if not flow.to]),
        "od": _flows([flow for flow in asked.flows if flow.to]),
        "trips": "" if asked.trips == "usual" else asked.trips,
        "others": others,
    }
    return tuple(f"{name}={word}" for name, word in words.items() if word)


def _flows(flows: Sequence[RoadFlow]) -> str:
    """Counted flows as they are written in a call; of many the first."""
    written = [
        ":".join(filter(None, (f"{flow.road}>{flow.to}" if flow.to else flow.road, f"{flow.per_h:g}", flow.direction)))
        for flow in flows[:_SHOWN_FLOWS]
    ]
    more = [f"{len(flows) - _SHOWN_FLOWS} more"] if len(flows) > _SHOWN_FLOWS else []
    return "; ".join([*written, *more])


def with_classes(vehicles: tuple[DescribedVehicle, ...], report: GeneratedScenario) -> tuple[DescribedVehicle, ...]:
    """The vehicles with the class that they were generated as, where CommonRoad's type has another name."""
    classes = report.vehicle_classes
    return tuple(
        vehicle.model_copy(update={"vehicle_class": name})
        if (name := classes.get(vehicle.vehicle_id, "")) not in ("", vehicle.kind)
        else vehicle
        for vehicle in vehicles
    )
