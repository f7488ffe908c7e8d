"""The decisive moments of one run: who hit whom, the closest approach, the largest motions, and the last seconds.

Kinds of contacts and comfort limits are defined in ``docs/runs.md``. The rules are deterministic and read only the
driven steps and the tracks of the other road users.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from ...schemas.errors import InvalidRequest, UnknownName
from ...schemas.grammar import Interval
from ...schemas.results import TimelineStep
from ...schemas.reviews import (
    BodySide,
    CollisionCause,
    ComfortExcess,
    Contact,
    ContactKind,
    EgoFault,
    Encounter,
    LargestMotion,
    Prevention,
    RelativeHeading,
    ReviewResponse,
    RunReview,
    SeenCourse,
    Sight,
    Unseen,
)
from ...schemas.runs import ReviewRequest, RunRecord, RunSteps
from ...schemas.text import RESOLUTION
from ...schemas.worlds import REPORTED, Sighting, sightings_of
from ..commonroad import Track, kept_recording
from ..criticality import encounters, gaps_m, times_to_collision_s
from ..execution import ProgressReporter
from ..geometry import Points, Values, oriented_rectangle, wrap_angle, wrap_angles
from ..planners import PLANNERS, Predictor, lane_line, predictor, uses_prediction
from ..vehicles import STANDING_MPS, VehicleParameters
from .pace import on_opposite_lane_since_s, own_doing, pace_of
from .prevention import Surroundings, prevention_of
from .run_set import RunSet, ego_track, tracks_in
from .traffic_rules import rule_verdicts

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork
    from shapely.geometry.base import BaseGeometry

_MOMENTS, _LAST_S = 10, 3.0
"""Entries of a timeline and the time span that they cover (chosen): a collision is decided in its last seconds."""
_SAME_RAD, _AGAINST_RAD = math.pi / 4, 3 * math.pi / 4
"""Headings that differ by less are the same direction, by more opposite directions (chosen as in ``criticality.py``).
"""
_ROUNDING_M = 1e-6
"""A smaller lateral motion is a rounding error of a straight drive."""
_CAME_IN_S = 3.0
"""Longest time since a cut-in (chosen). UN Regulation 157 and most cut-in studies consider 1 to 3 s."""
_BRAKING_MPS2 = -1.0
"""Stronger deceleration is braking; weaker deceleration may be coasting (chosen)."""
_FORESEEN_S = 1.0
"""How long before a collision predictions are judged (chosen): braking can still take 7 m/s off, and contact is not yet
inevitable.
"""
FROM_BEHIND: tuple[ContactKind, ...] = ("rear_end_by_other", "onto_standing_ego")
"""Kinds in which another drives into the ego from behind or while the ego stands."""
_LAST_STATES, _AROUND_M, _CLOSED_GAP_M = 40, 80.0, 0.1
"""Number of last states around which the road is examined, how far around them, and the gap between lanelets of real
maps that counts as closed (chosen).
"""
AGREES_M = 1e-3
"""If the closest gap differs by more from the run's own metric, the tracks do not show it."""


def review_runs(request: ReviewRequest, report: ProgressReporter) -> ReviewResponse:
    """Return the decisive moments of each run and, if requested, the traffic rules that it broke."""
    runs = RunSet(request.runs, scenarios=request.scenarios)
    reviews, broken = [], {}
    for number, record in enumerate(runs.records):
        reviews.append(review(runs, record))
        if request.with_rules:
            broken[record.run_id] = tuple(one for one in rule_verdicts(runs, record) if one.violated)
        report((number + 1) / len(runs.records), record.run_id)
    return ReviewResponse(reviews=tuple(reviews), broken=broken)


def review(runs: RunSet, record: RunRecord) -> RunReview:
    """Return the decisive moments of one run; if its steps are missing, moments that need them are left out."""
    kept = runs.look(record)
    if kept is not None:
        return kept.review
    steps = runs.steps.get(record.run_id)
    if steps is None or not steps.x_m or record.metrics is None:
        return RunReview(run_id=record.run_id)
    drive = _drive(runs, record, steps)
    closest, urgent = drive.nearest_moments()
    unseen = drive.unseen()
    return RunReview(
        run_id=record.run_id,
        contact=_attributed(runs, record, drive.contact()),
        closest=closest,
        most_urgent=urgent,
        largest=tuple(_largest(drive.motion)),
        uncomfortable=tuple(_uncomfortable(drive.motion)),
        pace=pace_of(runs, record),
        unseen=unseen[:_MOST_UNSEEN],
        unseen_times=len(unseen),
    )


def contact_of(runs: RunSet, record: RunRecord) -> Contact | None:
    """Return how a run's collision came about, or None if there is no collision or the steps are missing."""
    kept = runs.look(record)
    if kept is not None:
        return kept.review.contact
    steps = runs.steps.get(record.run_id)
    if record.collision is None or steps is None or not steps.x_m:
        return None
    if record.run_id not in runs.contacts:
        runs.contacts[record.run_id] = _attributed(runs, record, _drive(runs, record, steps).contact())
    return runs.contacts[record.run_id]


def contact_in(
    record: RunRecord, steps: RunSteps, tracks: dict[int, Track], predict: Predictor | None, lane: Points | None
) -> Contact | None:
    """Explain the collision in a run that is not stored, without the latest times to prevent it.

    Steering aside is not examined either.

    Args:
        record: the run.
        steps: its states.
        tracks: all other road users in it, by id.
        predict: the planner's prediction.
        lane: the line (n, 2) along the ego's lane and route, or None.
    """
    return _Drive(record, steps, tracks, predict, lane=lambda: lane).contact(finds_latest=False)


def _attributed(runs: RunSet, record: RunRecord, contact: Contact | None) -> Contact | None:
    """Return the contact; attribute it to the ego if an act of the ego made the collision unavoidable for reference
    drivers.
    """
    fault = None if contact is None else _fault(runs, record, contact)
    return (
        contact if contact is None or fault is None else contact.model_copy(update={"laid_to": "ego", "fault": fault})
    )


def _fault(runs: RunSet, record: RunRecord, contact: Contact) -> EgoFault | None:
    if contact.kind in FROM_BEHIND:
        moment = own_doing(runs, record, contact.time_s)
        return None if moment is None else EgoFault(code="slowed", time_s=moment.since_s, moment=moment)
    if contact.kind == "cut_in_by_ego":
        return EgoFault(code="cut_in", time_s=contact.time_s if contact.came_in_s is None else contact.came_in_s)
    if contact.laid_to != "neither" or contact.kind not in ("oncoming", "crossing"):
        return None
    broken = {verdict.rule: verdict for verdict in rule_verdicts(runs, record) if verdict.violated}
    light = broken.get("R_IN2")
    if light is not None and light.first_s is not None and light.first_s <= contact.time_s:
        return EgoFault(code="red_light", time_s=light.first_s)
    for rule in ("R_IN3", "R_IN4", "R_IN5"):
        verdict = broken.get(rule)
        if verdict is not None and verdict.obstacle_id == contact.obstacle_id and verdict.first_s is not None:
            return EgoFault(code="right_of_way", time_s=verdict.first_s)
    since_s = on_opposite_lane_since_s(runs, record, contact.time_s) if contact.kind == "oncoming" else None
    return None if since_s is None else EgoFault(code="wrong_side", time_s=since_s)


def _drive(runs: RunSet, record: RunRecord, steps: RunSteps) -> "_Drive":
    """Return the drive of a run, with the tracks of all other road users and its predictor."""
    path = runs.scenario_path(record)
    if path is None:
        return _Drive(record, steps, tracks_in(runs, record, steps))
    network = kept_recording(path).loaded.scenario.lanelet_network
    lane = partial(_lane_in, path, record, runs.vehicle(record))
    return _Drive(record, steps, tracks_in(runs, record, steps), predictor(record.prediction, network), network, lane)


def _lane_in(path: Path, record: RunRecord, vehicle: VehicleParameters) -> Points | None:
    """Return the line that follows the ego's lane and route, or None if no route is known."""
    loaded = kept_recording(path).loaded
    try:
        problem = loaded.problem(record.problem_id)
    except UnknownName:  # the file was replaced since the run
        return None
    return lane_line(loaded.scenario, problem, vehicle)


@dataclass(frozen=True)
class Course:
    """A run over time, one value per state: what passengers feel, and distances to others (NaN beyond 60 m).

    ``obstacle_ids``: the nearest road user, −1 if there is none; ``time_to_collision_s``: NaN if no road user was on a
    collision course. ``lateral_mps2`` is positive to the left.
    """

    time_s: Values
    speed_mps: Values
    acceleration_mps2: Values
    lateral_mps2: Values
    gap_m: Values
    obstacle_ids: tuple[int, ...]
    time_to_collision_s: Values


def course_of(runs: RunSet, record: RunRecord) -> Course | None:
    """Return the course of a run, or None if the run's steps are missing."""
    steps = runs.steps.get(record.run_id)
    if steps is None or not steps.x_m:
        return None
    return _Drive(record, steps, tracks_in(runs, record, steps)).course()


@dataclass(frozen=True)
class _Motion:
    """What passengers feel, one value per step after the first; the first jerk starts from the initial acceleration.

    ``lateral_mps2`` is signed, positive to the left; ``speed_mps`` belongs to the same steps.
    """

    step_s: float
    speed_mps: Values
    acceleration_mps2: Values
    lateral_mps2: Values
    jerk_mps3: Values

    def time_s(self, index: int) -> float:
        """Return the time of an entry since the first state."""
        return round((index + 1) * self.step_s, 9)


def plans_on_predictions(record: RunRecord) -> bool:
    """Return True if a run's planner is known to use predictions of other road users."""
    return uses_prediction(record.planner) if record.planner in PLANNERS else bool(record.uses_prediction)


def _reason(gap: Sequence[Sighting]) -> Sighting:
    """Return the entry with the reason of a time without reports: the last one, before it was only unconfirmed."""
    return next((one for one in reversed(gap) if one.code != "unconfirmed"), gap[0])


_MOST_UNSEEN = 3
"""How many times without reports a review lists (chosen)."""


class _Drive:
    """One run with the tracks of all other road users."""

    def __init__(
        self,
        record: RunRecord,
        steps: RunSteps,
        tracks: dict[int, Track],
        predict: Predictor | None = None,
        network: "LaneletNetwork | None" = None,
        lane: "Callable[[], Points | None] | None" = None,
    ) -> None:
        self._record, self._tracks, self._predict, self._network = record, tracks, predict, network
        self._perceived = steps.perceived
        self._lane = lane or (lambda: None)
        self._ego = ego_track(record, steps)
        turn = wrap_angles(np.diff(self._ego.headings_rad))
        self.motion = _Motion(
            step_s=record.step_s,
            speed_mps=self._ego.speeds_mps[1:],
            acceleration_mps2=np.asarray(steps.acceleration_mps2[1:], dtype=float),
            lateral_mps2=self._ego.speeds_mps[1:] * turn / record.step_s,
            jerk_mps3=np.abs(np.diff(np.asarray(steps.acceleration_mps2, dtype=float))) / record.step_s,
        )

    def course(self) -> Course:
        """Return the whole run, one value per state."""
        others, count = list(self._tracks.values()), len(self._ego.positions)
        gaps, urgent, nearest = np.full(count, np.nan), np.full(count, np.nan), np.full(count, -1)
        met = encounters(self._ego, others)
        found, times = gaps_m(met), times_to_collision_s(met.ego, met.other)
        for pair in np.argsort(-found, kind="stable"):  # the nearest comes last, so it is kept
            gaps[met.state[pair]] = found[pair]
            nearest[met.state[pair]] = others[int(met.track[pair])].obstacle_id
        np.fmin.at(urgent, met.state[np.isfinite(times)], times[np.isfinite(times)])
        return Course(
            time_s=np.arange(count, dtype=np.float64) * self._record.step_s,
            speed_mps=self._ego.speeds_mps,
            acceleration_mps2=np.concatenate([[np.nan], self.motion.acceleration_mps2])[:count],
            lateral_mps2=np.concatenate([[np.nan], self.motion.lateral_mps2])[:count],
            gap_m=gaps,
            obstacle_ids=tuple(int(one) for one in nearest),
            time_to_collision_s=urgent,
        )

    def nearest_moments(self) -> tuple[Encounter | None, Encounter | None]:
        """Return the moments of the smallest gap and of the shortest time to collision; the first moment wins a tie."""
        others = list(self._tracks.values())
        met = encounters(self._ego, others)
        if not len(met.state):
            return None, None
        gaps, times = gaps_m(met), times_to_collision_s(met.ego, met.other)

        def moment(pair: int) -> Encounter:
            other = others[int(met.track[pair])]
            index = int(met.state[pair])
            at = index + self._ego.first_step - other.first_step
            side, _ = _sides_of_approach(self._ego, index, other, at)
            return Encounter(
                time_s=round(index * self._record.step_s, 9),
                obstacle_id=other.obstacle_id,
                obstacle_class=other.kind,
                gap_m=float(gaps[pair]),
                side=side,
                direction=_course(self._ego, index, other, at),
                ego_speed_mps=float(self._ego.speeds_mps[index]),
                other_speed_mps=float(other.speeds_mps[at]),
                time_to_collision_s=float(times[pair]) if np.isfinite(times[pair]) else None,
            )

        order = np.lexsort((met.state, np.round(gaps, 9)))
        known = self._record.metrics.minimum_distance_m if self._record.metrics is not None else None
        shown = known is not None and abs(float(gaps[order[0]]) - known) < AGREES_M
        urgent = int(np.lexsort((met.state, np.round(times, 9)))[0])
        return (
            moment(int(order[0])) if shown else None,
            moment(urgent) if shown and np.isfinite(times[urgent]) else None,
        )

    def contact(self, *, finds_latest: bool = True) -> Contact | None:
        """Return how the collision came about, or None if there was no collision.

        Speeds are those at the collision; positions are those of the step before. ``finds_latest``: as in
        ``prevention_of``.
        """
        hit = self._record.collision
        if hit is None:
            return None
        last = len(self._ego.positions) - 1
        reached = min(max(hit.step - self._ego.first_step, 0), last)
        index = max(reached - 1, 0)
        speed = float(self._ego.speeds_mps[reached])
        braked = self._braked_since_s(index)
        if hit.obstacle_id is None or hit.obstacle_id not in self._tracks:
            return Contact(
                kind="road_boundary" if hit.obstacle_id is None else "unclear",
                time_s=hit.time_s,
                ego_speed_mps=speed,
                obstacle_id=hit.obstacle_id,
                obstacle_class="" if hit.obstacle_id is None else hit.kind,
                braked_since_s=braked,
            )
        other = self._tracks[hit.obstacle_id]
        at = other.index_at(self._ego.first_step + index)
        if at is None:
            at = 0 if hit.step <= other.first_step else len(other.positions) - 1
        ego_side, other_side = _sides_of_approach(self._ego, index, other, at)
        kind, came_in = self._kind(index, other, at, (ego_side, other_side))
        met = other.index_at(hit.step)
        met = at if met is None else met
        velocities = [_velocity(self._ego, reached), _velocity(other, met)]
        around = self._surroundings(other, evades=kind not in FROM_BEHIND)
        prevention = prevention_of(self._ego, other, hit.step, self._record.step_s, around, finds_latest=finds_latest)
        predicted = self._predicted_gap_m(other, hit.step, reached)
        sightings = () if self._perceived is None else sightings_of(self._perceived, other.obstacle_id)
        unseen = self._was_unseen(sightings, prevention, hit.step)
        return Contact(
            kind=kind,
            time_s=hit.time_s,
            ego_speed_mps=speed,
            obstacle_id=hit.obstacle_id,
            obstacle_class=hit.kind,
            other_speed_mps=float(other.speeds_mps[met]),
            closing_mps=float(np.linalg.norm(velocities[0] - velocities[1])),
            ego_side=ego_side,
            other_side=other_side,
            ego_stood_since_s=self._stood_since_s(index),
            braked_since_s=braked,
            came_in_s=came_in,
            also_touched=self._also_touched(hit.step, hit.obstacle_id),
            prevention=prevention,
            predicted_gap_m=predicted,
            laid_to=self._attribution(kind, prevention, predicted, unseen=unseen),
            sight=self._sight(sightings, hit.step),
        )

    def _attribution(
        self, kind: ContactKind, prevention: Prevention | None, predicted_m: float | None, *, unseen: bool
    ) -> CollisionCause | None:
        """Return the cause of the collision: the first that applies of recording, neither, perception, prediction and
        planning.

        ``neither``: neither UN R157's careful driver nor the fuzzy driver prevents it from both starts. ``unseen``: the
        planner did not receive the other road user in time.
        """
        if kind in FROM_BEHIND and self._record.traffic == "recorded":
            return "recording"
        if prevention is None:
            return None
        if not prevention.attributable:
            return "neither"
        if self._record.planner in PLANNERS and not uses_prediction(self._record.planner):
            return "planning"  # it ignores others, so that neither its sensors nor the prediction can change its motion
        if unseen:
            return "perception"
        if self._record.prediction == "ground_truth" or not plans_on_predictions(self._record):
            return "planning"
        return None if predicted_m is None else "prediction" if predicted_m > 0 else "planning"

    def _was_unseen(self, sightings: Sequence[Sighting], prevention: Prevention | None, hit_step: int) -> bool:
        """Return True if the planner had not received the other road user by the last time to brake.

        That time is the latest at which full braking prevents the collision or, if braking cannot prevent it, one
        second before the collision.
        """
        until_s = None if prevention is None else prevention.by_braking_until_s
        step = hit_step - round(_FORESEEN_S / self._record.step_s)
        if until_s is not None:
            step = self._ego.first_step + round(until_s / self._record.step_s)
        then = [one for one in sightings if one.step <= max(step, self._ego.first_step)]
        return bool(sightings) and (not then or then[-1].code not in REPORTED)

    def _sight(self, sightings: Sequence[Sighting], hit_step: int) -> Sight | None:
        """Return the ``Sight`` of a road user that is hit at a step, or None if the planner always received it."""
        before = [one for one in sightings if one.step <= hit_step]
        last = max((at for at, one in enumerate(before) if one.code not in REPORTED), default=-1)
        if last < 0:
            return None
        gap = itertools.takewhile(lambda one: one.code not in REPORTED, reversed(before[: last + 1]))
        why = _reason([*gap][::-1])
        first = next((one.step for one in before if one.code in REPORTED), None)
        since = before[last + 1].step if last + 1 < len(before) else None
        return Sight(
            code=why.code,
            by=why.by,
            by_class=self._class_of(why.by),
            first_s=self._since_start_s(first),
            since_s=self._since_start_s(since),
        )

    def unseen(self) -> tuple[Unseen, ...]:
        """Return when the planner did not receive a road user within the sensors' range, the nearest first."""
        found = list[Unseen]()
        for key, track in self._tracks.items():
            sightings = () if self._perceived is None else sightings_of(self._perceived, key)
            for is_reported, group in itertools.groupby(sightings, key=lambda one: one.code in REPORTED):
                gap = list(group)
                why = _reason(gap)
                if is_reported or why.code == "out_of_range":
                    continue
                again = next((one.step for one in sightings if one.step > gap[-1].step), None)
                nearest_m = self._nearest_center_m(track, gap[0].step, again)
                if nearest_m is None:
                    continue
                found.append(
                    Unseen(
                        obstacle_id=key,
                        obstacle_class=track.kind,
                        code=why.code,
                        by=why.by,
                        by_class=self._class_of(why.by),
                        from_s=self._since_start_s(gap[0].step) or 0.0,
                        until_s=self._since_start_s(again),
                        nearest_m=nearest_m,
                    )
                )
        return tuple(sorted(found, key=lambda one: (one.nearest_m, one.from_s, one.obstacle_id)))

    def _nearest_center_m(self, other: Track, first: int, after: int | None) -> float | None:
        """Return the smallest distance between the centres from a step until another; None if they never coexist."""
        end = self._ego.last_step + 1 if after is None else after
        steps = np.arange(max(first, other.first_step, self._ego.first_step), min(end, other.last_step + 1))
        steps = steps[steps <= self._ego.last_step]
        if not len(steps):
            return None
        own, its = self._ego.positions[steps - self._ego.first_step], other.positions[steps - other.first_step]
        return float(np.linalg.norm(own - its, axis=1).min())

    def _class_of(self, obstacle_id: int | None) -> str:
        return "" if obstacle_id is None or obstacle_id not in self._tracks else self._tracks[obstacle_id].kind

    def _since_start_s(self, step: int | None) -> float | None:
        return None if step is None else round((step - self._ego.first_step) * self._record.step_s, 9)

    def _surroundings(self, other: Track, *, evades: bool) -> Surroundings:
        """Return the surroundings of an encounter; they include the road only if it is known and the ego may evade."""
        others = [track for track in self._tracks.values() if track is not other]
        return Surroundings(others, self._road() if evades else None, self._lane(), self._record.friction)

    def _road(self) -> "BaseGeometry | None":
        """Return the area that an evading ego must not leave, or None if the road network is unknown."""
        import shapely

        if self._network is None:
            return None
        near = shapely.box(*shapely.total_bounds(shapely.points(self._ego.positions[-_LAST_STATES:]))).buffer(_AROUND_M)
        parts = [lanelet.polygon.shapely_object for lanelet in self._network.lanelets]
        road = shapely.union_all([shapely.make_valid(part) for part in parts if part.intersects(near)])
        road = road.buffer(_CLOSED_GAP_M, join_style="mitre")
        shapely.prepare(road)
        return road

    def _predicted_gap_m(self, other: Track, hit_step: int, reached: int) -> float | None:
        """Return the gap at the collision if the other road user had moved as predicted one second earlier."""
        import shapely

        steps = min(round(_FORESEEN_S / self._record.step_s), reached)
        at = other.index_at(hit_step - steps)
        if self._predict is None or at is None or steps < 1 or len(other.positions) < 2:
            return None
        if not plans_on_predictions(self._record) or not self._record.world.reports_true_states:
            return None
        foreseen = self._predict(other, at, steps, self._record.step_s)
        body = oriented_rectangle(foreseen.positions[-1], float(foreseen.headings_rad[-1]), other.size_m)
        own = shapely.Polygon(self._ego.corners_at(reached))
        return round(float(own.distance(shapely.Polygon(body))), 3)

    def _kind(
        self, index: int, other: Track, at: int, sides: tuple[BodySide, BodySide]
    ) -> tuple[ContactKind, float | None]:
        """Return the kind of contact by the first rule in ``docs/runs.md`` that holds, and the time of a cut-in."""
        ego_stands = self._ego.speeds_mps[index] < STANDING_MPS
        other_stands = other.speeds_mps[at] < STANDING_MPS
        if ego_stands != other_stands:
            return ("onto_standing_ego" if ego_stands else "into_standing"), None
        heading = relative_heading(self._ego, index, other, at)
        if heading != "same":
            return heading, None
        if sides[0] == "rear" or (sides[1] == "front" and sides[0] != "front"):
            came = self._cut_in_time_s(index, ahead=(self._ego, index), behind=(other, at))
            kind: ContactKind = "rear_end_by_other" if sides[0] == "rear" else "side"
            return (kind if came is None else "cut_in_by_ego"), came
        if sides[0] == "front":
            came = self._cut_in_time_s(index, ahead=(other, at), behind=(self._ego, index))
            kind = "rear_end_by_ego" if sides[1] == "rear" else "side"
            return (kind if came is None else "cut_in"), came
        return "side", None

    def _cut_in_time_s(self, index: int, *, ahead: tuple[Track, int], behind: tuple[Track, int]) -> float | None:
        """Return when the vehicle ahead entered the path of the vehicle behind, or None.

        None means that it entered longer ago, or that the vehicle behind changed lanes. The path of the vehicle behind
        is that of its last three seconds, extended straight ahead. The vehicle that ended farther to the side of its
        heading three seconds ago is the one that moved sideways.
        """
        (front, front_at), (rear, rear_at) = ahead, behind
        back = min(round(_CAME_IN_S / self._record.step_s), front_at, rear_at)
        if back < 1:
            return None
        way = rear.positions[rear_at - back : rear_at + 1]
        end = way[-1] + 100.0 * _along(float(rear.headings_rad[rear_at]))
        away = _distances(front.positions[front_at - back : front_at + 1], np.vstack([way, end]))
        outside = np.flatnonzero(away > (front.width_m + rear.width_m) / 2)
        if not len(outside):
            return None
        farther_m = abs(_sideways_m(front, front_at, back)) - abs(_sideways_m(rear, rear_at, back))
        if farther_m <= _ROUNDING_M:
            return None
        return round((index - back + int(outside[-1]) + 1) * self._record.step_s, 9)

    def _stood_since_s(self, index: int) -> float | None:
        moving = np.flatnonzero(self._ego.speeds_mps[: index + 1] >= STANDING_MPS)
        first = int(moving[-1]) + 1 if len(moving) else 0
        return round(first * self._record.step_s, 9) if first <= index else None

    def _braked_since_s(self, index: int) -> float | None:
        """Return the time at which the ego began the braking that lasted until a state."""
        felt = self.motion.acceleration_mps2[:index]
        weak = np.flatnonzero(felt > _BRAKING_MPS2)
        first = int(weak[-1]) + 1 if len(weak) else 0
        return round(first * self._record.step_s, 9) if first < len(felt) else None

    def _also_touched(self, step: int, hit: int) -> tuple[int, ...]:
        import shapely

        index = step - self._ego.first_step
        if not 0 <= index < len(self._ego.positions):
            return ()
        own = shapely.Polygon(self._ego.corners_at(index))
        touched = []
        for track in self._tracks.values():
            at = track.index_at(step)
            if track.obstacle_id != hit and at is not None and own.intersects(shapely.Polygon(track.corners_at(at))):
                touched.append(track.obstacle_id)
        return tuple(sorted(touched))


def _along(heading_rad: float) -> Points:
    direction: Points = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    return direction


def _velocity(track: Track, index: int) -> Points:
    velocity: Points = float(track.speeds_mps[index]) * _along(float(track.headings_rad[index]))
    return velocity


def relative_heading(ego: Track, index: int, other: Track, at: int) -> RelativeHeading:
    """Return the direction of another road user's heading relative to the ego's."""
    turned = abs(wrap_angle(float(other.headings_rad[at]) - float(ego.headings_rad[index])))
    return "same" if turned <= _SAME_RAD else "oncoming" if turned >= _AGAINST_RAD else "crossing"


def stands(other: Track, at: int) -> bool:
    """Return True if a road user is standing at a state, so that it is neither oncoming nor crossing."""
    return bool(other.speeds_mps[at] < STANDING_MPS)


def _course(ego: Track, index: int, other: Track, at: int) -> SeenCourse:
    """Return another road user's course; a vehicle parked facing the ego is not oncoming."""
    heading = relative_heading(ego, index, other, at)
    return "standing" if heading != "same" and stands(other, at) else heading


def _sides_of_approach(ego: Track, index: int, other: Track, at: int) -> tuple[BodySide, BodySide]:
    """Return on which side of the ego the other road user is, and on which side of that road user the ego is."""
    return side_of(ego, index, other.corners_at(at)), side_of(other, at, ego.corners_at(index))


def side_of(body: Track, index: int, corners: Points) -> BodySide:
    """Return the side of a body on which another body is: the largest of the four gaps along its axes."""
    along = _along(float(body.headings_rad[index]))
    away = corners - body.positions[index]
    forward, left = away @ along, away @ np.array([-along[1], along[0]])
    gaps: dict[BodySide, float] = {
        "front": float(forward.min()) - body.length_m / 2,
        "rear": -float(forward.max()) - body.length_m / 2,
        "left": float(left.min()) - body.width_m / 2,
        "right": -float(left.max()) - body.width_m / 2,
    }
    return max(gaps, key=lambda side: gaps[side])


def _sideways_m(track: Track, at: int, back: int) -> float:
    """Return how far a track moved sideways (left positive) from its heading ``back`` steps ago."""
    along = _along(float(track.headings_rad[at - back]))
    moved = track.positions[at] - track.positions[at - back]
    return float(along[0] * moved[1] - along[1] * moved[0])


def _distances(points: Points, path: Points) -> Values:
    import shapely

    distances: Values = shapely.distance(shapely.points(points), shapely.LineString(path))
    return distances


def _largest(motion: _Motion) -> Iterator[LargestMotion]:
    """Yield acceleration, braking, lateral acceleration and jerk, each only if the ego had any."""
    felt = motion.acceleration_mps2
    if not len(felt):
        return
    series: tuple[tuple[Literal["acceleration", "braking", "lateral acceleration", "jerk"], Values, str], ...] = (
        ("acceleration", felt, "m/s²"),
        ("braking", -felt, "m/s²"),
        ("lateral acceleration", np.abs(motion.lateral_mps2), "m/s²"),
        ("jerk", motion.jerk_mps3, "m/s³"),
    )
    for name, values, unit in series:
        if len(values) and (most := float(values.max())) >= RESOLUTION:
            yield LargestMotion(name=name, value=most, unit=unit, time_s=motion.time_s(int(values.argmax())))


_ACC, _LKA, _STEERING = "ISO 15622:2018", "ISO 11270:2014", "UN R79"


def _by_speed(speed_mps: Values, slow: float, fast: float) -> Values:
    """Return a limit of ISO 15622: one value up to 5 m/s, a second value above 20 m/s, and linear in between."""
    limits: Values = np.interp(speed_mps, [5.0, 20.0], [slow, fast])
    return limits


def _uncomfortable(motion: _Motion) -> Iterator[ComfortExcess]:
    """Yield the motions that exceeded a comfort limit.

    ISO 15622:2018 (adaptive cruise control): acceleration averaged over 2 s up to 2.0 m/s², braking averaged over 2 s
    up to 3.5 m/s², and the jerk of braking averaged over 1 s up to 2.5 m/s³. These limits apply at 20 m/s and above; at
    5 m/s and below, they are 4.0, 5.0 and 5.0. ISO 11270:2014 (lane keeping): lateral acceleration up to 3 m/s². UN
    Regulation 79 (automatically commanded steering): lateral jerk averaged over 0.5 s up to 5 m/s³. Only complete
    windows are averaged; the speed is that of the window's end. The filter of UN R79 is left out, because these values
    are not sensor measurements.
    """
    step_s, felt = motion.step_s, motion.acceleration_mps2
    mean = _window_means(felt, round(2.0 / step_s))
    speed = motion.speed_mps[len(felt) - len(mean) :]
    yield from _excess(motion, "acceleration", mean, _by_speed(speed, 4.0, 2.0), 2.0, _ACC)
    yield from _excess(motion, "braking", -mean, _by_speed(speed, 5.0, 3.5), 2.0, _ACC)
    jerk = _rates(felt, round(1.0 / step_s), step_s)
    speed = motion.speed_mps[len(felt) - len(jerk) :]
    yield from _excess(motion, "braking jerk", -jerk, _by_speed(speed, 5.0, 2.5), 1.0, _ACC)
    lateral = np.abs(motion.lateral_mps2)
    yield from _excess(motion, "lateral acceleration", lateral, np.full(len(lateral), 3.0), 0.0, _LKA)
    jerk = np.abs(_rates(motion.lateral_mps2, round(0.5 / step_s), step_s))
    yield from _excess(motion, "lateral jerk", jerk, np.full(len(jerk), 5.0), 0.5, _STEERING)


def _excess(
    motion: _Motion,
    name: Literal["acceleration", "braking", "braking jerk", "lateral acceleration", "lateral jerk"],
    values: Values,
    limits: Values,
    window_s: float,
    source: str,
) -> Iterator[ComfortExcess]:
    """Yield the entry that is farthest above its limit; the last of ``values`` belongs to the motion's last step."""
    if not len(values):
        return
    index = int((values - limits).argmax())
    value, limit = float(values[index]), float(limits[index])
    if value > limit * (1 + 1e-9):
        yield ComfortExcess(
            name=name,
            value=value,
            limit=limit,
            unit="m/s³" if "jerk" in name else "m/s²",
            window_s=window_s,
            time_s=motion.time_s(len(motion.speed_mps) - len(values) + index),
            source=source,
        )


def _window_means(values: Values, steps: int) -> Values:
    """Return the mean over every full window of ``steps`` entries, in order of the windows' ends."""
    if steps < 1 or len(values) < steps:
        return np.zeros(0)
    sums = np.concatenate([[0.0], np.cumsum(values)])
    means: Values = (sums[steps:] - sums[:-steps]) / steps
    return means


def _rates(values: Values, steps: int, step_s: float) -> Values:
    """Return the mean rate of change over every full window of ``steps`` steps."""
    steps = max(steps, 1)
    if len(values) <= steps:
        return np.zeros(0)
    rates: Values = (values[steps:] - values[:-steps]) / (steps * step_s)
    return rates


def timeline(
    runs: RunSet, record: RunRecord, moment: Encounter | None = None, window: Interval | None = None
) -> tuple[TimelineStep, ...]:
    """Return at most ten entries from the last three seconds, three seconds around a moment, or a time window.

    The result is empty if the run has no steps.

    Raises:
        InvalidRequest: the run ended before the window.
    """
    steps = runs.steps.get(record.run_id)
    if steps is None or not steps.x_m:
        return ()
    tracks = tracks_in(runs, record, steps)
    last = len(steps.x_m) - 1
    end_s = last * record.step_s
    if window is not None and (window.low or 0.0) > end_s:
        raise InvalidRequest(f"the run ends at {end_s:.1f} s, before time_s={window.low:g}", valid=[f"0..{end_s:.1f}"])
    if window is not None:
        last = last if window.high is None else min(last, math.floor(window.high / record.step_s + _EXACT))
        first = min(max(math.ceil((window.low or 0.0) / record.step_s - _EXACT), 0), last)
    else:
        if moment is not None:
            last = min(last, round((moment.time_s + _LAST_S / 2) / record.step_s))
        first = max(last - round(_LAST_S / record.step_s), 0)
    chosen = sorted({round(float(index)) for index in np.linspace(first, last, min(_MOMENTS, last - first + 1))})
    return tuple(_moment(record, steps, index, tracks) for index in chosen)


_EXACT = 1e-6
"""Share of a step that counts as rounding: 0.3 s are three steps of 0.1 s."""


def _moment(record: RunRecord, steps: RunSteps, index: int, tracks: dict[int, Track]) -> TimelineStep:
    hit = record.collision.obstacle_id if record.collision is not None else None
    considered = {hit: tracks[hit]} if hit is not None and hit in tracks else tracks
    nearest, gap = _nearest(steps, index, considered, (record.ego_length_m, record.ego_width_m))
    term, share = _largest_cost(steps, steps.first_step + index)
    return TimelineStep(
        time_s=round(index * record.step_s, 9),
        speed_mps=steps.speed_mps[index],
        acceleration_mps2=steps.acceleration_mps2[index],
        obstacle_id=nearest,
        gap_m=gap,
        largest_cost=term,
        largest_cost_share=share,
    )


def _nearest(
    steps: RunSteps, index: int, tracks: dict[int, Track], size: tuple[float, float]
) -> tuple[int | None, float | None]:
    import shapely

    center = np.array([steps.x_m[index], steps.y_m[index]])
    ego = shapely.Polygon(oriented_rectangle(center, steps.heading_rad[index], size))
    gaps = []
    for track in tracks.values():
        at = track.index_at(steps.first_step + index)
        if at is not None:
            heading = float(track.headings_rad[at])
            other = oriented_rectangle(track.positions[at], heading, (track.length_m, track.width_m))
            gaps.append((float(ego.distance(shapely.Polygon(other))), track.obstacle_id))
    if not gaps:
        return None, None
    gap, obstacle_id = min(gaps)
    return obstacle_id, gap


def _largest_cost(steps: RunSteps, step: int) -> tuple[str | None, float | None]:
    planned = [i for i, plan_step in enumerate(steps.plan_steps) if plan_step <= step]
    if not planned:
        return None, None
    at = planned[-1]
    terms = {term: values[at] for term, values in sorted(steps.costs.items()) if at < len(values)}
    total = sum(terms.values())
    if total <= 0:
        return None, None
    term = max(terms, key=lambda name: (terms[name], name))
    return term, terms[term] / total
