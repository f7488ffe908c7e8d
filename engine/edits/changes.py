"""What a list of edits comes to, before anything is simulated: an immutable value that each edit makes anew."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from ..cosimulation import DrivePlan, Replay, recorded_plan
from ..geometry import Points
from ..scene import Ego, LaneMatch, Scene

# ---------- changes
# What a list of edits comes to, before anything is simulated: an immutable value that each edit makes anew.


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


# ---------- altered_scene
# The scene as the edits so far leave it, for the edits that follow and for the simulation.


def altered(base: Scene, changes: Changes) -> Scene:
    """The base scene with recordings moved in time, with added walkers, and with another start of the ego."""
    if not changes.replays and changes.ego is None:
        return base
    tracks = base.tracks | {key: replay.track for key, replay in changes.replays.items()}
    matches = {key: match for key, match in base.matches.items() if key not in changes.replays}
    matches |= {key: replay.match for key, replay in changes.replays.items() if replay.match is not None}
    return replace(
        base, tracks=dict(sorted(tracks.items())), matches=dict(sorted(matches.items())), ego=changes.ego or base.ego
    )


def populated(scene: Scene, changes: Changes) -> Scene:
    """An altered scene with the vehicles that edits put in, where they enter, and without those that edits took out.

    It says who is meant by a word and who is in the way, as a description of the edited scenario would. It is not for
    a simulation, which drives the added vehicles and has no recording of them.
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
