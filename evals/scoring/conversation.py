"""Scores conversations: each turn by the content of the workspace after it, and the whole by all of its turns.

Columns: one for each kind of turn that occurs (``generate``, ``select``, ``modify``, ``test``, ``tune``, ``analyse``,
``compare``), met if every turn of the kind is.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..attempts import Attempt, EvalRequest, EvalTurn, MadeCall, Score
from .common import MAKING, is_close, last_of
from .files import World
from .generation import generation_columns
from .modification import edit_columns
from .tuning import tuning_columns

_NO_TRAJECTORY = ("invalid",)


def score_conversation(request: EvalRequest, attempt: Attempt, workspace: Path) -> Score:
    """Score every turn against its ground truth."""
    world = World(workspace)
    columns: dict[str, bool | None] = {}
    misses = []
    without_runs: set[int] = set()
    for number, turn in enumerate(request.turns):
        calls = [call for call in attempt.calls if call.turn == number]
        if "test" in turn.action and _lacks_planner(turn.truth, calls):
            without_runs.add(number + 1)
            continue
        about = turn.truth.get("compare", turn.truth)
        if without_runs & {about.get("about_turn"), *about.get("between_turns", ())}:
            continue
        for action in turn.action.split("+"):
            why = _turn(action, turn, calls, world, workspace)
            columns[action] = columns.get(action) is not False and not why
            misses += [f"turn {number + 1} ({action}): {why}"] if why else []
    return Score(request.request_id, done=not misses, columns=columns, misses=tuple(misses))


def _turn(action: str, turn: EvalTurn, calls: Sequence[MadeCall], world: World, workspace: Path) -> str:
    """Return an empty string if a turn is correct, otherwise the reason why it is not."""
    if turn.expect in ("refuse", "clarify"):
        made = last_of(calls, *MAKING)
        return "" if made is None else f"{made.tool} created something although a refusal was correct"
    truth = turn.truth
    if action == "generate":
        made = last_of(calls, "generate_scenarios")
        return _failed(generation_columns(truth, made, workspace) if made else None, "no scenario was created")
    if action == "select":
        return _selected(truth, calls, world)
    if action == "modify":
        made = last_of(calls, "modify_scenario")
        return _failed(edit_columns(truth["edits"], made, world) if made else None, "no edit was carried out")
    if action == "tune":
        made = last_of(calls, "configure_planner")
        record = world.record("config", str(made.structured["config_id"])) if made else None
        return _failed(_tuned(truth, record["weights"]) if record else None, "no configuration was created")
    if action == "test":
        return _tested(truth, calls, world)
    tools = ("analyze_results",) if action == "analyse" else ("compare_results",)
    return "" if last_of(calls, *tools) else f"{tools[0]} was not carried out"


def _lacks_planner(truth: Mapping[str, Any], calls: Sequence[MadeCall]) -> bool:
    """Return whether a run was refused because the server has no such planner, which is correct and ends the topic."""
    refusals = [call.text for call in calls if call.tool == "run_planner" and call.is_error]
    return any(f"no planner '{truth.get('planner')}'" in text for text in refusals)


def _failed(columns: Mapping[str, bool | None] | None, without: str) -> str:
    if columns is None:
        return without
    return ", ".join(f"{name} is not met" for name, verdict in columns.items() if verdict is False)


def _tuned(truth: Mapping[str, Any], weights: Mapping[str, float]) -> dict[str, bool | None]:
    expected = truth.get("expected_weights")
    columns = tuning_columns({**truth, "weights": expected, "preset": None, "explicit": {}}, {}, weights)
    return {name: verdict for name, verdict in columns.items() if name in ("yaml", "full_yaml", "direction")}


def _selected(truth: Mapping[str, Any], calls: Sequence[MadeCall], world: World) -> str:
    if "slots" not in truth:
        wanted = str(truth["scenario"]).removesuffix(".xml")
        named = {str(call.structured.get("scenario_id")) for call in calls if not call.is_error}
        named |= {str(one["scenario_id"]) for call in calls for one in call.structured.get("matches", [])[:1]}
        return "" if wanted in named else f"{wanted} was not chosen"
    search = last_of(calls, "find_scenarios")
    found = [] if search is None else [str(one["scenario_id"]) for one in search.structured.get("matches", [])]
    right = {str(name).removesuffix(".xml") for name in truth["slots"].get("matches", truth.get("matches", []))}
    made = {key for key in found if world.recipe(key).get("parents")}
    wrong = [key for key in found if key not in right and key not in made]
    if not found:
        return "nothing was found"
    return f"{wrong[:2]} do not match" if wrong else ""


def _tested(truth: Mapping[str, Any], calls: Sequence[MadeCall], world: World) -> str:
    made = last_of(calls, "run_planner", "get_job")
    if made is None:
        return "no run was made"
    runs = [run for one in _runs_of(made) if (run := world.record("run", one)) is not None]
    if not runs:
        return "no run is stored"
    expected = truth.get("expected_weights") or {}
    for run in runs:
        record = world.record("config", str(run["config_id"])) or {}
        weights = record.get("weights", {})
        off = [name for name, value in expected.items() if not is_close(float(weights.get(name, -1)), float(value))]
        if off and len({one["config_id"] for one in runs}) == 1:
            return f"weights differ: {off}"
        if run["traffic"] != truth["traffic"]:
            return f"traffic is {run['traffic']}"
        if run["outcome"] in _NO_TRAJECTORY:
            return f"{run['run_id']} is invalid: {run['reason']}"
    return ""


def _runs_of(made: MadeCall) -> list[str]:
    return [str(run["run_id"]) for run in made.structured.get("runs", [])]
