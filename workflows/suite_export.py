"""Write runs as a test suite that ``plannerforge test`` repeats on a new version of the planner.

The suite's folder is complete: the scenarios, the configurations that are not presets, and the runs as the baseline.
"""

import shutil
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from ..engine.tuning import named_configuration, to_yaml
from ..engine.workspace import Artifact, refuse_existing, write_whole
from ..schemas.analysis.suite import SuiteBaseline
from ..schemas.artifacts import ExportedFile
from ..schemas.errors import InvalidRequest, NotPossible
from ..schemas.planning import PlannerConfiguration
from ..schemas.runs import BatchRecord, RunRecord
from ..schemas.scenarios import ScenarioRecord
from ..schemas.text import counted, printable
from .context import WorkflowContext

SUITE_NAME, BASELINE_NAME = "suite.yaml", "baseline.json"
_SCENARIOS = "scenarios"
_LIMITS = ("collision <= 0 %", "off_road <= 0 %", "infeasible <= 0 %", f"nothing lost against {BASELINE_NAME}")
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
    sources = {
        f"{_SCENARIOS}/{scenario_id}{ending}": path
        for scenario_id in dict.fromkeys(key for key, _ in tests)
        for ending, path in _stored_files(scenario_id, context)
    }
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
        refuse_existing([folder / name for name in (*texts, *sources)])
    first = artifacts[0].artifact_id
    written = []
    for name, text in texts.items():
        write_whole(folder / name, partial(Path.write_text, data=text, encoding="utf-8"))
        written.append(_file(first, folder / name))
    for name, path in sources.items():
        write_whole(folder / name, partial(_copy, source=path))
        written.append(_file(Path(name).name.partition(".")[0], folder / name))
    return written


def _records(artifacts: Sequence[Artifact], context: WorkflowContext) -> list[RunRecord]:
    """Return the attempted runs of runs and batches, each once."""
    records: dict[str, RunRecord] = {}
    for artifact in artifacts:
        if artifact.kind == "run":
            records[artifact.artifact_id] = artifact.read(RunRecord)
        elif artifact.kind == "batch":
            for run_id in artifact.read(BatchRecord).runs:
                records[run_id] = context.workspace.get(run_id, "run").read(RunRecord)
        else:
            raise InvalidRequest(
                f"a suite repeats runs, and {artifact.artifact_id} is a {artifact.kind}", valid=["run ids", "batch ids"]
            )
    attempted = [record for record in records.values() if record.outcome != "invalid"]
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


def _stored_files(scenario_id: str, context: WorkflowContext) -> list[tuple[str, Path]]:
    """Return the stored files of a scenario that an import reads, with the endings that it expects."""
    xml = context.workspace.file("scenario", scenario_id, "scenario.xml")
    net = xml.with_name("scenario.net.xml")
    return [(".xml", xml), *([(".net.xml", net)] if net.is_file() else [])]


def _scenario(scenario_id: str, problem_id: int, context: WorkflowContext) -> dict[str, Any]:
    """Return the suite's entry of a test; a file with one planning problem needs no number."""
    file = f"{_SCENARIOS}/{scenario_id}.xml"
    egos = context.workspace.get(scenario_id, "scenario").read(ScenarioRecord).facts.egos
    return {"files": file if len(egos) == 1 else {"path": file, "problem": problem_id}}


def _copy(target: Path, source: Path) -> None:
    shutil.copyfile(source, target)


def _file(artifact_id: str, path: Path) -> ExportedFile:
    return ExportedFile(
        artifact_id=artifact_id, format="suite", path=printable(str(path), kept=""), size_bytes=path.stat().st_size
    )
