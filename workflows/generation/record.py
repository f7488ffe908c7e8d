"""The stored report on a generated scenario, and its text for ``describe_scenario``."""

from collections.abc import Sequence

from ...engine.workspace import Artifact
from ...schemas.generation import Checks, GeneratedScenario, RoadFlow, TrafficConditions
from ...schemas.scenarios import DescribedGeneration, DescribedVehicle, Detail
from ..context import WorkflowContext

REPORT = "generation.json"
"""The result of the generation, stored with the scenario."""
_IN_FULL: tuple[Detail, ...] = ("checks", "recipe")
"""Details that list notes and warnings."""
_SHOWN_FLOWS = 8
"""How many counted flows an answer lists (chosen)."""


def verdicts(checks: Checks) -> tuple[list[str], list[str]]:
    """Return the passed and the failed checks in words; a check that did not run is in neither."""
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
    """Return the report of a scenario's generation; None for a scenario that was not generated."""
    path = context.workspace.folder("scenario", artifact.artifact_id) / REPORT
    return GeneratedScenario.model_validate_json(path.read_bytes()) if path.is_file() else None


def described_generation(report: GeneratedScenario, artifact: Artifact, detail: Detail) -> DescribedGeneration:
    """Return the requested and the realised values of a generated scenario; notes and warnings depend on the detail."""
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
        absences=report.absences if full else (),
    )


def _conditions(artifact: Artifact) -> tuple[str, ...]:
    """Return the conditions of the request in the notation of a call, such as ``weather=snow``."""
    kept, others = (artifact.recipe.arguments.get(name) for name in ("conditions", "others"))
    conditions = TrafficConditions.model_validate(kept or {})
    words = {
        "time": conditions.time,
        "weather": conditions.weather,
        "drivers": conditions.drivers,
        "mix": "natural" * conditions.natural_mix,
        "counts": _flows([flow for flow in conditions.flows if not flow.to]),
        "od": _flows([flow for flow in conditions.flows if flow.to]),
        "trips": "" if conditions.trips == "usual" else conditions.trips,
        "others": others,
    }
    return tuple(f"{name}={word}" for name, word in words.items() if word)


def _flows(flows: Sequence[RoadFlow]) -> str:
    """Return counted flows in the notation of a call; if there are many, the first few and the number of the rest."""
    written = [
        ":".join(filter(None, (f"{flow.road}>{flow.to}" if flow.to else flow.road, f"{flow.per_h:g}", flow.direction)))
        for flow in flows[:_SHOWN_FLOWS]
    ]
    more = [f"{len(flows) - _SHOWN_FLOWS} more"] if len(flows) > _SHOWN_FLOWS else []
    return "; ".join([*written, *more])


def with_classes(vehicles: tuple[DescribedVehicle, ...], report: GeneratedScenario) -> tuple[DescribedVehicle, ...]:
    """Return the vehicles with ``vehicle_class`` set to the generated class if that differs from CommonRoad's type."""
    classes = report.vehicle_classes
    return tuple(
        vehicle.model_copy(update={"vehicle_class": name})
        if (name := classes.get(vehicle.vehicle_id, "")) not in ("", vehicle.kind)
        else vehicle
        for vehicle in vehicles
    )
