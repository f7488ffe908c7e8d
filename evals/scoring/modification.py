"""Scores modification: whether the written file has the requested edits, and nothing else.

The columns are those of the paper (Scenario Modification Module, Evaluation Metrics), judged in the files. The first
are ``xml`` (the file exists), ``tgt`` (the vehicle still exists), ``ends`` (it drives onto the target, or is on a route
there when the recording ends). Next are ``preserve`` and ``others`` (vehicles reported as untouched have identical
bytes), ``preset``, ``tgt_chg``, ``count_match``, ``edge``, ``pos_gt``, ``edge_gt``.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import shapely

from ..attempts import Attempt, EvalRequest, MadeCall, Score
from .common import is_close, last_of, refused, scored
from .files import Lanelet, RoadUser, SceneFile, World

_SHARES = {"beginning": 0.0, "quarter": 0.25, "middle": 0.5, "three_quarter": 0.75, "final": 1.0}
_NEAR_M = 2.0
"""Tolerance for positions (rule 3 of the corpora)."""
_GOAL_M = 10.0
"""Maximum distance of a goal's middle from the position's station: half of a long rectangle is inside the lanelet."""
_ON_M = 0.75
"""A centre within this distance of a lanelet is on it."""
Columns = dict[str, bool | None]


def score_modification(request: EvalRequest, attempt: Attempt, workspace: Path) -> Score:
    """Score the last scenario made from the requested scenario."""
    if request.expect == "refuse":
        return refused(request, attempt, "modify_scenario")
    made = last_of(attempt.calls, "modify_scenario")
    if made is None:
        return scored(request, {"xml": False}, ["no edit was carried out"])
    return scored(request, edit_columns(request.truth["edits"], made, World(workspace)))


def edit_columns(truths: Sequence[Mapping[str, Any]], made: MadeCall, world: World) -> Columns:
    """Return, by column, whether a written scenario meets the check, for all edits together."""
    scene = world.scene(str(made.structured.get("scenario_id")))
    base = world.scene(str(made.structured.get("base_id")))
    if scene is None or base is None:
        return {"xml": False}
    reports = list(made.structured.get("edits", []))[-len(truths) :]
    columns: Columns = {"xml": True, "preserve": _untouched_are_so(made, scene, base)}
    columns["edits"] = len(reports) == len(truths)
    requested = world.recipe(str(made.structured["scenario_id"])).get("arguments", {}).get("edits", [])
    for index, truth in enumerate(truths):
        report = reports[index] if index < len(reports) else {}
        for name, verdict in _checks(truth, report, scene, base, requested).items():
            columns[name] = verdict and columns.get(name) is not False
    return columns


def _checks(
    truth: Mapping[str, Any],
    report: Mapping[str, Any],
    scene: SceneFile,
    base: SceneFile,
    asked: Sequence[Mapping[str, Any]],
) -> dict[str, bool]:
    op = truth["op"]
    if op == "reroute":
        keys = [truth["vehicle_id"]] if truth.get("vehicle_id") is not None else _ids(truth, report)
        targets = set(truth["target_lanelets"])
        return {
            "tgt": all(key in scene.users for key in keys),
            "ends": bool(keys) and all(_ends(scene, key, targets) for key in keys if key in scene.users),
        }
    if op == "set_behaviour":
        return {"tgt": _same_ids(truth, report), "preset": _behaves(truth, asked)}
    if op == "remove_vehicle":
        keys = _ids(truth, report)
        gone = bool(keys) and all(key in base.users and key not in scene.users for key in keys)
        return {"tgt_chg": gone, "count_match": _same_ids(truth, report)}
    if op == "add_vehicle":
        return _added(truth, report, scene, base)
    return _goal(truth, scene)


def _ids(truth: Mapping[str, Any], report: Mapping[str, Any]) -> list[int]:
    """Return the ids of an edit's vehicles: from the ground truth, or as resolved if only a rule is known."""
    known = truth.get("vehicle_ids")
    return [int(key) for key in (report.get("vehicles", []) if known is None else known)]


def _same_ids(truth: Mapping[str, Any], report: Mapping[str, Any]) -> bool:
    known = truth.get("vehicle_ids")
    there = [int(key) for key in report.get("vehicles", [])]
    selector = truth.get("selector", {})
    if known is not None and selector.get("by") != "new" and not selector.get("include_new"):
        return set(map(int, known)) == set(there)
    return len(there) == int(selector["n"]) if "n" in selector else bool(there)


def _ends(scene: SceneFile, key: int, targets: set[int]) -> bool:
    """Return whether a vehicle drives over a target, or is on a route to one when its recording ends."""
    user = scene.users[key]
    if any(_is_on(scene.lanelets.get(target), user) for target in targets):
        return True
    last = user.states[max(user.states)]
    under = scene.under(last.x, last.y, _ON_M)
    return bool(_reached(scene, under) & targets)


def _is_on(lane: Lanelet | None, user: RoadUser) -> bool:
    if lane is None:
        return False
    points = shapely.points([(state.x, state.y) for state in user.states.values()])
    return bool(shapely.dwithin(lane.polygon, points, _ON_M).any())


def _reached(scene: SceneFile, begin: Iterable[int]) -> set[int]:
    """Return the lanelets that successors and neighbours of the same direction reach."""
    reached, todo = set(begin), list(begin)
    while todo:
        lane = scene.lanelets.get(todo.pop())
        if lane is None:
            continue
        adjoining = [
            lane.adjacent_left if lane.left_is_same else None,
            lane.adjacent_right if lane.right_is_same else None,
        ]
        for key in (*lane.successors, *adjoining):
            if key is not None and key not in reached:
                reached.add(key)
                todo.append(key)
    return reached


def _behaves(truth: Mapping[str, Any], requested: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether preset and parameters are as requested, according to the recipe of the written file."""
    preset, params = truth.get("preset"), {name: float(value) for name, value in truth.get("params", {}).items()}
    for edit in requested:
        if edit.get("op") != "set_behaviour" or str(edit.get("preset") or "").lower() != str(preset or "").lower():
            continue
        given = dict(_assigned(str(text)) for text in edit.get("params") or [])
        if set(given) == set(params) and all(is_close(given[name], value) for name, value in params.items()):
            return True
    return False


def _assigned(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        return name.strip(), math.nan


def _added(truth: Mapping[str, Any], report: Mapping[str, Any], scene: SceneFile, base: SceneFile) -> dict[str, bool]:
    new = [scene.users[key] for key in report.get("vehicles", []) if key in scene.users and key not in base.users]
    right = len(new) == truth.get("count", 1)
    places = truth.get("resolved") or []
    speed = truth.get("speed_mps")
    return {
        "tgt_chg": bool(new),
        "count_match": right,
        "place": all(any(_begins_at(scene, user, place) for user in new) for place in places),
        "speed": speed is None or all(abs(user.first.speed - speed) < max(1.0, 0.2 * speed) for user in new),
    }


def _begins_at(scene: SceneFile, user: RoadUser, place: Mapping[str, Any]) -> bool:
    """Return whether a vehicle begins near a position in m along a lanelet.

    The tolerance includes half the vehicle's length, because a vehicle at the end of a lanelet is moved inwards by it.
    """
    lane = scene.lanelets.get(int(place["lanelet"]))
    if lane is None:
        return False
    spot = shapely.Point(user.first.x, user.first.y)
    off_m = abs(lane.centre.project(spot) - float(place["s_m"]))
    return bool(lane.polygon.distance(spot) <= _ON_M) and off_m <= _NEAR_M + user.length / 2


def _goal(truth: Mapping[str, Any], scene: SceneFile) -> dict[str, bool]:
    goal = scene.problems[0].goals[0]
    lane = scene.lanelets.get(int(truth["lanelet"]))
    if lane is None:
        return {"edge": False, "edge_gt": False}
    middle = goal.areas[0].centroid if goal.areas else None
    on_it = int(truth["lanelet"]) in goal.lanelets or (middle is not None and lane.polygon.distance(middle) <= _ON_M)
    checks = {"edge": on_it, "edge_gt": on_it}
    if middle is not None:
        station = lane.centre.project(middle)
        wanted = _SHARES.get(truth.get("position") or "final", 1.0) * lane.length
        checks["pos_gt"] = abs(station - wanted) <= _GOAL_M
    if truth.get("time"):
        start = scene.problems[0].start.step
        window = ((goal.first_step - start) * scene.step_s, (goal.last_step - start) * scene.step_s)
        ends = (truth["time"].get("start_s"), truth["time"].get("end_s"))
        checks["time"] = all(end is None or abs(at - end) < 0.11 for at, end in zip(window, ends, strict=True))
    return checks


def _untouched_are_so(made: MadeCall, scene: SceneFile, base: SceneFile) -> bool:
    """Return whether all vehicles that the answer does not list as touched or removed are as recorded."""
    named = {int(one["vehicle_id"]) for one in made.structured.get("touched", [])}
    named |= {int(key) for key in made.structured.get("removed", [])}
    return all(scene.texts.get(key) == text for key, text in base.texts.items() if key not in named)
