"""Draws and computes what a report on stored artifacts shows, and has it written."""

from collections.abc import Sequence
from pathlib import Path

from plannerforge.engine.rendering.report_sections import (
    analysis_section,
    batch_section,
    comparison_section,
    report_image,
    scenario_section,
)
from plannerforge.engine.workspace.artifacts import Artifact
from plannerforge.schemas.comparison import CompareResultsArguments
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.rendering import (
    ReportImage,
    ReportRequest,
    ReportSection,
    ReportWritten,
)
from plannerforge.schemas.results import AnalyzeResultsArguments, RunSource
from plannerforge.schemas.runs import BatchRecord
from plannerforge.schemas.scenarios import ScenarioRecord
from plannerforge.tools.call import ToolCall
from plannerforge.tools.drawings import draw
from plannerforge.tools.result_choice import run_sources
from plannerforge.tools.results import analyze_results, compare_results

FAILURES = ("collision", "off_road", "infeasible", "timeout", "goal_missed", "goal_late", "goal_early")


async def write_report(call: ToolCall, artifacts: Sequence[Artifact], path: Path) -> ReportWritten:
    """One page on scenarios and batches, in their order.

    Raises:
        InvalidRequest: an artifact that a report cannot show.
    """
    sections: list[ReportSection] = []
    for number, artifact in enumerate(artifacts):
        if artifact.kind == "scenario":
            sections.append(await _scenario(call, artifact))
        elif artifact.kind == "batch":
            sections += await _batch(call, artifact)
        else:
            raise InvalidRequest(
                f"a report cannot show the {artifact.kind} {artifact.artifact_id}", valid=["scenario ids", "batch ids"]
            )
        await call.progress(0.9 * (number + 1) / len(artifacts), f"report on {artifact.artifact_id}")
    request = ReportRequest(
        title="PlannerForge report",
        introduction="What was made, run and found; every figure was computed from the artifacts named beside it.",
        sections=tuple(sections),
        footer="Made by PlannerForge MCP.",
        path=str(path),
    )
    return await call.run("plannerforge.engine.rendering.report:write_report", request, ReportWritten)


async def _scenario(call: ToolCall, artifact: Artifact) -> ReportSection:
    base = [parent for parent in artifact.recipe.parents if call.workspace.find("scenario", parent) is not None]
    beside = [*base[:1], artifact.artifact_id]
    drawn = await draw(call, "picture", scenario_ids=beside)
    caption = f"{beside[0]} before and {beside[1]} after the edits" if len(beside) == 2 else artifact.artifact_id
    images = [report_image(image, caption) for image in drawn.images]
    return scenario_section(artifact.read(ScenarioRecord), artifact.recipe, images)


async def _batch(call: ToolCall, artifact: Artifact) -> list[ReportSection]:
    batch = artifact.read(BatchRecord)
    runs = run_sources(batch.runs, call)
    sections = [batch_section(batch, [run.record for run in runs], await _run_images(call, runs))]
    if len(batch.configs) > 1 and runs:
        compared = await compare_results(CompareResultsArguments(results=[artifact.artifact_id]), call)
        sections.append(comparison_section(compared))
    if runs:
        findings = AnalyzeResultsArguments(results=[artifact.artifact_id], detail="findings")
        costs = await draw(call, "costs", run_ids=batch.runs)
        images = [report_image(image, "Mean weighted cost by term and configuration") for image in costs.images]
        sections.append(analysis_section(await analyze_results(findings, call), images))
    return sections


async def _run_images(call: ToolCall, runs: Sequence[RunSource]) -> list[ReportImage]:
    """The run that failed, or the first one, as an animation, and the speeds on its scenario."""
    if not runs:
        return []
    failed = [run.record for run in runs if run.record.outcome in FAILURES]
    shown = (failed or [run.record for run in runs])[0]
    together = [run.record.run_id for run in runs if run.record.scenario_id == shown.scenario_id]
    moving = await draw(call, "animation", run_ids=[shown.run_id])
    speeds = await draw(call, "profile", run_ids=together)
    caption = f"{shown.run_id}: {shown.config_name} on {shown.scenario_id}, {shown.outcome.replace('_', ' ')}"
    return [report_image(image, caption) for image in moving.images] + [
        report_image(image, f"Speed and acceleration of the runs on {shown.scenario_id}") for image in speeds.images
    ]
