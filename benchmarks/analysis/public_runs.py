"""Runs on public scenarios for the parts of ``make bench-analysis``, made once and kept in the scratch folder."""

import random
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mcp import Client

from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.runs import BatchRecord, RunRecord, RunSteps
from plannerforge.schemas.scenarios import ScenarioFacts, ScenarioRecord
from plannerforge.server.assembly import create_server

from ..harness import SeededBench, finished_batch, import_scenarios, read_run_file, scenario_files, settings_for

DEFAULT, SAFETY = "frenetix:Default", "frenetix:Safety-Conservative"
PREDICTION = "constant_velocity"
COMPARED = 40
"""Scenarios for comparing two configurations (chosen: a minute of runs)."""
_FOLDER, _DONE = "public", "imported"


def public_folder(bench: SeededBench) -> Path:
    """Return the workspace of the runs, which all parts share."""
    return bench.scratch / _FOLDER


def public_server(bench: SeededBench) -> Client:
    """Open a client of a server with one worker that may write into the scratch; all parts share the workspace."""
    settings = settings_for(public_folder(bench), bench.shared, 1)
    return Client(create_server(settings.model_copy(update={"roots": (bench.shared, bench.scratch)})))


async def import_public(bench: SeededBench, client: Client, limit: int | None = None) -> None:
    """Import every public scenario up to a limit; scenarios that another part imported are already there."""
    marker = public_folder(bench) / f"{_DONE}-{limit or 'all'}"
    if not marker.exists():
        await import_scenarios(client, scenario_files(bench.shared / "data" / "commonroad", limit))
        marker.touch()


async def public_batch(bench: SeededBench, client: Client) -> str:
    """Return the batch of Frenetix' default on every public scenario, or on as many as the bench's limit."""
    await import_public(bench, client, bench.limit)
    return await finished_batch(client, scenarios=["preset:500"], configs=[DEFAULT], prediction=PREDICTION)


async def compared_batch(bench: SeededBench, client: Client, batch_id: str) -> str:
    """Run two configurations on forty of a batch's scenarios, drawn by the bench's seed."""
    names = raw_runs(bench, batch_id).batch.scenarios
    chosen = random.Random(bench.seed).sample(sorted(names), min(COMPARED, len(names)))  # noqa: S311 - no secret
    return await finished_batch(client, scenarios=sorted(chosen), configs=[DEFAULT, SAFETY], prediction=PREDICTION)


@dataclass(frozen=True)
class RawRuns:
    """The stored data of a batch's runs, by run id and by scenario id, in the order of the batch."""

    batch: BatchRecord
    records: tuple[RunRecord, ...]
    steps: Mapping[str, RunSteps]
    facts: Mapping[str, ScenarioFacts]
    files: Mapping[str, Path]

    @property
    def valid(self) -> tuple[RunRecord, ...]:
        """The runs that could be attempted."""
        return tuple(record for record in self.records if record.outcome != "invalid")


def raw_runs(bench: SeededBench, batch_id: str) -> RawRuns:
    """Read the runs of a batch from the workspace."""
    workspace = Workspace(public_folder(bench))
    batch = workspace.get(batch_id, "batch").read(BatchRecord)
    records = tuple(workspace.get(run_id, "run").read(RunRecord) for run_id in batch.runs)
    scenarios = sorted({record.scenario_id for record in records})
    raw = RawRuns(
        batch=batch,
        records=records,
        steps={
            record.run_id: read_run_file(workspace, record.run_id, "steps.json", RunSteps)
            for record in records
            if (workspace.folder("run", record.run_id) / "steps.json").is_file()
        },
        facts={name: workspace.get(name, "scenario").read(ScenarioRecord).facts for name in scenarios},
        files={name: workspace.file("scenario", name, "scenario.xml") for name in scenarios},
    )
    workspace.close()
    return raw
