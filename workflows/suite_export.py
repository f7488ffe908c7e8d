"""Write runs as a test suite that ``plannerforge test`` repeats on a new version of the planner.

The suite's folder is complete: the scenarios, the configurations that are not presets, and the runs as the baseline.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from ..engine.tuning import named_configuration, to_yaml
from ..engine.workspace import Artifact, plan_exports, refuse_existing, write_export, write_whole
from ..schemas.analysis.suite import FAILED_OUTCOMES, SuiteBaseline
from ..schemas.artifacts import ExportedFile
from ..schemas.errors import InvalidRequest, NotPossible
from ..schemas.planning import PlannerConfiguration
from ..schemas.runs import BatchRecord, RunRecord
from ..schemas.scenarios import ScenarioRecord
from ..schemas.text import counted
from .context import WorkflowContext
from .results import run_sources

SUITE_NAME, BASELINE_NAME = "suite.yaml", "baseline.json"
_SCENARIOS = "scenarios"
_READ_AGAIN = ("xml", "net")
"""The stored files of a scenario that an import reads."""
_LIMITS = (*(f"{outcome} <= 0 %" for outcome in FAILED_OUTCOMES), f"nothing lost against {BASELINE_NAME}")
"""What a suite of failures demands of the next version."""


def write_suite(
    artifacts: Sequence[Artifact], folder: Path, context: WorkflowContext, *, overwrite: bool
) -> list[ExportedFile]:
    """Write runs and batches as one suite, and return its files, the suite first.

    Raises:
        InvalidRequest: an artifact is neither a run nor a batch, or the runs' conditions differ.
        NotPossible: there is no run, or a file exists and ``overwrite`` is false.
        UnknownName: a scenario or configuration is no longer in the workspace.
        ResourceFailure: the folder cannot be written.
    """
    records = _records(artifacts, context)
    conditions = _conditions(records)
    configurations = {
        record.config_id: context.workspace.get(record.config_id, "config").read(PlannerConfiguration)
        for record in records
    }
    entries, weights = _configurations(configurations)
    names = {key: str(entry if isinstance(entry, str) else entry["name"]) for key, entry in entries.items()}
    tests = list(dict.fromkeys((record.scenario_id, record.problem_id) for record in records))
    scenarios = [context.workspace.get(key, "scenario") for key in dict.fromkeys(key for key, _ in tests)]
    planned = [
        export
        for export in plan_exports(context.workspace, scenarios, (), folder / _SCENARIOS)
        if export.format in _READ_AGAIN
    ]
    suite: dict[str, Any] = {
        "name": counted(len(tests), "recorded test"),
        "scenarios": [_scenario(*test, context) for test in tests],
        "configurations": list(entries.values()),
        **conditions,
        "limits": list(_LIMITS),
    }
    baseline = SuiteBaseline(
        suite=str(suite["name"]),
        configurations={
            name: tuple(record for record in records if record.config_id == key) for key, name in names.items()
        },
    )
    texts = {
        SUITE_NAME: "# Repeat these runs with a new version: plannerforge test suite.yaml\n"
        + yaml.safe_dump(suite, sort_keys=False, allow_unicode=True),
        BASELINE_NAME: baseline.model_dump_json(indent=1) + "\n",
        **weights,
    }
    if not overwrite:
        refuse_existing([*(folder / name for name in texts), *(export.path for export in planned)])
    written = []
    for name, text in texts.items():
        write_whole(folder / name, partial(Path.write_text, data=text, encoding="utf-8"))
        written.append(ExportedFile.of(artifacts[0].artifact_id, "suite", folder / name))
    for export in planned:
        write_export(context.workspace, export)
        written.append(ExportedFile.of(export.artifact.artifact_id, "suite", export.path))
    return written


def _records(artifacts: Sequence[Artifact], context: WorkflowContext) -> list[RunRecord]:
    """Return the attempted runs of runs and batches, each once."""
    run_ids: list[str] = []
    for artifact in artifacts:
        if artifact.kind not in ("run", "batch"):
            raise InvalidRequest(
                f"a suite repeats runs, and {artifact.artifact_id} is a {artifact.kind}", valid=["run ids", "batch ids"]
            )
        run_ids += [artifact.artifact_id] if artifact.kind == "run" else artifact.read(BatchRecord).runs
    attempted = [run.record for run in run_sources(run_ids, context) if run.record.outcome != "invalid"]
    if not attempted:
        raise NotPossible("no run to repeat: all are invalid", next_step="run_planner on scenarios that can be run")
    return attempted


def _conditions(records: Sequence[RunRecord]) -> dict[str, str | int]:
    """Return the conditions that all runs share, as a suite states them.

    Raises:
        InvalidRequest: the runs' conditions differ.
    """
    found = {(record.prediction, record.traffic, record.world.in_words(), record.seed) for record in records}
    if len(found) > 1:
        raise InvalidRequest(
            f"a suite has one prediction, traffic, world and seed, and these runs have {len(found)} combinations",
            next_step="export the runs of each combination into a folder of its own",
        )
    prediction, traffic, world, seed = found.pop()
    return {"prediction": prediction, "traffic": traffic, "world": world, "seed": seed}


def _configurations(
    configurations: Mapping[str, PlannerConfiguration],
) -> tuple[dict[str, str | dict[str, str]], dict[str, str]]:
    """Return the suite's entry of each configuration by id, and the weight files that the entries name."""
    entries: dict[str, str | dict[str, str]] = {}
    files: dict[str, str] = {}
    for key, configuration in configurations.items():
        preset = f"{configuration.planner}:{configuration.preset}"
        named = named_configuration(preset)
        if named is not None and named.config_id == key:
            entries[key] = configuration.name
        else:
            file = f"{key}.yaml"
            files[file] = to_yaml(configuration)
            entries[key] = {"name": configuration.name, "file": file}
    return entries, files


def _scenario(scenario_id: str, problem_id: int, context: WorkflowContext) -> dict[str, Any]:
    """Return the suite's entry of a test; a file with one planning problem needs no number."""
    file = f"{_SCENARIOS}/{scenario_id}.xml"
    egos = context.workspace.get(scenario_id, "scenario").read(ScenarioRecord).facts.egos
    return {"files": file if len(egos) == 1 else {"path": file, "problem": problem_id}}
