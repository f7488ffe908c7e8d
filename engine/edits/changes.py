"""What a list of edits asks for, before anything is simulated, and the scene that it makes for the edits that follow.

``Changes`` is an immutable value: each edit makes a new one. Lengths are in m, steps are time steps of the scenario,
counted from its start.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from ...schemas.modification import Edit
from ..commonroad import Track
from ..cosimulation import DrivePlan, Replay, recorded_plan
from ..geometry import Points
from ..scene import Ego, LaneMatch, Scene

FEWEST_STATES = 3
"""A recording moved in time needs as many states for a motion with an acceleration (chosen)."""


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
    """All that the edits up to one of them ask for.

    ``added_by_edit``: ids that each edit added, by its index. ``next_id``: the id that the next added vehicle gets.
    ``replays``: tracks that stand for the recorded ones, and added pedestrians. ``ego``: another start of the ego.
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
    """The changes after one edit, the vehicles that it is about, and the sentence for its report.

    ``added``: those of the vehicles that it put in. ``aims``: by vehicle, sets of lanelets; the vehicle is to get onto
    any lanelet of each set. ``since``: the step from which on aims count. ``speeds``: the speed in m/s that a vehicle
    is to reach, and from which step on. ``parameters``: those of a driver's behaviour that it sets, each with whether
    the new value is independent of the one before.
    """

    changes: Changes
    vehicles: tuple[int, ...]
    what: str
    added: tuple[int, ...] = ()
    aims: Mapping[int, tuple[frozenset[int], ...]] = field(default_factory=dict)
    since: Mapping[int, int] = field(default_factory=dict)
    speeds: Mapping[int, tuple[float, int]] = field(default_factory=dict)
    parameters: Mapping[str, bool] = field(default_factory=dict)


@dataclass(frozen=True)
class ResolvedEdits:
    """A list of edits, what each of them did, and the changes after the last one.

    ``scene``: the base scene with these changes, as ``apply_changes`` makes it.
    """

    edits: tuple[Edit, ...]
    steps: tuple[EditStep, ...]
    changes: Changes
    scene: Scene


def plan_of(scene: Scene, changes: Changes, vehicle_id: int) -> DrivePlan:
    """The plan of a vehicle as it stands, or a new one that drives its recorded route from its first step on.

    Raises:
        NotPossible: the vehicle cannot be driven (a pedestrian, an obstacle off the lanes, or an occupancy set).
    """
    first = scene.tracks[vehicle_id].first_step if vehicle_id in scene.tracks else 0
    if vehicle_id in changes.driven:
        plan = changes.driven[vehicle_id]
        return plan if plan.cause == "added" else replace(plan, from_step=first)
    return recorded_plan(scene, vehicle_id, "edited", first)


def apply_changes(base: Scene, changes: Changes) -> Scene:
    """The base scene with recordings moved in time, with added pedestrians, and with another start of the ego.

    Vehicles that SUMO is to drive are in it as recorded. Edits and the simulation see this scene.
    """
    if not changes.replays and changes.ego is None:
        return base
    tracks = base.tracks | {key: replay.track for key, replay in changes.replays.items()}
    matches = {key: match for key, match in base.matches.items() if key not in changes.replays}
    matches |= {key: replay.match for key, replay in changes.replays.items() if replay.match is not None}
    return replace(
        base, tracks=dict(sorted(tracks.items())), matches=dict(sorted(matches.items())), ego=changes.ego or base.ego
    )


def scene_for_references(scene: Scene, changes: Changes) -> Scene:
    """A scene of ``apply_changes`` with the vehicles that edits put in, where they enter, without those taken out.

    It resolves words for vehicles and occupied places, as a description of the edited scenario would. It is not for a
    simulation, which drives the added vehicles and has no recording of them.
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
    """The track moved by a number of steps, without what lies before step 0 or after the scenario's last step.

    None where fewer than three states are left.
    """
    first = max(track.first_step + steps, 0)
    begin = first - steps - track.first_step
    end = min(len(track.positions), scene.last_step + 1 - steps - track.first_step)
    if end - begin < FEWEST_STATES:
        return None
    return replace(
        track,
        first_step=first,
        positions=track.positions[begin:end],
        headings_rad=track.headings_rad[begin:end],
        speeds_mps=track.speeds_mps[begin:end],
    )
