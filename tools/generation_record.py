"""The report that is kept with a generated scenario, read back for ``describe_scenario``."""

from plannerforge.engine.workspace.artifacts import Artifact
from plannerforge.schemas.described_generation import DescribedGeneration
from plannerforge.schemas.generation import GeneratedScenario
from plannerforge.schemas.scenarios import DescribedVehicle, Detail
from plannerforge.tools.call import ToolCall
from plannerforge.tools.generation_answer import verdicts

REPORT = "generation.json"
"""What came out of the generation, kept with the scenario for when it is asked for again."""
IN_FULL: tuple[Detail, ...] = ("checks", "recipe")


def kept_report(artifact: Artifact, call: ToolCall) -> GeneratedScenario | None:
    """What was kept when a scenario was generated; None for scenarios of other origin."""
    path = call.workspace.folder("scenario", artifact.artifact_id) / REPORT
    return GeneratedScenario.model_validate_json(path.read_bytes()) if path.is_file() else None


def described_generation(report: GeneratedScenario, artifact: Artifact, detail: Detail) -> DescribedGeneration:
    """What was asked beside what came out; notes and warnings as the detail asks for."""
    full = detail in IN_FULL
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
    )


def with_classes(vehicles: tuple[DescribedVehicle, ...], report: GeneratedScenario) -> tuple[DescribedVehicle, ...]:
    """The vehicles with the class that they were generated as, where CommonRoad's type has another name."""
    classes = report.vehicle_classes
    return tuple(
        vehicle.model_copy(update={"vehicle_class": name})
        if (name := classes.get(vehicle.vehicle_id, "")) not in ("", vehicle.kind)
        else vehicle
        for vehicle in vehicles
    )
