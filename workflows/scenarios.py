"""Describe one scenario, and resolve the scenarios that a request refers to.

A word is an id, ``ID#problem``, a search, a stage of one (``SEARCH:STAGE``), a coverage plan, ``preset:N``, or the id
of a job that runs planners. A stored search keeps only the counts of its stages, so the scenarios of a stage are looked
up again.
"""

import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..engine.catalog import MOST_ENTRIES, Postings, Search, entries_of, open_catalogue
from ..engine.generation import PlanRows
from ..engine.workspace import Artifact
from ..schemas.catalog import FindScenariosArguments, SearchRecord
from ..schemas.errors import Faults, InvalidRequest, NotPossible, UnknownName, instead
from ..schemas.runs import BatchRecord
from ..schemas.scenarios import (
    DescribeRequest,
    DescribeScenarioArguments,
    DescribeScenarioResult,
    ScenarioFacts,
    ScenarioRecord,
)
from ..schemas.text import counted, shown_name
from .context import WorkflowContext
from .generation.record import described_generation, kept_report, with_classes
from .operations import DESCRIBE_SCENARIO

_LARGEST_PRESET = 500
_PRESET_SIZES = (10, 50, 100, 200, 300, 400, 500)
"""The largest size, and those that a refusal suggests (chosen)."""


@dataclass(frozen=True)
class ChosenScenario:
    """A scenario and one of its planning problems (None means the first)."""

    scenario_id: str
    problem_id: int | None = None


@dataclass(frozen=True)
class _Choice:
    """The scenarios in order, each once, and notes."""

    scenarios: tuple[ChosenScenario, ...]
    notes: tuple[str, ...]


async def describe_scenario(arguments: DescribeScenarioArguments, context: WorkflowContext) -> DescribeScenarioResult:
    """Describe a scenario in words and ids."""
    open_catalogue(context.workspace, with_starter=context.services.with_starter)
    artifact, problem_id = one_scenario(arguments.scenario_id, context)
    record = artifact.read(ScenarioRecord)
    description = await context.run(
        DESCRIBE_SCENARIO,
        DescribeRequest(
            path=context.workspace.file("scenario", artifact.artifact_id, "scenario.xml"),
            base=_edited_file(artifact, context) if arguments.detail == "motion" else None,
            problem_id=problem_id,
            detail=arguments.detail,
            focus=arguments.focus,
            radius_m=arguments.radius_m,
            time_s=arguments.time_s,
        ),
    )
    facts = record.facts if problem_id is None else record.facts.seen_by(problem_id)
    limits = [f"limit {limit:g} km/h" for limit in facts.roads.limits_ego_kmh]
    light = ["traffic_light"] if facts.roads.traffic_light_ego else []
    report = kept_report(artifact, context)
    if report is not None:
        vehicles = with_classes(description.vehicles, report)
        description = description.model_copy(update={"vehicles": vehicles})
    return DescribeScenarioResult(
        scenario_id=facts.scenario_id,
        origin=record.origin,
        detail=arguments.detail,
        place=f"{shown_name(facts.location.place)}, {facts.location.country}",
        tags=facts.tags,
        features=facts.features,
        step_s=facts.step_s,
        duration_s=round(facts.horizon_steps * facts.step_s, 3),
        counts=facts.participants.counts,
        signs=(*(sign for sign in facts.roads.signs_ego if sign != "speed_limit"), *limits, *light),
        circumstances=facts.circumstances,
        description=description,
        other_problems=_other_problems(record.facts, problem_id),
        generation=described_generation(report, artifact, arguments.detail) if report is not None else None,
        recipe=artifact.recipe.model_dump(mode="json") if arguments.detail == "recipe" else None,
    )


def _edited_file(artifact: Artifact, context: WorkflowContext) -> Path | None:
    """Return the file that a scenario was edited from, or None if it was not edited or the file is gone."""
    base = artifact.recipe.arguments.get("base")
    if not isinstance(base, str) or context.workspace.find("scenario", base) is None:
        return None
    return context.workspace.file("scenario", base, "scenario.xml")


def _other_problems(facts: ScenarioFacts, problem_id: int | None) -> tuple[int, ...]:
    """Return a file's planning problems other than the described problem; None means the first."""
    known = [ego.problem_id for ego in facts.egos]
    shown = known[0] if problem_id is None and known else problem_id
    return tuple(key for key in known if key != shown)


def one_scenario(word: str, context: WorkflowContext) -> tuple[Artifact, int | None]:
    """Return the scenario of an id or ``ID#problem``, and the planning problem, or None if no problem is given.

    Raises:
        UnknownName: there is no such scenario or planning problem.
    """
    scenario, mark, problem = word.partition("#")
    artifact = context.artifact(scenario, "scenario")
    if not mark:
        return artifact, None
    known = [ego.problem_id for ego in artifact.read(ScenarioRecord).facts.egos]
    if not re.fullmatch(r"\d+", problem) or int(problem) not in known:
        raise UnknownName(
            f"{artifact.artifact_id} has no planning problem '{problem}'",
            valid=known,
            remedies=[instead(word, scenario)],
        )
    return artifact, int(problem)


def choose_scenarios(words: Sequence[str], context: WorkflowContext) -> _Choice:
    """Resolve the words of a call; ``latest`` and ``search:latest`` become ids.

    Raises:
        UnknownName: there are unknown scenarios, planning problems, searches or stages; all are reported together.
        InvalidRequest: ``preset:`` is not followed by a number from 1 to 500.
        NotPossible: a search has no hits, or no scenario can run.
    """
    open_catalogue(context.workspace, with_starter=context.services.with_starter)
    chosen: dict[ChosenScenario, None] = {}
    notes: list[str] = []
    faults = Faults()
    for word in words:
        with faults.collecting():
            scenarios, remarks = _resolve_word(word.strip(), context)
            chosen.update(dict.fromkeys(scenarios))
            notes += remarks
    faults.raise_all()
    if not chosen:
        raise NotPossible("no scenario is left to run", next_step="use scenario ids, a search id or preset:10")
    return _Choice(tuple(chosen), tuple(notes))


def _resolve_word(word: str, context: WorkflowContext) -> tuple[list[ChosenScenario], list[str]]:
    if word.startswith("preset:"):
        return _preset(word, context)
    if word.startswith(("search:", "search_")):
        return _hits(word.removeprefix("search:"), context)
    if word.startswith("batch_"):
        chosen = [one_scenario(key, context) for key in context.artifact(word, "batch").read(BatchRecord).scenarios]
        return [ChosenScenario(artifact.artifact_id, problem_id) for artifact, problem_id in chosen], []
    if word.startswith("plan_"):
        return [ChosenScenario(key) for key in planned_scenarios(word, context)], []
    if word.startswith("job_"):
        return _scenarios_of_job(word, context), []
    artifact, problem_id = one_scenario(word, context)
    return [ChosenScenario(artifact.artifact_id, problem_id)], []


def planned_scenarios(word: str, context: WorkflowContext) -> tuple[str, ...]:
    """Return the scenarios of a coverage plan so far, in the plan's order; ``plan_latest`` is the client's last plan.

    Raises:
        UnknownName: there is no such plan.
        NotPossible: it has no scenario yet.
    """
    plan = context.artifact("latest" if word == "plan_latest" else word, "plan")
    ids = PlanRows(context.workspace.database, plan.artifact_id).scenario_ids()
    if not ids:
        raise NotPossible(
            f"{plan.artifact_id} has no scenario so far",
            next_step="get_job waits for its job; if that is done, repeat generate_scenarios for the reasons",
        )
    return ids


def _scenarios_of_job(word: str, context: WorkflowContext) -> list[ChosenScenario]:
    """Return the scenarios that a batch's or a study's job began with, whatever the words of its call name now.

    Raises:
        UnknownName: there is no such job, or a scenario of it is gone.
        InvalidRequest: the job runs no planners.
    """
    job = context.jobs.store.get(word)
    if job.kind not in ("batch", "study"):
        raise InvalidRequest(
            f"{job.job_id} ({job.kind}) does not run planners on scenarios",
            valid=["a job of run_planner or optimize_planner"],
            next_step="use scenario ids, a search id or preset:10",
        )
    entries = (
        one if isinstance(one, str) else "#".join(str(part) for part in one if part is not None)
        for one in job.recipe.arguments["scenarios"]
    )
    chosen = [one_scenario(entry, context) for entry in entries]
    return [ChosenScenario(artifact.artifact_id, problem_id) for artifact, problem_id in chosen]


def _preset(word: str, context: WorkflowContext) -> tuple[list[ChosenScenario], list[str]]:
    """Return the first N scenarios of the catalogue with a planning problem, in an order that looks random.

    The order does not change. Edited scenarios are left out, including failures that a search found and reduced,
    because they would make the same call name other scenarios later, and count their bases twice. Generated scenarios
    follow the others, the oldest first, so that further ones change nothing.
    """
    number = word.removeprefix("preset:")
    if not re.fullmatch(r"\d+", number) or not 1 <= int(number) <= _LARGEST_PRESET:
        raise InvalidRequest(
            f"'{word}' is not preset:N with a whole number N from 1 to {_LARGEST_PRESET}",
            valid=[f"preset:{size}" for size in _PRESET_SIZES],
            given=word,
        )
    stored = context.workspace.newest(kind="scenario", limit=100_000)
    brought, generated, edited = list[str](), list[str](), 0
    for artifact in reversed(stored):
        record = artifact.read(ScenarioRecord)
        if not record.facts.egos:
            continue
        if record.origin == "modified":
            edited += 1
        else:
            (generated if record.origin == "generated" else brought).append(artifact.artifact_id)
    brought.sort(key=lambda key: hashlib.sha256(key.encode()).hexdigest())
    chosen = [ChosenScenario(key) for key in (brought + generated)[: int(number)]]
    left_out = f"; {counted(edited, 'edited scenario')} left out" if edited else ""
    notes = [f"{word}: only {counted(len(chosen), 'scenario')} with a planning problem{left_out}"]
    return chosen, notes if len(chosen) < int(number) else []


def _hits(word: str, context: WorkflowContext) -> tuple[list[ChosenScenario], list[str]]:
    """Return the hits of a search or, with ``:STAGE`` after its id, those left after that stage."""
    name, mark, stage = word.partition(":")
    search = context.artifact(name, "search")
    ids, notes = _stage_hits(search, stage, context) if mark else (_all_hits(search, context), [])
    if not ids:
        left = [f"{name}:{count.stage}" for count in search.read(SearchRecord).stages if count.left]
        raise NotPossible(
            f"{search.artifact_id} has no hits", valid=left, next_step="relax the search with find_scenarios"
        )
    return [_entry(key) for key in ids], notes


def _entry(scenario_id: str) -> ChosenScenario:
    scenario, _, problem = scenario_id.partition("#")
    return ChosenScenario(scenario, int(problem) if problem else None)


def _stage_hits(search: Artifact, stage: str, context: WorkflowContext) -> tuple[tuple[str, ...], list[str]]:
    """Return the ids left after the stage, alphabetically, and a remark if versions have changed since.

    Scenarios added after the search are not included.

    Raises:
        UnknownName: the search has no conditions for this stage, or an earlier stage left nothing.
    """
    record = search.read(SearchRecord)
    counts = {count.stage: count.left for count in record.stages}
    if stage not in counts:
        valid = [f"{search.artifact_id}:{name}" for name in counts]
        raise UnknownName(f"{search.artifact_id} has no stage '{stage}'", valid=valid)
    again = opened_search(record.arguments, context)
    numbers = next((left.numbers for left in again.funnel.stages if left.stage == stage), ())
    known = _known_at_search(search, numbers)
    changed = len(known) != counts[stage]
    note = f"{search.artifact_id}:{stage} left {counts[stage]}; {len(known)} of them are unchanged in the catalogue"
    entries = entries_of(context.workspace.database.connection(), known)
    return tuple(entry.scenario_id for entry in entries), [note] if changed else []


def _known_at_search(search: Artifact, numbers: Iterable[int]) -> list[int]:
    """Return those entries that were in the catalogue when a search was stored."""
    return [number for number in numbers if number < search.sequence * MOST_ENTRIES]


def _all_hits(search: Artifact, context: WorkflowContext) -> tuple[str, ...]:
    """Return the ids of all hits. If only the first are stored, the others follow alphabetically from a new search.

    Scenarios added after the search are not included.
    """
    record = search.read(SearchRecord)
    if record.total is None:
        return record.scenario_ids
    matches = opened_search(record.arguments, context).funnel.matches
    entries = entries_of(context.workspace.database.connection(), _known_at_search(search, matches))
    return tuple(dict.fromkeys((*record.scenario_ids, *(entry.scenario_id for entry in entries))))


def searched_within(search_id: str | None, context: WorkflowContext) -> tuple[str, ...] | None:
    """Return the hits of the refined search, or a plan's scenarios; None means the whole catalogue."""
    if search_id is not None and search_id.startswith("plan_"):
        return planned_scenarios(search_id, context)
    return None if search_id is None else _all_hits(context.artifact(search_id, "search"), context)


def opened_search(arguments: FindScenariosArguments, context: WorkflowContext) -> Search:
    """Return a search of the workspace's catalogue, using the cached index.

    Raises:
        UnknownName: a word is outside the vocabularies.
        InvalidRequest: a condition is malformed.
    """
    database = context.workspace.database
    return Search(database.connection(), arguments, searched_within(arguments.within, context), database.kept(Postings))
