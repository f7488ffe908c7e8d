"""The tool that writes files, pictures and reports into a folder of the user's.

Stored files are copied; solution files, tables, pictures and the report are made for the export.
"""

from collections.abc import Sequence
from pathlib import Path

from ..engine.rendering import analysis_section, batch_section, comparison_section, report_image, scenario_section
from ..engine.workspace import REPORT_NAME, Artifact, Export, plan_exports, refuse_taken, write_export
from ..schemas.analysis.comparison import CompareResultsArguments
from ..schemas.artifacts import (
    ExportArtifactsArguments,
    ExportArtifactsResult,
    ExportedFile,
    ForeignExport,
    ForeignExportRequest,
    RunTableRequest,
    SolutionRequest,
)
from ..schemas.errors import Faults, InvalidRequest
from ..schemas.planning import PlannerConfiguration
from ..schemas.rendering import PictureKind, ReportImage, ReportRequest, ReportSection, ReportWritten
from ..schemas.results import AnalyzeResultsArguments
from ..schemas.runs import BatchRecord, RunRecord, RunSource
from ..schemas.scenarios import ScenarioRecord
from ..schemas.text import printable
from .analysis.tool import analyze_results, compare_results
from .call import ToolCall
from .operations import WRITE_OPENDRIVE, WRITE_OPENSCENARIO, WRITE_REPORT, WRITE_RUN_TABLE, WRITE_SOLUTION
from .rendering import draw, named_artifact
from .results import run_sources

_FAILURES = ("collision", "off_road", "infeasible", "timeout", "goal_missed", "goal_late", "goal_early")
"""Outcomes whose run a report shows first, whatever the order: any of them is a failure of the planner."""


async def export_artifacts(arguments: ExportArtifactsArguments, call: ToolCall) -> ExportArtifactsResult:
    """Write what was asked for; every name is checked before the first file is written."""
    folder = call.allowed_path(arguments.folder)
    named, faults = list[Artifact](), Faults()
    for word in dict.fromkeys(arguments.ids):
        with faults.collecting():
            named.append(named_artifact(word, call))
    faults.raise_all()
    artifacts = list({(artifact.kind, artifact.artifact_id): artifact for artifact in named}.values())
    planned = plan_exports(call.workspace, artifacts, arguments.formats, folder)
    report = folder / REPORT_NAME if "html" in arguments.formats else None
    if not arguments.overwrite:
        refuse_taken([export.path for export in planned] + ([report] if report else []))
    files = [await _write(call, export) for export in planned]
    if report is not None:
        await _write_report(call, artifacts, report)
        files.append(_written(", ".join(artifact.artifact_id for artifact in artifacts), "html", report))
    return ExportArtifactsResult(folder=_shown(folder), files=tuple(files))


async def _write(call: ToolCall, export: Export) -> ExportedFile:
    """Write the file of an export."""
    foreign: ForeignExport | None = None
    if export.is_computed:
        with call.workspace.scratch() as scratch:
            target = scratch / "made"
            if export.format in ("opendrive", "openscenario"):
                foreign = await _compute_foreign(call, export, target)
            else:
                await _compute(call, export, target)
            write_export(call.workspace, export, target)
    else:
        write_export(call.workspace, export, await _drawn(call, export) if export.is_drawn else None)
    written = _written(export.artifact.artifact_id, export.format, export.path)
    if foreign is None:
        return written
    return written.model_copy(update={"lost": foreign.lost, "geometry": foreign.geometry})


async def _drawn(call: ToolCall, export: Export) -> Path:
    kind: PictureKind = "animation" if export.format == "gif" else "auto"
    scenario_ids = [export.artifact.artifact_id] if export.artifact.kind == "scenario" else []
    made = await draw(call, kind, scenario_ids=scenario_ids, run_ids=_runs(export.artifact))
    return Path(made.images[0].path)


def _runs(artifact: Artifact) -> list[str]:
    if artifact.kind == "run":
        return [artifact.artifact_id]
    return list(artifact.record["runs"]) if artifact.kind == "batch" else []


def _shown(path: Path) -> str:
    return printable(str(path), kept="")


def _written(artifact_id: str, form: str, path: Path) -> ExportedFile:
    return ExportedFile(artifact_id=artifact_id, format=form, path=_shown(path), size_bytes=path.stat().st_size)


async def _compute(call: ToolCall, export: Export, target: Path) -> None:
    """Have a worker write the file of an export to ``target``.

    Raises:
        UnknownName: the export's run, configuration or scenario is not in the workspace any more.
    """
    if export.format == "solution":
        await call.run(WRITE_SOLUTION, _solution(call, export, target))
    else:
        await call.run(WRITE_RUN_TABLE, _table(call, export, target))


async def _compute_foreign(call: ToolCall, export: Export, target: Path) -> ForeignExport:
    """Have a worker write a scenario in another tool's format; OpenSCENARIO names the OpenDRIVE file beside it."""
    scenario = call.workspace.file("scenario", export.artifact.artifact_id, "scenario.xml")
    roads = f"{export.artifact.artifact_id}.xodr"
    request = ForeignExportRequest(scenario_path=str(scenario), target_path=str(target), roads=roads)
    return await call.run(WRITE_OPENDRIVE if export.format == "opendrive" else WRITE_OPENSCENARIO, request)


def _solution(call: ToolCall, export: Export, target: Path) -> SolutionRequest:
    record = export.artifact.read(RunRecord)
    return SolutionRequest(
        record=record,
        configuration=call.workspace.get(record.config_id, "config").read(PlannerConfiguration),
        scenario_path=str(call.workspace.file("scenario", record.scenario_id, "scenario.xml")),
        steps_path=str(call.workspace.file("run", record.run_id, "steps.json")),
        target_path=str(target),
    )


def _table(call: ToolCall, export: Export, target: Path) -> RunTableRequest:
    batch = export.artifact.read(BatchRecord)
    return RunTableRequest(
        records=tuple(call.workspace.get(run_id, "run").read(RunRecord) for run_id in batch.runs),
        lost=batch.lost,
        configurations=tuple(call.workspace.get(key, "config").read(PlannerConfiguration) for key in batch.configs),
        form="csv" if export.format == "csv" else "parquet",
        target_path=str(target),
    )


async def _write_report(call: ToolCall, artifacts: Sequence[Artifact], path: Path) -> ReportWritten:
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
    return await call.run(WRITE_REPORT, request)


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
    failed = [run.record for run in runs if run.record.outcome in _FAILURES]
    shown = (failed or [run.record for run in runs])[0]
    together = [run.record.run_id for run in runs if run.record.scenario_id == shown.scenario_id]
    moving = await draw(call, "animation", run_ids=[shown.run_id])
    speeds = await draw(call, "profile", run_ids=together)
    caption = f"{shown.run_id}: {shown.config_name} on {shown.scenario_id}, {shown.outcome.replace('_', ' ')}"
    return [report_image(image, caption) for image in moving.images] + [
        report_image(image, f"Speed and acceleration of the runs on {shown.scenario_id}") for image in speeds.images
    ]
