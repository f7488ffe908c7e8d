"""What a list of edits comes to, before anything is simulated: an immutable value that each edit makes anew."""

from dataclasses import dataclass, replace
from typing import Literal

from plannerforge.engine.edits.behaviours import Behaviour, usual_behaviour
from plannerforge.engine.edits.scene import NOT_DRIVEN, Scene
from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.engine.traffic.vehicle_classes import VehicleClass, vehicle_classes
from plannerforge.schemas.errors import NotPossible

Cause = Literal["edited", "added", "handed_over"]


@dataclass(frozen=True)
class DrivePlan:
    """A vehicle that SUMO drives from ``from_step`` on.

    ``start``: its recorded track, or a track of one pose for an added vehicle. ``lanelets``: the way it is meant to
    drive; ``edges``: SUMO's route for it; ``targets``: lanelets any of which the edit sends it to (none: no target).
    """

    start: Track
    cause: Cause
    from_step: int
    lanelets: tuple[int, ...]
    edges: tuple[str, ...]
    targets: frozenset[int]
    behaviour: Behaviour
    vehicle_class: VehicleClass


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
    """

    next_id: int
    driven: dict[int, DrivePlan]
    removed: frozenset[int] = frozenset()
    goal: GoalChange | None = None
    added_by_edit: tuple[tuple[int, ...], ...] = ()

    def with_plan(self, plan: DrivePlan) -> "Changes":
        """The changes with one more driven vehicle, or another plan for it; ids stay in ascending order."""
        driven = {**self.driven, plan.start.obstacle_id: plan}
        return replace(self, driven=dict(sorted(driven.items())))

    def without(self, vehicle_id: int) -> "Changes":
        """The changes after a vehicle was removed; an added one is simply not there any more."""
        driven = {key: plan for key, plan in self.driven.items() if key != vehicle_id}
        was_added = vehicle_id in self.driven and self.driven[vehicle_id].cause == "added"
        removed = self.removed if was_added else self.removed | {vehicle_id}
        return replace(self, driven=driven, removed=removed)


@dataclass(frozen=True)
class EditStep:
    """What one edit did to the changes: which vehicles, and the sentence for its report."""

    changes: Changes
    vehicles: tuple[int, ...]
    what: str


def plan_of(scene: Scene, changes: Changes, vehicle_id: int) -> DrivePlan:
    """The plan of a vehicle as it stands, or a new one that drives its recorded way from its first step on.

    Raises:
        NotPossible: the vehicle cannot be driven (a pedestrian, an obstacle off the lanes, or an occupancy set).
    """
    if vehicle_id in changes.driven:
        return changes.driven[vehicle_id]
    first = scene.tracks[vehicle_id].first_step if vehicle_id in scene.tracks else 0
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
