"""Which scenarios the words of a call mean: ids, ``ID#problem``, a search, a stage of one, or ``preset:N``."""

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass

from plannerforge.engine.catalog.starter import open_catalogue
from plannerforge.engine.workspace.artifacts import Artifact
from plannerforge.schemas.catalog import SearchRecord
from plannerforge.schemas.errors import InvalidRequest, NotPossible, UnknownName
from plannerforge.schemas.scenarios import ScenarioRecord
from plannerforge.tools.call import ToolCall
from plannerforge.tools.search_stages import stage_hits

LARGEST_PRESET = 500
PRESET_SIZES = (10, 50, 100, 200, 300, 400, 500)


@dataclass(frozen=True)
class ChosenScenario:
    """A scenario and one of its planning problems (None: the first)."""

    scenario_id: str
    problem_id: int | None = None


@dataclass(frozen=True)
class Choice:
    """The scenarios in order, each once, and remarks."""

    scenarios: tuple[ChosenScenario, ...]
    notes: tuple[str, ...]


def choose_scenarios(words: Sequence[str], call: ToolCall) -> Choice:
    """Resolve the words of a call; ``latest`` and ``search:latest`` become concrete ids.

    Raises:
        UnknownName: a scenario, planning problem, search or stage of it that does not exist.
        InvalidRequest: ``preset:`` without a number from 1 to 500.
        NotPossible: a search without hits, or no scenario that could be run.
    """
    open_catalogue(call.workspace, with_starter=call.services.with_starter)
    chosen: dict[ChosenScenario, None] = {}
    notes: list[str] = []
    for word in words:
        found, remarks = _meant(word.strip(), call)
        chosen.update(dict.fromkeys(found))
        notes += remarks
    if not chosen:
        raise NotPossible("no scenario is left to run", next_step="name scenario ids, a search id or preset:10")
    return Choice(tuple(chosen), tuple(notes))


def _meant(word: str, call: ToolCall) -> tuple[list[ChosenScenario], list[str]]:
    if word.startswith("preset:"):
        return _preset(word, call)
    if word.startswith(("search:", "search_")):
        return _hits(word.removeprefix("search:"), call)
    artifact, problem_id = one_scenario(word, call)
    return [ChosenScenario(artifact.artifact_id, problem_id)], []


def _hits(word: str, call: ToolCall) -> tuple[list[ChosenScenario], list[str]]:
    """The hits of a search, or with ``:STAGE`` behind its id what one of its stages left."""
    name, mark, stage = word.partition(":")
    search = call.workspace.get(name, "search")
    ids, notes = stage_hits(search, stage, call) if mark else (search.read(SearchRecord).scenario_ids, [])
    if not ids:
        left = [f"{name}:{one.stage}" for one in search.read(SearchRecord).stages if one.left]
        raise NotPossible(f"{word} has no hits", valid=left, next_step="relax the search with find_scenarios")
    return [_entry(key) for key in ids], notes


def _entry(scenario_id: str) -> ChosenScenario:
    scenario, _, problem = scenario_id.partition("#")
    return ChosenScenario(scenario, int(problem) if problem else None)


def one_scenario(word: str, call: ToolCall) -> tuple[Artifact, int | None]:
    """The scenario that an id or ``ID#problem`` names, and the planning problem; None where none is named.

    Raises:
        UnknownName: there is no such scenario or planning problem.
    """
    scenario, mark, problem = word.partition("#")
    artifact = call.workspace.get(scenario, "scenario")
    if not mark:
        return artifact, None
    known = [ego.problem_id for ego in artifact.read(ScenarioRecord).facts.egos]
    if not re.fullmatch(r"\d+", problem) or int(problem) not in known:
        raise UnknownName(f"{artifact.artifact_id} has no planning problem '{problem}'", valid=known)
    return artifact, int(problem)


def _preset(word: str, call: ToolCall) -> tuple[list[ChosenScenario], list[str]]:
    """The first N scenarios with a planning problem, in an order that looks random but is always the same."""
    number = word.removeprefix("preset:")
    if not re.fullmatch(r"\d+", number) or not 1 <= int(number) <= LARGEST_PRESET:
        raise InvalidRequest(f"'{word}' names no size", valid=[f"preset:{size}" for size in PRESET_SIZES])
    stored = call.workspace.newest(kind="scenario", limit=100_000)
    runnable = [artifact.artifact_id for artifact in stored if artifact.read(ScenarioRecord).facts.egos]
    ordered = sorted(runnable, key=lambda key: hashlib.sha256(key.encode()).hexdigest())
    found = [ChosenScenario(key) for key in ordered[: int(number)]]
    few = [f"{word}: only {len(found)} scenarios with a planning problem are here"] if len(found) < int(number) else []
    return found, few
