"""Find the runs that a call refers to, and what analyses need: records, configurations, scenarios, lineage.

Results are given by run and batch ids and by words for the latest ones (``WORDS``).
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ..engine.planners import PLANNERS, built_in_version
from ..engine.tuning import preset_configuration, tuning_of
from ..engine.workspace import Artifact
from ..schemas.errors import (
    Faults,
    InvalidRequest,
    NotPossible,
    PlannerFailure,
    UnknownName,
    calling,
    instead,
    with_values,
)
from ..schemas.modification import Edit
from ..schemas.planning import PlannerConfiguration, PlannerSettings
from ..schemas.results import ConfigWeights
from ..schemas.reviews import RunLook
from ..schemas.runs import (
    VERSION_MARK,
    BatchRecord,
    Lineage,
    LostCell,
    RunRecord,
    RunSource,
    ScenarioSource,
    configuration_id,
)
from ..schemas.scenarios import ScenarioRecord
from ..schemas.text import cited, shown_name
from ..schemas.vocabulary import ROAD_KINDS
from .context import RESULT_WORDS, WorkflowContext

WORDS = ("latest", *RESULT_WORDS)


@dataclass(frozen=True)
class ChosenResult:
    """A run or a batch by its id, with the ids of its runs in order."""

    result_id: str
    kind: Literal["run", "batch"]
    run_ids: tuple[str, ...]
    lost: tuple[LostCell, ...] = ()


def chosen_runs(
    words: Sequence[str], context: WorkflowContext
) -> tuple[tuple[ChosenResult, ...], tuple[RunSource, ...]]:
    """Return the results and all their runs, or refuse if there are no runs."""
    chosen = choose_results(words, context)
    runs = run_sources((run_id for result in chosen for run_id in result.run_ids), context)
    if not runs:
        errors = [cell.error for result in chosen for cell in result.lost]
        raise NotPossible(
            f"{', '.join(result.result_id for result in chosen)} has no run{f': {errors[0]}' if errors else ''}",
            next_step="call run_planner again",
        )
    return chosen, runs


def choose_results(words: Sequence[str], context: WorkflowContext) -> tuple[ChosenResult, ...]:
    """Resolve words and ids, each result once.

    Raises:
        UnknownName: a name is unknown, or there is no such run or batch yet.
        InvalidRequest: an id belongs to something that is not a result.
    """
    faults, chosen = Faults(), dict[str, ChosenResult]()
    for word in words:
        others = [other for other in words if other != word]
        with faults.collecting(), _proposing_others(others):
            result = _chosen(result_named(word.strip(), context))
            chosen[result.result_id] = result
    faults.raise_all()
    return tuple(chosen.values())


@contextmanager
def _proposing_others(others: Sequence[str]) -> Iterator[None]:
    """If the block refuses a name, propose the other given names, if there are any."""
    try:
        yield
    except UnknownName as error:
        raise error.also(*([with_values(results=list(others))] if others else [])) from error.__cause__


def result_named(word: str, context: WorkflowContext) -> Artifact:
    """Return the run or batch with an id, or the client's latest result that a word refers to (``WORDS``).

    Raises:
        UnknownName: the name is unknown, or there is no such run or batch yet.
        InvalidRequest: the id belongs to something that is not a result.
    """
    if word == "latest":
        newest = context.newest("run", "batch")
        if newest:
            return newest[0]
        raise UnknownName("there is no run yet", next_step="call run_planner")
    if word in WORDS:
        age, _, kind = word.partition("_")
        place = 0 if age == "latest" else 1
        stored = context.newest(kind, count=place + 1)  # type: ignore[arg-type]
        if len(stored) > place:
            return stored[place]
        known = (*context.newest("batch", count=4), *context.newest("run", count=4))
        there = [artifact.artifact_id for artifact in known]
        raise UnknownName(f"there is no {word.replace('_', ' ')}", valid=there, next_step="call run_planner")
    try:
        kind = context.workspace.kind_of(word, "run", "batch")
    except UnknownName as refusal:
        raise context.meant_job(word) or refusal.with_words(word, WORDS) from refusal.__cause__
    if kind not in ("run", "batch"):
        made = [one for made in ("run", "batch") for one in context.workspace.newest(kind=made, parent=word, limit=1)]
        raise InvalidRequest(
            f"'{word}' is a {kind}, not a run or batch",
            valid=[*(one.artifact_id for one in made), *WORDS],
            next_step="render it with kind search" if kind == "study" else "use the run or batch id of run_planner",
            remedies=[
                *(instead(word, one.artifact_id, "results") for one in made),
                *([calling("run_planner", scenarios=[word])] if kind == "scenario" else []),
            ],
        )
    return context.workspace.get(word, kind)


def _chosen(artifact: Artifact) -> ChosenResult:
    if artifact.kind == "run":
        return ChosenResult(artifact.artifact_id, "run", (artifact.artifact_id,))
    batch = artifact.read(BatchRecord)
    return ChosenResult(artifact.artifact_id, "batch", batch.runs, batch.lost)


def run_sources(run_ids: Iterable[str], context: WorkflowContext) -> tuple[RunSource, ...]:
    """Return records and step files of runs, each once, with planner versions distinguished (:func:`with_versions`)."""
    records = with_versions(run_record(context.workspace.get(run_id, "run")) for run_id in dict.fromkeys(run_ids))
    sources = []
    for record in records:
        steps = context.workspace.folder("run", record.run_id) / "steps.json"
        path = str(steps) if steps.is_file() else None
        sources.append(RunSource(record=record, steps_path=path, look=_kept_look(record.run_id, context)))
    return tuple(sources)


def run_record(artifact: Artifact) -> RunRecord:
    """Return the record of a stored run. A missing planner version comes from the run's recipe."""
    record = _cited_words(artifact.read(RunRecord), artifact.imported)
    if record.planner_source:
        return record
    versions = artifact.recipe.versions
    if record.planner in PLANNERS:
        known = built_in_version(record.planner, versions)
        return record.model_copy(update={"planner_version": known.words, "planner_source": known.source})
    source = versions.get(version_key(record.planner), "")
    return record.model_copy(update={"planner_version": source[:_SHORT], "planner_source": source})


def _cited_words(record: RunRecord, imported: bool) -> RunRecord:
    """Return a record as answers print it; names that do not have the form of a name are cited.

    An archive's description of how a run ended is its maker's text, so all of it is cited.
    """
    return record.model_copy(
        update={
            "imported": imported,
            "reason": cited(record.reason, _LONGEST_REASON) if imported else record.reason,
            "config_name": shown_name(record.config_name),
            "planner_version": shown_name(record.planner_version) if record.planner_version else "",
            "rejected_candidates": {shown_name(name): count for name, count in record.rejected_candidates.items()},
        }
    )


_LONGEST_REASON = 600
"""The maximum length of an imported run's outcome text, in characters (chosen: our longest has 400)."""


def version_key(planner: str) -> str:
    """Return a recipe's key for the version of an external planner, which differs from the key of a package of that
    name.
    """
    return f"planner {planner}"


_SHORT = 7
"""How many characters of a digest are shown, as git abbreviates object ids."""


def with_versions(records: Iterable[RunRecord]) -> list[RunRecord]:
    """Return the records; if a planner has several versions, its names and configuration ids include the version.

    ``mylane:Default`` with ``cfg_1`` becomes ``mylane:Default v2 (d4e5f6a)`` with ``cfg_1@d4e5f6a``. Grouping by
    configuration then separates the versions, and every printed name shows its version.
    """
    kept = list(records)
    sources: dict[str, set[str]] = {}
    for record in kept:
        sources.setdefault(record.planner, set()).add(record.planner_source)
    return [_versioned(record) if len(sources[record.planner]) > 1 else record for record in kept]


def _versioned(record: RunRecord) -> RunRecord:
    version = record.planner_version or "of unknown version"
    return record.model_copy(
        update={
            "config_id": f"{record.config_id}{VERSION_MARK}{record.planner_source[:_SHORT] or 'unknown'}",
            "config_name": f"{record.config_name} {version}",
        }
    )


def driven_by(record: RunRecord) -> str:
    """Return the name of a run's configuration, with the version if the planner is external."""
    version = record.planner_version
    if record.planner in PLANNERS or not version or version in record.config_name:
        return record.config_name
    return f"{record.config_name} {version}"


def _look_path(run_id: str, context: WorkflowContext) -> Path:
    return context.workspace.root / "looks" / str(RunLook.VERSION) / f"{run_id}.json"


def _kept_look(run_id: str, context: WorkflowContext) -> RunLook | None:
    """Return the stored review of a run, or None if there is no review or it cannot be read."""
    try:
        return RunLook.model_validate_json(_look_path(run_id, context).read_bytes())
    except (OSError, ValueError):
        return None


def keep_look(run_id: str, look: RunLook, context: WorkflowContext) -> None:
    """Store the review of a run for later analyses. If the disk is full, the review is computed again."""
    path = _look_path(run_id, context)
    with context.workspace.scratch() as folder, suppress(OSError):
        made = folder / path.name
        made.write_text(look.model_dump_json(), encoding="utf-8")
        path.parent.mkdir(parents=True, exist_ok=True)
        made.replace(path)


def config_weights(runs: Iterable[RunSource], context: WorkflowContext) -> tuple[ConfigWeights, ...]:
    """Return the stored configurations of runs."""
    weights = []
    for config_id in dict.fromkeys(run.record.config_id for run in runs):
        artifact = context.workspace.find("config", configuration_id(config_id))
        if artifact is not None:
            config = artifact.read(PlannerConfiguration)
            weights.append(
                ConfigWeights(
                    config_id=config_id,
                    name=shown_name(config.name),
                    planner=config.planner,
                    weights=config.weights | config.external_weights,
                    settings=_settings(config.settings),
                    default_weights=_default_weights(config.planner),
                    parameters=_parameters(config.planner),
                    terms=_terms(config.planner),
                )
            )
    return tuple(weights)


def _settings(settings: PlannerSettings) -> dict[str, float]:
    """Return the settings that differ from the default, with the vehicle if it is stated."""
    changed = settings.model_dump(exclude_defaults=True, exclude={"vehicle_stated"})
    return {"vehicle": settings.vehicle} | changed if settings.states_vehicle else changed


def _default_weights(planner: str) -> dict[str, float] | None:
    """Return the weights of a planner's Default preset by name, or None if it is no longer installed."""
    try:
        return dict(preset_configuration(planner).weights)
    except (UnknownName, PlannerFailure):
        return None


def _parameters(planner: str) -> tuple[str, ...]:
    """Return a planner's settings other than its cost weights; empty if the planner is no longer installed."""
    try:
        return tuple(name for name, weight in tuning_of(planner).weights.items() if not weight.of_cost)
    except (UnknownName, PlannerFailure):
        return ()


def _terms(planner: str) -> dict[str, str]:
    """Return, by weight, the cost terms with a name of their own; empty if the planner is no longer installed."""
    try:
        return {name: weight.term for name, weight in tuning_of(planner).weights.items() if weight.term}
    except (UnknownName, PlannerFailure):
        return {}


def scenario_sources(scenario_ids: Iterable[str], context: WorkflowContext) -> tuple[ScenarioSource, ...]:
    """Return each scenario once, with its file and the known facts about how hard it is."""
    sources = []
    for scenario_id in dict.fromkeys(scenario_ids):
        artifact = context.workspace.get(scenario_id, "scenario")
        facts = artifact.read(ScenarioRecord).facts
        sources.append(
            ScenarioSource(
                scenario_id=scenario_id,
                path=str(context.workspace.file("scenario", scenario_id, "scenario.xml")),
                obstacles=facts.participants.counts,
                density_per_km=facts.density_per_km,
                road=next((kind for kind in ROAD_KINDS if kind in facts.tags), ""),
                limit_kmh=max(facts.roads.limits_ego_kmh, default=None),
            )
        )
    return tuple(sources)


def lineages(scenario_ids: Iterable[str], context: WorkflowContext) -> tuple[Lineage, ...]:
    """Return the lineage of each edited scenario among the given ones, once."""
    found = []
    for scenario_id in dict.fromkeys(scenario_ids):
        artifact = context.workspace.get(scenario_id, "scenario")
        ancestors: list[str] = []
        edits: list[str] = []
        while artifact.recipe.tool == "modify_scenario" and artifact.recipe.parents[0] not in ancestors:
            own = [Edit.model_validate(edit).in_words() for edit in artifact.recipe.arguments["edits"]]
            edits = [*own, *edits]
            ancestors.append(artifact.recipe.parents[0])
            parent = context.workspace.find("scenario", ancestors[-1])
            if parent is None:
                break
            artifact = parent
        if ancestors:
            found.append(Lineage(scenario_id=scenario_id, ancestors=tuple(ancestors), edits=tuple(edits)))
    return tuple(found)
