"""Scores tuning: the resulting configuration, weight by weight.

Columns of the paper (Planner Testing and Enhancement Module, Evaluation Metrics): ``yaml`` (a configuration was
created), ``struct`` (all weights of the planner), ``preset``, ``explicit``, ``full_yaml``, ``refused``.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...engine.tuning import named_configuration
from ..attempts import Attempt, EvalRequest, Score
from .common import is_close, last_of, refused, scored
from .files import World

MISSING_PLANNER = "no_such_planner"
"""Column of requests for a planner that the server does not have: a refusal that states this is correct."""


def score_tuning(request: EvalRequest, attempt: Attempt, workspace: Path) -> Score:
    """Score the last configuration against the weights that the request amounts to."""
    made = last_of(attempt.calls, "configure_planner")
    refusals = " ".join(call.text for call in attempt.calls if call.is_error)
    planner = str(request.truth["planner"])
    if made is None and f"'{planner}'" in refusals and "planner" in refusals:
        return scored(request, {MISSING_PLANNER: True})
    if request.expect == "refuse":
        return refused(request, attempt, "configure_planner")
    if made is None:
        return scored(request, {"yaml": False}, ["no configuration was created"])
    record = World(workspace).record("config", str(made.structured["config_id"])) or {}
    weights: Mapping[str, float] = record.get("weights", {})
    return scored(request, tuning_columns(request.truth, request.context, weights))


def tuning_columns(
    truth: Mapping[str, Any], context: Mapping[str, Any], weights: Mapping[str, float]
) -> dict[str, bool | None]:
    """Return, by column, whether a configuration's weights meet the check; None if the request does not involve it."""
    wanted: Mapping[str, float] | None = truth.get("weights")
    explicit: Mapping[str, float] = truth.get("explicit", {})
    complete = truth.get("weights_complete", True)
    columns: dict[str, bool | None] = {"yaml": bool(weights)}
    columns["struct"] = None if wanted is None or not complete else set(wanted) == set(weights)
    named = wanted or {}
    untouched = {name for name in named if name not in explicit and name not in truth.get("relative", {})}
    agrees = {name: name in weights and is_close(weights[name], value) for name, value in named.items()}
    columns["preset"] = all(agrees[name] for name in untouched) if truth.get("preset") and complete else None
    columns["explicit"] = (
        all(name in weights and is_close(weights[name], value) for name, value in explicit.items())
        if explicit
        else None
    )
    if truth.get("direction"):
        before = _weights_before(context)
        columns["direction"] = all(_moved(one, before, weights) for one in truth["direction"])
    else:
        columns["full_yaml"] = all(agrees.values()) if named else None
    return columns


def _weights_before(context: Mapping[str, Any]) -> Mapping[str, float]:
    """Return the weights before a request, by name."""
    named = named_configuration(f"{context.get('planner') or 'frenetix'}:{context.get('preset') or 'Default'}")
    weights = {} if named is None else dict(named.weights)
    return {**weights, **context.get("overrides", {}), **(context.get("weights") or {})}


def _moved(wanted: Mapping[str, Any], before: Mapping[str, float], after: Mapping[str, float]) -> bool:
    """Return whether one of the weights changed as requested; a weight that was unknown before starts at 0."""
    sign = 1 if wanted["sign"] == "up" else -1
    start = wanted.get("from", {})
    return any(
        sign * (after.get(name, 0.0) - float(start.get(name, before.get(name, 0.0)))) > 0 for name in wanted["any_of"]
    )
