"""How close an ego comes to the traffic of a scenario before and after edits, as numbers.

A planning problem has a start and a goal, but no motion. Among the recorded vehicles, SUMO drives the ego once from its
start towards its goal, as an ordinary driver would. This motion is then replayed, so that vehicles driven by edits see
the ego and keep clear of it. The danger before and after the edits is also measured along this motion. Distances are in
m, times in s.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...schemas.modification import EgoDanger
from ..commonroad import Track
from ..cosimulation import (
    Actor,
    DrivePlan,
    SimulationSetup,
    all_actors,
    driven_actor,
    handover_track,
    replayed_actor,
    resimulate,
)
from ..criticality import SAME_DIRECTION_RAD, encounters, gaps_m, risk_scores, times_to_collision_s
from ..geometry import Values, wrap_angle
from ..scene import Ego, Scene, goal_lanelets, obstacle_of
from ..vehicles import HAND_OVER_S
from .changes import Changes, car_plan
from .edited_scene import EditedScene

_LONGEST_TIME_S = 60.0
"""Later collisions do not count: no road user keeps speed and heading for so long (chosen)."""
_SAME_PLACE_M = 0.001
"""Positions in files are rounded by less (chosen)."""
_NO_CHANGES = Changes(next_id=0, driven={})


@dataclass(frozen=True)
class EgoRisk:
    """The figures, and the ids of vehicles that they leave out: replayed vehicles that hit the ego from behind."""

    figures: EgoDanger
    left_out: tuple[int, ...] = ()


@dataclass(frozen=True)
class EgoDrive:
    """The ego's motion, and its danger among the recorded vehicles."""

    track: Track
    danger: EgoRisk


def base_drive(base: Scene, setup: SimulationSetup) -> EgoDrive | None:
    """Return the ego's motion among the recorded vehicles of a base scenario; None if there is no ego."""
    if base.ego is None:
        return None
    track = _simulate_ego(base, base.ego, _problem_goals(base, base.ego), setup)
    if track is None:
        return None
    others = [*base.standing.values(), *(region.track for region in base.regions)]
    return EgoDrive(track, ego_risk_to(track, others, base.tracks.values(), step_s=base.step_s))


def drive_after(
    before: EgoDrive | None, base: Scene, scene: Scene, changes: Changes, setup: SimulationSetup
) -> Track | None:
    """Return the ego's motion in the edited scene; it is simulated again if the edits change its start or goal."""
    ego, goal = scene.ego, changes.goal
    keeps_place = goal is None or goal.keeps_place
    if ego is None or (ego is base.ego and keeps_place):
        return None if before is None else before.track
    goals = _problem_goals(scene, ego) if goal is None or keeps_place else (goal.lanelet_id,)
    return _simulate_ego(scene, ego, goals, setup, changes)


def _problem_goals(scene: Scene, ego: Ego) -> tuple[int, ...]:
    """Return the lanelets of the goal of the ego's planning problem, ascending; empty if it has no position."""
    return tuple(goal_lanelets(scene.network, scene.loaded.problem(ego.problem_id).goal) or ())


def _simulate_ego(
    scene: Scene, ego: Ego, goals: Collection[int], setup: SimulationSetup, changes: Changes = _NO_CHANGES
) -> Track | None:
    """Return the ego's motion on the shortest route to any of the goal lanelets, else straight ahead.

    The result is None if the ego is not on a lanelet or starts when the scenario ends.
    """
    plan = _plan(scene, ego, goals)
    if plan is None:
        return None
    recorded = all_actors(scene, {}, changes.removed, changes.replays.values())
    driven = resimulate(setup, (*recorded, driven_actor(scene, plan)))
    seen = driven.get(plan.start.obstacle_id)
    motion = None if seen is None else handover_track(plan.start, seen, scene.step_s, scene.last_step)
    return None if motion is None else motion.whole(plan.start)


def shown_ego(scene: Scene, drive: Track | None) -> tuple[Actor, ...]:
    """Return the ego as a replayed road user of a re-simulation; empty if it is off the lanes or does not drive."""
    match = None if drive is None else scene.matcher.match(drive)
    return () if drive is None or match is None else (replayed_actor(scene, drive, match),)


def _plan(scene: Scene, ego: Ego, goals: Collection[int]) -> DrivePlan | None:
    drivable = [key for key in ego.lanelets if key in scene.layout.table.lanes]
    if not drivable:
        return None
    route = scene.lanelet_graph.shortest_route(drivable, sorted(goals)) or drivable[:1]
    route = tuple(key for key in route if key in scene.layout.table.lanes)
    edges = scene.edge_graph.route(route) or scene.edge_graph.route(drivable[:1])
    if edges is None:
        return None
    # The id is negative if the file gives the planning problem's id to an obstacle as well.
    is_taken = ego.problem_id in scene.tracks or ego.problem_id in scene.standing
    return car_plan(scene, ego, -ego.problem_id if is_taken else ego.problem_id, route, edges, frozenset(goals))


@dataclass(frozen=True)
class _Replayed:
    """A road user's track, and the recording that it follows up to a step (None: to the end)."""

    track: Track
    recording: Track
    until_step: int | None = None


def ego_risk_to(drive: Track, others: Iterable[Track], replayed: Iterable[Track] = (), *, step_s: float) -> EgoRisk:
    """Return the most critical figures of a motion of the ego among others with the given tracks.

    A replayed vehicle does not react to this ego. If it hits the ego from behind, a real driver would have braked. The
    collision is therefore not attributed to the ego, and the vehicle counts only until 4 s earlier (edits hand over at
    the same time).

    Args:
        drive: the ego's motion.
        others: road users that always count.
        replayed: vehicles that follow their recording.
        step_s: duration of a time step in s.
    """
    return _danger(drive, tuple(others), tuple(_Replayed(track, track) for track in replayed), step_s)


def ego_risk_after(drive: Track, edited: EditedScene) -> EgoRisk:
    """Return the figures of a motion of the ego among all road users after the edits.

    A driven vehicle always counts after its hand-over. An earlier hit from behind comes from the recording. So does a
    hit by a time-shifted vehicle if its recording also hits this ego. These hits are left out, as in recorded traffic.
    """
    others, replayed = [], []
    for track in edited.tracks:
        key = track.obstacle_id
        if key not in edited.scene.tracks or edited.changes.is_added(key):
            others.append(track)
            continue
        driven, replay = edited.result.tracks.get(key), edited.changes.replays.get(key)
        recording = replay.recording if replay is not None else None
        recording = edited.scene.tracks[key] if recording is None else recording
        replayed.append(_Replayed(track, recording, None if driven is None else driven.first_step))
    return _danger(drive, tuple(others), tuple(replayed), edited.scene.step_s)


def risk_against(drive: Track, edited: EditedScene, given: Mapping[int, Track]) -> EgoRisk:
    """Return the figures of a motion of the ego among all road users after edits of a given scenario.

    A road user that moves as in the given scenario follows its recording, as does one that is only moved in time.

    Args:
        drive: the ego's motion.
        edited: the scene after the edits.
        given: the moving road users of the given scenario by id.
    """
    others, replayed = [], []
    for track in edited.tracks:
        known = given.get(track.obstacle_id)
        if known is None:
            others.append(track)
            continue
        until = None if track.obstacle_id in edited.shifted else first_change(track, known)
        replayed.append(_Replayed(track, known, until))
    return _danger(drive, tuple(others), tuple(replayed), edited.scene.step_s)


def first_change(track: Track, known: Track) -> int | None:
    """Return the first step at which a road user is not where an earlier track has it; None if it follows that track.

    A track that is only cut at its ends still follows the earlier track.
    """
    begin, end = max(track.first_step, known.first_step), min(track.last_step, known.last_step)
    if (track.kind, track.size_m) != (known.kind, known.size_m) or end < begin or track.first_step < known.first_step:
        return track.first_step
    moved_m = np.linalg.norm(
        track.positions[begin - track.first_step : end + 1 - track.first_step]
        - known.positions[begin - known.first_step : end + 1 - known.first_step],
        axis=1,
    )
    moved = np.flatnonzero(moved_m > _SAME_PLACE_M)
    if len(moved):
        return begin + int(moved[0])
    return end + 1 if track.last_step > end else None


def is_unchanged(track: Track, known: Track) -> bool:
    """Return whether a road user still follows an earlier track."""
    return first_change(track, known) is None


def _danger(drive: Track, others: tuple[Track, ...], replayed: tuple[_Replayed, ...], step_s: float) -> EgoRisk:
    met = _Meetings.of(drive, (*others, *(one.track for one in replayed)))
    figures = met.figures(met.last_steps, step_s)
    if figures.minimum_distance_m != 0.0:
        return EgoRisk(figures)
    touching = met.touching
    touched = (one for at, one in enumerate(replayed, start=len(others)) if at in touching)
    hits = {one.track.obstacle_id: step for one in touched if (step := _recorded_hit(drive, one)) is not None}
    if not hits:
        return EgoRisk(figures)
    reaction_steps = round(HAND_OVER_S / step_s)
    last_steps = list(met.last_steps)
    for at, one in enumerate(replayed, start=len(others)):
        hit = hits.get(one.track.obstacle_id)
        last_steps[at] = last_steps[at] if hit is None else hit - reaction_steps
    return EgoRisk(met.figures(last_steps, step_s), tuple(sorted(hits)))


@dataclass(frozen=True)
class _Meetings:
    """All pairs of a state of the ego and a nearby road user, with gaps in m and times to collision in s."""

    ego: Track
    others: tuple[Track, ...]
    state: NDArray[np.intp]
    other: NDArray[np.intp]
    gaps_m: Values
    times_s: Values

    @classmethod
    def of(cls, ego: Track, others: tuple[Track, ...]) -> "_Meetings":
        """Return the meetings of the ego with the other road users."""
        met = encounters(ego, others)
        times_s = times_to_collision_s(met.ego, met.other)
        times_s[times_s > _LONGEST_TIME_S] = math.inf
        return cls(ego, others, met.state, met.track, gaps_m(met), times_s)

    @property
    def last_steps(self) -> tuple[int, ...]:
        """The last step of each of the other road users."""
        return tuple(track.last_step for track in self.others)

    @property
    def touching(self) -> frozenset[int]:
        """The indices of the road users that the ego touches."""
        return frozenset(self.other[self.gaps_m == 0.0].tolist())

    def figures(self, last_steps: Sequence[int], step_s: float) -> EgoDanger:
        """Return the most critical figures; each road user counts up to its own last step."""
        counts = self.ego.first_step + self.state <= np.asarray(last_steps, dtype=int)[self.other]
        state, other = self.state[counts], self.other[counts]
        gaps, times = self.gaps_m[counts], self.times_s[counts]
        if not len(state):
            return EgoDanger(minimum_distance_m=None, minimum_time_to_collision_s=None, risk_score=None)
        scores = risk_scores(gaps, times)
        worst = int(np.lexsort((state, gaps, times, scores))[0])
        soonest = float(times.min())
        return EgoDanger(
            minimum_distance_m=round(float(gaps.min()), 3),
            minimum_time_to_collision_s=round(soonest, 3) if math.isfinite(soonest) else None,
            risk_score=int(scores[worst]),
            most_critical_id=obstacle_of(self.others[int(other[worst])].obstacle_id),
            most_critical_time_s=round((self.ego.first_step + int(state[worst])) * step_s, 3),
        )


def _recorded_hit(ego: Track, one: _Replayed) -> int | None:
    """Return the step at which a replayed road user, like its recording, hits the ego from behind, else None."""
    step = _hit_from_behind(ego, one.track)
    if step is None or (one.until_step is not None and step > one.until_step):
        return None
    if one.recording is not one.track and _hit_from_behind(ego, one.recording) is None:
        return None
    return step


def _hit_from_behind(ego: Track, track: Track) -> int | None:
    """Return the step at which a vehicle first touches the ego from behind with the same heading, or None."""
    met = encounters(ego, (track,))
    touching = np.flatnonzero(gaps_m(met) == 0.0)
    if not len(touching):
        return None
    first = touching[0]
    heading = float(met.ego.headings_rad[first])
    away = met.other.centers[first] - met.ego.centers[first]
    ahead_m = float(away[0]) * math.cos(heading) + float(away[1]) * math.sin(heading)
    follows = abs(wrap_angle(float(met.other.headings_rad[first]) - heading)) < SAME_DIRECTION_RAD
    is_behind = follows and ahead_m < -ego.length_m / 2
    return ego.first_step + int(met.state[first]) if is_behind else None
