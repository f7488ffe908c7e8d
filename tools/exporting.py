"""The tool that writes files, pictures and reports into a folder of the user's."""

from pathlib import Path

from plannerforge.engine.workspace.artifacts import Artifact
from plannerforge.engine.workspace.export import REPORT_NAME, Export, plan_exports, refuse_taken, write_export
from plannerforge.schemas.artifacts import ExportArtifactsArguments, ExportArtifactsResult, ExportedFile
from plannerforge.schemas.rendering import PictureKind
from plannerforge.tools.call import ToolCall
from plannerforge.tools.drawings import draw
from plannerforge.tools.exporting_kinds import compute
from plannerforge.tools.reporting import write_report


async def export_artifacts(arguments: ExportArtifactsArguments, call: ToolCall) -> ExportArtifactsResult:
    """Write what was asked for; every name is checked before the first file is written."""
    folder = call.allowed_path(arguments.folder)
    artifacts = [call.workspace.get(key, call.workspace.kind_of(key)) for key in dict.fromkeys(arguments.ids)]
    planned = plan_exports(call.workspace, artifacts, arguments.formats, folder)
    report = folder / REPORT_NAME if "html" in arguments.formats else None
    if not arguments.overwrite:
        refuse_taken([export.path for export in planned] + ([report] if report else []))
    for export in planned:
        if export.is_computed:
            with call.workspace.scratch() as scratch:
                write_export(call.workspace, export, await compute(call, export, scratch / "made"))
        else:
            write_export(call.workspace, export, await _drawn(call, export) if export.is_drawn else None)
    if report is not None:
        await write_report(call, artifacts, report)
    files = [_written(export.artifact.artifact_id, export.format, export.path) for export in planned]
    if report is not None:
        files.append(_written(", ".join(artifact.artifact_id for artifact in artifacts), "html", report))
    return ExportArtifactsResult(folder=str(folder), files=tuple(files))


async def _drawn(call: ToolCall, export: Export) -> Path:
    kind: PictureKind = "animation" if export.format == "gif" else "auto"
    scenario_ids = [export.artifact.artifact_id] if export.artifact.kind == "scenario" else []
    made = await draw(call, kind, scenario_ids=scenario_ids, run_ids=_runs(export.artifact))
    return Path(made.images[0].path)


def _runs(artifact: Artifact) -> list[str]:
    if artifact.kind == "run":
        return [artifact.artifact_id]
    return list(artifact.record["runs"]) if artifact.kind == "batch" else []


def _written(artifact_id: str, form: str, path: Path) -> ExportedFile:
    return ExportedFile(artifact_id=artifact_id, format=form, path=str(path), size_bytes=path.stat().st_size)
