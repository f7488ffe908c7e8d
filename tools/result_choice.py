"""Which runs the words of a call mean: run and batch ids, and words for the newest ones."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from plannerforge.engine.workspace.artifacts import Artifact
from plannerforge.schemas.errors import InvalidRequest, UnknownName
from plannerforge.schemas.planning import PlannerConfiguration
from plannerforge.schemas.results import ConfigWeights, RunSource, ScenarioSource
from plannerforge.schemas.runs import BatchRecord, LostCell, RunRecord
from plannerforge.schemas.scenarios import ScenarioRecord
from plannerforge.tools.call import ToolCall

WORDS = ("latest", "latest_run", "previous_run", "latest_batch", "previous_batch")


@dataclass(frozen=True)
class ChosenResult:
    """A run or a batch by its concrete id, with the ids of its runs in order."""

    result_id: str
    kind: Literal["run", "batch"]
    run_ids: tuple[str, ...]
    lost: tuple[LostCell, ...] = ()


def choose_results(words: Sequence[str], call: ToolCall) -> tuple[ChosenResult, ...]:
    """Resolve words and ids, each result once.

    Raises:
        UnknownName: nothing of that name, or no such run or batch yet.
        InvalidRequest: the id of something that is no result.
    """
    chosen = (_chosen(_artifact(word.strip(), call)) for word in words)
    return tuple({found.result_id: found for found in chosen}.values())


def run_sources(run_ids: Iterable[str], call: ToolCall) -> tuple[RunSource, ...]:
    """Records and step files of runs, each once."""
    found = []
    for run_id in dict.fromkeys(run_ids):
        record = call.workspace.get(run_id, "run").read(RunRecord)
        steps = call.workspace.folder("run", run_id) / "steps.json"
        found.append(RunSource(record=record, steps_path=str(steps) if steps.is_file() else None))
    return tuple(found)


def config_weights(runs: Iterable[RunSource], call: ToolCall) -> tuple[ConfigWeights, ...]:
    """The configurations of runs, as far as they are stored."""
    found = []
    for config_id in dict.fromkeys(run.record.config_id for run in runs):
        artifact = call.workspace.find("config", config_id)
        if artifact is not None:
            config = artifact.read(PlannerConfiguration)
            found.append(
                ConfigWeights(
                    config_id=config_id,
                    name=config.name,
                    planner=config.planner,
                    weights=config.weights | config.external_weights,
                    settings=config.settings.model_dump(exclude_defaults=True),
                )
            )
    return tuple(found)


def scenario_sources(scenario_ids: Iterable[str], call: ToolCall) -> tuple[ScenarioSource, ...]:
    """Files and obstacle counts of scenarios, each once."""
    return tuple(scenario_source(call.workspace.get(key, "scenario"), call) for key in dict.fromkeys(scenario_ids))


def scenario_source(artifact: Artifact, call: ToolCall) -> ScenarioSource:
    """File and obstacle counts of a stored scenario."""
    path = call.workspace.file("scenario", artifact.artifact_id, "scenario.xml")
    counts = artifact.read(ScenarioRecord).facts.participants.counts
    return ScenarioSource(scenario_id=artifact.artifact_id, path=str(path), obstacles=counts)


def _artifact(word: str, call: ToolCall) -> Artifact:
    if word == "latest":
        newest = [found for kind in ("run", "batch") for found in _newest(kind, 1, call)]
        if newest:
            return max(newest, key=lambda artifact: artifact.sequence)
        raise UnknownName("there is no run yet", next_step="call run_planner")
    if word in WORDS:
        age, _, kind = word.partition("_")
        place = 0 if age == "latest" else 1
        stored = _newest(kind, place + 1, call)  # type: ignore[arg-type]
        if len(stored) > place:
            return stored[place]
        there = [artifact.artifact_id for artifact in (*_newest("batch", 4, call), *_newest("run", 4, call))]
        raise UnknownName(f"there is no {word.replace('_', ' ')}", valid=there, next_step="call run_planner")
    kind = call.workspace.kind_of(word)
    if kind not in ("run", "batch"):
        raise InvalidRequest(
            f"'{word}' is a {kind}, not a run or batch", valid=WORDS, next_step="name what run_planner answered with"
        )
    return call.workspace.get(word, kind)


def _newest(kind: Literal["run", "batch"], count: int, call: ToolCall) -> list[Artifact]:
    return call.workspace.newest(kind=kind, limit=count)


def _chosen(artifact: Artifact) -> ChosenResult:
    if artifact.kind == "run":
        return ChosenResult(artifact.artifact_id, "run", (artifact.artifact_id,))
    batch = artifact.read(BatchRecord)
    return ChosenResult(artifact.artifact_id, "batch", batch.runs, batch.lost)
