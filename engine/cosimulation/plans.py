"""Plans for the road users that SUMO drives or replays: immutable values, made before a simulation.

A :class:`DrivePlan` is for a vehicle that SUMO drives from a step on. A :class:`Replay` is for a road user that follows
a given track. Every edit creates new plans.

SUMO's vehicles keep their lanes inside junctions. A vehicle that changes lanes inside a junction when it is handed over
(:class:`JunctionLaneChange`) is driven on the adjacent lanelet from its first step (:func:`shown_track`). In the
written motion, it moves gradually from its recorded position to that lanelet, and moves sideways only while it rolls
(:func:`lane_change_track`).
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ...schemas.errors import NotPossible
from ..commonroad import Track
from ..geometry import Points, arc_length, point_at, project
from ..scene import NOT_DRIVEN, LaneMatch, Scene
from ..vehicles import VehicleClass, vehicle_classes
from .driver import Behaviour, usual_behaviour
from .manoeuvres import Halt, Manoeuvre, StopOrder
from .triggers import Script

Cause = Literal["edited", "added", "handed_over"]
NOT_DRIVABLE = "not_drivable"
"""The reason of a refusal if SUMO cannot drive a recorded vehicle."""


@dataclass(frozen=True)
class JunctionLaneChange:
    """A lane change inside a junction: SUMO uses ``lanelet_id`` at once; the written motion moves over gradually, while
    the vehicle rolls.

    ``within_m``: the distance of the change along the lane, from the hand-over.
    """

    lanelet_id: int
    within_m: float


@dataclass(frozen=True)
class DrivePlan:
    """A vehicle that SUMO drives from ``from_step`` on.

    ``start``: its recorded track, or a track of one pose for an added vehicle. ``lanelets``: its intended route.
    ``edges``: SUMO's route for it. ``targets``: the lanelets that the edit accepts as targets; empty if it has no
    target. ``through``: lanelets of the route that the vehicle must use. ``manoeuvres``: its orders, by step.
    ``junction_lane_change``: how it changes lanes if it is handed over inside a junction, or None. ``halts``: where it
    waits for others. ``stops``: the stops that edits order. ``gives_way``: whether it waits for others that it would
    hit. ``ignores_lights``: whether it neither stops at red lights nor yields.
    """

    start: Track
    cause: Cause
    from_step: int
    lanelets: tuple[int, ...]
    edges: tuple[str, ...]
    targets: frozenset[int]
    behaviour: Behaviour
    vehicle_class: VehicleClass
    manoeuvres: tuple[Manoeuvre, ...] = ()
    through: frozenset[int] = frozenset()
    junction_lane_change: JunctionLaneChange | None = None
    halts: tuple[Halt, ...] = ()
    stops: tuple[StopOrder, ...] = ()
    gives_way: bool = False
    ignores_lights: bool = False


@dataclass(frozen=True)
class Replay:
    """A road user that follows a given track instead of being driven by SUMO.

    It is a recording moved in time, an added pedestrian, or a vehicle with a motion that an edit prescribes.
    ``recording``: the original, moved by ``shifted_steps`` (later positive); None for an added road user.
    ``is_scripted``: whether the motion is prescribed and kept regardless of others. ``is_parked``: whether it is an
    added vehicle that stands and is not traffic. ``from_step``: the first step at which it differs from its recording.
    ``script``: what it does in reactive traffic, if that depends on the ego; None means that it follows the track there
    too.
    """

    track: Track
    match: LaneMatch | None
    recording: Track | None = None
    shifted_steps: int = 0
    is_scripted: bool = False
    is_parked: bool = False
    from_step: int = 0
    script: Script | None = None


def recorded_plan(scene: Scene, vehicle_id: int, cause: Cause, from_step: int) -> DrivePlan:
    """Return a plan that drives a recorded vehicle along its recorded route, starting at a step.

    Raises:
        NotPossible: the vehicle cannot be driven.
    """
    why = not_drivable(scene, vehicle_id)
    edges = None if why else scene.edge_graph.route(scene.matches[vehicle_id].sequence)
    if edges is None:
        raise NotPossible(
            why,
            valid=[key for key in _by_distance(scene, vehicle_id) if not not_drivable(scene, key)],
            next_step="remove it with remove_vehicle, or choose a valid one (nearest first), which can be driven",
            reason=NOT_DRIVABLE,
        )
    track, lanelets = scene.tracks[vehicle_id], scene.matches[vehicle_id].sequence
    vehicle_class = class_of(track.kind)
    return DrivePlan(
        start=track,
        cause=cause,
        from_step=from_step,
        lanelets=lanelets,
        edges=scene.edge_graph.extended(edges, lanelets[-1]),
        targets=frozenset(),
        behaviour=usual_behaviour(vehicle_class),
        vehicle_class=vehicle_class,
    )


def sent_on(plan: DrivePlan) -> DrivePlan:
    """Return the plan of a vehicle that an edit sends somewhere; one added at a standstill starts to move."""
    if plan.cause != "added" or plan.manoeuvres != (Manoeuvre(plan.from_step, speed_mps=0.0),):
        return plan
    return replace(plan, manoeuvres=())


def not_drivable(scene: Scene, vehicle_id: int) -> str:
    """Return why a recorded vehicle cannot be driven by SUMO; empty if it can."""
    if vehicle_id not in scene.tracks:
        return f"obstacle {vehicle_id} has no trajectory to take over"
    track = scene.tracks[vehicle_id]
    if track.kind in NOT_DRIVEN:
        return f"{track.kind} {vehicle_id} cannot be driven as a vehicle"
    if vehicle_id not in scene.matches:
        return f"{track.kind} {vehicle_id} is recorded off the lanelets"
    gap = scene.edge_graph.first_gap(scene.matches[vehicle_id].sequence)
    if gap is not None:
        before, after = gap
        route = f"the recorded route of {track.kind} {vehicle_id}"
        return f"{route} leaves the lanelet graph: no lane joins {before} and {after}"
    return ""


def _by_distance(scene: Scene, vehicle_id: int) -> list[int]:
    """Return the other recorded vehicles, ordered by distance at the first step at which the two are present."""
    if vehicle_id not in scene.tracks:
        return list(scene.tracks)
    own = scene.tracks[vehicle_id]

    def distance_m(key: int) -> float:
        other = scene.tracks[key]
        step = max(own.first_step, other.first_step)
        return float(
            np.linalg.norm(own.positions[own.index_at(step) or 0] - other.positions[other.index_at(step) or 0])
        )

    return sorted((key for key in scene.tracks if key != vehicle_id), key=distance_m)


def class_of(kind: str) -> VehicleClass:
    """Return the class for a CommonRoad obstacle type; a car for types without a class."""
    classes = vehicle_classes()
    return next((known for known in classes.values() if known.commonroad_type == kind), classes["car"])


ACROSS_SHARE = 0.6
"""A vehicle is on the other lanelet after this share of the offset, whichever of the two is wider (chosen)."""
PROGRESS_ACROSS = 0.5 - math.sin(math.asin(1.0 - 2.0 * ACROSS_SHARE) / 3.0)
"""The share of the distance along the lane after which it is across: there 3p² - 2p³ reaches ``ACROSS_SHARE``."""
MOVED_M = 1e-3
"""A step shorter than this has no direction (chosen)."""


def shown_track(scene: Scene, plan: DrivePlan) -> Track:
    """Return the track for SUMO: at the hand-over, the vehicle is already on the lanelet that it changes to."""
    start, change = plan.start, plan.junction_lane_change
    if change is None:
        return start
    index, center = plan.from_step - start.first_step, scene.layout.table.lanes[change.lanelet_id].center
    positions, headings = start.positions.copy(), start.headings_rad.copy()
    positions[index], headings[index] = point_at(center, project(center, positions[index])[0])
    return replace(start, positions=positions, headings_rad=headings)


def lane_change_track(front: Points, expected: Points, onward: Points, within_m: float) -> tuple[Points, list[bool]]:
    """Return the front track (n, 2) of a vehicle that moves over to SUMO's track, and whether it is across, by step.

    Args:
        front: the recorded position of the front at the hand-over, shape (2,), in metres.
        expected: the front's position a step later if the vehicle rolls straight ahead, shape (2,).
        onward: SUMO's front track, starting at the first step, shape (n, 2), in metres.
        within_m: the distance along the lane in which the vehicle gets over.
    """
    forward = _directions_along(onward)
    left = np.stack([-forward[:, 1], forward[:, 0]], axis=1)
    rolled_m = float(np.linalg.norm(expected - front)) + arc_length(onward)
    offset, progress = expected - onward[0], np.clip(rolled_m / within_m, 0.0, 1.0)
    share = progress**2 * (3.0 - 2.0 * progress)
    missing = (offset @ forward[0]) * forward + (offset @ left[0]) * left
    return onward + missing * (1.0 - share)[:, None], (share >= ACROSS_SHARE).tolist()


def _directions_along(track: Points) -> Points:
    """Return unit vectors (n, 2) along a track (n, 2); a stop repeats the last vector, a first stop uses the next."""
    moved = np.diff(track, axis=0, append=track[-1:])
    length_m = np.linalg.norm(moved, axis=1)
    rolls = length_m > MOVED_M
    last = np.maximum.accumulate(np.where(rolls, np.arange(len(track)), int(np.argmax(rolls))))
    return np.asarray(moved[last] / np.maximum(length_m[last], MOVED_M)[:, None])


_MOST_CONTINUATIONS = 20
"""How often a route is continued straight ahead beyond its end (chosen)."""


def distances_ahead_m(scene: Scene, plan: DrivePlan) -> dict[int, float]:
    """Return the distance from a driven vehicle's front to the start of each lanelet of its route.

    Distances are in m, along the route and straight on beyond its end, at the step at which the plan begins. The first
    lanelet is the one under the front; the distance to its start is 0 or negative.
    """
    lanes, successors = scene.layout.table.lanes, scene.layout.table.successors
    chain = list(plan.lanelets)
    for _ in range(_MOST_CONTINUATIONS):
        following = scene.edge_graph.straight_on(chain[-1])
        if not following or not set(chain).isdisjoint(following):
            break
        chain += following
    front = plan.start.front_at(plan.from_step - plan.start.first_step)
    while len(chain) > 1 and project(lanes[chain[0]].center, front)[0] >= lanes[chain[0]].length_m:
        del chain[0]
    start_m, distances = -project(lanes[chain[0]].center, front)[0], dict[int, float]()
    for place, key in enumerate(chain):
        if place and key in successors[chain[place - 1]]:
            start_m += lanes[chain[place - 1]].length_m
        distances.setdefault(key, start_m)
    return distances


def halts_at_stops(scene: Scene, plan: DrivePlan) -> tuple[Halt, ...]:
    """Return halts for the stops of a plan; a stop at a place that its route does not pass is left out."""
    if not plan.stops:
        return ()
    starts_m = distances_ahead_m(scene, plan)
    return tuple(
        Halt(plan.from_step, scene.last_step + 1, starts_m[stop.lanelet_id] + stop.station_m, stop.stands_steps)
        for stop in plan.stops
        if stop.lanelet_id in starts_m
    )
