"""Where an added vehicle is put."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ...schemas.errors import InvalidRequest, NotPossible, UnknownName, closest
from ...schemas.grammar import SELECTORS, parse_selector
from ...schemas.modification import Edit
from ..commonroad import Track
from ..cosimulation import highest_entry_speed
from ..geometry import Points, arc_length, oriented_rectangle, point_at, project, rectangles_overlap, wrap_angle
from ..network import station_m
from ..scene import Scene, straightness
from ..vehicles import EGO_SIZE_M, HARDEST_BRAKING_MPS2, VehicleClass, vehicle_classes
from .changes import Changes, populated
from .references import EGO_WORDS, known_lanelet, select

# ---------- braking_reach
# How far a recorded vehicle gets on its way although it brakes as hard as it can.

REACTION_S = 0.5
"""The least time after which a driver brakes hard."""


def _stopping_way_m(speed_mps: float) -> float:
    """The way in m in which a driver stops from a speed, or in which he loses one by which he comes closer."""
    return speed_mps * REACTION_S + speed_mps**2 / (2 * HARDEST_BRAKING_MPS2)


def gets_onto(coming: Track, step: int, center: Points, heading_rad: float, size_m: tuple[float, float]) -> bool:
    """Whether a vehicle gets onto a rectangle (length, width) on its recorded way if it brakes hard from a step on."""
    index = coming.index_at(step)
    if index is None:
        return False
    speed_mps = max(float(coming.speeds_mps[index]), 0.0)
    stops_after_m = _stopping_way_m(speed_mps)
    place, size = oriented_rectangle(center, heading_rad, size_m), (coming.length_m, coming.width_m)
    count = int((arc_length(coming.positions[index:]) <= stops_after_m).sum())
    return any(
        rectangles_overlap(oriented_rectangle(coming.positions[at], float(coming.headings_rad[at]), size), place)
        for at in range(index, index + count)
    )


# ---------- road_users
# Who may use a lanelet: what its users and its type say, no bicycles or walkers on motorways.
#
# Walkers cross any other road, and walk along footpaths. An emergency vehicle may drive everywhere.

MOTORWAY_WORDS = frozenset({"highway", "interstate", "mainCarriageWay"})
"""Lanelet types and scenario tags that say motorway; some recordings carry only the tag."""
FOOTPATH_TYPES = frozenset({"sidewalk", "crosswalk"})
USERS_OF_TYPE: Mapping[str, frozenset[str]] = {
    "busLane": frozenset({"bus", "taxi"}),
    "bicycleLane": frozenset({"bicycle"}),
}
"""Types of lanelets that are there for some vehicles only, where the file does not name the users itself."""
ANY_VEHICLE = "vehicle"
"""CommonRoad's road user that stands for all vehicles."""
SLOW_CLASSES, EVERYWHERE = ("bicycle", "pedestrian"), "priorityVehicle"


def check_allowed(class_name: str, lanelet_id: int, scene: Scene) -> None:
    """Refuse a road user that the road at a lanelet is not open to.

    Raises:
        NotPossible: users or type of the lanelet leave the class out, or a bicycle or pedestrian on a motorway.
    """
    reason = _closed_because(class_name, lanelet_id, scene)
    if reason:
        elsewhere = [key for key in scene.layout.table.lanes if not _closed_because(class_name, key, scene)]
        raise NotPossible(
            f"a {class_name} is not allowed on lanelet {lanelet_id}: {reason}",
            valid=elsewhere,
            next_step="choose another class" if not elsewhere else "choose another lanelet or class",
        )


def is_footpath(scene: Scene, lanelet_id: int) -> bool:
    """Whether a lanelet is there to walk along."""
    return bool(_kinds(scene, lanelet_id) & FOOTPATH_TYPES) or _users(scene, lanelet_id) == {"pedestrian"}


def _closed_because(class_name: str, lanelet_id: int, scene: Scene) -> str:
    """Why a class may not use a lanelet; empty if it may. Its users say it, else its type, else the kind of road."""
    one, kinds, users = _user(class_name), _kinds(scene, lanelet_id), _users(scene, lanelet_id)
    if one == EVERYWHERE or one in users:
        return ""
    if users and ANY_VEHICLE not in users and one != "pedestrian":
        return f"it is for {', '.join(sorted(users))}"
    special = sorted(kinds & USERS_OF_TYPE.keys())
    if special and not users and one != "pedestrian":
        return "" if any(one in USERS_OF_TYPE[kind] for kind in special) else f"it is a {' and '.join(special)}"
    return "it belongs to a motorway" if one in SLOW_CLASSES and not special and _is_motorway(scene, kinds) else ""


def _is_motorway(scene: Scene, kinds: set[str]) -> bool:
    tags = {str(tag.value) for tag in scene.loaded.scenario.tags or ()}
    return bool((kinds | tags) & MOTORWAY_WORDS)


def _user(class_name: str) -> str:
    """CommonRoad's word for a class."""
    found = vehicle_classes().get(class_name)
    return class_name if found is None else found.commonroad_type


def _kinds(scene: Scene, lanelet_id: int) -> set[str]:
    return {str(kind.value) for kind in scene.network.find_lanelet_by_id(lanelet_id).lanelet_type or ()}


def _users(scene: Scene, lanelet_id: int) -> set[str]:
    """Who is named as a user of a lanelet, in its direction or in both; nobody where the file does not say."""
    lanelet = scene.network.find_lanelet_by_id(lanelet_id)
    return {str(user.value) for user in {*(lanelet.user_one_way or ()), *(lanelet.user_bidirectional or ())}}


# ---------- placing
# Where an added vehicle is put.

ONCOMING_RAD = math.radians(135.0)
ONCOMING_REACH_M = 15.0
"""How far beside its own lane a vehicle's oncoming lane may lie."""


@dataclass(frozen=True)
class Place:
    """A point on a lanelet's centre line, by arc length in m."""

    lanelet_id: int
    station_m: float

    def pose(self, scene: Scene) -> tuple[Points, float]:
        """Position (2,) in m and heading in rad."""
        return point_at(scene.layout.table.lanes[self.lanelet_id].center, self.station_m)


@dataclass(frozen=True)
class _Reference:
    """Something that a place is given relative to."""

    name: str
    lanelet_id: int
    position: Points


def first_place(edit: Edit, scene: Scene, changes: Changes, length_m: float) -> Place:
    """The place that an edit names, on a lanelet or relative to the ego or a vehicle.

    Raises:
        InvalidRequest: no place, or arguments that contradict each other.
        UnknownName: a lanelet, edge or vehicle that does not exist.
        NotPossible: no such lane, or the road ends before.
    """
    if edit.at is None:
        raise InvalidRequest(
            "add_vehicle needs a place",
            valid=["at=LANELET with position", "at=ego with lane and offset_m", "at=VEHICLE with lane and offset_m"],
            next_step="name one in 'at'",
        )
    lanelet = _lanelet(edit.at, scene, changes)
    if lanelet is not None:
        if edit.lane not in (None, "same"):
            raise InvalidRequest(
                f"lane is relative to the ego or a vehicle; '{edit.at}' is a lanelet",
                valid=["position"],
                next_step="leave lane out, and name the lanelet that is meant in 'at'",
            )
        lane_length = scene.layout.table.lanes[lanelet].length_m
        station = station_m(edit.position or "middle", lanelet, lane_length, length_m / 2)
        return ahead(scene, Place(lanelet, station), edit.offset_m or 0.0)
    if edit.position is not None:
        raise InvalidRequest(
            f"position is for lanelets; '{edit.at}' is none",
            valid=["lane", "offset_m"],
            next_step="leave position out, or name a lanelet in 'at'",
        )
    reference = _reference(edit.at, scene, changes)
    if edit.lane == "oncoming":
        return _oncoming(reference, edit.offset_m or 0.0, scene)
    lane = _lane_beside(reference, edit.lane or "same", scene)
    station, _ = project(scene.layout.table.lanes[lane].center, reference.position)
    return ahead(scene, Place(lane, station), edit.offset_m or 0.0)


def ahead(scene: Scene, place: Place, distance_m: float, targets: frozenset[int] = frozenset()) -> Place:
    """The place farther along the lane (behind for a negative distance), over the straightest joints.

    ``targets``: lanelets on the shortest way to any of which it lies, as far as a way leads there.

    Raises:
        NotPossible: the road ends before.
    """
    lanes, table = scene.layout.table.lanes, scene.layout.table
    key, station, seen = place.lanelet_id, place.station_m + distance_m, {place.lanelet_id}
    room_m = lanes[key].length_m - place.station_m if distance_m > 0.0 else -place.station_m
    while not 0.0 <= station <= lanes[key].length_m:
        forward = station > lanes[key].length_m
        onward = [other for other in (table.successors if forward else table.predecessors)[key] if other not in seen]
        if not onward:
            raise NotPossible(
                f"the road ends before {distance_m:+.6g} m from lanelet {place.lanelet_id} at {place.station_m:.1f} m",
                valid=[f"up to {room_m:+.1f} m, where lanelet {key} {'ends' if forward else 'begins'}"],
                next_step="choose a place within the road",
            )
        before, current = lanes[key].length_m, lanes[key].center
        if forward:
            onward = _towards(scene, key, onward, targets)
            key = max(onward, key=lambda other: (straightness(current, lanes[other].center), -other))
            station -= before
            room_m += lanes[key].length_m
        else:
            key = max(onward, key=lambda other: (straightness(lanes[other].center, current), -other))
            station += lanes[key].length_m
            room_m -= lanes[key].length_m
        seen.add(key)
    return Place(key, station)


def _towards(scene: Scene, key: int, onward: list[int], targets: frozenset[int]) -> list[int]:
    """Those of the lanelets after one that are on the shortest way to targets, else that lead there, else all."""
    if not targets:
        return onward
    way = scene.driven_graph.shortest_route([key], sorted(targets)) or ()
    leading = [other for other in onward if scene.driven_graph.shortest_route([other], sorted(targets))]
    return [other for other in onward if other in way] or leading or onward


def _lanelet(text: str, scene: Scene, changes: Changes) -> int | None:
    """The lanelet that ``at`` names, or None if it names the ego or a vehicle."""
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
            raise NotPossible("the scenario has no ego on a lanelet", next_step="name a lanelet or a vehicle")
        return _Reference("the ego", scene.ego.lanelets[0], scene.ego.position)
    found = _vehicles_meant(text, body.removeprefix("vehicle:"), scene, changes)
    if len(found) != 1:
        raise NotPossible(f"'{text}' means {len(found)} vehicles", valid=found, next_step="name one by its id")
    there = populated(scene, changes)
    if found[0] not in there.tracks or found[0] not in there.matches:
        raise NotPossible(f"vehicle {found[0]} is recorded on no lanelet", next_step="name a lanelet")
    track, match = there.tracks[found[0]], there.matches[found[0]]
    index = track.index_at(scene.ego.step if scene.ego else 0) or 0
    return _Reference(f"vehicle {found[0]}", match.at(index), track.positions[index])


def _vehicles_meant(text: str, selector: str, scene: Scene, changes: Changes) -> tuple[int, ...]:
    """The vehicles that ``at`` means where it names no lanelet or edge that there is."""
    try:
        parse_selector(selector)
    except InvalidRequest as error:
        known = [*map(str, scene.layout.table.lanes), *scene.layout.edges, "ego", *SELECTORS[1:]]
        raise UnknownName(
            f"'{text}' is no lanelet, edge or vehicle",
            valid=closest(text, known),
            next_step="name a lanelet or an edge, the ego, or a vehicle by its id",
        ) from error
    return select([selector], scene, changes)


def _oncoming(reference: _Reference, offset_m: float, scene: Scene) -> Place:
    """The lane of the other direction beside a point so far along the reference's own lane.

    It is the one that the map says lies beside, else the nearest.
    """
    station, _ = project(scene.layout.table.lanes[reference.lanelet_id].center, reference.position)
    own = ahead(scene, Place(reference.lanelet_id, station), offset_m)
    (point, heading), declared = own.pose(scene), _declared_opposite(scene, own.lanelet_id)
    found = []
    for key, lane in scene.layout.table.lanes.items():
        station, beside = project(lane.center, point)
        against = abs(wrap_angle(point_at(lane.center, station)[1] - heading)) > ONCOMING_RAD
        if against and abs(beside) <= ONCOMING_REACH_M and 0.0 < station < lane.length_m:
            found.append((key != declared, abs(beside), key, station))
    if not found:
        raise NotPossible(
            f"{reference.name} has no oncoming lane beside its own {offset_m:+.6g} m along it",
            valid=["lane=same, left or right", "another offset_m"],
            next_step="choose another place",
        )
    *_, key, station = min(found)
    return Place(key, station)


def _declared_opposite(scene: Scene, lanelet_id: int) -> int | None:
    """The lanelet of the other direction that the map puts to the left of a lanelet and those beside it, or None."""
    lanes, seen = scene.layout.table.lanes, {lanelet_id}
    while (left := lanes[lanelet_id].left) in lanes and left not in seen:
        lanelet_id = left
        seen.add(left)
    lanelet = scene.network.find_lanelet_by_id(lanelet_id)
    return None if lanelet.adj_left_same_direction else lanelet.adj_left


def _lane_beside(reference: _Reference, side: str, scene: Scene) -> int:
    if side == "same":
        return reference.lanelet_id
    lane = scene.layout.table.lanes[reference.lanelet_id]
    beside = {"left": lane.left, "right": lane.right}
    there = {key: value for key, value in beside.items() if value is not None and value in scene.layout.table.lanes}
    if side not in there:
        raise NotPossible(
            f"{reference.name} has no lane of its direction to its {side}",
            valid=["same", *there],
            next_step="choose another lane",
        )
    return there[side]


# ---------- entry_speed
# How fast an added vehicle enters when the request leaves it open: with the traffic around it, able to brake.

SHARE_OF_LANE_SPEED = 0.8
LOOK_M = 60.0


@dataclass(frozen=True)
class _Neighbour:
    """A vehicle in the lane: how far ahead of the place its centre is (behind negative), its speed, and its length.

    ``is_parked``: it never moves.
    """

    vehicle_id: int
    distance_m: float
    speed_mps: float
    length_m: float
    is_parked: bool = False

    def gap_m(self, vehicle_class: VehicleClass) -> float:
        """The room between the bumpers."""
        return max(abs(self.distance_m) - (self.length_m + vehicle_class.length_m) / 2, 0.0)


def entry_speed(
    scene: Scene, changes: Changes, vehicle_class: VehicleClass, place: Place, step: int, way: tuple[int, ...]
) -> float:
    """Speed in m/s: 80 % of the lane's, or that of the nearest vehicle in the lane; parked ones are no traffic.

    Never too fast for the leader, parked or not, nor for the bends of the way, which begins with the place's lanelet.

    Raises:
        NotPossible: the vehicle behind would run into it, even if it brakes as hard as it can.
    """
    fastest = min(vehicle_class.maximum_speed_mps, highest_entry_speed(scene, way, place.station_m))
    usual = min(SHARE_OF_LANE_SPEED * scene.driven_speeds_mps[place.lanelet_id], fastest)
    neighbours = _same_lane(scene, changes, place, step)
    traffic = [one for one in neighbours if not one.is_parked and abs(one.distance_m) < LOOK_M]
    nearest = min(traffic, key=lambda one: (abs(one.distance_m), one.distance_m), default=None)
    speed = usual if nearest is None else min(nearest.speed_mps, fastest)
    leaders = [one for one in neighbours if one.distance_m > 0]
    if leaders:
        leader = min(leaders, key=lambda one: one.distance_m)
        free = max(leader.gap_m(vehicle_class) - vehicle_class.minimum_gap_m, 0.0)
        speed = min(speed, math.sqrt(leader.speed_mps**2 + 2 * vehicle_class.deceleration_mps2 * free))
    followers = [one for one in neighbours if one.distance_m <= 0 and not one.is_parked]
    if followers:
        follower = max(followers, key=lambda one: one.distance_m)
        if _comes_along(follower, scene, changes, vehicle_class, place, step):
            _check_follower(follower, vehicle_class, place, speed)
    return speed


def _comes_along(
    follower: _Neighbour, scene: Scene, changes: Changes, vehicle_class: VehicleClass, place: Place, step: int
) -> bool:
    """Whether a vehicle behind comes over the place, and does not turn off before or brake; one that is driven may."""
    recorded = None if follower.vehicle_id in changes.driven else scene.tracks.get(follower.vehicle_id)
    if recorded is None:
        return True
    center, heading_rad = place.pose(scene)
    return gets_onto(recorded, step, center, heading_rad, (vehicle_class.length_m, vehicle_class.width_m))


def _check_follower(follower: _Neighbour, vehicle_class: VehicleClass, place: Place, speed_mps: float) -> None:
    gap = follower.gap_m(vehicle_class)
    needed = _stopping_way_m(max(follower.speed_mps - speed_mps, 0.0))
    if needed > gap:
        raise NotPossible(
            f"a {vehicle_class.name} that enters lanelet {place.lanelet_id} at {place.station_m:.1f} m with "
            f"{speed_mps:.1f} m/s is hit by vehicle {follower.vehicle_id}, which comes {gap:.1f} m behind with "
            f"{follower.speed_mps:.1f} m/s and cannot brake enough",
            valid=[f"at least {needed:.0f} m before its front", "a speed, and the collision is reported"],
            next_step="choose a place farther ahead of it or behind it, or name a speed",
        )


def _same_lane(scene: Scene, changes: Changes, place: Place, step: int) -> list[_Neighbour]:
    """Vehicles in the lane, or in those right before and after it."""
    lanes = scene.layout.table.lanes
    starts = {place.lanelet_id: 0.0}
    for before in scene.lanelet_graph.predecessors.get(place.lanelet_id, ()):
        if before in lanes:
            starts[before] = -lanes[before].length_m
    for after in scene.layout.table.successors[place.lanelet_id]:
        starts[after] = lanes[place.lanelet_id].length_m
    there, found = populated(scene, changes), []
    for key, match in sorted(there.matches.items()):
        track: Track | None = there.tracks.get(key) or there.standing.get(key)
        index = track.index_at(step) if track else None
        if track is None or index is None or match.at(index) not in starts:
            continue
        lanelet = match.at(index)
        station, _ = project(lanes[lanelet].center, track.positions[index])
        distance = starts[lanelet] + station - place.station_m
        is_parked = key not in there.tracks
        found.append(_Neighbour(key, distance, float(track.speeds_mps[index]), track.length_m, is_parked))
    return found


# ---------- occupancy
# Whether a place is free for a vehicle at a time step, and where the nearest free one is.

CLEARANCE_M = 0.3
SEARCH_STEP_M = 1.0
FREE_PLACES_NAMED = 3
NEAR_M = 40.0
"""Vehicles whose centres are farther apart do not touch."""
Body = tuple[str, Points, Points]
"""Name, centre (2,) and corners (4, 2)."""


def occupant(scene: Scene, changes: Changes, place: Place, size_m: tuple[float, float], step: int) -> str:
    """Who stands where a vehicle (length, width) would be put at a step; empty if the place is free."""
    center, heading = place.pose(scene)
    return occupant_at(scene, changes, center, heading, size_m, step)


def occupant_at(
    scene: Scene, changes: Changes, center: Points, heading: float, size_m: tuple[float, float], step: int
) -> str:
    """The same for a centre (2,) in m and a heading in rad."""
    return _in_the_way(center, heading, size_m, _bodies(scene, changes, step))


def free_places(scene: Scene, changes: Changes, place: Place, size_m: tuple[float, float], step: int) -> list[str]:
    """The nearest free places, as ``at`` and ``position``, nearest first: in the lane, else in those next to it."""
    lane, table = scene.layout.table.lanes[place.lanelet_id], scene.layout.table
    beside = [key for key in (lane.left, lane.right) if key is not None and key in table.lanes]
    next_to_it = [*table.successors[place.lanelet_id], *table.predecessors[place.lanelet_id], *beside]
    for lanelets in ([place.lanelet_id], next_to_it):
        found = _free_on(lanelets, scene, changes, place, size_m, step)
        if found:
            return found
    return []


def _free_on(
    lanelets: list[int], scene: Scene, changes: Changes, place: Place, size_m: tuple[float, float], step: int
) -> list[str]:
    """Up to three free places on lanelets, the nearest to a place (as the crow flies) first."""
    wanted, lanes = place.pose(scene)[0], scene.layout.table.lanes
    tried = []
    for key in lanelets:
        for station in np.arange(size_m[0] / 2, lanes[key].length_m - size_m[0] / 2 + 1e-6, SEARCH_STEP_M).tolist():
            other = Place(key, station)
            tried.append((float(np.linalg.norm(other.pose(scene)[0] - wanted)), key, station))
    found: list[str] = []
    there = tuple(_bodies(scene, changes, step))
    for _, key, station in sorted(tried):
        if not _in_the_way(*Place(key, station).pose(scene), size_m, there):
            found.append(f"at={key} position='{station:.1f}m'")
        if len(found) == FREE_PLACES_NAMED:
            break
    return found


def _in_the_way(center: Points, heading: float, size_m: tuple[float, float], bodies: Iterable[Body]) -> str:
    """The first body that is where a vehicle would be put; empty if the place is free."""
    mine = oriented_rectangle(center, heading, (size_m[0] + 2 * CLEARANCE_M, size_m[1] + CLEARANCE_M))
    for name, position, corners in bodies:
        if float(np.abs(position - center).max()) < NEAR_M and rectangles_overlap(mine, corners):
            return name
    return ""


def _bodies(scene: Scene, changes: Changes, step: int) -> Iterator[Body]:
    """Everybody who is known to be there at a step: name, centre (2,) and corners (4, 2).

    Where those are whom edits drive by then, only the simulation shows.
    """
    there = populated(scene, changes)
    driven = {key for key, plan in changes.driven.items() if plan.from_step < step}
    for key, track in (there.tracks | there.standing).items():
        index = track.index_at(step)
        if index is None or key in driven:
            continue
        size = (track.length_m, track.width_m)
        position = track.positions[index]
        yield f"vehicle {key}", position, oriented_rectangle(position, float(track.headings_rad[index]), size)
    for region in scene.regions:
        index = region.track.index_at(step)
        if index is not None and region.obstacle_id not in changes.removed:
            box, position = region.track, region.track.positions[index]
            corners = oriented_rectangle(position, float(box.headings_rad[index]), (box.length_m, box.width_m))
            yield f"obstacle {region.obstacle_id}", position, corners
    if scene.ego is not None and scene.ego.step == step:
        corners = oriented_rectangle(scene.ego.position, scene.ego.heading_rad, EGO_SIZE_M)
        yield "the ego", scene.ego.position, corners
