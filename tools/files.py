"""The tools that import the user's files, and that write files for the user."""

from ..schemas.artifacts import ExportArtifactsArguments, ExportArtifactsResult, ImportFilesArguments, ImportFilesResult
from ..workflows import exporting, importing
from .call import ToolCall


async def import_files(arguments: ImportFilesArguments, call: ToolCall) -> ImportFilesResult:
    """Import scenarios, maps, weight files and archives; many files become a job."""
    return await importing.import_files(arguments, call)


async def export_artifacts(arguments: ExportArtifactsArguments, call: ToolCall) -> ExportArtifactsResult:
    """Write artifacts, tables, pictures and reports into a folder."""
    return await exporting.export_artifacts(arguments, call)
