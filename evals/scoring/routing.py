"""Scores routing: which of the paper's nine classes the calls of an attempt belong to, and in which order.

Columns (Module Router, Evaluation Metrics): ``json`` (there were calls or a refusal), ``key`` (the classes), ``value``
(the classes and the letters of edits, in order), ``set`` (the letters, in any order), ``order``.
"""

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from ...schemas.modification import EDITS
from ...server.arguments.loose_reading import read_loosely
from ...tools.registry import TOOLS
from ..attempts import Attempt, EvalRequest, MadeCall, Score
from .common import scored

_LOOK = "look"
_QUESTIONS = ("describe_catalog", "describe_scenario", "find_scenarios", "list_artifacts")


def score_routing(request: EvalRequest, attempt: Attempt, workspace: Path) -> Score:
    """Score the classes of the calls against those of the request, or against accepted alternatives."""
    del workspace
    classes, letters = classes_of(attempt)
    if request.expect == "clarify" and attempt.ending == "asked":
        return scored(request, {"key": True})
    answers = [request.truth, *request.truth.get("accept", [])]
    verdicts = [_verdicts(answer, classes, letters) for answer in answers]
    best = max(verdicts, key=lambda columns: sum(verdict is not False for verdict in columns.values()))
    columns = {"json": bool(classes), **best}
    return scored(request, columns, [f"calls are {classes} {letters}, requested is {request.truth}"])


def _verdicts(truth: Mapping[str, Any], classes: Sequence[str], letters: str) -> dict[str, bool | None]:
    wanted, edits = list(truth["actions"]), truth.get("vehicle_mod", "")
    key = wanted == list(classes)
    composite = len(edits) > 1
    return {
        "key": key,
        "value": key and edits == letters,
        "set": set(edits) == set(letters) if edits else None,
        "order": edits == letters if composite else None,
    }


def classes_of(attempt: Attempt) -> tuple[list[str], str]:
    """Return the classes of the calls in order without repeats, and the letters of edits in canonical order.

    An attempt without calls is a question about the tool or, if the agent refused, ``fail``.
    """
    letters = {_letter(edit) for call in attempt.calls for edit in _edits(call)}
    classes = [name for name, _ in groupby(filter(None, map(_class, attempt.calls)))]
    found = "".join(letter for letter in "TBPG" if letter in letters)
    work = [name for name in classes if name != _LOOK]
    if not work:
        answered = bool(classes) or (attempt.ending == "answered" and bool(attempt.answers))
        return ["qa" if answered and attempt.ending != "refused" else "fail"], found
    return [*work, *(["qa"] if classes[-1] == _LOOK else [])], found


def _as_read(call: MadeCall) -> Mapping[str, Any]:
    """Return the arguments as the server reads them, whatever their form."""
    model = next((spec.arguments_type for spec in TOOLS if spec.name == call.tool), None)
    return call.arguments if model is None else read_loosely(model, call.arguments).values


def _letter(edit: Mapping[str, Any]) -> str:
    """Return the paper's letter of an edit; empty for an unknown operation."""
    kind = next((kind for name, kind in EDITS.items() if name == edit.get("op")), None)
    return kind.letter if kind else ""


def _edits(call: MadeCall) -> Sequence[Mapping[str, Any]]:
    edits = _as_read(call).get("edits", []) if call.tool == "modify_scenario" else []
    return [edit for edit in edits if isinstance(edit, Mapping)] if isinstance(edits, list) else []


def _class(call: MadeCall) -> str:
    """Return the class of a call; a query that only prepares other work has no class of its own."""
    if call.tool == "modify_scenario":
        return "vehicle_mod"
    if call.tool == "configure_planner":
        return "param_mod"
    if call.tool == "list_planners":
        return "param_qa"
    if call.tool == "run_planner":
        return "batch_sim"
    if call.tool == "list_artifacts" and _as_read(call).get("kind") == "batch":
        return "batch_qa"
    if call.tool in ("analyze_results", "compare_results"):
        named = [str(word) for word in _as_read(call).get("results") or ["latest_run"]]
        several = len(named) > 1 or any("batch" in word for word in named)
        return "batch_analysis" if several else "analysis"
    return _LOOK if call.tool in _QUESTIONS else ""
