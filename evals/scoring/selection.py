"""Scores selection: the search, slot by slot, and whether its results meet every condition.

Columns of the paper (Scenario Selection Module, Evaluation Metrics): ``sat_any5``, ``sat_top1``, ``sat_all``; and the
five slots, each met if the call's conditions are those of the ground truth.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...engine.maps import country_code
from ...schemas.errors import PlannerForgeError
from ...schemas.grammar import parse_condition
from ..attempts import Attempt, EvalRequest, Score
from ..ground_truth.selection import arguments_of
from .common import last_of, scored
from .files import World

_FIRST = 5
"""Results that count as seen: as many as the paper's interface shows."""
_NO_SEARCH: Mapping[str, bool | None] = {"sat_any5": False, "sat_top1": False, "sat_all": False}


def score_selection(request: EvalRequest, attempt: Attempt, workspace: Path) -> Score:
    """Score the last search by comparing its results with the ids that satisfy every slot."""
    search = last_of(attempt.calls, "find_scenarios")
    if search is None:
        return scored(request, _NO_SEARCH, ["no search was carried out"])
    found = [str(match["scenario_id"]) for match in search.structured.get("matches", [])]
    recipe = World(workspace).recipe(str(search.structured.get("search_id")))
    slots = _slots(request, {**search.arguments, **recipe.get("arguments", {})})
    if request.expect == "empty":
        none = not found and int(search.structured.get("total", 0)) == 0
        return scored(request, {**slots, "empty": none}, [] if none else [f"returned {found[:3]}, but nothing matches"])
    right = set(request.truth["matching_ids"])
    columns = {
        "sat_any5": bool(right & set(found[:_FIRST])),
        "sat_top1": bool(found) and found[0] in right,
        "sat_all": bool(found) and set(found) <= right,
    }
    wrong = [key for key in found if key not in right]
    misses = [f"{len(wrong)} of {len(found)} do not match, such as {wrong[:2]}"] if wrong else []
    misses += [] if found else ["nothing was found"]
    score = scored(request, columns, misses)
    return Score(score.request_id, score.done, {**slots, **columns}, score.misses)


def _slots(request: EvalRequest, given: Mapping[str, Any]) -> dict[str, bool | None]:
    truth = arguments_of(dict(request.truth))
    return {
        "location": (_country(truth.country), _plain(truth.city))
        == (_country(given.get("country")), _plain(given.get("city"))),
        "tags": sorted(truth.tags) == sorted(map(str, given.get("tags") or [])),
        "road_net": _conditions(truth.road_net) == _conditions(given.get("road_net")),
        "obstacles": _conditions(truth.obstacles) == _conditions(given.get("obstacles")),
        "velocity": (truth.ego_speed is None) == (given.get("ego_speed") is None),
    }


def _country(word: object) -> str:
    return "" if not word else country_code(str(word)) or str(word).upper()


def _plain(word: object) -> str:
    return "".join(letter for letter in str(word or "").lower() if letter.isalnum())


def _conditions(texts: object) -> frozenset[str]:
    """Return conditions in a canonical form, however they are written."""
    listed = texts if isinstance(texts, list | tuple) else [texts] if texts else []
    return frozenset(_canonical(str(text)) for text in listed)


def _canonical(text: str) -> str:
    try:
        read = parse_condition(text)
    except PlannerForgeError:
        return text.strip().lower()
    return (
        f"{'!' if read.negated else ''}{read.name}@{read.scope} {read.value} {read.interval.low}..{read.interval.high}"
    )
