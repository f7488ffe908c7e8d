"""Write files, pictures and reports into the user's folder.

Stored files are copied. Solution files, tables, pictures and the report are created for the export.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from ..engine.rendering import (
    analysis_section,
    batch_section,
    comparison_section,
    overview_section,
    report_image,
    rules_section,
    run_section,
    scenario_section,
)
from ..engine.scenarios import write_openlabel
from ..engine.workspace import (
    REPORT_NAME,
    Artifact,
    Export,
    plan_exports,
    refuse_existing,
    refuse_file,
    write_export,
    write_whole,
)
from ..schemas.analysis.comparison import CompareResultsArguments
from ..schemas.artifacts import (
    ExportArtifactsArguments,
    ExportArtifactsResult,
    ExportedFile,
    ForeignExport,
    ForeignExportRequest,
    RunTableRequest,
    SolutionRequest,
    StepTableRequest,
    shown_path,
)
from ..schemas.errors import Faults, InvalidRequest, NotPossible
from ..schemas.measures import MeasuredValue
from ..schemas.planning import PlannerConfiguration
from ..schemas.rendering import REPORT_PICTURES, PictureKind, ReportPart, ReportRequest, ReportSection
from ..schemas.results import AnalyzeResultsArguments, AnalyzeResultsResult
from ..schemas.runs import BatchRecord, RunRecord, RunSource, configuration_id, excesses_in_words
from ..schemas.scenarios import ScenarioRecord
from .analysis.comparison import compare_results
from .analysis.figures import analyze_results
from .context import WorkflowContext
from .operations import (
    WRITE_OPENDRIVE,
    WRITE_OPENSCENARIO,
    WRITE_REPORT,
    WRITE_RUN_TABLE,
    WRITE_SOLUTION,
    WRITE_STEP_TABLE,
)
from .rendering import draw, make_view, named_artifact
from .results import driven_by, run_sources, scenario_sources
from .suite_export import write_suite

_FAILURES = ("collision", "off_road", "infeasible", "timeout", "goal_missed", "goal_late", "goal_early", "goal_refused")
"""Outcomes that a report shows first: all of them are failures of the planner."""


async def export_artifacts(arguments: ExportArtifactsArguments, context: WorkflowContext) -> ExportArtifactsResult:
    """Write the requested files; every name is checked before the first file is written."""
    folder = context.allowed_path(arguments.folder)
    refuse_file(folder)
    chosen, faults = list[Artifact](), Faults()
    for word in dict.fromkeys(arguments.ids):
        with faults.collecting():
            chosen.append(named_artifact(word, context))
    faults.raise_all()
    artifacts = list({(artifact.kind, artifact.artifact_id): artifact for artifact in chosen}.values())
    planned = plan_exports(context.workspace, artifacts, arguments.formats, folder)
    report = folder / REPORT_NAME if "html" in arguments.formats else None
    views = (
        {artifact.artifact_id: folder / f"{artifact.artifact_id}.view.html" for artifact in artifacts} if report else {}
    )
    if not arguments.overwrite:
        refuse_existing([export.path for export in planned] + ([report, *views.values()] if report else []))
    files = []
    if "suite" in arguments.formats:
        files += write_suite(artifacts, folder, context, overwrite=arguments.overwrite)
    files += [await _write(context, export) for export in planned]
    if report is not None:
        files += await _write_report(context, artifacts, report, views)
    return ExportArtifactsResult(folder=shown_path(folder), files=tuple(files))


async def _write(context: WorkflowContext, export: Export) -> ExportedFile:
    """Write the file of an export."""
    foreign: ForeignExport | None = None
    if export.is_computed:
        with context.workspace.scratch() as scratch:
            target = scratch / "made"
            if export.format == "openlabel":
                write_openlabel(export.artifact.read(ScenarioRecord).facts, target)
            elif export.format in ("opendrive", "openscenario"):
                foreign = await _compute_foreign(context, export, target)
            else:
                await _compute(context, export, target)
            write_export(context.workspace, export, target)
    else:
        write_export(context.workspace, export, await _drawn(context, export) if export.is_drawn else None)
    written = ExportedFile.of(export.artifact.artifact_id, export.format, export.path)
    if export.format == "solution" and (beyond := export.artifact.read(RunRecord).beyond_vehicle):
        return written.model_copy(update={"warning": excesses_in_words(beyond)})
    if foreign is None:
        return written
    return written.model_copy(update={"lost": foreign.lost, "geometry": foreign.geometry})


async def _drawn(context: WorkflowContext, export: Export) -> Path:
    kind: PictureKind = "animation" if export.format == "gif" else "auto"
    scenario_ids = [export.artifact.artifact_id] if export.artifact.kind == "scenario" else []
    made = await draw(context, kind, scenario_ids=scenario_ids, run_ids=_runs(export.artifact))
    return Path(made.images[0].path)


def _runs(artifact: Artifact) -> list[str]:
    if artifact.kind == "run":
        return [artifact.artifact_id]
    return list(artifact.record["runs"]) if artifact.kind == "batch" else []


async def _compute(context: WorkflowContext, export: Export, target: Path) -> None:
    """Have a worker write the file of an export to ``target``.

    Raises:
        UnknownName: the export's run, configuration or scenario is no longer in the workspace.
    """
    if export.format == "solution":
        await context.run(WRITE_SOLUTION, _solution(context, export, target))
    elif export.artifact.kind == "run":
        await context.run(WRITE_STEP_TABLE, _steps_table(context, export, target))
    else:
        await context.run(WRITE_RUN_TABLE, _table(context, export, target))


async def _compute_foreign(context: WorkflowContext, export: Export, target: Path) -> ForeignExport:
    """Have a worker write a scenario in another tool's format; OpenSCENARIO refers to its OpenDRIVE file."""
    scenario = context.workspace.file("scenario", export.artifact.artifact_id, "scenario.xml")
    roads = f"{export.artifact.artifact_id}.xodr"
    request = ForeignExportRequest(scenario_path=str(scenario), target_path=str(target), roads=roads)
    return await context.run(WRITE_OPENDRIVE if export.format == "opendrive" else WRITE_OPENSCENARIO, request)


def _solution(context: WorkflowContext, export: Export, target: Path) -> SolutionRequest:
    record = export.artifact.read(RunRecord)
    return SolutionRequest(
        record=record,
        configuration=context.workspace.get(configuration_id(record.config_id), "config").read(PlannerConfiguration),
        scenario_path=str(context.workspace.file("scenario", record.scenario_id, "scenario.xml")),
        steps_path=str(context.workspace.file("run", record.run_id, "steps.json")),
        target_path=str(target),
    )


def _steps_table(context: WorkflowContext, export: Export, target: Path) -> StepTableRequest:
    record = export.artifact.read(RunRecord)
    return StepTableRequest(
        record=record,
        steps_path=str(context.workspace.file("run", record.run_id, "steps.json")),
        form="csv" if export.format == "csv" else "parquet",
        target_path=str(target),
    )


def _table(context: WorkflowContext, export: Export, target: Path) -> RunTableRequest:
    batch = export.artifact.read(BatchRecord)
    runs = run_sources(batch.runs, context)
    return RunTableRequest(
        records=tuple(run.record for run in runs),
        steps_paths={run.record.run_id: run.steps_path for run in runs if run.steps_path is not None},
        scenarios=scenario_sources((run.record.scenario_id for run in runs), context),
        lost=batch.lost,
        configurations=tuple(context.workspace.get(key, "config").read(PlannerConfiguration) for key in batch.configs),
        form="csv" if export.format == "csv" else "parquet",
        target_path=str(target),
    )


async def _write_report(
    context: WorkflowContext, artifacts: Sequence[Artifact], path: Path, views: Mapping[str, Path]
) -> list[ExportedFile]:
    """Write one page on scenarios and batches, in the given order, with the view of each next to it.

    Raises:
        InvalidRequest: a report cannot show one of the artifacts.
    """
    for artifact in artifacts:
        if artifact.kind not in ("scenario", "batch"):
            raise InvalidRequest(
                f"a report cannot show the {artifact.kind} {artifact.artifact_id}", valid=["scenario ids", "batch ids"]
            )
    sections, written, left_out = list[ReportSection](), list[ExportedFile](), list[str]()
    for number, artifact in enumerate(artifacts):
        own = [await _scenario(context, artifact)] if artifact.kind == "scenario" else await _batch(context, artifact)
        view = views[artifact.artifact_id]
        try:
            page = (await make_view([artifact.artifact_id], context)).page()
        except NotPossible as error:
            left_out.append(f"no view of {artifact.artifact_id}: {error.message}")
            sections += own
        else:
            write_whole(view, partial(Path.write_text, data=page, encoding="utf-8"))
            written.append(ExportedFile.of(artifact.artifact_id, "view", view))
            sections += [own[0].model_copy(update={"view": view.name}), *own[1:]]
        await context.progress(0.9 * (number + 1) / len(artifacts), f"report on {artifact.artifact_id}")
    request = ReportRequest(
        title="PlannerForge report",
        introduction="Scenarios, runs and findings. Every figure was computed from the artifacts listed with it.",
        sections=tuple(sections),
        footer="Created by PlannerForge MCP.",
        path=str(path),
    )
    await context.run(WRITE_REPORT, request)
    report = ExportedFile.of(", ".join(artifact.artifact_id for artifact in artifacts), "html", path)
    return [report.model_copy(update={"warning": "; ".join(left_out)}), *written]


async def _scenario(context: WorkflowContext, artifact: Artifact) -> ReportSection:
    base = [parent for parent in artifact.recipe.parents if context.workspace.find("scenario", parent) is not None]
    shown = [*base[:1], artifact.artifact_id]
    drawn = await draw(context, "picture", scenario_ids=shown)
    caption = f"{shown[0]} before and {shown[1]} after the edits" if len(shown) == 2 else artifact.artifact_id
    images = [report_image(image, caption) for image in drawn.images]
    return scenario_section(artifact.read(ScenarioRecord), artifact.recipe, images)


async def _batch(context: WorkflowContext, artifact: Artifact) -> list[ReportSection]:
    """Return the sections of a batch: pictures, comparison, findings, one run in detail, all runs."""
    batch = artifact.read(BatchRecord)
    runs = run_sources(batch.runs, context)
    listed = batch_section(batch, [run.record for run in runs])
    if not runs:
        return [listed]
    ids = [artifact.artifact_id]
    whole = await analyze_results(AnalyzeResultsArguments(results=ids, breakdown="config"), context)
    found = await analyze_results(AnalyzeResultsArguments(results=ids, detail="findings"), context)
    compared = None
    if len(batch.configs) > 1:
        compared = await compare_results(CompareResultsArguments(results=ids), context)
    names = {run.record.config_id: driven_by(run.record) for run in runs}
    overview = overview_section(batch, names, whole, compared)
    sections = [await _illustrated(overview, context, batch.runs, "overview")]
    if compared is not None:
        sections.append(await _illustrated(comparison_section(compared), context, batch.runs, "comparison"))
    sections.append(await _illustrated(analysis_section(found), context, batch.runs, "findings"))
    ruled = await analyze_results(AnalyzeResultsArguments(results=ids, detail="rules"), context)
    sections += [rules_section(ruled)] if ruled.rule_shares else []
    shown = _most_informative_run(runs, whole)
    together = [run.record.run_id for run in runs if run.record.scenario_id == shown.scenario_id]
    looked_at = await analyze_results(AnalyzeResultsArguments(results=[shown.run_id]), context)
    section = run_section(shown, looked_at, await _measures(context, shown))
    detail = await _illustrated(section, context, [shown.run_id], "one_run")
    return [*sections, await _illustrated(detail, context, together, "same_scenario"), listed]


async def _measures(context: WorkflowContext, record: RunRecord) -> Sequence[MeasuredValue]:
    """Return the measures of a run, or nothing if it could not be attempted."""
    if record.outcome == "invalid":
        return ()
    call = AnalyzeResultsArguments(results=[record.run_id], detail="measures")
    return (await analyze_results(call, context)).measures


async def _illustrated(
    section: ReportSection, context: WorkflowContext, run_ids: Sequence[str], part: ReportPart
) -> ReportSection:
    """Return the section with the part's pictures of the given runs, and the reasons for missing pictures."""
    images, absent = list(section.images), list[str]()
    captions = {kind: picture.caption for kind, picture in REPORT_PICTURES.items() if picture.part == part}
    for kind, caption in captions.items():
        try:
            made = await draw(context, kind, run_ids=run_ids)
        except NotPossible as error:
            absent.append(f"No picture of {kind}: {error}.")
            continue
        notes = "".join(f"; {note}" for note in made.notes)
        images += [report_image(image, f"{caption}{notes}") for image in made.images]
    return section.model_copy(update={"images": tuple(images), "text": (*section.text, *absent)})


def _most_informative_run(runs: Sequence[RunSource], whole: AnalyzeResultsResult) -> RunRecord:
    """Return the run to show: the first failure that a reference driver prevents, otherwise the first failure."""
    records = [run.record for run in runs]
    hopeless = whole.causes.not_preventable if whole.causes is not None else ()
    failed = [record for record in records if record.outcome in _FAILURES]
    return ([record for record in failed if record.run_id not in hopeless] or failed or records)[0]
