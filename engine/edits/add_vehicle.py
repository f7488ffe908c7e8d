"""Edit P: put new vehicles in."""

import math
from dataclasses import replace

import numpy as np

from plannerforge.engine.edits.behaviours import behaviour_from, own_minimum_gap_m, usual_behaviour
from plannerforge.engine.edits.changes import Changes, DrivePlan, EditStep
from plannerforge.engine.edits.entry_speed import entry_speed
from plannerforge.engine.edits.lanelet_targets import drive_to, nearest_driven, target_lanelets
from plannerforge.engine.edits.occupancy import CLEARANCE_M, free_places, occupant
from plannerforge.engine.edits.placing import Place, ahead, first_place
from plannerforge.engine.edits.road_users import check_allowed
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.walkers import add_walker
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.engine.traffic.vehicle_classes import VehicleClass, vehicle_classes
from plannerforge.schemas.errors import InvalidRequest, NotPossible, UnknownName, closest
from plannerforge.schemas.grammar import parse_quantity
from plannerforge.schemas.modification import Edit

USUAL_SPACING_M = 10.0
ROUNDING_M = 0.01


def add_vehicle(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Put one or several vehicles of a class in; several stand downstream of the first, ``spacing_m`` apart.

    Raises:
        UnknownName: no such class, lanelet or vehicle.
        NotPossible: the place is taken (the nearest free ones are named), the vehicle behind cannot brake enough, or
            there is no such lane.
    """
    if edit.vehicle_class is not None and edit.vehicle_class.strip().lower() == "pedestrian":
        return add_walker(edit, scene, changes)
    vehicle_class = _class(edit.vehicle_class)
    place = first_place(edit, scene, changes, vehicle_class.length_m)
    check_allowed(vehicle_class.name, place.lanelet_id, scene)
    count = edit.count or 1
    spacing = edit.spacing_m if edit.spacing_m is not None else max(USUAL_SPACING_M, 2 * vehicle_class.length_m)
    targets = target_lanelets(edit.to, scene, changes) if edit.to else frozenset()
    added: list[int] = []
    places: list[Place] = []
    for number in range(count):
        try:
            places.append(ahead(scene, place, number * spacing, targets))
            plan = _plan(edit, scene, changes, vehicle_class, places[-1], targets)
        except NotPossible as error:
            if number == 0:
                raise
            raise _no_more(error, number, count, spacing, vehicle_class) from error
        added.append(changes.next_id)
        changes = replace(changes.with_plan(plan), next_id=changes.next_id + 1)
    who = f"{vehicle_class.name} {', '.join(map(str, added))}"
    what = f"{who} {_where(places, spacing)}, {_entries(edit, scene, changes, added)}"
    aims = {key: (changes.driven[key].targets,) for key in added if changes.driven[key].targets}
    return EditStep(changes, tuple(added), what, added=tuple(added), aims=aims)


def _where(places: list[Place], spacing_m: float) -> str:
    """Where the vehicles enter, the first and the last of several."""
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
    """The refusal of several vehicles of which only some have a place: fewer of them or another spacing would do."""
    least_m = math.ceil(10 * (vehicle_class.length_m + CLEARANCE_M + ROUNDING_M)) / 10
    too_near = spacing_m < least_m
    return NotPossible(
        f"{number} of {count} vehicles have a place, {spacing_m:g} m apart; of the next: {error.message}",
        valid=[f"spacing_m={least_m:g} or more"] if too_near else [f"count={number}"],
        next_step="choose a larger spacing_m" if too_near else "add fewer, or choose another place or spacing_m",
    )


def _entries(edit: Edit, scene: Scene, changes: Changes, added: list[int]) -> str:
    """How fast and when the vehicles enter, once where it is the same for all of them, with the time asked for."""
    words = []
    for key in added:
        start = changes.driven[key].start
        entry = f"{start.speeds_mps[0]:.1f} m/s, from {start.first_step * scene.step_s:.1f} s on"
        late = start.first_step > _asked_step(edit, scene)
        words.append(f"{entry} (asked: {edit.time_s:g} s, but the place is taken until then)" if late else entry)
    if len(set(words)) == 1:
        return words[0]
    return "; ".join(f"{key}: {entry}" for key, entry in zip(added, words, strict=True))


def _class(word: str | None) -> VehicleClass:
    classes = vehicle_classes()
    if word is None:
        raise InvalidRequest(
            "add_vehicle needs a vehicle_class", valid=[*classes, "pedestrian"], next_step="name one in 'vehicle_class'"
        )
    if word.strip().lower() not in classes:
        raise UnknownName(
            f"there is no vehicle class '{word}' that can be added",
            valid=closest(word, [*classes, "pedestrian"]),
            next_step="name one of these in 'vehicle_class'",
        )
    return classes[word.strip().lower()]


def _plan(
    edit: Edit,
    scene: Scene,
    changes: Changes,
    vehicle_class: VehicleClass,
    place: Place,
    targets: frozenset[int],
) -> DrivePlan:
    step = _free_step(edit, scene, changes, vehicle_class, place)
    usual = behaviour_from(usual_behaviour(vehicle_class), edit.preset, edit.params, own_minimum_gap_m(vehicle_class))
    who = f"the added {vehicle_class.name}"
    way = drive_to(scene, place.lanelet_id, targets, who) if targets else (place.lanelet_id,)
    edges = scene.edge_graph.route(way)
    if edges is None:
        raise NotPossible(
            f"{who} cannot drive from lanelet {way[0]} to {way[-1]}: the lanes do not connect",
            valid=nearest_driven(scene, way[0], way[-1:]),
            next_step="choose another lanelet in 'to'",
        )
    asked = None if edit.speed is None else _speed(edit.speed, vehicle_class)
    speed = entry_speed(scene, changes, vehicle_class, place, step, way) if asked is None else asked
    return DrivePlan(
        start=_start(changes.next_id, vehicle_class, scene, place, step, speed),
        cause="added",
        from_step=step,
        lanelets=way,
        edges=scene.edge_graph.extended(edges, way[-1]),
        targets=targets,
        behaviour=usual,
        vehicle_class=vehicle_class,
    )


def _free_step(edit: Edit, scene: Scene, changes: Changes, vehicle_class: VehicleClass, place: Place) -> int:
    """The step at which the vehicle enters: at once, or as soon after a named departure as there is room."""
    size = (vehicle_class.length_m, vehicle_class.width_m)
    first = _asked_step(edit, scene)
    if not 0 <= first < scene.last_step:
        raise InvalidRequest(
            f"departure at {edit.time_s} s is not before the scenario's end",
            valid=[f"0 … {(scene.last_step - 1) * scene.step_s:.1f} s"],
            next_step="choose an earlier time_s",
        )
    last = scene.last_step - 1 if edit.time_s else first
    for step in range(first, last + 1):
        who = occupant(scene, changes, place, size, step)
        if not who:
            return step
    who = occupant(scene, changes, place, size, first)
    raise NotPossible(
        f"lanelet {place.lanelet_id} at {place.station_m:.1f} m is taken by {who}",
        valid=free_places(scene, changes, place, size, first),
        next_step="choose a free place or another departure",
    )


def _asked_step(edit: Edit, scene: Scene) -> int:
    return round((edit.time_s or 0.0) / scene.step_s)


def _speed(text: str, vehicle_class: VehicleClass) -> float:
    speed = parse_quantity(text, "m/s")
    if not 0.0 <= speed <= vehicle_class.maximum_speed_mps:
        limit = vehicle_class.maximum_speed_mps
        raise InvalidRequest(
            f"a {vehicle_class.name} does not drive {text}",
            valid=[f"0 … {limit:g} m/s"],
            next_step="choose another speed or class",
        )
    return speed


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
