"""Requests that have to be refused: those of the corpus as a caller would pass them on, and drawn ones for every file.

The corpus gives a reason as a code, and the words of the request; the edits here say the same words as arguments. What
a refusal has to name follows from the code and from the edit that fails.
"""

from collections.abc import Mapping
from typing import Any, Final

from plannerforge.engine.edits.changes import not_drivable
from plannerforge.engine.edits.scene import Scene
from plannerforge.evals.modification_requests import Asked, edit_of
from plannerforge.schemas.modification import Edit

EditWords = dict[str, Any]

CORPUS: Final[Mapping[str, tuple[tuple[EditWords, ...], tuple[str, ...]]]] = {
    "modT-d041": (({"op": "reroute", "vehicles": ["495"], "to": ["40"]},), ("no vehicle 495",)),
    "modT-d042": (({"op": "reroute", "vehicles": ["31033"], "to": ["402"]},), ("no vehicle 31033",)),
    "modT-d043": (({"op": "reroute", "vehicles": ["332"], "to": ["338"]},), ("338 is no lanelet",)),
    "modT-d048": (({"op": "reroute", "vehicles": ["ego"], "to": ["290"]},), ("is the ego", "set_goal")),
    "modT-d049": (({"op": "reroute", "vehicles": ["30749"]},), ("'to'",)),
    "modT-d050": (({"op": "reroute", "vehicles": ["one:motorcycle"], "to": ["1155"]},), ("there are", "motorcycle")),
    "modB-d041": (({"op": "set_behaviour", "vehicles": ["317"], "preset": "drunk"},), ("preset 'drunk'",)),
    "modB-d042": (({"op": "set_behaviour", "vehicles": ["11006"], "preset": "zen"},), ("preset 'zen'",)),
    "modB-d043": (({"op": "set_behaviour", "vehicles": ["260"], "preset": "aggressive"},), ("no vehicle 260",)),
    "modB-d044": (({"op": "set_behaviour", "vehicles": ["97"], "preset": "eco"},), ("no vehicle 97",)),
    "modB-d045": (({"op": "set_behaviour", "vehicles": ["class:truck"], "preset": "cautious"},), ("has no truck",)),
    "modB-d046": (({"op": "set_behaviour", "vehicles": ["338"], "params": ["tau=-1"]},), ("tau=-1 is out of range",)),
    "modB-d047": (({"op": "set_behaviour", "vehicles": ["523"], "params": ["hornLevel=0.7"]},), ("'hornLevel'",)),
    "modB-d048": (
        ({"op": "set_behaviour", "vehicles": ["ego"], "preset": "cautious"},),
        ("is the ego", "configure_planner"),
    ),
    "modB-d049": (({"op": "set_behaviour", "vehicles": ["341"]},), ("preset",)),
    "modB-d050": (({"op": "set_behaviour", "preset": "aggressive"},), ("vehicle",)),
    "modP-d041": (({"op": "remove_vehicle", "vehicles": ["30673"]},), ("no vehicle 30673",)),
    "modP-d042": (({"op": "remove_vehicle", "vehicles": ["460"]},), ("no vehicle 460",)),
    "modP-d043": (({"op": "remove_vehicle", "vehicles": ["class:bus"]},), ("has no bus",)),
    "modP-d044": (
        ({"op": "add_vehicle", "vehicle_class": "pedestrian", "at": "4"},),
        ("pedestrian is not allowed",),
    ),
    "modP-d045": (({"op": "add_vehicle", "vehicle_class": "tank", "at": "52804"},), ("class 'tank'",)),
    "modP-d046": (
        ({"op": "add_vehicle", "vehicle_class": "car", "at": "30222", "position": "middle"},),
        ("30222 is no lanelet",),
    ),
    "modP-d047": (({"op": "add_vehicle", "vehicle_class": "car", "at": "ego", "lane": "left"},), ("no lane", "left")),
    "modP-d048": (({"op": "add_vehicle", "vehicle_class": "car", "at": "vehicle:20026"},), ("taken", "20026")),
    "modP-d049": (({"op": "add_vehicle", "vehicle_class": "truck"},), ("needs a place",)),
    "modP-d050": (({"op": "remove_vehicle", "vehicles": ["one:car"]},), ("there are", "car")),
    "modG-d041": (({"op": "set_goal", "to": ["400"]},), ("400 is no lanelet",)),
    "modG-d042": (({"op": "set_goal", "to": ["258"], "position": "final"},), ("258 is no lanelet",)),
    "modG-d047": (
        ({"op": "set_goal", "to": ["35"], "position": "middle", "rectangle_m": [6.0, 0.0]},),
        ("[6.0, 0.0]",),
    ),
    "modG-d048": (({"op": "set_goal"},), ("lanelet", "'to'")),
    "modG-d050": (({"op": "set_goal", "position": "final"},), ("lanelet", "'to'")),
    "modC-d026": (
        (
            {"op": "reroute", "vehicles": ["30203"], "to": ["453"]},
            {"op": "remove_vehicle", "vehicles": ["30213"]},
        ),
        ("no vehicle 30213", "edit 1"),
    ),
    "modC-d027": (
        (
            {"op": "set_behaviour", "vehicles": ["324"], "preset": "aggressive"},
            {"op": "set_goal", "to": ["31075"], "position": "middle"},
        ),
        ("31075 cannot be reached by the ego", "edit 1"),
    ),
    "modC-d028": (
        (
            {"op": "add_vehicle", "vehicle_class": "car", "at": "299", "position": "beginning"},
            {"op": "set_behaviour", "vehicles": ["326"], "preset": "zombie"},
        ),
        ("preset 'zombie'", "edit 1"),
    ),
    "modC-d029": (
        ({"op": "reroute", "vehicles": ["3099"], "to": ["371"]}, {"op": "remove_vehicle", "vehicles": ["3108"]}),
        ("371 cannot be reached by vehicle 3099", "edit 0"),
    ),
    "modC-d030": (
        ({"op": "remove_vehicle", "vehicles": ["32"]}, {"op": "reroute", "vehicles": ["32"], "to": ["48063"]}),
        ("32", "removed"),
    ),
}
"""Lines whose ground truth holds no edit that could be passed on: the edits of their words, and what is to be named."""


def corpus_refusal(row: Mapping[str, Any]) -> Asked | None:
    """A line that is to be refused, as arguments; None where nothing can be passed on that has to be refused.

    That is so where going on with a stated assumption is right too, as with "two thirds along the lanelet".
    """
    truth = row["truth"]
    if row["id"] in CORPUS:
        edits, words = CORPUS[row["id"]]
        return Asked("refuse", tuple(Edit.model_validate(edit) for edit in edits), must_name=words)
    requested = truth.get("requested", ())
    if not requested or any("infeasible" in one for one in requested) or "ok" in truth.get("also_accept", ()):
        return None
    failing = requested[truth.get("failing_edit", 0)]
    return Asked("refuse", tuple(edit_of(one) for one in requested), must_name=_words(truth["reason"], failing))


def drawn_refusals(scene: Scene) -> list[Asked]:
    """Requests that no scenario allows, each with what the reason has to name."""
    unknown = str(max([*scene.tracks, *scene.layout.table.lanes, 0]) + 7_654_321)
    goal = unknown if scene.ego is not None and scene.ego.lanelets else "no ego"
    asked: list[tuple[EditWords, tuple[str, ...]]] = [
        ({"op": "remove_vehicle", "vehicles": [unknown]}, (f"no vehicle {unknown}",)),
        ({"op": "set_behaviour", "vehicles": ["ego"], "preset": "eco"}, ("is the ego",)),
        ({"op": "set_goal", "to": [unknown]}, (goal,)),
        ({"op": "add_vehicle", "vehicle_class": "tram", "at": "ego"}, ("'tram'",)),
        ({"op": "add_vehicle", "vehicle_class": "car", "at": unknown}, (f"{unknown} is no lanelet",)),
    ]
    vehicle = _vehicle(scene)
    if vehicle is not None:
        named = [str(vehicle)]
        asked += [
            ({"op": "reroute", "vehicles": named, "to": [unknown]}, (f"{unknown} is no lanelet",)),
            ({"op": "set_behaviour", "vehicles": named, "preset": "furious"}, ("'furious'",)),
            ({"op": "set_behaviour", "vehicles": named, "params": ["hornLevel=2"]}, ("'hornLevel'",)),
            ({"op": "set_behaviour", "vehicles": named, "params": ["sigma=1.5"]}, ("sigma=1.5 is out of range",)),
            *_unreachable(scene, vehicle),
        ]
    return [Asked("refuse", (Edit.model_validate(edit),), must_name=words) for edit, words in asked]


def _words(reason: str, failing: Mapping[str, Any]) -> tuple[str, ...]:
    """What a refusal for a reason has to name of the edit that fails."""
    if reason == "infeasible_time":
        return ("out of reach", "goal_time")
    if reason == "unreachable_target" and failing["op"] == "set_goal":
        return (f"{failing['lanelet']} cannot be reached by the ego",)
    if reason == "unreachable_target":
        return (f"{failing['target_lanelets'][0]} cannot be reached by vehicle {failing['vehicle_id']}",)
    raise ValueError(f"no words are known for the reason {reason}")


def _vehicle(scene: Scene) -> int | None:
    """A vehicle that can be edited; one with the planning problem's id is taken for the ego."""
    problem = scene.ego.problem_id if scene.ego is not None else None
    return next((key for key in scene.tracks if key != problem and not not_drivable(scene, key)), None)


def _unreachable(scene: Scene, vehicle_id: int) -> list[tuple[EditWords, tuple[str, ...]]]:
    """A reroute to a lanelet that no way leads to; empty where every lanelet can be reached."""
    start = scene.matches[vehicle_id].sequence[0]
    reached = {start, *scene.lanelet_graph.reachable([start])}
    beyond = next((key for key in scene.layout.table.lanes if key not in reached), None)
    if beyond is None:
        return []
    edit = {"op": "reroute", "vehicles": [str(vehicle_id)], "to": [str(beyond)]}
    return [(edit, (f"{beyond} cannot be reached by vehicle {vehicle_id}",))]
