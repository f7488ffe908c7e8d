"""The tools that say what runs show: figures of a set, and one set against another.

Results are named by run and batch ids and by words for the newest ones (``WORDS``).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from ..engine.tuning import preset_configuration
from ..engine.workspace import Artifact
from ..schemas.analysis.comparison import CompareRequest, CompareResultsArguments, CompareResultsResult, Side
from ..schemas.errors import Faults, InvalidRequest, NotPossible, UnknownName
from ..schemas.modification import Edit
from ..schemas.planning import PlannerConfiguration
from ..schemas.results import AnalyseRequest, AnalyzeResultsArguments, AnalyzeResultsResult, ConfigWeights
from ..schemas.runs import BatchRecord, Lineage, LostCell, RunRecord, RunSource, ScenarioSource
from ..schemas.scenarios import ScenarioRecord
from ..schemas.vocabulary import ROAD_KINDS
from .call import ToolCall
from .operations import ANALYSE, COMPARE

WORDS = ("latest", "latest_run", "previous_run", "latest_batch", "previous_batch")


@dataclass(frozen=True)
class _ChosenResult:
    """A run or a batch by its concrete id, with the ids of its runs in order."""

    result_id: str
    kind: Literal["run", "batch"]
    run_ids: tuple[str, ...]
    lost: tuple[LostCell, ...] = ()


async def analyze_results(arguments: AnalyzeResultsArguments, call: ToolCall) -> AnalyzeResultsResult:
    """Rates, metrics, costs and findings of runs."""
    chosen, runs = _chosen_runs(arguments.results, call)
    request = AnalyseRequest(
        results=tuple(result.result_id for result in chosen),
        runs=runs,
        configs=config_weights(runs, call),
        scenarios=scenario_sources((run.record.scenario_id for run in runs), call),
        lineage=lineages((run.record.scenario_id for run in runs), call),
        lost=tuple(cell for result in chosen for cell in result.lost),
        breakdown=arguments.breakdown,
        where=tuple(arguments.where),
        detail=arguments.detail,
    )
    result = await call.run(ANALYSE, request)
    if not arguments.trial:
        return result
    from .trial import with_trials  # it runs planners, whose tools name results by words of this module

    return await with_trials(result, runs, call)


async def compare_results(arguments: CompareResultsArguments, call: ToolCall) -> CompareResultsResult:
    """Paired tests of every side against the first."""
    words, notes = _words_of(arguments, call)
    chosen, runs = _chosen_runs(words, call)
    request = CompareRequest(
        sides=_sides_of(chosen, runs),
        runs=runs,
        configs=config_weights(runs, call),
        scenarios=scenario_sources((run.record.scenario_id for run in runs), call),
        lineage=lineages((run.record.scenario_id for run in runs), call),
        metrics=tuple(arguments.metrics),
        limit=arguments.limit,
    )
    result = await call.run(COMPARE, request)
    asked = arguments.limit if "limit" in arguments.model_fields_set else None
    return result.model_copy(update={"notes": (*notes, *result.notes), "flips_asked": asked})


def _words_of(arguments: CompareResultsArguments, call: ToolCall) -> tuple[list[str], tuple[str, ...]]:
    """What is compared; left out while there is one batch only, its configurations, and without any, two runs."""
    if "results" in arguments.model_fields_set:
        return arguments.results, ()
    batches = len(_newest("batch", 2, call))
    if batches == 0:
        return ["previous_run", "latest_run"], ("there is no batch: the two newest runs are compared",)
    if batches == 1:
        return ["latest_batch"], ("there is one batch only: its configurations are compared",)
    return arguments.results, ()


def _chosen_runs(words: Sequence[str], call: ToolCall) -> tuple[tuple[_ChosenResult, ...], tuple[RunSource, ...]]:
    """The results and all their runs; refused where there is none."""
    chosen = choose_results(words, call)
    runs = run_sources((run_id for result in chosen for run_id in result.run_ids), call)
    if not runs:
        errors = [cell.error for result in chosen for cell in result.lost]
        raise NotPossible(
            f"{', '.join(result.result_id for result in chosen)} holds no run{f': {errors[0]}' if errors else ''}",
            next_step="call run_planner again",
        )
    return chosen, runs


def choose_results(words: Sequence[str], call: ToolCall) -> tuple[_ChosenResult, ...]:
    """Resolve words and ids, each result once.

    Raises:
        UnknownName: nothing of that name, or no such run or batch yet.
        InvalidRequest: the id of something that is no result.
    """
    faults, chosen = Faults(), dict[str, _ChosenResult]()
    for word in words:
        with faults.collecting():
            result = _chosen(result_named(word.strip(), call))
            chosen[result.result_id] = result
    faults.raise_all()
    return tuple(chosen.values())


def result_named(word: str, call: ToolCall) -> Artifact:
    """The run or batch of an id, or of a word for the client's last ones (``WORDS``).

    Raises:
        UnknownName: nothing of that name, or no such run or batch yet.
        InvalidRequest: the id of something that is no result.
    """
    if word == "latest":
        newest = call.newest("run", "batch")
        if newest:
            return newest[0]
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
    return call.newest(kind, count=count)


def _chosen(artifact: Artifact) -> _ChosenResult:
    if artifact.kind == "run":
        return _ChosenResult(artifact.artifact_id, "run", (artifact.artifact_id,))
    batch = artifact.read(BatchRecord)
    return _ChosenResult(artifact.artifact_id, "batch", batch.runs, batch.lost)


def run_sources(run_ids: Iterable[str], call: ToolCall) -> tuple[RunSource, ...]:
    """Records and step files of runs, each once."""
    sources = []
    for run_id in dict.fromkeys(run_ids):
        record = call.workspace.get(run_id, "run").read(RunRecord)
        steps = call.workspace.folder("run", run_id) / "steps.json"
        sources.append(RunSource(record=record, steps_path=str(steps) if steps.is_file() else None))
    return tuple(sources)


def config_weights(runs: Iterable[RunSource], call: ToolCall) -> tuple[ConfigWeights, ...]:
    """The configurations of runs, as far as they are stored."""
    weights = []
    for config_id in dict.fromkeys(run.record.config_id for run in runs):
        artifact = call.workspace.find("config", config_id)
        if artifact is not None:
            config = artifact.read(PlannerConfiguration)
            weights.append(
                ConfigWeights(
                    config_id=config_id,
                    name=config.name,
                    planner=config.planner,
                    weights=config.weights | config.external_weights,
                    settings=config.settings.model_dump(exclude_defaults=True),
                    default_weights=preset_configuration(config.planner).weights,
                )
            )
    return tuple(weights)


def scenario_sources(scenario_ids: Iterable[str], call: ToolCall) -> tuple[ScenarioSource, ...]:
    """Files of scenarios, and what is known of how hard they are, each once."""
    sources = []
    for scenario_id in dict.fromkeys(scenario_ids):
        artifact = call.workspace.get(scenario_id, "scenario")
        facts = artifact.read(ScenarioRecord).facts
        sources.append(
            ScenarioSource(
                scenario_id=scenario_id,
                path=str(call.workspace.file("scenario", scenario_id, "scenario.xml")),
                obstacles=facts.participants.counts,
                density_per_km=facts.density_per_km,
                road=next((kind for kind in ROAD_KINDS if kind in facts.tags), ""),
                limit_kmh=max(facts.roads.limits_ego_kmh, default=None),
            )
        )
    return tuple(sources)


def lineages(scenario_ids: Iterable[str], call: ToolCall) -> tuple[Lineage, ...]:
    """Where the edited ones among scenarios come from, each once."""
    found = []
    for scenario_id in dict.fromkeys(scenario_ids):
        artifact = call.workspace.get(scenario_id, "scenario")
        ancestors: list[str] = []
        edits: list[str] = []
        while artifact.recipe.tool == "modify_scenario" and artifact.recipe.parents[0] not in ancestors:
            own = [Edit.model_validate(edit).in_words() for edit in artifact.recipe.arguments["edits"]]
            edits = [*own, *edits]
            ancestors.append(artifact.recipe.parents[0])
            parent = call.workspace.find("scenario", ancestors[-1])
            if parent is None:
                break
            artifact = parent
        if ancestors:
            found.append(Lineage(scenario_id=scenario_id, ancestors=tuple(ancestors), edits=tuple(edits)))
    return tuple(found)


def _sides_of(chosen: Sequence[_ChosenResult], runs: Sequence[RunSource]) -> tuple[Side, ...]:
    """The sides in the given order.

    A batch gives one side a configuration; single runs with several configurations are put together by configuration;
    two runs of one configuration stand against each other.

    Raises:
        InvalidRequest: there is only one side.
    """
    by_id = {run.record.run_id: run for run in runs}
    if all(result.kind == "run" for result in chosen) and len({run.record.config_id for run in runs}) > 1:
        groups = [("", list(by_id.values()))]
    else:
        groups = [(result.result_id, [by_id[run_id] for run_id in result.run_ids]) for result in chosen]
    sides = [side for label, members in groups for side in _by_config(label, members, alone=len(groups) == 1)]
    if len(sides) < 2:
        labels = ", ".join(side.label for side in sides)
        raise InvalidRequest(
            f"only one side: {labels}",
            valid=["two runs or batches", "one batch with several configurations"],
            next_step="run another configuration on the same scenarios with run_planner",
        )
    return tuple(sides)


def _by_config(label: str, members: Sequence[RunSource], *, alone: bool) -> list[Side]:
    groups: dict[str, list[RunSource]] = {}
    for member in members:
        groups.setdefault(member.record.config_id, []).append(member)
    names = [group[0].record.config_name for group in groups.values()]
    sides = []
    for config_id, group in groups.items():
        name = group[0].record.config_name
        words = name if names.count(name) == 1 else f"{name} {config_id}"
        sides.append(
            Side(
                label=words if alone else f"{words} ({label})",
                config_id=config_id,
                config_name=name,
                run_ids=tuple(member.record.run_id for member in group),
            )
        )
    return sides
