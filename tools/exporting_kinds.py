"""Exports that a worker computes: the solution file of a run, the tables of a batch."""

from pathlib import Path

from plannerforge.engine.workspace.export import Export
from plannerforge.schemas.base import Model
from plannerforge.schemas.exporting import FileWritten, RunTableRequest, SolutionRequest
from plannerforge.schemas.planning import PlannerConfiguration
from plannerforge.schemas.runs import BatchRecord, RunRecord
from plannerforge.tools.call import ToolCall

SOLUTION = "plannerforge.engine.planners.solution:write_solution"
RUN_TABLE = "plannerforge.engine.analysis.run_table:write_run_table"


async def compute(call: ToolCall, export: Export, target: Path) -> Path:
    """Have a worker write the file of an export to ``target``.

    Raises:
        UnknownName: the export's run, configuration or scenario is not in the workspace any more.
    """
    if export.format == "solution":
        await call.run(SOLUTION, _solution(call, export, target), FileWritten)
    else:
        await call.run(RUN_TABLE, _table(call, export, target), FileWritten)
    return target


def _solution(call: ToolCall, export: Export, target: Path) -> Model:
    record = export.artifact.read(RunRecord)
    return SolutionRequest(
        record=record,
        configuration=call.workspace.get(record.config_id, "config").read(PlannerConfiguration),
        scenario_path=str(call.workspace.file("scenario", record.scenario_id, "scenario.xml")),
        steps_path=str(call.workspace.file("run", record.run_id, "steps.json")),
        target_path=str(target),
    )


def _table(call: ToolCall, export: Export, target: Path) -> Model:
    batch = export.artifact.read(BatchRecord)
    return RunTableRequest(
        records=tuple(call.workspace.get(run_id, "run").read(RunRecord) for run_id in batch.runs),
        lost=batch.lost,
        configurations=tuple(call.workspace.get(key, "config").read(PlannerConfiguration) for key in batch.configs),
        form="csv" if export.format == "csv" else "parquet",
        target_path=str(target),
    )
