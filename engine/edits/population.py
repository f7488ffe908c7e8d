"""Edits P: add vehicles and pedestrians, remove vehicles.

SUMO's vehicles do not walk, so a pedestrian moves at a constant speed along a given line, along a footpath or across a
road. The vehicles that SUMO drives see the pedestrian when it is on their lane, or about to be.

A lanelet's users and type decide who may use it; bicycles and pedestrians are kept off motorways. Pedestrians cross any
other road, and walk along footpaths. An emergency vehicle may drive everywhere.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...schemas.errors import InvalidRequest, NotPossible, UnknownName, closest, with_values
from ...schemas.modification import Edit
from ...schemas.text import counted
from ..commonroad import Track
from ..cosimulation import (
    DrivePlan,
    Manoeuvre,
    Replay,
    Script,
    ScriptPart,
    behaviour_from,
    own_minimum_gap_m,
    usual_behaviour,
)
from ..geometry import Points, length_m, point_at, project, without_repeats
from ..network import station_m
from ..scene import Scene
from ..vehicles import PEDESTRIAN, VehicleClass, vehicle_class_of, vehicle_classes
from .changes import Changes, EditStep, check_speed, listed, parse_speed, within_time
from .entries import CLEARANCE_M, NO_NEIGHBOURS, PLACE_TAKEN, OccupiedPlaces, entry_speed, gaps_in_words
from .placement import Place, advance_along_lane, first_place, read_trigger
from .references import drive_to, nearest_driven, select, target_lanelets

_USUAL_SPACING_M = 10.0
"""Spacing between the centres of several vehicles, or twice their length if that is more (chosen)."""
_ROUNDING_M = 0.01
"""The least spacing that a refusal gives is rounded up from this much more than needed."""
_WALKING_MPS, _RUNNING_MPS = 1.4, 4.0
"""The usual speed of pedestrians, and the highest (chosen)."""
_SIZE_M = (0.5, 0.6)
"""Length and width of a person (chosen)."""


@dataclass(frozen=True)
class _Crosser:
    """A road user that crosses a road: its name, CommonRoad's type, length and width, and limits of its motion."""

    name: str
    kind: str
    size_m: tuple[float, float]
    largest_mps: float
    acceleration_mps2: float = math.inf


_PEDESTRIAN = _Crosser("pedestrian", "pedestrian", _SIZE_M, _RUNNING_MPS)
_CYCLIST = _Crosser("bicycle", "bicycle", (1.6, 0.65), 5.6, 1.0)
"""Size and limits of the class ``bicycle`` (``engine/vehicles/classes.py``)."""
_PARKING_GAP_M = 1.5
"""Gap between the bumpers of vehicles that are parked one behind the other (chosen)."""
_FROM_LANE_M = 0.1
"""Gap between a parked vehicle and the lane (chosen), so that drivers who keep to lanes pass it."""
_KERB_M = 0.6
"""A crossing pedestrian starts and ends this far outside the road (chosen)."""
_MOTORWAY_WORDS = frozenset({"highway", "interstate", "mainCarriageWay"})
"""Lanelet types and scenario tags of motorways; some recordings have only the tag."""
_FOOTPATH_TYPES = frozenset({"sidewalk", "crosswalk"})
_USERS_OF_TYPE: Mapping[str, frozenset[str]] = {
    "busLane": frozenset({"bus", "taxi"}),
    "bicycleLane": frozenset({"bicycle"}),
}
"""Types of lanelets for some vehicles only, used if the file does not list the users itself."""
_ANY_VEHICLE = "vehicle"
"""CommonRoad's road user for all vehicles."""
_SLOW_CLASSES, _EVERYWHERE = ("bicycle", "pedestrian"), "priorityVehicle"


@dataclass(frozen=True)
class _Entering:
    """A vehicle on entry: the reason for its speed (empty if the speed was given), and the gaps to its neighbours."""

    plan: DrivePlan
    reason: str
    ahead: str
    behind: str


def add_vehicle(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Add one or more vehicles of a class; further vehicles are placed downstream of the first, ``spacing_m`` apart.

    Raises:
        UnknownName: there is no such class, lanelet or vehicle.
        NotPossible: the place is occupied (the error lists the nearest free places), the vehicle behind cannot brake
            enough, or there is no such lane.
    """
    named = None if edit.vehicle_class is None else vehicle_class_of(edit.vehicle_class)
    if named == "pedestrian":
        return _add_crossing(edit, scene, changes, _PEDESTRIAN)
    if named == "bicycle" and edit.side is not None and edit.speed is not None:
        return _add_crossing(edit, scene, changes, _CYCLIST)
    vehicle_class = resolve_class(edit.vehicle_class, on_foot=True)
    if edit.duration_s is not None:
        raise InvalidRequest(
            "duration_s applies to a pedestrian or crossing cyclist here: how long it stands at the kerb",
            valid=["time_s", "vehicle_class=pedestrian"],
            next_step="remove duration_s, or give time_s for a later entry",
            remedies=[with_values(duration_s=None)],
        )
    if edit.side is not None:
        return _add_parked(edit, scene, changes, vehicle_class)
    if edit.dodge is not None:
        raise InvalidRequest(
            "dodge applies to pedestrians here; an added vehicle yields by itself",
            valid=["without dodge"],
            next_step="remove dodge",
            remedies=[with_values(dodge=None)],
        )
    if edit.when is not None:
        raise InvalidRequest(
            "when applies to pedestrians here; a vehicle enters at a time",
            valid=["time_s", "vehicle_class=pedestrian"],
            next_step="give a time, or add a separate edit with 'when' for the added vehicle",
        )
    place = first_place(edit, scene, changes, vehicle_class.length_m)
    check_allowed(vehicle_class.name, place.lanelet_id, scene)
    count = edit.count or 1
    spacing = edit.spacing_m if edit.spacing_m is not None else max(_USUAL_SPACING_M, 2 * vehicle_class.length_m)
    targets = target_lanelets(edit.to, scene, changes) if edit.to else frozenset()
    added: list[int] = []
    places: list[Place] = []
    entering: list[_Entering] = []
    for number in range(count):
        try:
            places.append(advance_along_lane(scene, place, number * spacing, targets))
            entering.append(_plan(edit, scene, changes, vehicle_class, places[-1], targets))
        except NotPossible as error:
            if number == 0:
                raise
            raise _no_more(error, number, count, spacing, vehicle_class) from error
        added.append(changes.next_id)
        changes = replace(changes.with_plan(entering[-1].plan), next_id=changes.next_id + 1)
    kind = counted(len(added), vehicle_class.name).partition(" ")[2]
    who = f"{kind} {', '.join(map(str, added))}"
    requested = (edit.vehicle_class or "").strip()
    who += f" ({requested!r} read as {vehicle_class.name})" if requested.lower() != vehicle_class.name else ""
    where = f"{_where(places, spacing)}{_why_there(edit)}"
    why = f" ({entering[0].reason})" if entering[0].reason else ""
    around = entering[-1].ahead, entering[0].behind
    gaps = "no vehicle ahead or behind in its lane" if around == NO_NEIGHBOURS else f"gaps: {', '.join(around)}"
    stands = " (stands until another edit moves it)" if changes.driven[added[0]].manoeuvres else ""
    what = f"{who} {where}, at {_entries(edit, scene, changes, added, why)}{stands}, {gaps}"
    aims = {key: (changes.driven[key].targets,) for key in added if changes.driven[key].targets}
    return EditStep(changes, tuple(added), what, added=tuple(added), aims=aims)


def _why_there(edit: Edit) -> str:
    """Return text on how the place was computed; empty if the edit gives a position on a lanelet."""
    if edit.position is not None:
        return ""
    of_lanelet = (edit.at or "").strip().isdigit() and not edit.offset_m
    if of_lanelet:
        return " (its middle, because no position was given)"
    place = (edit.at or "").strip().replace("vehicle:", "vehicle ")
    who = "the ego" if place == "ego" else place
    distance, unit = (edit.gap_s, "s") if edit.gap_s is not None else (edit.offset_m, "m")
    where = f"{abs(distance):g} {unit} {'ahead of' if distance > 0 else 'behind'}" if distance else "at"
    lane = f", {edit.lane} lane" if edit.lane else ""
    return f" ({where} {who}{lane})"


def _where(places: list[Place], spacing_m: float) -> str:
    """Return text on where the vehicles enter: the place of a single vehicle, or the first and the last place."""
    first, last = places[0], places[-1]
    begin, end = (f"lanelet {place.lanelet_id} at {place.station_m:.1f} m" for place in (first, last))
    if len(places) == 1:
        return f"on {begin}"
    if first.lanelet_id == last.lanelet_id:
        along = f"on lanelet {first.lanelet_id} from {first.station_m:.1f} to {last.station_m:.1f} m"
    else:
        along = f"from {begin} to {end}"
    return f"{along}, {spacing_m:g} m apart"


def _no_more(error: NotPossible, number: int, count: int, spacing_m: float, vehicle_class: VehicleClass) -> NotPossible:
    """Return the refusal of an edit with too little room for all vehicles; it proposes fewer, or a larger spacing."""
    least_m = math.ceil(10 * (vehicle_class.length_m + CLEARANCE_M + _ROUNDING_M)) / 10
    too_near = spacing_m < least_m
    why = f"a {vehicle_class.name} is {vehicle_class.length_m:g} m long" if too_near else error.message
    return NotPossible(
        f"only {number} of {count} vehicles fit {spacing_m:g} m apart: {why}",
        reason=error.reason,
        valid=[f"spacing_m={least_m:g}"] if too_near else [f"count={number}"],
        next_step="choose a larger spacing_m" if too_near else "add fewer, or choose another place or spacing_m",
    )


def _entries(edit: Edit, scene: Scene, changes: Changes, added: list[int], why: str) -> str:
    """Return speeds and times of entries, once if all are equal, with the requested time if it differs.

    ``why`` is the reason for the speed, in brackets, or empty.
    """
    words = []
    for key in added:
        start = changes.driven[key].start
        entry = f"{round(start.speeds_mps[0], 1):g} m/s{why} from {start.first_step * scene.step_s:g} s"
        late = start.first_step > _requested_step(edit, scene)
        words.append(f"{entry} (requested: {edit.time_s:g} s, but the place is not free earlier)" if late else entry)
    if len(set(words)) == 1:
        return words[0]
    return "; ".join(f"{key}: {entry}" for key, entry in zip(added, words, strict=True))


def resolve_class(word: str | None, *, on_foot: bool = False) -> VehicleClass:
    """Return the class of vehicle that a word means.

    Args:
        word: a name of a class in any language of the table, or None.
        on_foot: whether the edit also accepts pedestrians, so that refusals list them.

    Raises:
        InvalidRequest: there is no word.
        UnknownName: there is no such class.
        NotPossible: the word means a pedestrian, which is not a vehicle.
    """
    classes = vehicle_classes()
    names = [*classes, PEDESTRIAN.name] if on_foot else [*classes]
    if word is None:
        raise InvalidRequest(
            "the edit needs a vehicle_class",
            valid=names,
            next_step="give one in 'vehicle_class'",
            remedies=[with_values(vehicle_class="car")],
        )
    known = vehicle_class_of(word)
    if known in classes:
        return classes[known]
    if known == PEDESTRIAN.name:
        raise NotPossible(
            f"this edit needs a class of vehicle, not '{word}'",
            valid=names,
            next_step="choose a class of vehicle, or add a pedestrian with op add_vehicle",
            complete=True,
        )
    if word.strip().lower() not in classes:
        raise UnknownName(
            f"there is no vehicle class '{word}' that can be added",
            valid=closest(word, names),
            next_step="give one of these in 'vehicle_class'",
            complete=True,
        )
    return classes[word.strip().lower()]


def _plan(
    edit: Edit, scene: Scene, changes: Changes, vehicle_class: VehicleClass, place: Place, targets: frozenset[int]
) -> _Entering:
    step = _free_step(edit, scene, changes, vehicle_class, place)
    usual = behaviour_from(usual_behaviour(vehicle_class), edit.preset, edit.params, own_minimum_gap_m(vehicle_class))
    who = f"the added {vehicle_class.name}"
    route = drive_to(scene, place.lanelet_id, targets, who) if targets else (place.lanelet_id,)
    edges = scene.edge_graph.route(route)
    if edges is None:
        raise NotPossible(
            f"{who} cannot drive from lanelet {route[0]} to {route[-1]}: the lanes do not connect",
            valid=nearest_driven(scene, route[0], route[-1:]),
            next_step="choose another lanelet in 'to'",
        )
    if edit.speed is None:
        entry = entry_speed(scene, changes, vehicle_class, place, step, route)
        speed, reason = entry.speed_mps, entry.reason
    else:
        reason = ""
        largest_mps = vehicle_class.maximum_speed_mps
        speed, refusal = parse_speed(edit.speed, largest_mps), f"a {vehicle_class.name} cannot drive at {edit.speed}"
        check_speed(speed, largest_mps, refusal, "choose another speed or class")
    plan = DrivePlan(
        start=_start(changes.next_id, vehicle_class, scene, place, step, speed),
        cause="added",
        from_step=step,
        lanelets=route,
        edges=scene.edge_graph.extended(edges, route[-1]),
        targets=targets,
        behaviour=usual,
        vehicle_class=vehicle_class,
        manoeuvres=(Manoeuvre(step, speed_mps=0.0),) if _stands_until_edited(edit, speed) else (),
    )
    return _Entering(plan, reason, *gaps_in_words(scene, changes, vehicle_class, place, step, speed))


def _stands_until_edited(edit: Edit, speed_mps: float) -> bool:
    """Return True if a vehicle is added to stand until another edit moves it."""
    return edit.speed is not None and speed_mps == 0.0 and not edit.to


def _free_step(edit: Edit, scene: Scene, changes: Changes, vehicle_class: VehicleClass, place: Place) -> int:
    """Return the step at which the vehicle enters: at once or, with a given departure, as soon as there is room."""
    size = (vehicle_class.length_m, vehicle_class.width_m)
    first = _requested_step(edit, scene)
    if not 0 <= first < scene.last_step:
        raise InvalidRequest(
            f"departure at {first * scene.step_s:.1f} s is not before the scenario's end",
            valid=[f"0 to {(scene.last_step - 1) * scene.step_s:.1f} s"],
            next_step="choose an earlier time_s",
            remedies=within_time(first, 0, scene.last_step - 1, scene),
        )
    steps = range(first, scene.last_step if edit.time_s else first + 1)
    free = (step for step in steps if OccupiedPlaces.at(scene, step, changes).occupant(place, size) is None)
    step = next(free, first)

    def suits(other: Place) -> bool:
        return edit.speed is not None or _is_safe_entry(scene, changes, vehicle_class, other, step)

    OccupiedPlaces.at(scene, step, changes).check_free(
        place, size, "choose a free place or another departure time", side=_side_of(edit), suits=suits
    )
    return step


def _is_safe_entry(scene: Scene, changes: Changes, vehicle_class: VehicleClass, place: Place, step: int) -> bool:
    """Return whether the vehicle behind a place can brake for a vehicle that enters there."""
    try:
        entry_speed(scene, changes, vehicle_class, place, step, (place.lanelet_id,))
    except NotPossible:
        return False
    return True


def _side_of(edit: Edit) -> int:
    """Return 1 if the edit places a vehicle ahead of another in its lane, -1 if behind it, otherwise 0."""
    offset_m = edit.gap_s if edit.offset_m is None else edit.offset_m
    return 0 if not offset_m else 1 if offset_m > 0 else -1


def _requested_step(edit: Edit, scene: Scene) -> int:
    """Return the step of the given departure, else of the ego's start, to which relative places refer."""
    if edit.time_s is None:
        return scene.ego.step if scene.ego else 0
    return round(edit.time_s / scene.step_s)


def _start(key: int, vehicle_class: VehicleClass, scene: Scene, place: Place, step: int, speed_mps: float) -> Track:
    center, heading = place.pose(scene)
    return Track(
        obstacle_id=key,
        kind=vehicle_class.commonroad_type,
        length_m=vehicle_class.length_m,
        width_m=vehicle_class.width_m,
        first_step=step,
        positions=center[None],
        headings_rad=np.array([heading]),
        speeds_mps=np.array([speed_mps]),
    )


def _add_parked(edit: Edit, scene: Scene, changes: Changes, vehicle_class: VehicleClass) -> EditStep:
    """Park vehicles at a kerb: next to the outermost lane on a side of the road, clear of traffic.

    Raises:
        InvalidRequest: arguments for driving vehicles are given.
        NotPossible: the place is occupied or belongs to another lane.
    """
    foreign = [name for name in ("to", "preset", "params", "speed", "time_s") if name in edit.given]
    if foreign:
        raise InvalidRequest(
            f"{' and '.join(foreign)} cannot be combined with side, which parks a vehicle at the kerb",
            valid=["at", "position", "lane", "offset_m", "count", "spacing_m"],
            next_step=f"remove {' and '.join(foreign)}, or remove side",
            remedies=[with_values(**dict.fromkeys(foreign))],
        )
    place, side = first_place(edit, scene, changes, vehicle_class.length_m), edit.side or "right"
    count = edit.count or 1
    spacing = edit.spacing_m or vehicle_class.length_m + _PARKING_GAP_M
    added: list[int] = []
    for number in range(count):
        center, heading = _at_kerb(scene, advance_along_lane(scene, place, number * spacing), side, vehicle_class)
        occupant = OccupiedPlaces.at(scene, 0, changes).occupant_at(
            center, heading, (vehicle_class.length_m, vehicle_class.width_m)
        )
        if occupant is not None:
            raise NotPossible(
                f"{number} of {count} vehicles fit at the {side} kerb; the next place is occupied by {occupant}",
                reason=PLACE_TAKEN,
                valid=[f"count={number}"] if number else ["another position", "the other side"],
                next_step="choose another place",
            )
        steps = scene.last_step + 1
        track = Track(
            obstacle_id=changes.next_id,
            kind="parkedVehicle",
            length_m=vehicle_class.length_m,
            width_m=vehicle_class.width_m,
            first_step=0,
            positions=np.repeat(center[None], steps, axis=0),
            headings_rad=np.full(steps, heading),
            speeds_mps=np.zeros(steps),
        )
        added.append(track.obstacle_id)
        changes = replace(changes.with_replay(Replay(track, None, is_parked=True)), next_id=changes.next_id + 1)
    who = ", ".join(map(str, added))
    what = (
        f"{vehicle_class.name} {who} parked at the {side} kerb of lanelet {place.lanelet_id} at "
        f"{place.station_m:.1f} m, {_FROM_LANE_M:g} m from the lane"
    )
    return EditStep(changes, tuple(added), what, added=tuple(added))


def _at_kerb(scene: Scene, place: Place, side: str, vehicle_class: VehicleClass) -> tuple[Points, float]:
    """Return the centre (2,) in m and the heading of a vehicle parked next to the outermost lane of a side.

    Raises:
        NotPossible: the place belongs to another lane.
    """
    point, heading = place.pose(scene)
    left = np.array([-np.sin(heading), np.cos(heading)])
    offsets = [offset for key in _side_by_side(scene, place.lanelet_id) for offset in _bounds(scene, key, point, left)]
    half_m = vehicle_class.width_m / 2 + _FROM_LANE_M
    aside_m = max(offsets) + half_m if side == "left" else min(offsets) - half_m
    center: Points = point + left * aside_m
    ahead = np.array([np.cos(heading), np.sin(heading)])
    corners = [center + ahead * shift for shift in (-vehicle_class.length_m / 2, 0.0, vehicle_class.length_m / 2)]
    there = [
        int(key)
        for found in scene.network.find_lanelet_by_position(corners)
        for key in found
        if int(key) in scene.layout.table.lanes
    ]
    if there:
        raise NotPossible(
            f"lanelet {min(there)} is at the {side} kerb of lanelet {place.lanelet_id}",
            valid=["another position", "the other side"],
            next_step="choose another place",
        )
    return center, heading


def _add_crossing(edit: Edit, scene: Scene, changes: Changes, who: _Crosser) -> EditStep:
    """Add a pedestrian or cyclist who moves along a footpath or crossing from the place, or crosses the road there.

    With ``duration_s``, the pedestrian or cyclist first stands at the start for that time, where drivers can see them.

    Raises:
        InvalidRequest: an argument for vehicles is given, or the speed or the departure is impossible.
        NotPossible: the road is a motorway, or the place is occupied.
    """
    foreign = [name for name in ("to", "preset", "params", "count", "spacing_m") if name in edit.given]
    if foreign:
        raise InvalidRequest(
            f"{', '.join(foreign)} applies to vehicles; a crossing {who.name} moves straight on",
            valid=["at", "position", "lane", "offset_m", "speed", "time_s"],
            next_step="remove it",
        )
    speed = _WALKING_MPS if edit.speed is None else parse_speed(edit.speed, who.largest_mps)
    does = "walk" if who is _PEDESTRIAN else "drive"
    check_speed(speed, who.largest_mps, f"a {who.name} cannot {does} at {edit.speed}", "choose a slower speed")
    line, where = _line(edit, scene, changes, stands=speed == 0.0)
    middle = line[[0, -1]].mean(axis=0)
    first = _requested_step(edit, scene)
    trigger = None
    if edit.when is not None:
        if edit.duration_s is not None:
            raise InvalidRequest(
                "when and duration_s both say when it sets off",
                valid=["when", "duration_s"],
                next_step="give one of them",
                remedies=[with_values(duration_s=None)],
            )
        trigger, first = read_trigger(edit.when, scene, changes, lambda _: middle)
    if not 0 <= first < scene.last_step:
        raise InvalidRequest(
            f"departure at {first * scene.step_s:.1f} s is not within the scenario",
            valid=[f"0 to {(scene.last_step - 1) * scene.step_s:.1f} s"],
            next_step="choose another time_s",
        )
    waits_s = edit.duration_s or 0.0
    track = _crossed(changes.next_id, line, speed, first, scene, who, waits_s)
    places = OccupiedPlaces.at(scene, first, changes)
    occupant = places.occupant_at(track.positions[0], float(track.headings_rad[0]), who.size_m)
    if occupant is not None:
        raise NotPossible(
            f"the place is occupied by {occupant}", reason=PLACE_TAKEN, next_step="choose another position or departure"
        )
    parts = () if trigger is None else (ScriptPart(first, (), trigger),)
    script = Script(track, parts, bool(edit.dodge))
    replay = Replay(track, None, script=script if script.depends_on_ego else None)
    changes = replace(changes.with_replay(replay), next_id=changes.next_id + 1)
    what = f"{who.name} {track.obstacle_id} {where} at {round(speed, 1):g} m/s from {first * scene.step_s:g} s"
    if waits_s:
        what += f", after standing there for {waits_s:g} s"
    if trigger is not None:
        what += f"; in reactive runs it starts when the planner's ego has {edit.when}"
    return EditStep(changes, (track.obstacle_id,), what, added=(track.obstacle_id,))


def _line(edit: Edit, scene: Scene, changes: Changes, *, stands: bool) -> tuple[Points, str]:
    """Return the line (n, 2) that a pedestrian walks along, and its place as text."""
    footpath = _footpath(edit, scene)
    if footpath is not None:
        return _along(edit, footpath, scene, stands=stands)
    place = first_place(edit, scene, changes, _SIZE_M[0])
    check_allowed("pedestrian", place.lanelet_id, scene)
    if stands:
        (x, y), heading = place.pose(scene)
        line = np.array([(x, y), (x + np.cos(heading), y + np.sin(heading))])
        return line, _stands_on(place.lanelet_id, place.station_m)
    line = _across(scene, place)
    begin, end = ("left", "right") if edit.side == "left" else ("right", "left")
    where = f"crosses lanelet {place.lanelet_id} from {begin} to {end}, {place.station_m:.1f} m along it,"
    return line[::-1] if begin == "left" else line, where


def _along(edit: Edit, footpath: int, scene: Scene, *, stands: bool) -> tuple[Points, str]:
    """Return the line (n, 2) along a footpath or crossing, and its place as text."""
    if edit.lane not in (None, "same"):
        raise InvalidRequest(
            f"lane is relative to the ego or a vehicle; '{edit.at}' is a lanelet",
            valid=["position", "offset_m"],
            next_step="remove lane",
        )
    center = without_repeats(np.asarray(scene.network.find_lanelet_by_id(footpath).center_vertices, dtype=float))
    last_m = length_m(center) - _SIZE_M[0]
    station = station_m(edit.position or "beginning", footpath, length_m(center)) + (edit.offset_m or 0.0)
    if not 0.0 <= station <= last_m:
        raise InvalidRequest(
            f"lanelet {footpath} has no room for a pedestrian at {station:.1f} m",
            valid=[f"position='0m' … position='{math.floor(last_m * 10) / 10:g}m'"],
            next_step="choose another position",
        )
    onward = [vertex for vertex in center if project(center, vertex)[0] > station + 1e-6]
    line = np.array([point_at(center, station)[0], *onward])
    return line, _stands_on(footpath, station) if stands else f"walks along lanelet {footpath} from {station:.1f} m"


def _stands_on(lanelet_id: int, station: float) -> str:
    return f"stands on lanelet {lanelet_id} at {station:.1f} m"


def _footpath(edit: Edit, scene: Scene) -> int | None:
    known = {int(lanelet.lanelet_id) for lanelet in scene.network.lanelets}
    text = (edit.at or "").strip()
    return int(text) if text.isdigit() and int(text) in known and _is_footpath(scene, int(text)) else None


def _across(scene: Scene, place: Place) -> Points:
    """Return the line (2, 2) from the right edge of the road to its left edge, across all adjacent lanes."""
    point, heading = place.pose(scene)
    left = np.array([-np.sin(heading), np.cos(heading)])
    return np.array([point + left * offset for offset in road_across(scene, place.lanelet_id, point, heading)])


def road_across(scene: Scene, lanelet_id: int, point: Points, heading_rad: float) -> tuple[float, float]:
    """Return where a crossing through a point of a lanelet starts and ends, in m to the left of that point.

    The first is on the right of the road, and usually negative.
    """
    left = np.array([-np.sin(heading_rad), np.cos(heading_rad)])
    offsets = [offset for key in _side_by_side(scene, lanelet_id) for offset in _bounds(scene, key, point, left)]
    return min(offsets) - _KERB_M, max(offsets) + _KERB_M


def _side_by_side(scene: Scene, lanelet_id: int) -> list[int]:
    """Return the lanelets of a road at a place, including oncoming lanelets."""
    row = [lanelet_id]
    for key in row:
        lanelet = scene.network.find_lanelet_by_id(key)
        row += [int(other) for other in (lanelet.adj_left, lanelet.adj_right) if other is not None and other not in row]
    return row


def _bounds(scene: Scene, lanelet_id: int, point: Points, left: Points) -> list[float]:
    """Return how far each bound of a lanelet is to the left of a point (negative: to the right)."""
    lanelet = scene.network.find_lanelet_by_id(lanelet_id)
    lines = [
        without_repeats(np.asarray(bound, dtype=float)) for bound in (lanelet.left_vertices, lanelet.right_vertices)
    ]
    return [float((point_at(line, project(line, point)[0])[0] - point) @ left) for line in lines]


def _crossed(
    key: int, line: Points, speed_mps: float, first: int, scene: Scene, who: _Crosser, waits_s: float
) -> Track:
    """Return the motion along a line until it or the scenario ends; at speed 0, the road user stands at its start.

    It stands for ``waits_s``, then accelerates as its kind does.
    """
    times = np.maximum(np.arange(scene.last_step - first + 1) * scene.step_s - waits_s, 0.0)
    gains_s = speed_mps / who.acceleration_mps2 if waits_s else 0.0
    gained = np.minimum(times, gains_s)
    speeds = np.where(times <= gains_s, gained * who.acceleration_mps2 if gains_s else speed_mps, speed_mps)
    if waits_s:
        speeds = np.where(times > 0.0, speeds, 0.0)
    stations = speed_mps * (times - gained) + (gained**2 * who.acceleration_mps2 / 2 if gains_s else 0.0)
    on_line = stations <= length_m(line)
    poses = [point_at(line, float(station)) for station in stations[on_line]]
    return Track(
        obstacle_id=key,
        kind=who.kind,
        length_m=who.size_m[0],
        width_m=who.size_m[1],
        first_step=first,
        positions=np.array([point for point, _ in poses]),
        headings_rad=np.array([heading for _, heading in poses]),
        speeds_mps=speeds[on_line],
    )


def check_allowed(class_name: str, lanelet_id: int, scene: Scene) -> None:
    """Refuse a road user that may not use the road at a lanelet.

    Raises:
        NotPossible: users or type of the lanelet exclude the class, or a bicycle or pedestrian is on a motorway.
    """
    reason = _closed_because(class_name, lanelet_id, scene)
    if reason is not None:
        elsewhere = [key for key in scene.layout.table.lanes if _closed_because(class_name, key, scene) is None]
        raise NotPossible(
            f"a {class_name} is not allowed on lanelet {lanelet_id}: {reason}",
            valid=elsewhere,
            next_step="choose another class" if not elsewhere else "choose another lanelet or class",
        )


def _is_footpath(scene: Scene, lanelet_id: int) -> bool:
    """Return True if a lanelet is intended for walking."""
    return bool(_kinds(scene, lanelet_id) & _FOOTPATH_TYPES) or _users(scene, lanelet_id) == {"pedestrian"}


def _closed_because(class_name: str, lanelet_id: int, scene: Scene) -> str | None:
    """Return why a class may not use a lanelet, judged by its users, else its type, else the kind of road, or None."""
    user, kinds, users = _user(class_name), _kinds(scene, lanelet_id), _users(scene, lanelet_id)
    if user == _EVERYWHERE or user in users:
        return None
    if users and _ANY_VEHICLE not in users and user != "pedestrian":
        return f"it is for {', '.join(sorted(users))}"
    special = sorted(kinds & _USERS_OF_TYPE.keys())
    if special and not users and user != "pedestrian":
        return None if any(user in _USERS_OF_TYPE[kind] for kind in special) else f"it is a {' and '.join(special)}"
    return "it belongs to a motorway" if user in _SLOW_CLASSES and not special and _is_motorway(scene, kinds) else None


def _is_motorway(scene: Scene, kinds: set[str]) -> bool:
    tags = {str(tag.value) for tag in scene.loaded.scenario.tags or ()}
    return bool((kinds | tags) & _MOTORWAY_WORDS)


def _user(class_name: str) -> str:
    """Return CommonRoad's word for a class."""
    vehicle_class = vehicle_classes().get(class_name)
    return class_name if vehicle_class is None else vehicle_class.commonroad_type


def _kinds(scene: Scene, lanelet_id: int) -> set[str]:
    return {str(kind.value) for kind in scene.network.find_lanelet_by_id(lanelet_id).lanelet_type or ()}


def _users(scene: Scene, lanelet_id: int) -> set[str]:
    """Return the users that a file lists for a lanelet, for one direction or both; empty if there is no list."""
    lanelet = scene.network.find_lanelet_by_id(lanelet_id)
    return {str(user.value) for user in {*(lanelet.user_one_way or ()), *(lanelet.user_bidirectional or ())}}


def remove_vehicle(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Remove the selected vehicles; the others stay as recorded, and driven vehicles no longer see them."""
    vehicles = select(edit.vehicles, scene, changes)
    for vehicle_id in vehicles:
        changes = changes.without(vehicle_id)
    return EditStep(changes, vehicles, f"removed {listed(vehicles, 12)}")
