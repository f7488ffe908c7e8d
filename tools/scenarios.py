"""The tool that describes one scenario."""

from plannerforge.engine.catalog.starter import open_catalogue
from plannerforge.schemas.scenarios import (
    DescribeRequest,
    DescribeScenarioArguments,
    DescribeScenarioResult,
    Description,
    ScenarioRecord,
)
from plannerforge.tools.call import ToolCall
from plannerforge.tools.generation_record import described_generation, kept_report, with_classes
from plannerforge.tools.scenario_choice import one_scenario


async def describe_scenario(arguments: DescribeScenarioArguments, call: ToolCall) -> DescribeScenarioResult:
    """A scenario in words and ids."""
    open_catalogue(call.workspace, with_starter=call.services.with_starter)
    artifact, problem_id = one_scenario(arguments.scenario_id, call)
    record = artifact.read(ScenarioRecord)
    description = await call.run(
        "plannerforge.engine.scenarios.describe:describe",
        DescribeRequest(
            path=call.workspace.file("scenario", artifact.artifact_id, "scenario.xml"),
            problem_id=problem_id,
            detail=arguments.detail,
            focus=arguments.focus,
            radius_m=arguments.radius_m,
        ),
        Description,
    )
    facts = record.facts if problem_id is None else record.facts.seen_by(problem_id)
    limits = [f"limit {limit:g} km/h" for limit in facts.roads.limits_ego_kmh]
    light = ["traffic_light"] if facts.roads.traffic_light_ego else []
    report = kept_report(artifact, call)
    if report is not None:
        vehicles = with_classes(description.vehicles, report)
        description = description.model_copy(update={"vehicles": vehicles})
    return DescribeScenarioResult(
        scenario_id=facts.scenario_id,
        origin=record.origin,
        place=f"{facts.location.place}, {facts.location.country}",
        tags=facts.tags,
        features=facts.features,
        step_s=facts.step_s,
        duration_s=round(facts.horizon_steps * facts.step_s, 3),
        counts=facts.participants.counts,
        signs=(*(sign for sign in facts.roads.signs_ego if sign != "speed_limit"), *limits, *light),
        description=description,
        generation=described_generation(report, artifact, arguments.detail) if report is not None else None,
        recipe=artifact.recipe.model_dump(mode="json") if arguments.detail == "recipe" else None,
    )
