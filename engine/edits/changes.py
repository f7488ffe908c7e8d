"""The changes that edits request, before anything is simulated, and the resulting scene for later edits.

``Changes`` is an immutable value: each edit returns a new one. Lengths are in m, steps are time steps of the scenario,
counted from its start.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...schemas.errors import InvalidRequest, NotPossible, Remedy, instead, with_values
from ...schemas.grammar import parse_quantity
from ...schemas.modification import Achieved
from ..commonroad import Track
from ..cosimulation import DrivePlan, Replay, recorded_plan, usual_behaviour
from ..geometry import Points
from ..scene import Ego, LaneMatch, Scene
from ..vehicles import vehicle_classes

FEWEST_STATES = 3
"""States that a recording moved in time needs for a motion with an acceleration (chosen)."""
MOST_NAMED = 8
"""Number of vehicles that a sentence lists before it is cut short."""


@dataclass(frozen=True)
class GoalChange:
    """A goal region: a rectangle (length, width) around a centre (2,) on a lanelet; None leaves an interval as is.

    ``keeps_place``: the file's goal stays where it is, and only the intervals change; the place here is not used.
    """

    problem_id: int
    lanelet_id: int
    center: Points
    heading_rad: float
    size_m: tuple[float, float] | None
    steps: tuple[int, int] | None
    speed_mps: tuple[float, float] | None
    keeps_place: bool = False


@dataclass(frozen=True)
class Changes:
    """Everything that a list of edits requests, up to one of the edits.

    ``added_by_edit``: the ids that each edit added, by the edit's index. ``next_id``: the id that the next added
    vehicle gets. ``replays``: tracks that replace the recorded tracks, and added road users that SUMO does not drive.
    ``ego``: a new start of the ego. ``ego_drive``: returns the ego's motion under an ordinary driver in the base
    scenario, None if there is no ego; edits that depend on the ego's position call it.
    """

    next_id: int
    driven: dict[int, DrivePlan]
    removed: frozenset[int] = frozenset()
    goal: GoalChange | None = None
    added_by_edit: tuple[tuple[int, ...], ...] = ()
    replays: Mapping[int, Replay] = field(default_factory=dict)
    ego: Ego | None = None
    ego_drive: Callable[[], Track | None] = field(default=lambda: None, compare=False)

    def with_plan(self, plan: DrivePlan) -> "Changes":
        """Return the changes with one more driven vehicle, or a new plan for a driven one; ids stay ascending."""
        driven = {**self.driven, plan.start.obstacle_id: plan}
        return replace(self, driven=dict(sorted(driven.items())))

    def without(self, vehicle_id: int) -> "Changes":
        """Return the changes after a vehicle was removed; an added vehicle simply disappears."""
        driven = {key: plan for key, plan in self.driven.items() if key != vehicle_id}
        replays = {key: replay for key, replay in self.replays.items() if key != vehicle_id}
        removed = self.removed if self.is_added(vehicle_id) else self.removed | {vehicle_id}
        return replace(self, driven=driven, replays=replays, removed=removed)

    def with_replay(self, replay: Replay) -> "Changes":
        """Return the changes with a replayed track added; ids stay in ascending order."""
        key = replay.track.obstacle_id
        driven = {other: plan for other, plan in self.driven.items() if other != key}
        return replace(self, driven=driven, replays=dict(sorted({**self.replays, key: replay}.items())))

    @property
    def shifts(self) -> dict[int, int]:
        """The number of steps by which recordings are moved in time (later positive), by id."""
        return {key: replay.shifted_steps for key, replay in self.replays.items()}

    @property
    def scripted(self) -> frozenset[int]:
        """The road users that move as prescribed or are parked: they do not react to other road users."""
        return frozenset(key for key, replay in self.replays.items() if replay.is_scripted or replay.is_parked)

    def is_added(self, vehicle_id: int) -> bool:
        """Return True if an edit added the road user."""
        plan, replay = self.driven.get(vehicle_id), self.replays.get(vehicle_id)
        return (plan is not None and plan.cause == "added") or (replay is not None and replay.recording is None)


@dataclass(frozen=True)
class EditStep:
    """The changes after one edit, its vehicles, and the sentence for its report.

    ``added``: the vehicles that it added. ``aims``: by vehicle, sets of lanelets; the vehicle should reach at least one
    lanelet of each set. ``since``: the step from which aims count. ``speeds``: the speed in m/s that a vehicle should
    reach, and the step from which it counts. ``measure``: returns the results for the requested values, from the
    ``EditedScene`` after the simulation. ``parameters``: for each driver parameter that it sets, whether the new value
    is independent of the old value. ``meant``: the vehicles that its selectors match, as text; "" for plain ids.
    """

    changes: Changes
    vehicles: tuple[int, ...]
    what: str
    added: tuple[int, ...] = ()
    aims: Mapping[int, tuple[frozenset[int], ...]] = field(default_factory=dict)
    since: Mapping[int, int] = field(default_factory=dict)
    speeds: Mapping[int, tuple[float, int]] = field(default_factory=dict)
    parameters: Mapping[str, bool] = field(default_factory=dict)
    measure: Callable[[Any], tuple[Achieved, ...]] = field(default=lambda _: ())
    meant: str = ""


def plan_of(scene: Scene, changes: Changes, vehicle_id: int) -> DrivePlan:
    """Return the current plan of a vehicle, or a new plan along its recorded route from its first step.

    Raises:
        NotPossible: the vehicle cannot be driven (a pedestrian, an obstacle off the lanes, or an occupancy set).
    """
    if vehicle_id in changes.scripted:
        raise NotPossible(
            f"an earlier edit prescribes the motion of vehicle {vehicle_id}",
            valid=["set_speed", "change_lane", "swerve", "cut_in", "remove_vehicle"],
            next_step="use one of these, or drop the edit that prescribes the motion",
        )
    first = scene.tracks[vehicle_id].first_step if vehicle_id in scene.tracks else 0
    if vehicle_id in changes.driven:
        plan = changes.driven[vehicle_id]
        return plan if plan.cause == "added" else replace(plan, from_step=first, cause="edited")
    return recorded_plan(scene, vehicle_id, "edited", first)


def scene_for_references(scene: Scene, changes: Changes) -> Scene:
    """Return ``scene_after``'s scene, with added vehicles at their entries and without removed vehicles.

    Use the scene to resolve selectors and occupied positions, so that they agree with a description of the edited
    scenario. Don't simulate it: a simulation drives the added vehicles and has no recording of them.
    """
    added = {key: plan for key, plan in changes.driven.items() if plan.cause == "added"}
    if not added and not changes.removed:
        return scene
    tracks = {key: track for key, track in scene.tracks.items() if key not in changes.removed}
    tracks |= {key: plan.start for key, plan in added.items()}
    standing = {key: track for key, track in scene.standing.items() if key not in changes.removed}
    matches = {key: match for key, match in scene.matches.items() if key not in changes.removed}
    matches |= {key: LaneMatch((0,), plan.lanelets[:1]) for key, plan in added.items()}
    return replace(scene, tracks=dict(sorted(tracks.items())), standing=standing, matches=dict(sorted(matches.items())))


def moved_in_time(track: Track, steps: int, scene: Scene) -> Track | None:
    """Return the track moved by a number of steps, cut to the steps from 0 to the scenario's last.

    The result is None if fewer than three states are left.
    """
    later = replace(track, first_step=track.first_step + steps)
    begin, end = max(-later.first_step, 0), min(len(track.positions), scene.last_step + 1 - later.first_step)
    return later.part(begin, end) if end - begin >= FEWEST_STATES else None


def car_at_start(ego: Ego, key: int) -> Track:
    """Return the ego at its start, as a track with an id and a single state."""
    length_m, width_m = ego.size_m
    return Track(
        obstacle_id=key,
        kind=vehicle_classes()[ego.vehicle_class].commonroad_type,
        length_m=length_m,
        width_m=width_m,
        first_step=ego.step,
        positions=np.asarray(ego.position)[None],
        headings_rad=np.array([ego.heading_rad]),
        speeds_mps=np.array([ego.speed_mps]),
    )


def car_plan(
    scene: Scene, ego: Ego, key: int, route: tuple[int, ...], edges: tuple[str, ...], targets: frozenset[int]
) -> DrivePlan:
    """Return the plan of an ordinary driver from the ego's start along a route, given as lanelets and edges."""
    own = vehicle_classes()[ego.vehicle_class]
    return DrivePlan(
        start=car_at_start(ego, key),
        cause="added",
        from_step=ego.step,
        lanelets=route,
        edges=scene.edge_graph.extended(edges, route[-1]),
        targets=targets,
        behaviour=usual_behaviour(own),
        vehicle_class=own,
    )


def check_speed(speed_mps: float, largest_mps: float, refusal: str, next_step: str) -> None:
    """Refuse a speed below 0 or above the maximum.

    Raises:
        InvalidRequest: the speed is invalid; the error has the text ``refusal`` and the valid speeds.
    """
    if not 0.0 <= speed_mps <= largest_mps:
        nearest_mps = math.floor(10 * largest_mps) / 10 if speed_mps > 0.0 else 0.0
        raise InvalidRequest(
            refusal,
            valid=[f"0 to {largest_mps:g} m/s"],
            next_step=next_step,
            remedies=[with_values(speed=f"{nearest_mps:g}m/s")],
        )


def parse_speed(text: str, largest_mps: float, now_mps: float | None = None) -> float:
    """Return the speed in m/s that a text states; ``check_speed`` checks its range.

    ``now_mps``: the speed that a relative speed refers to; None if there is no earlier speed.

    Raises:
        InvalidRequest: the text is not a speed, or it is relative and there is no earlier speed; the error states the
            valid form and range.
    """
    if now_mps is None and is_relative(text):
        plain = text.strip().lstrip("+-").strip()
        raise InvalidRequest(
            f"speed '{text}' is relative, but there is no earlier speed that it could refer to",
            valid=[f"0 to {largest_mps:g} m/s"],
            next_step="give the speed without a sign",
            remedies=[] if plain.endswith("%") else [instead(text, plain, "speed")],
        )
    try:
        return requested_speed(text, now_mps or 0.0)
    except InvalidRequest as refusal:
        raise refusal.with_valid(f"0 to {largest_mps:g} m/s") from refusal


def requested_speed(text: str, now_mps: float) -> float:
    """Return the speed in m/s that a text states; with +, - or % it is relative to the current speed.

    Raises:
        InvalidRequest: the text is not a speed.
    """
    body = text.strip()
    if body.endswith("%"):
        percent = parse_quantity(body[:-1])
        return now_mps * ((1.0 + percent / 100.0) if body[0] in "+-" else percent / 100.0)
    if body[:1] in ("+", "-"):
        return now_mps + parse_quantity(body, "m/s")
    return parse_quantity(body, "m/s")


def is_relative(text: str) -> bool:
    """Return True if a speed is relative to an earlier speed."""
    body = text.strip()
    return body.endswith("%") or body[:1] == "+" or (body[:1] == "-" and len(body) > 1)


_TIMES_TRIED = (0.0, 0.2, 0.5)
"""Positions within the possible time span, from its nearer end, that a refusal proposes (chosen)."""


def within_time(requested: int, first: int, last: int, scene: Scene) -> list[Remedy]:
    """Return times between two steps for a refusal to propose, the nearest to the requested step first."""
    nearer, farther = (first, last) if requested < first else (last, first)
    steps = [round(nearer + share * (farther - nearer)) for share in _TIMES_TRIED]
    return [with_values(time_s=round(step * scene.step_s, 3)) for step in steps if last >= first]


def adjacent_lanes(scene: Scene, lanelets: Iterable[int], side: str) -> list[int]:
    """Return the adjacent lane, on the left or right, of each lanelet that has one."""
    lanes = scene.layout.table.lanes
    adjacent = [lanes[key].left if side == "left" else lanes[key].right for key in lanelets]
    return [key for key in adjacent if key is not None and key in lanes]


def first_step_with_lane(scene: Scene, track: Track, lanelets: Sequence[int], side: str) -> int | None:
    """Return the first step at which a vehicle has an adjacent lane on a side, or None if it never has.

    ``lanelets``: the lanelet at each step of its track.
    """
    first = next((index for index, key in enumerate(lanelets) if adjacent_lanes(scene, [key], side)), None)
    return None if first is None else track.first_step + first


def no_such_lane(
    scene: Scene, vehicle_id: int, here: int | None, side: str, step: int | None, later: Sequence[str] = ()
) -> NotPossible:
    """Return the refusal for a vehicle without a lane in its direction on a side.

    Args:
        here: its lanelet, if known.
        side: left or right.
        step: the first step at which it has a lane there, if any.
        later: places of its route with a lane there, in words.
    """
    other = {"left": "right", "right": "left"}[side]
    there = [f"lane={other}"] if here is not None and adjacent_lanes(scene, [here], other) else []
    time_s = None if step is None else round(step * scene.step_s, 3)
    at_time = [] if time_s is None else [f"time_s={time_s:g}"]
    ways = [f"the {other}"] * bool(there) + ["another time"] * bool(later or at_time)
    return NotPossible(
        f"on lanelet {here}, vehicle {vehicle_id} has no lane in its direction on the {side}",
        valid=[*at_time, *there, *later],
        next_step=f"choose {' or '.join([*ways, 'a vehicle on a road with another lane'])}",
        remedies=[] if time_s is None else [with_values(time_s=time_s)],  # the other side is not what was requested
    )


def named_vehicles(vehicles: tuple[int, ...]) -> str:
    """Return vehicles as text, cut short if there are many."""
    return f"vehicle{'s' if len(vehicles) > 1 else ''} {listed(vehicles)}"


def listed(vehicles: tuple[int, ...], most: int = MOST_NAMED) -> str:
    """Return the first of some ids as text."""
    return ", ".join(map(str, vehicles[:most])) + (" …" if len(vehicles) > most else "")
