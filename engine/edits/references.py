"""Resolve the references of an edit: vehicles, lanelets, and routes to lanelets.

Selectors match the vehicles that remain after earlier edits, at the ego's first time step, as in a description of the
scenario at that step. Lanelets are given by id, by SUMO's edges and lanes, or by a turn at the next fork.
"""

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from ...schemas.errors import (
    LANELETS_LISTED,
    InvalidRequest,
    NotPossible,
    Remedy,
    UnknownName,
    closest,
    instead,
    misspelt,
    with_values,
)
from ...schemas.grammar import SELECTORS, Selector, parse_selector
from ...schemas.modification import AMBIGUOUS_VEHICLE, Edit
from ...schemas.text import counted
from ..commonroad import Track
from ..scene import NOT_DRIVEN, Ego, Scene, ego_lane, leader_and_follower
from ..vehicles import STANDING_MPS, vehicle_class_of, vehicle_classes
from .changes import Changes, scene_for_references

_TIE = 1e-3
"""Speeds in m/s or distances in m that differ by less are equal for a description."""
_NAME_A_VEHICLE = "use one of these ids"
_NAME_A_LANELET = "use one of these lanelets"
_MOST_CANDIDATES = 3
"""Number of vehicles that are described if a selector matches several (chosen)."""
_MEAN_ALL = ("id", "new", "all", "class")
"""Selectors that match the same vehicles regardless of exclusions."""
EGO_WORDS = ("ego", "the ego", "me", "self")


def select(texts: Sequence[str], scene: Scene, changes: Changes) -> tuple[int, ...]:
    """Return the ids of the vehicles that the selectors match and do not exclude, ascending.

    Vehicles that earlier edits added count like recorded vehicles; removed vehicles do not count.

    Raises:
        InvalidRequest: nothing is selected, or only exclusions are given.
        UnknownName: an id, class or word does not exist.
        NotPossible: a selector refers to the ego or a removed vehicle, or a description is ambiguous or fits no
            vehicle.
    """
    there = scene_for_references(scene, changes)
    if not texts:
        raise InvalidRequest(
            "no vehicle is given",
            valid=[*_listed(there), *SELECTORS[1:]],
            next_step="give vehicles",
            remedies=[with_values(vehicles=["nearest:1"])],
        )
    selectors = [_selector(text, scene) for text in texts]
    wanted = [selector for selector in selectors if not selector.negated]
    if not wanted:
        raise InvalidRequest(
            "only exclusions are given", valid=["all", "class:car"], next_step="add a selector that they exclude from"
        )
    excluded = {key for selector in selectors if selector.negated for key in _resolve(selector, there, changes)}
    matched = {key for selector in wanted for key in _resolve_without(selector, there, excluded, changes)}
    left = tuple(sorted(matched - excluded))
    gone = _gone(there, changes) & set(left)
    if gone:
        raise NotPossible(
            f"vehicle {min(gone)} was removed by an earlier edit", valid=_listed(there), next_step="remove it"
        )
    if not left:
        raise NotPossible(
            f"{', '.join(texts)} leaves no vehicle", valid=_listed(there), next_step="exclude fewer vehicles"
        )
    return left


def select_one(edit: Edit, scene: Scene, changes: Changes) -> int:
    """Return the vehicle's id for an edit of a single vehicle.

    Raises:
        InvalidRequest: its selectors match several vehicles, or :func:`select` raises it.
    """
    vehicles = select(edit.vehicles, scene, changes)
    if len(vehicles) != 1:
        raise InvalidRequest(
            f"{edit.op} takes one vehicle, not {len(vehicles)}",
            valid=[f"vehicles=['{key}']" for key in vehicles],
            next_step="give one",
        )
    return vehicles[0]


def _resolve_without(selector: Selector, scene: Scene, excluded: set[int], changes: Changes) -> tuple[int, ...]:
    """Resolve a selector, such as the nearest or the fastest, among the vehicles that are not excluded."""
    if not excluded or selector.kind in _MEAN_ALL:
        return _resolve(selector, scene, changes)
    if selector.kind in ("one", "only"):
        left = tuple(key for key in _of_class(selector.argument, scene) if key not in excluded)
        return _the_only(selector.argument, left, scene, selector) if left else ()
    others = {key: track for key, track in scene.tracks.items() if key not in excluded}
    return _resolve(selector, replace(scene, tracks=others), changes)


def describe_matches(texts: Sequence[str], vehicles: Sequence[int], scene: Scene, changes: Changes) -> str:
    """Return, as text, the vehicles that selectors matched, with their classes and positions relative to the ego.

    The text is empty for vehicles given by id, and for selectors that need no explanation (all, an edit's vehicle).
    Vehicles that the edit adds are left out, because no selector matched them.
    """
    kinds = {parse_selector(text).kind for text in texts}
    if kinds <= {"id", "all", "new"}:
        return ""
    there = scene_for_references(scene, changes)
    lane, step = ego_lane(there, there.ego) if there.ego else None, there.ego.step if there.ego else 0
    matched = [key for key in vehicles if key in there.tracks]
    named = []
    for key in matched[:_MOST_CANDIDATES]:
        track, match = there.tracks[key], there.matches.get(key)
        index = track.index_at(step)
        where = ""
        if lane is not None and index is not None:
            where = f", {lane.where(track, index, match.at(index) if match else None).words}"
        named.append(f"{track.kind} {key}{where}")
    if not named:
        return ""
    more = f" and {len(matched) - _MOST_CANDIDATES} more" if len(matched) > _MOST_CANDIDATES else ""
    return f"{', '.join(map(_with_meaning, texts))}: {'; '.join(named)}{more}"


def _with_meaning(text: str) -> str:
    """Return a selector as written; if its word is not a class's own name, the class is added."""
    selector = parse_selector(text)
    known = vehicle_class_of(selector.argument) if selector.kind in ("class", "one", "only") else None
    if known is None or selector.argument.lower() == known:
        return text
    return f"{text} ('{selector.argument}' read as {known})"


def _selector(text: str, scene: Scene) -> Selector:
    """Return the parsed selector; the ego and its planning problem are refused, because the ego is not traffic."""
    body = text.strip().removeprefix("!").lower()
    if body in EGO_WORDS or (scene.ego is not None and body == str(scene.ego.problem_id)):
        raise NotPossible(
            f"the planner drives the ego, so edits of the traffic cannot change or remove it ('{text}')",
            next_step="move its goal with op set_goal, change its start with op set_ego, or change how it drives with "
            "configure_planner",
            complete=True,
        )
    return parse_selector(text)


def nearest_ids(wanted: int, known: Sequence[int]) -> list[int]:
    """Return known ids, ordered by their difference from the wanted id."""
    return sorted(known, key=lambda key: (abs(key - wanted), key))


def _resolve(selector: Selector, scene: Scene, changes: Changes) -> tuple[int, ...]:
    word = selector.argument
    match selector.kind:
        case "id":
            return (_known(int(word), scene, changes),)
        case "new":
            return _new(int(word), changes)
        case "all":
            return _vehicles(scene)
        case "class":
            return _of_class(word, scene)
        case "one" | "only":
            return _the_only(word, _of_class(word, scene), scene, selector)
        case "leftmost" | "rightmost" | "lane":
            side = word if selector.kind == "lane" else selector.kind
            return _the_only("vehicle", _outermost(side, scene), scene, selector, f" in the {side} lane")
        case _:
            return _described(selector, scene)


def _known(vehicle_id: int, scene: Scene, changes: Changes) -> int:
    sets = (int(obstacle.obstacle_id) for obstacle in scene.loaded.scenario.dynamic_obstacles)
    gone = _gone(scene, changes)
    known = {*scene.tracks, *scene.standing, *sets} - gone
    if vehicle_id not in known | gone:
        raise UnknownName(
            f"there is no vehicle {vehicle_id}", valid=nearest_ids(vehicle_id, sorted(known)), next_step=_NAME_A_VEHICLE
        )
    return vehicle_id


def _gone(scene: Scene, changes: Changes) -> set[int]:
    """Return the vehicles that edits removed, including those that an earlier edit had added."""
    return {*changes.removed, *(key for added in changes.added_by_edit for key in added if key not in scene.tracks)}


def _new(edit: int, changes: Changes) -> tuple[int, ...]:
    if edit >= len(changes.added_by_edit) or not changes.added_by_edit[edit]:
        raise UnknownName(
            "new:K selects what edit K of this call adds, so edit K must come earlier and add something",
            valid=[key for added in changes.added_by_edit for key in added],
            next_step="give a vehicle by its id",
        )
    return changes.added_by_edit[edit]


def _vehicles(scene: Scene) -> tuple[int, ...]:
    return tuple(key for key, track in scene.tracks.items() if track.kind not in NOT_DRIVEN)


def _of_class(word: str, scene: Scene) -> tuple[int, ...]:
    kinds = {name: kind.commonroad_type for name, kind in vehicle_classes().items()}
    kinds |= {track.kind: track.kind for track in scene.tracks.values()} | {"pedestrian": "pedestrian"}
    if word not in kinds:
        word = vehicle_class_of(word) or word
    if word not in kinds:
        raise UnknownName(
            f"there is no vehicle class '{word}'",
            valid=closest(word, sorted(kinds)),
            next_step="use one of these",
            complete=True,
        )
    vehicles = tuple(key for key, track in scene.tracks.items() if track.kind == kinds[word])
    if not vehicles:
        raise NotPossible(f"the scenario has no {word}", valid=_listed(scene), next_step=_NAME_A_VEHICLE)
    return vehicles


def _the_only(
    what: str, vehicles: tuple[int, ...], scene: Scene, selector: Selector, where: str = ""
) -> tuple[int, ...]:
    if len(vehicles) != 1:
        raise NotPossible(
            f"there {'is no' if not vehicles else 'are'} {counted(len(vehicles), what) if vehicles else what}{where}",
            valid=[_name(scene.tracks[key]) for key in vehicles] or _listed(scene),
            next_step="give one by its id",
            reason=f"{AMBIGUOUS_VEHICLE} {selector}" if vehicles else "",
        )
    return vehicles


def _outermost(side: str, scene: Scene) -> tuple[int, ...]:
    if side not in ("leftmost", "rightmost"):
        raise UnknownName(
            f"there is no lane '{side}'", valid=["lane:leftmost", "lane:rightmost"], next_step="use one of these"
        )
    outermost, step = [], scene.ego.step if scene.ego else 0
    for key in _vehicles(scene):
        index = scene.tracks[key].index_at(step)
        if key in scene.matches and index is not None:
            lane = scene.layout.table.lanes[scene.matches[key].at(index)]
            outer, inner = (lane.left, lane.right) if side == "leftmost" else (lane.right, lane.left)
            if outer is None and inner is not None:
                outermost.append(key)
    return tuple(outermost)


def _described(selector: Selector, scene: Scene) -> tuple[int, ...]:
    """Resolve descriptions by distance, speed or order in the ego's lane, at the first time step."""
    step = scene.ego.step if scene.ego else 0
    there = {key: scene.tracks[key] for key in _vehicles(scene) if scene.tracks[key].index_at(step) is not None}
    if not there:
        raise NotPossible(f"no vehicle is there at time step {step}", valid=_listed(scene), next_step=_NAME_A_VEHICLE)
    if selector.kind == "standing":
        return _fitting("stands at the start", [key for key in there if _speed(there[key], step) < STANDING_MPS], scene)
    if selector.kind in ("fastest", "slowest"):
        sign = -1.0 if selector.kind == "fastest" else 1.0
        return _first(selector, there, 1, lambda track: sign * _speed(track, step))
    ego = scene.ego
    if ego is None:
        raise NotPossible(
            f"'{selector}' needs an ego, and the scenario has no planning problem",
            valid=_listed(scene),
            next_step=_NAME_A_VEHICLE,
        )
    if selector.kind in ("lead", "follow"):
        neighbour = leader_and_follower(scene, ego)[selector.kind == "follow"]
        what = "drives ahead of the ego" if selector.kind == "lead" else "follows the ego"
        return _fitting(f"{what} in its lane", [] if neighbour is None else [neighbour], scene)
    sign, count = (-1.0, 1) if selector.kind == "farthest" else (1.0, _number(selector, len(there)))
    return _first(selector, there, count, lambda track: sign * _distance(track, step, ego))


def _number(selector: Selector, there: int) -> int:
    """Return how many vehicles a selector requests; refuse 0, and more than the available number ``there``."""
    count = int(selector.argument)
    if count == 0:
        raise InvalidRequest(
            f"'{selector}' selects no vehicle",
            valid=["nearest:1", "nearest:3"],
            next_step="request at least one",
            given=str(selector),
        )
    if count > there:
        raise NotPossible(
            f"'{selector}' requests more vehicles than are there when the ego starts",
            valid=[f"nearest:{there}", "all"],
            next_step="request fewer",
            given=str(selector),
        )
    return count


def _fitting(what: str, vehicles: Sequence[int], scene: Scene) -> tuple[int, ...]:
    if not vehicles:
        raise NotPossible(f"no vehicle {what}", valid=_listed(scene), next_step=_NAME_A_VEHICLE)
    return tuple(vehicles)


def _first(selector: Selector, tracks: dict[int, Track], count: int, rank: Callable[[Track], float]) -> tuple[int, ...]:
    """Return the first vehicles by rank; refuse a tie between the last of them and the next vehicle."""
    order = sorted(tracks, key=lambda key: (rank(tracks[key]), key))
    chosen, bound = order[:count], rank(tracks[order[:count][-1]])
    alike = [key for key in order if abs(rank(tracks[key]) - bound) < _TIE]
    if not set(alike) <= set(chosen):
        raise NotPossible(
            f"'{selector}' is ambiguous: {len(alike)} vehicles are equal",
            valid=[_name(tracks[key]) for key in alike],
            next_step="give one by its id",
            reason=f"{AMBIGUOUS_VEHICLE} {selector}" if count == 1 else "",
        )
    return tuple(chosen)


def _speed(track: Track, step: int) -> float:
    return float(track.speeds_mps[step - track.first_step])


def _distance(track: Track, step: int, ego: Ego) -> float:
    return float(np.linalg.norm(track.positions[step - track.first_step] - ego.position))


def _listed(scene: Scene) -> list[str]:
    return [_name(scene.tracks[key]) for key in _vehicles(scene)]


def _name(track: Track) -> str:
    return f"{track.obstacle_id} ({track.kind})"


def target_lanelets(texts: Sequence[str], scene: Scene, changes: Changes) -> frozenset[int]:
    """Return the lanelets given by id, by SUMO edge (all its lanes) or as ``lanelet_of:SELECTOR``.

    Raises:
        InvalidRequest: no lanelet is given.
        UnknownName: a lanelet or edge does not exist.
    """
    if not texts:
        raise InvalidRequest("no lanelet is given in 'to'", valid=[*scene.layout.lane_of], next_step="give one")
    return frozenset(key for text in texts for key in _resolve_lanelets(text.strip(), scene, changes))


def _resolve_lanelets(text: str, scene: Scene, changes: Changes) -> tuple[int, ...]:
    if text.startswith("lanelet_of:"):
        vehicles = select([text.removeprefix("lanelet_of:")], scene, changes)
        return tuple(_lanelet_at_start(key, scene_for_references(scene, changes)) for key in vehicles)
    if text in scene.layout.edges:
        return scene.layout.edges[text]
    return (known_lanelet(text, scene),)


def known_lanelet(text: str, scene: Scene) -> int:
    """Return the drivable lanelet with this id, or the lanelet of a SUMO lane (edge, underscore, index).

    Raises:
        UnknownName: there is no such lanelet or edge; the error lists the nearest ids.
    """
    lanes = scene.layout.table.lanes
    if text.isdigit() and int(text) in lanes:
        return int(text)
    if len(scene.layout.lanelets_of_lane.get(text, ())) == 1:
        return scene.layout.lanelets_of_lane[text][0]
    if text.isdigit():
        every = {lanelet.lanelet_id for lanelet in scene.network.lanelets}
        what = "is not a lanelet for vehicles" if int(text) in every else "is not a lanelet of the scenario"
        raise UnknownName(
            f"{text} {what}",
            valid=nearest_ids(int(text), list(lanes)),
            next_step=_NAME_A_LANELET,
            remedies=[LANELETS_LISTED],
        )
    known = [*map(str, lanes), *scene.layout.edges]
    near = closest(text, known)
    raise UnknownName(
        f"'{text}' is not a lanelet or edge",
        valid=near,
        next_step=_NAME_A_LANELET,
        remedies=[*misspelt(text, near), LANELETS_LISTED],
    )


def route_to(scene: Scene, starts: Iterable[int], targets: Iterable[int], who: str) -> tuple[int, ...]:
    """Return the lanelets from a start to the nearest target, both included.

    Raises:
        NotPossible: no target can be reached; the error lists reachable lanelets, the nearest to a target first.
    """
    begin, wanted = tuple(starts), sorted(targets)
    route = scene.lanelet_graph.shortest_route(begin, wanted)
    if route is None:
        nearest = _by_distance_to(wanted, reachable_lanelets(scene, begin), scene)
        raise NotPossible(
            f"lanelet {' or '.join(map(str, wanted))} cannot be reached by {who}"
            f" from lanelet {', '.join(map(str, begin))}: no successors or lane changes lead there",
            valid=nearest,
            next_step="choose a reachable lanelet",
            remedies=[_toward(wanted[0], key) for key in nearest[:_MOST_CANDIDATES]] if len(wanted) == 1 else [],
        )
    return route


def drive_to(scene: Scene, start: int, targets: frozenset[int], who: str, *, is_there: bool = False) -> tuple[int, ...]:
    """Return the lanelets that a vehicle drives from its own lanelet to the nearest target, both included.

    ``is_there``: whether it is already on the start lanelet, so that it may change lanes there inside a junction.

    Raises:
        NotPossible: no target can be reached, or only by a lane change inside a junction.
    """
    route = scene.driven_graph.shortest_route([start], sorted(targets))
    if route is None and is_there:
        route = scene.graph_from_inside(start).shortest_route([start], sorted(targets))
    if route is not None:
        return route
    route = route_to(scene, [start], targets, who)
    changes = [pair for pair in itertools.pairwise(route) if pair[1] in scene.lanelet_graph.neighbours[pair[0]]]
    wrong, right = next(pair for pair in changes if not set(pair) <= set(scene.layout.lane_of))
    nearest = nearest_driven(scene, start, sorted(targets))
    raise NotPossible(
        f"{who} would have to change from lanelet {wrong} to {right} inside a junction, where SUMO's vehicles keep "
        "their lanes",
        valid=nearest,
        next_step="choose a target before or after the junction",
        remedies=[_toward(key, other) for key in targets for other in nearest[:_MOST_CANDIDATES]],
    )


def _toward(lanelet: int, other: int) -> Remedy:
    """Return the edit with a different lanelet as its target, or as a lanelet that its route leads through."""
    return instead(str(lanelet), other, "to", "via")


def nearest_driven(scene: Scene, start: int, targets: Sequence[int]) -> list[int]:
    """Return the lanelets that SUMO's vehicles reach without a lane change inside a junction.

    The nearest to a target (straight-line distance) comes first.
    """
    return _by_distance_to(targets, sorted(scene.driven_graph.reachable([start])), scene)


def reachable_lanelets(scene: Scene, starts: Sequence[int]) -> list[int]:
    """Return reachable lanelets outside junctions, except the starts, ordered by the number of lanelets on the way."""
    nearest_first = scene.lanelet_graph.reachable(starts)
    return [key for key in nearest_first if key not in starts and key in scene.layout.lane_of]


def _by_distance_to(targets: Sequence[int], lanelets: Sequence[int], scene: Scene) -> list[int]:
    """Return lanelets, ordered by the straight-line distance between their centre line and the nearest target's."""
    lanes = scene.layout.table.lanes
    wanted = np.vstack([lanes[key].center for key in targets])

    def distance_m(key: int) -> float:
        return float(np.linalg.norm(lanes[key].center[:, None] - wanted[None], axis=2).min())

    return sorted(lanelets, key=lambda key: (round(distance_m(key), 3), key))


def _lanelet_at_start(vehicle_id: int, scene: Scene) -> int:
    match = scene.matches.get(vehicle_id)
    if match is None:
        raise NotPossible(
            f"vehicle {vehicle_id} is not on a lanelet",
            valid=[f"lanelet_of:{key}" for key in nearest_ids(vehicle_id, list(scene.matches))],
            next_step="give another vehicle, or a lanelet by its id",
        )
    track = scene.tracks.get(vehicle_id)
    index = track.index_at(scene.ego.step) if track and scene.ego else None
    return match.at(index or 0)
