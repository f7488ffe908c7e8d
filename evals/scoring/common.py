"""The common rules of scorers: which call counts, when a refusal or a question is correct, how a score is built.

The call that counts is the last accepted one of its tool: a model may correct a call, and the final state is what the
user has.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ...engine.tuning import named_configuration
from ...schemas.planning import PlannerConfiguration
from ..attempts import Attempt, EvalRequest, MadeCall, Score

MAKING = ("generate_scenarios", "modify_scenario", "configure_planner", "run_planner", "find_scenarios")
"""Tools that create something lasting if they succeed."""
TOLERANCE = 1e-3
"""Relative difference below which weights are equal (paper, Planner Testing and Enhancement, Evaluation Metrics)."""


def last_of(calls: Iterable[MadeCall], *tools: str) -> MadeCall | None:
    """Return the last accepted call of the given tools, or None."""
    return next((call for call in reversed(list(calls)) if call.tool in tools and not call.is_error), None)


def is_close(one: float, other: float) -> bool:
    """Return whether two weights are equal within the paper's tolerance."""
    return abs(one - other) <= TOLERANCE * max(abs(one), abs(other), TOLERANCE)


def scored(request: EvalRequest, columns: Mapping[str, bool | None], misses: Sequence[str] = ()) -> Score:
    """Return a score that is done if all applicable columns are met; by default, each failed column is a miss."""
    failed = [name for name, verdict in columns.items() if verdict is False]
    words = tuple(misses) or tuple(f"{name} is not met" for name in failed)
    return Score(request.request_id, done=not failed, columns=columns, misses=words if failed else ())


def score_question(request: EvalRequest, attempt: Attempt) -> Score:
    """Score a request that needs a question: one must be asked and nothing created, or an alternative accepted."""
    made = last_of(attempt.calls, *MAKING)
    accepted = "ok" in request.truth.get("also_accept", ()) and made is not None
    asks = attempt.ending == "asked" or (made is None and any("?" in answer for answer in attempt.answers))
    done = (asks and made is None) or accepted
    return Score(request.request_id, done, {"asked": done}, () if done else ("did not ask back",))


def refused(request: EvalRequest, attempt: Attempt, *tools: str) -> Score:
    """Score a request that must be refused, by the tool or by the agent, without creating anything."""
    made = last_of(attempt.calls, *tools)
    is_refusal = attempt.ending in ("refused", "asked") or any(call.is_error for call in attempt.calls)
    accepted = "ok" in request.truth.get("also_accept", ())
    done = accepted or (made is None and is_refusal)
    why = f"created {_created_id(made)} although a refusal was correct" if made else "neither refused nor asked"
    return Score(request.request_id, done, {"refused": done}, () if done else (why,))


def _created_id(call: MadeCall | None) -> str:
    given: Mapping[str, Any] = {} if call is None else call.structured
    return str(given.get("scenario_id") or given.get("config_id") or given.get("search_id") or "something")


def built_in(name: str) -> PlannerConfiguration:
    """Return a configuration that comes with the package, such as ``frenetix:Default``.

    Raises:
        RuntimeError: there is no configuration with this name any more.
    """
    configuration = named_configuration(name)
    if configuration is None:
        raise RuntimeError(f"the built-in configuration {name} is gone")
    return configuration
