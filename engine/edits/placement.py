"""The place that an edit gives on a lanelet: an arc length in m along the lanelet's centre line."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

from ...schemas.errors import LANELETS_LISTED, InvalidRequest, NotPossible, UnknownName, closest, misspelt, with_values
from ...schemas.grammar import SELECTORS, parse_quantity, parse_selector
from ...schemas.modification import Edit
from ..commonroad import Track
from ..cosimulation import Trigger
from ..geometry import Points, point_at, project, wrap_angle
from ..network import station_m
from ..scene import Scene, ego_lane, goal_center_lanelets, straightest_ahead, straightest_behind
from ..vehicles import TIME_GAP_MPS
from .changes import Changes, scene_for_references
from .references import EGO_WORDS, known_lanelet, select

_ONCOMING_RAD = math.radians(135.0)
"""Lanes with directions that differ by more are oncoming (chosen)."""
_ONCOMING_REACH_M = 15.0
"""Largest lateral distance of an oncoming lane from a vehicle's own lane (chosen): medians are narrower."""


_USUAL_OFFSETS_M = (30.0, 50.0, -30.0)
"""Offsets from the ego that are proposed if no place was given (chosen)."""
_SHARES_OF_ROOM = (0.95, 0.8, 0.5)
"""Shares of the distance to the end of the road at which a place is proposed if the road ends before (chosen)."""


@dataclass(frozen=True)
class Place:
    """A point on a lanelet's centre line, by arc length in m."""

    lanelet_id: int
    station_m: float

    def pose(self, scene: Scene) -> tuple[Points, float]:
        """Return position (2,) in m and heading in rad."""
        return point_at(scene.layout.table.lanes[self.lanelet_id].center, self.station_m)


@dataclass(frozen=True)
class _Reference:
    """The ego or vehicle that a relative place refers to; ``towards``: the lanelets that it drives to, if known."""

    name: str
    lanelet_id: int
    position: Points
    towards: frozenset[int] = frozenset()
    speed_mps: float = 0.0
    length_m: float = 0.0


def first_place(edit: Edit, scene: Scene, changes: Changes, length_m: float) -> Place:
    """Return the place that an edit gives, on a lanelet or relative to the ego or a vehicle.

    Raises:
        InvalidRequest: no place is given, or arguments contradict each other.
        UnknownName: a lanelet, edge or vehicle does not exist.
        NotPossible: there is no such lane, or the road ends before the place.
    """
    if edit.at is None:
        raise InvalidRequest(
            f"{edit.op} needs a place",
            valid=["at=LANELET with position", "at=ego with lane and offset_m", "at=VEHICLE with lane and offset_m"],
            next_step="give one in 'at'",
            remedies=[with_values(at="ego", offset_m=far) for far in _USUAL_OFFSETS_M],
        )
    lanelet = _lanelet(edit.at, scene, changes)
    if lanelet is not None:
        if edit.lane not in (None, "same"):
            raise InvalidRequest(
                f"lane is relative to the ego or a vehicle; '{edit.at}' is a lanelet",
                valid=["position"],
                next_step="remove lane, and give the intended lanelet in 'at'",
                remedies=[with_values(lane=None)],
            )
        lane_length = scene.layout.table.lanes[lanelet].length_m
        station = station_m(edit.position or "middle", lanelet, lane_length, length_m / 2)
        return advance_along_lane(scene, Place(lanelet, station), edit.offset_m or 0.0)
    if edit.position is not None:
        raise InvalidRequest(
            f"position applies to lanelets; '{edit.at}' is not a lanelet",
            valid=["lane", "offset_m"],
            next_step="remove position, or give a lanelet in 'at'",
            remedies=[with_values(position=None)],
        )
    reference = _reference(edit.at, scene, changes)
    offset_m = _offset_m(edit, reference, length_m)
    if edit.lane == "oncoming":
        return _oncoming(reference, offset_m, scene)
    lane = _adjacent_lane(reference, edit.lane or "same", scene)
    station, _ = project(scene.layout.table.lanes[lane].center, reference.position)
    return advance_along_lane(scene, Place(lane, station), offset_m, reference.towards)


def _offset_m(edit: Edit, reference: _Reference, length_m: float) -> float:
    """Return how far along the lane a place is from its reference, between centres: as given, or by a time gap.

    A time gap is measured between bumpers at the follower's speed. For a place ahead of the reference, the follower is
    the reference. For a place behind the reference, the reference's speed is also used, because followers drive about
    as fast.

    Raises:
        InvalidRequest: both a distance and a time gap are given, or a time gap to a standing vehicle.
    """
    if edit.gap_s is None:
        return edit.offset_m or 0.0
    if edit.offset_m is not None or reference.speed_mps < TIME_GAP_MPS:
        stands = f"{reference.name} stands, so a time gap gives no place"
        raise InvalidRequest(
            "gap_s and offset_m both set the place" if edit.offset_m is not None else stands,
            valid=["offset_m", *([] if edit.offset_m is None else ["gap_s"])],
            next_step="give only offset_m" if edit.offset_m is None else "give one of them",
            remedies=[with_values(gap_s=None, offset_m=edit.offset_m or _USUAL_OFFSETS_M[0])],
        )
    room_m = abs(edit.gap_s) * reference.speed_mps + (reference.length_m + length_m) / 2
    return math.copysign(room_m, edit.gap_s)


def read_trigger(
    text: str, scene: Scene, changes: Changes, place_at: Callable[[int], Points | None]
) -> tuple[Trigger, int]:
    """Return a trigger, and the first step at which it holds when an ordinary driver drives the ego.

    ``ego@595:35m`` holds once the ego's centre has passed a point on a lanelet (``ego@595`` is its start), and
    ``gap<=2s`` once the ego is behind the road user and, at its speed, would reach it in that time.

    Args:
        text: the trigger.
        scene: the scene after the earlier edits.
        changes: the changes so far, which provide the ego's drive.
        place_at: returns the position (2,) of the road user at a step, or None if it is absent.

    Raises:
        InvalidRequest: the text is not a trigger.
        NotPossible: there is no ego, or the condition never holds.
    """
    drive = changes.ego_drive()
    if drive is None:
        raise NotPossible("the scenario has no driving ego", next_step="give a time in 'time_s'")
    word = text.replace(" ", "")
    gap = re.fullmatch(r"gap<=?(.+)", word)
    place = re.fullmatch(r"ego@(\w+)(?::(.+))?", word)
    if gap is not None:
        seconds = parse_quantity(gap[1], "s")
        trigger = Trigger(gap_s=seconds)
        never = f"the ego never comes within {seconds:g} s"
    elif place is not None:
        lanelet = known_lanelet(place[1], scene)
        station = station_m(place[2] or "beginning", lanelet, scene.layout.table.lanes[lanelet].length_m)
        trigger = Trigger(lanelet, station)
        never = f"the ego never passes lanelet {lanelet} at {station:.1f} m"
    else:
        raise InvalidRequest(
            f"'{text}' is not a trigger",
            valid=["ego@LANELET:35m", "gap<=2s", "time_s=3 for a time"],
            next_step="write it like one of these",
            remedies=[*(with_values(when=f"gap<={gap}s") for gap in (2, 4)), with_values(when=None)],
        )
    lanes = scene.layout.table.lanes
    for index in range(len(drive.positions)):
        step = drive.first_step + index
        if trigger.holds(drive, index, place_at(step), lambda key: lanes[key].center):
            return trigger, step
    raise NotPossible(
        never,
        valid=["another place", "a larger gap", "time_s"],
        next_step="choose one of these",
        remedies=[*(with_values(when=f"gap<={gap}s") for gap in (2, 4)), with_values(when=None)],
    )


def held(step: int, scene: Scene) -> str:
    """Return text if a trigger that holds from a step already holds at the ego's start, so that it delays nothing."""
    return ", which is already so at the ego's start" if scene.ego is not None and step <= scene.ego.step else ""


def advance_along_lane(scene: Scene, place: Place, distance_m: float, targets: frozenset[int] = frozenset()) -> Place:
    """Return the place farther along the lane, or behind for a negative distance, following the straightest successors.

    At a fork, the far ends of the successors are compared, because branches of a junction start alike.

    ``targets``: if any routes lead to these lanelets, the place is on the shortest of the routes, or straight on after
    its end.

    Raises:
        NotPossible: the road ends before the place.
    """
    lanes, table = scene.layout.table.lanes, scene.layout.table
    key, station, seen = place.lanelet_id, place.station_m + distance_m, {place.lanelet_id}
    room_m = lanes[key].length_m - place.station_m if distance_m > 0.0 else -place.station_m
    while not 0.0 <= station <= lanes[key].length_m:
        forward = station > lanes[key].length_m
        onward = [other for other in (table.successors if forward else table.predecessors)[key] if other not in seen]
        if not onward:
            raise NotPossible(
                f"from lanelet {place.lanelet_id} at {place.station_m:.1f} m, the road does not extend "
                f"{abs(distance_m):.6g} m {'ahead' if forward else 'back'}",
                valid=[f"up to {room_m:+.1f} m, where lanelet {key} {'ends' if forward else 'begins'}"],
                next_step="choose a place within the road",
                remedies=[with_values(offset_m=round(share * room_m, 1)) for share in _SHARES_OF_ROOM],
            )
        before, current = lanes[key].length_m, lanes[key].center
        if forward:
            targets = frozenset() if key in targets else targets
            onward = _towards(scene, key, onward, targets)
            key = straightest_ahead(current, {other: lanes[other].center for other in onward})
            station -= before
            room_m += lanes[key].length_m
        else:
            key = straightest_behind(current, {other: lanes[other].center for other in onward})
            station += lanes[key].length_m
            room_m -= lanes[key].length_m
        seen.add(key)
    return Place(key, station)


def _towards(scene: Scene, key: int, onward: list[int], targets: frozenset[int]) -> list[int]:
    """Return the next lanelets on the shortest route to targets, else those that lead to targets, else all."""
    if not targets:
        return onward
    route = scene.driven_graph.shortest_route([key], sorted(targets)) or ()
    leading = [other for other in onward if scene.driven_graph.shortest_route([other], sorted(targets))]
    return [other for other in onward if other in route] or leading or onward


def _lanelet(text: str, scene: Scene, changes: Changes) -> int | None:
    """Return the lanelet that ``at`` gives, or None if it gives the ego or a vehicle."""
    body, vehicles = text.strip(), {*scene.tracks, *scene.standing, *changes.driven}
    if body in scene.layout.edges:
        return scene.layout.edges[body][0]
    if body in scene.layout.lanelets_of_lane:
        return known_lanelet(body, scene)
    if body.isdigit() and int(body) not in vehicles:
        return known_lanelet(body, scene)
    return None


def _reference(text: str, scene: Scene, changes: Changes) -> _Reference:
    body = text.strip()
    if body.lower() in EGO_WORDS:
        if scene.ego is None or not scene.ego.lanelets:
            raise NotPossible("the scenario has no ego on a lanelet", next_step="give a lanelet or a vehicle")
        ego = scene.ego
        goals = _ego_goals(scene, changes)
        return _Reference("the ego", ego.lanelets[0], ego.position, goals, ego.speed_mps, ego.size_m[0])
    vehicles = _matching_vehicles(text, body.removeprefix("vehicle:"), scene, changes)
    if len(vehicles) != 1:
        raise NotPossible(f"'{text}' matches {len(vehicles)} vehicles", valid=vehicles, next_step="give one by its id")
    there, key = scene_for_references(scene, changes), vehicles[0]
    if key not in there.tracks or key not in there.matches:
        raise NotPossible(f"vehicle {key} is not recorded on a lanelet", next_step="give a lanelet")
    track, match = there.tracks[key], there.matches[key]
    index = track.index_at(scene.ego.step if scene.ego else 0) or 0
    speed_mps = float(track.speeds_mps[index])
    towards = frozenset(match.sequence[-1:])
    return _Reference(f"vehicle {key}", match.at(index), track.positions[index], towards, speed_mps, track.length_m)


def _ego_goals(scene: Scene, changes: Changes) -> frozenset[int]:
    """Return the lanelets of the ego's goal, as earlier edits set it; empty if the goal has no position."""
    if scene.ego is None:
        return frozenset()
    if changes.goal is not None and not changes.goal.keeps_place:
        return frozenset({changes.goal.lanelet_id})
    return frozenset(goal_center_lanelets(scene.network, scene.loaded.problem(scene.ego.problem_id)))


def seen_from_ego(edit: Edit, scene: Scene, changes: Changes, start: Track, lanelet_id: int) -> str:
    """Return where an edit with ``at=ego`` puts a vehicle, as descriptions say it: "40 m ahead of the ego, same lane".

    The text is empty for other places, and if earlier edits move the ego or its goal.
    """
    ego = scene.ego
    if (edit.at or "").strip().lower() not in EGO_WORDS or ego is None or changes.goal or changes.ego:
        return ""
    lane = ego_lane(scene, ego)
    if lane is None:
        return ""
    away, _, which = lane.where(start, 0, lanelet_id).words.partition(", ")
    preposition = "" if away.split()[-1] in ("alongside", "behind") else " of"
    return f"{away}{preposition} the ego{', ' * bool(which)}{which}"


def _matching_vehicles(text: str, selector: str, scene: Scene, changes: Changes) -> tuple[int, ...]:
    """Return the vehicles that ``at`` matches, unless it is the name of a lanelet or edge."""
    try:
        parse_selector(selector)
    except InvalidRequest as error:
        known = [*map(str, scene.layout.table.lanes), *scene.layout.edges, "ego", *SELECTORS[1:]]
        near = closest(text, known)
        bare = text.split()[-1] if text.split() else ""
        is_id = bare != text and bare in known
        raise UnknownName(
            f"'{text}' is not a lanelet, edge or vehicle",
            valid=[bare] if is_id else near,
            next_step="write only the id" if is_id else "give a lanelet, an edge, the ego, or a vehicle by its id",
            remedies=[*misspelt(text, near, "at"), *([with_values(at="ego")] if scene.ego else []), LANELETS_LISTED],
        ) from error
    return select([selector], scene, changes)


def _oncoming(reference: _Reference, offset_m: float, scene: Scene) -> Place:
    """Return the place in the oncoming lane next to a point ``offset_m`` along the reference's own lane.

    This is the lane that the map declares as adjacent, else the nearest oncoming lane.
    """
    station, _ = project(scene.layout.table.lanes[reference.lanelet_id].center, reference.position)
    own = advance_along_lane(scene, Place(reference.lanelet_id, station), offset_m, reference.towards)
    (point, heading), declared = own.pose(scene), _declared_opposite(scene, own.lanelet_id)
    candidates = []
    for key, lane in scene.layout.table.lanes.items():
        station, lateral = project(lane.center, point)
        against = abs(wrap_angle(point_at(lane.center, station)[1] - heading)) > _ONCOMING_RAD
        if against and abs(lateral) <= _ONCOMING_REACH_M and 0.0 < station < lane.length_m:
            candidates.append((key != declared, abs(lateral), key, station))
    if not candidates:
        raise NotPossible(
            f"{reference.name} has no oncoming lane next to its own at {offset_m:+.6g} m",
            valid=["lane=same", "lane=left", "lane=right", "another offset_m"],
            next_step="choose another place",
            remedies=[with_values(lane="same")],
        )
    *_, key, station = min(candidates)
    return Place(key, station)


def _declared_opposite(scene: Scene, lanelet_id: int) -> int | None:
    """Return the opposite lanelet that the map puts to the left of a lanelet's carriageway, or None."""
    lanes, seen = scene.layout.table.lanes, {lanelet_id}
    while (left := lanes[lanelet_id].left) in lanes and left not in seen:
        lanelet_id = left
        seen.add(left)
    lanelet = scene.network.find_lanelet_by_id(lanelet_id)
    return None if lanelet.adj_left_same_direction else lanelet.adj_left


def _adjacent_lane(reference: _Reference, side: str, scene: Scene) -> int:
    if side == "same":
        return reference.lanelet_id
    lane = scene.layout.table.lanes[reference.lanelet_id]
    sides = {"left": lane.left, "right": lane.right}
    there = {key: value for key, value in sides.items() if value is not None and value in scene.layout.table.lanes}
    if side not in there:
        raise NotPossible(
            f"{reference.name} has no lane in its direction on the {side}",
            valid=["same", *there],
            next_step="choose another lane",
            remedies=[with_values(lane=word) for word in (*there, "same")],
        )
    return there[side]
