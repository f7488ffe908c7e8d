"""Which vehicles an edit means: among those that the edits before it leave, at the ego's first time step."""

from collections.abc import Callable, Sequence

import numpy as np

from plannerforge.engine.edits.altered_scene import populated
from plannerforge.engine.edits.changes import Changes
from plannerforge.engine.edits.lane_order import leader_and_follower
from plannerforge.engine.edits.scene import NOT_DRIVEN, Ego, Scene
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.engine.traffic.vehicle_classes import vehicle_classes
from plannerforge.schemas.errors import InvalidRequest, NotPossible, UnknownName, closest
from plannerforge.schemas.grammar import SELECTORS, Selector, parse_selector

STANDING_MPS = 0.1
TIE = 1e-3
"""Speeds in m/s or distances in m that differ by less are the same to whoever describes a vehicle by them."""

NAME_ONE = "name one of these by its id; describe_scenario with detail=vehicles lists all"
EGO_WORDS = ("ego", "the ego", "me", "self")


def select(texts: Sequence[str], scene: Scene, changes: Changes) -> tuple[int, ...]:
    """Ids of the vehicles that the selectors mean together, ascending.

    Vehicles that earlier edits added count like recorded ones; those that they removed count no more.

    Raises:
        InvalidRequest: nothing is selected, or only exclusions are given.
        UnknownName: an id, class or word that does not exist.
        NotPossible: the ego, a removed vehicle, an ambiguous description, or a description that nobody fits.
    """
    there = populated(scene, changes)
    if not texts:
        raise InvalidRequest("no vehicle is named", valid=[*_listed(there), *SELECTORS[1:]], next_step="name vehicles")
    selectors = [_parsed(text, scene) for text in texts]
    wanted = [selector for selector in selectors if not selector.negated]
    if not wanted:
        raise InvalidRequest(
            "only exclusions are given", valid=["all", "class:car"], next_step="add whom they exclude from"
        )
    meant = {key for selector in wanted for key in _resolve(selector, there, changes)}
    excluded = {key for selector in selectors if selector.negated for key in _resolve(selector, there, changes)}
    left = tuple(sorted(meant - excluded))
    gone = _gone(there, changes) & set(left)
    if gone:
        raise NotPossible(
            f"vehicle {min(gone)} was removed by an earlier edit", valid=_listed(there), next_step="leave it out"
        )
    if not left:
        raise NotPossible(
            f"{', '.join(texts)} leaves no vehicle", valid=_listed(there), next_step="leave fewer of them out"
        )
    return left


def refuse_ego(text: str, scene: Scene) -> None:
    """Refuse the ego as a vehicle: it is not part of the traffic.

    Raises:
        NotPossible: always if the text names the ego or its planning problem.
    """
    body = text.strip().removeprefix("!").lower()
    if body in EGO_WORDS or (scene.ego is not None and body == str(scene.ego.problem_id)):
        raise NotPossible(
            f"'{text}' is the ego, which the planner drives and no edit of the traffic can",
            next_step="op set_goal moves the ego's goal; configure_planner changes how it drives",
        )


def nearest_ids(wanted: int, known: Sequence[int]) -> list[int]:
    """Known ids, those that differ least from the wanted one first."""
    return sorted(known, key=lambda key: (abs(key - wanted), key))


def _parsed(text: str, scene: Scene) -> Selector:
    refuse_ego(text, scene)
    return parse_selector(text)


def _resolve(selector: Selector, scene: Scene, changes: Changes) -> tuple[int, ...]:
    if selector.kind == "id":
        return (_known(int(selector.argument), scene, changes),)
    if selector.kind == "new":
        return _new(int(selector.argument), changes)
    if selector.kind == "all":
        return _vehicles(scene)
    if selector.kind == "class":
        return _of_class(selector.argument, scene)
    if selector.kind in ("one", "only"):
        return _the_only(f"{selector.argument}s", _of_class(selector.argument, scene), scene)
    if selector.kind in ("leftmost", "rightmost", "lane"):
        side = selector.argument if selector.kind == "lane" else selector.kind
        return _the_only(f"vehicles in the {side} lane", _outermost(side, scene), scene)
    return _described(selector, scene)


def _known(vehicle_id: int, scene: Scene, changes: Changes) -> int:
    gone = _gone(scene, changes)
    known = {*scene.tracks, *scene.standing, *_sets(scene)} - gone
    if vehicle_id not in known | gone:
        raise UnknownName(
            f"there is no vehicle {vehicle_id}", valid=nearest_ids(vehicle_id, sorted(known)), next_step=NAME_ONE
        )
    return vehicle_id


def _gone(scene: Scene, changes: Changes) -> set[int]:
    """Whom the edits so far removed; an added vehicle that was removed again has left no other trace."""
    return {*changes.removed, *(key for added in changes.added_by_edit for key in added if key not in scene.tracks)}


def _sets(scene: Scene) -> list[int]:
    return [int(obstacle.obstacle_id) for obstacle in scene.loaded.scenario.dynamic_obstacles]


def _new(edit: int, changes: Changes) -> tuple[int, ...]:
    if edit >= len(changes.added_by_edit) or not changes.added_by_edit[edit]:
        raise UnknownName(
            "new:K names what edit K of the same call adds, and that edit adds nothing before this one",
            valid=[key for added in changes.added_by_edit for key in added],
            next_step="name a vehicle by its id",
        )
    return changes.added_by_edit[edit]


def _vehicles(scene: Scene) -> tuple[int, ...]:
    return tuple(key for key, track in scene.tracks.items() if track.kind not in NOT_DRIVEN)


def _of_class(word: str, scene: Scene) -> tuple[int, ...]:
    kinds = {name: one.commonroad_type for name, one in vehicle_classes().items()}
    kinds |= {track.kind: track.kind for track in scene.tracks.values()} | {"pedestrian": "pedestrian"}
    if word not in kinds:
        raise UnknownName(
            f"there is no vehicle class '{word}'", valid=closest(word, sorted(kinds)), next_step="name one of these"
        )
    found = tuple(key for key, track in scene.tracks.items() if track.kind == kinds[word])
    if not found:
        raise NotPossible(f"the scenario has no {word}", valid=_listed(scene), next_step=NAME_ONE)
    return found


def _the_only(what: str, found: tuple[int, ...], scene: Scene) -> tuple[int, ...]:
    if len(found) != 1:
        raise NotPossible(
            f"there are {len(found)} {what}",
            valid=[_name(scene.tracks[key]) for key in found] or _listed(scene),
            next_step="name one by its id",
        )
    return found


def _outermost(side: str, scene: Scene) -> tuple[int, ...]:
    if side not in ("leftmost", "rightmost"):
        raise UnknownName(
            f"there is no lane '{side}'", valid=["lane:leftmost", "lane:rightmost"], next_step="name one of these"
        )
    found, step = [], scene.ego.step if scene.ego else 0
    for key in _vehicles(scene):
        index = scene.tracks[key].index_at(step)
        if key in scene.matches and index is not None:
            lane = scene.layout.table.lanes[scene.matches[key].at(index)]
            outer, inner = (lane.left, lane.right) if side == "leftmost" else (lane.right, lane.left)
            if outer is None and inner is not None:
                found.append(key)
    return tuple(found)


def _described(selector: Selector, scene: Scene) -> tuple[int, ...]:
    """Descriptions that hold at the first time step: by distance, speed or order in the ego's lane."""
    step = scene.ego.step if scene.ego else 0
    there = {key: scene.tracks[key] for key in _vehicles(scene) if scene.tracks[key].index_at(step) is not None}
    if not there:
        raise NotPossible(f"no vehicle is there at time step {step}", valid=_listed(scene), next_step=NAME_ONE)
    if selector.kind == "standing":
        return _fitting("stands at the start", [key for key in there if _speed(there[key], step) < STANDING_MPS], scene)
    if selector.kind in ("fastest", "slowest"):
        sign = -1.0 if selector.kind == "fastest" else 1.0
        return _first(selector, there, 1, lambda track: sign * _speed(track, step))
    ego = _ego(scene, selector)
    if selector.kind in ("lead", "follow"):
        found = leader_and_follower(scene, ego)[selector.kind == "follow"]
        return _fitting(f"is the ego's {selector.kind}", [] if found is None else [found], scene)
    sign, count = (-1.0, 1) if selector.kind == "farthest" else (1.0, _number(selector, len(there)))
    return _first(selector, there, count, lambda track: sign * _distance(track, step, ego))


def _number(selector: Selector, there: int) -> int:
    """How many vehicles a selector asks for, of those that are there."""
    count = int(selector.argument)
    if count == 0:
        raise InvalidRequest(
            f"'{selector}' asks for nobody", valid=["nearest:1", "nearest:3"], next_step="ask for one at least"
        )
    if count > there:
        raise NotPossible(
            f"'{selector}' asks for more vehicles than are there when the ego starts",
            valid=[f"nearest:{there}", "all"],
            next_step="ask for fewer",
        )
    return count


def _fitting(what: str, found: Sequence[int], scene: Scene) -> tuple[int, ...]:
    if not found:
        raise NotPossible(f"no vehicle {what}", valid=_listed(scene), next_step=NAME_ONE)
    return tuple(found)


def _first(selector: Selector, tracks: dict[int, Track], count: int, rank: Callable[[Track], float]) -> tuple[int, ...]:
    """The first vehicles by a rank, of which the last must not be as good as the next one."""
    order = sorted(tracks, key=lambda key: (rank(tracks[key]), key))
    chosen, bound = order[:count], rank(tracks[order[:count][-1]])
    alike = [key for key in order if abs(rank(tracks[key]) - bound) < TIE]
    if not set(alike) <= set(chosen):
        raise NotPossible(
            f"'{selector}' is ambiguous: {len(alike)} vehicles are alike",
            valid=[_name(tracks[key]) for key in alike],
            next_step="name one by its id",
        )
    return tuple(chosen)


def _ego(scene: Scene, selector: Selector) -> Ego:
    if scene.ego is None:
        raise NotPossible(
            f"'{selector}' needs an ego, and the scenario has no planning problem",
            valid=_listed(scene),
            next_step=NAME_ONE,
        )
    return scene.ego


def _speed(track: Track, step: int) -> float:
    return float(track.speeds_mps[step - track.first_step])


def _distance(track: Track, step: int, ego: Ego) -> float:
    return float(np.linalg.norm(track.positions[step - track.first_step] - ego.position))


def _listed(scene: Scene) -> list[str]:
    return [_name(scene.tracks[key]) for key in _vehicles(scene)]


def _name(track: Track) -> str:
    return f"{track.obstacle_id} ({track.kind})"
