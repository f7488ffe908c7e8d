"""What a list of edits comes to, before anything is simulated: an immutable value that each edit makes anew."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from plannerforge.engine.edits.behaviours import Behaviour, usual_behaviour
from plannerforge.engine.edits.lane_matching import LaneMatch
from plannerforge.engine.edits.manoeuvring import Halt, Manoeuvre
from plannerforge.engine.edits.scene import NOT_DRIVEN, Ego, Scene
from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.engine.traffic.vehicle_classes import VehicleClass, vehicle_classes
from plannerforge.schemas.errors import NotPossible

Cause = Literal["edited", "added", "handed_over"]


@dataclass(frozen=True)
class SteeringOver:
    """A change of lane inside a junction: SUMO drives on ``lanelet_id`` at once, the motion gets there as it rolls.

    ``within_m``: along the lane, from the hand-over on.
    """

    lanelet_id: int
    within_m: float


@dataclass(frozen=True)
class DrivePlan:
    """A vehicle that SUMO drives from ``from_step`` on.

    ``start``: its recorded track, or a track of one pose for an added vehicle. ``lanelets``: the way it is meant to
    drive; ``edges``: SUMO's route for it; ``targets``: lanelets any of which the edit sends it to (none: no target);
    ``through``: lanelets on the way that it has to use; ``manoeuvres``: what it is told, in the order of their steps;
    ``steering_over``: how it changes lanes where it is handed over inside a junction (None: it does not); ``halts``:
    where it waits for others.
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
    steering_over: SteeringOver | None = None
    halts: tuple[Halt, ...] = ()


@dataclass(frozen=True)
class Replay:
    """A road user that moves by a given track and not by SUMO: a recording moved in time, or somebody who walks.

    ``recording``: what was moved by ``shifted_steps`` (later positive); None for an added walker.
    """

    track: Track
    match: LaneMatch | None
    recording: Track | None = None
    shifted_steps: int = 0


@dataclass(frozen=True)
class GoalChange:
    """A goal region: rectangle (length, width) around a centre (2,) on a lanelet; intervals None stay as they are."""

    problem_id: int
    lanelet_id: int
    center: Points
    heading_rad: float
    size_m: tuple[float, float] | None
    steps: tuple[int, int] | None
    speed_mps: tuple[float, float] | None


@dataclass(frozen=True)
class Changes:
    """Everything that the edits so far ask for.

    ``added_by_edit``: ids that each edit added, by its index. ``next_id``: the id that the next added vehicle gets.
    ``replays``: tracks that stand for the recorded ones, and added walkers. ``ego``: another start of the ego.
    """

    next_id: int
    driven: dict[int, DrivePlan]
    removed: frozenset[int] = frozenset()
    goal: GoalChange | None = None
    added_by_edit: tuple[tuple[int, ...], ...] = ()
    replays: Mapping[int, Replay] = field(default_factory=dict)
    ego: Ego | None = None

    def with_plan(self, plan: DrivePlan) -> "Changes":
        """The changes with one more driven vehicle, or another plan for it; ids stay in ascending order."""
        driven = {**self.driven, plan.start.obstacle_id: plan}
        return replace(self, driven=dict(sorted(driven.items())))

    def without(self, vehicle_id: int) -> "Changes":
        """The changes after a vehicle was removed; an added one is simply not there any more."""
        driven = {key: plan for key, plan in self.driven.items() if key != vehicle_id}
        replays = {key: replay for key, replay in self.replays.items() if key != vehicle_id}
        removed = self.removed if self.is_added(vehicle_id) else self.removed | {vehicle_id}
        return replace(self, driven=driven, replays=replays, removed=removed)

    def with_replay(self, replay: Replay) -> "Changes":
        """The changes with one more given track; ids stay in ascending order."""
        replays = {**self.replays, replay.track.obstacle_id: replay}
        return replace(self, replays=dict(sorted(replays.items())))

    def is_added(self, vehicle_id: int) -> bool:
        """Whether an edit put the road user in."""
        plan, replay = self.driven.get(vehicle_id), self.replays.get(vehicle_id)
        return (plan is not None and plan.cause == "added") or (replay is not None and replay.recording is None)


@dataclass(frozen=True)
class EditStep:
    """What one edit did to the changes: which vehicles, and the sentence for its report.

    ``added``: those of them that it put in. ``aims``: sets of lanelets, of each of which it wants a vehicle on any.
    ``since``: the step from which on aims count. ``speeds``: the speed in m/s that a vehicle is to reach, and from
    which step on. ``parameters``: those of a driver's behaviour that it sets, each with whether to a value that does
    not go by the one before.
    """

    changes: Changes
    vehicles: tuple[int, ...]
    what: str
    added: tuple[int, ...] = ()
    aims: Mapping[int, tuple[frozenset[int], ...]] = field(default_factory=dict)
    since: Mapping[int, int] = field(default_factory=dict)
    speeds: Mapping[int, tuple[float, int]] = field(default_factory=dict)
    parameters: Mapping[str, bool] = field(default_factory=dict)


def plan_of(scene: Scene, changes: Changes, vehicle_id: int) -> DrivePlan:
    """The plan of a vehicle as it stands, or a new one that drives its recorded way from its first step on.

    Raises:
        NotPossible: the vehicle cannot be driven (a pedestrian, an obstacle off the lanes, or an occupancy set).
    """
    first = scene.tracks[vehicle_id].first_step if vehicle_id in scene.tracks else 0
    if vehicle_id in changes.driven:
        plan = changes.driven[vehicle_id]
        return plan if plan.cause == "added" else replace(plan, from_step=first)
    return recorded_plan(scene, vehicle_id, "edited", first)


def recorded_plan(scene: Scene, vehicle_id: int, cause: Cause, from_step: int) -> DrivePlan:
    """A plan that drives a recorded vehicle along its recorded way from a step on.

    Raises:
        NotPossible: the vehicle cannot be driven.
    """
    why = not_drivable(scene, vehicle_id)
    edges = None if why else scene.edge_graph.route(scene.matches[vehicle_id].sequence)
    if edges is None:
        raise NotPossible(why, valid=drivable_ids(scene), next_step="remove_vehicle works for it, driving it does not")
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


def not_drivable(scene: Scene, vehicle_id: int) -> str:
    """Why a recorded vehicle cannot be driven by SUMO; empty if it can."""
    if vehicle_id not in scene.tracks:
        return f"obstacle {vehicle_id} has no trajectory that a vehicle could take over"
    track = scene.tracks[vehicle_id]
    if track.kind in NOT_DRIVEN:
        return f"{track.kind} {vehicle_id} cannot be driven as a vehicle"
    if vehicle_id not in scene.matches:
        return f"{track.kind} {vehicle_id} is recorded off the lanelets"
    if scene.edge_graph.route(scene.matches[vehicle_id].sequence) is None:
        return f"the recorded way of {track.kind} {vehicle_id} leaves the lanelet graph"
    return ""


def drivable_ids(scene: Scene) -> list[int]:
    """Recorded vehicles that SUMO can drive, ascending."""
    return [key for key in scene.tracks if not not_drivable(scene, key)]


def class_of(kind: str) -> VehicleClass:
    """The class that stands for a CommonRoad obstacle type; a car for types without a class."""
    classes = vehicle_classes()
    return next((one for one in classes.values() if one.commonroad_type == kind), classes["car"])
