"""The measures of runs (``schemas/measures.py``), each with its decisive road user, relation and time.

They are computed on request, from the driven steps and the tracks of all other road users. A stored metric keeps its
stored value; its time is given only if the tracks yield the same value.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...schemas.errors import UnknownName
from ...schemas.measures import LEFT_THE_ROAD, MEASURES, Measure, MeasuredValue, MeasureSpread, Relation
from ...schemas.runs import RunRecord, RunSteps, drawn
from ..commonroad import Track, kept_recording
from ..criticality import (
    MovingRectangles,
    ahead_of,
    driving_times_s,
    encounters,
    gaps_m,
    risk_scores,
    times_to_collision_s,
)
from ..execution import ProgressReporter
from ..geometry import Points, Values, wrap_angles
from ..motion_figures import MotionSeries, motion_figures
from ..planners import progress_to_goal, steering_of
from ..vehicles import HARDEST_BRAKING_MPS2, Motion, VehicleParameters, drivable_steps
from .conflicts import CONFLICT_S, nearest_crossing, times_left_to_crossing, worst_times_s
from .moments import AGREES_M, relative_heading, side_of, stands
from .prevention import safe_distance_m
from .run_set import RunSet, ego_track, tracks_in

LONGEST_S = 100.0
"""As for the criticality figures, longer times do not count."""
EXPOSED_S = 3.0
"""Threshold of time exposed and time integrated: the largest that Minderhoud and Bovy (2001) use."""
MOST_NEEDED_MPS2, MOST_THREAT = 20.0, 5.0
"""Upper bounds (chosen): larger values add no information; no road vehicle brakes harder than half of the first."""
CROSSED_WITHIN_S = 10.0
"""Longest time between crossing paths that counts as an encounter (chosen); most studies use 5 s or less."""
_CLOSING_MPS = 1e-6
"""Slower closing counts as keeping the distance (chosen, far above rounding errors)."""
_MASSES_KG = {"pedestrian": 75.0, "bicycle": 90.0, "motorcycle": 250.0, "truck": 12_000.0, "bus": 12_000.0}
_CAR_KG = 1500.0
"""Mass with driver (chosen): files contain no masses. All other classes count as cars."""
MOST_MEASURED = 60
"""Number of runs of a set that are measured, drawn at random (chosen): each reads its scenario; an answer has 50 s."""


def measures_of(runs: RunSet, record: RunRecord) -> tuple[MeasuredValue, ...]:
    """Return all measures of a run, in the order of ``MEASURES``."""
    steps = runs.steps.get(record.run_id)
    if record.metrics is None or steps is None or not steps.x_m:
        why = "the problem is invalid" if record.metrics is None else "the steps of the run were not kept"
        return tuple(
            _with_stored_value(measure, record, MeasuredValue(name=measure.name, why=why)) for measure in MEASURES
        )
    drive = _measured_drive(runs, record, steps)
    found = {one.name: one for one in drive.measured()}
    if record.outcome == "off_road":
        found["risk_score"] = MeasuredValue(name="risk_score", why=LEFT_THE_ROAD)
    return tuple(
        _with_stored_value(
            measure, record, found.get(measure.name) or MeasuredValue(name=measure.name, why=measure.none)
        )
        for measure in MEASURES
    )


def measure_spreads(runs: RunSet, report: ProgressReporter) -> tuple[MeasureSpread, ...]:
    """Return every measure over the valid runs of a set or a random sample of them, with the worst run."""
    records = drawn(runs.valid)[:MOST_MEASURED] if len(runs.valid) > MOST_MEASURED else runs.valid
    measured: dict[str, list[tuple[str, MeasuredValue]]] = {measure.name: [] for measure in MEASURES}
    for number, record in enumerate(records):
        for one in measures_of(runs, record):
            measured[one.name].append((record.run_id, one))
        report((number + 1) / len(records), record.run_id)
    return tuple(_spread(measure, measured[measure.name]) for measure in MEASURES)


def _spread(measure: Measure, measured: Sequence[tuple[str, MeasuredValue]]) -> MeasureSpread:
    there = [(one.value, run_id, one) for run_id, one in measured if one.value is not None]
    if not there:
        return MeasureSpread(name=measure.name, runs=0, why=measure.none)
    values = [value for value, _, _ in there]
    _, run_id, worst = min(there, key=lambda one: -one[0] if measure.better == "lower" else one[0])
    return MeasureSpread(
        name=measure.name,
        runs=len(there),
        median=float(np.median(values)),
        lowest=min(values),
        highest=max(values),
        worst=None if measure.better is None else worst,
        worst_run_id="" if measure.better is None else run_id,
    )


def _with_stored_value(measure: Measure, record: RunRecord, found: MeasuredValue) -> MeasuredValue:
    """Return a measure with its stored value, if any; its time is included only if the computed value agrees."""
    stored: float | None = getattr(record.metrics, measure.name, None) if measure.stored else None
    if measure.name == "risk_score" and record.outcome == "off_road":
        stored = None
    if stored is None:
        return found
    if found.value is None or abs(found.value - stored) > AGREES_M:
        return MeasuredValue(name=measure.name, value=float(stored))
    return found.model_copy(update={"value": float(stored)})


def _measured_drive(runs: RunSet, record: RunRecord, steps: RunSteps) -> "MeasuredDrive":
    others = tracks_in(runs, record, steps)
    vehicle, path = runs.vehicle(record), runs.scenario_path(record)
    standing, progress = frozenset[int](), None
    ego = ego_track(record, steps)
    if path is not None:
        loaded = kept_recording(path).loaded
        standing = frozenset(int(one.obstacle_id) for one in loaded.scenario.static_obstacles)
        try:
            progress = progress_to_goal(loaded.scenario, loaded.problem(record.problem_id), vehicle, ego.positions)
        except UnknownName:  # the file was replaced since the run
            progress = None
    return MeasuredDrive(
        ego=ego,
        accelerations_mps2=np.asarray(steps.acceleration_mps2, dtype=float),
        others=tuple(others.values()),
        standing=standing,
        step_s=record.step_s,
        vehicle=vehicle,
        hit=record.collision.obstacle_id if record.collision is not None else None,
        progress=progress,
    )


@dataclass(frozen=True)
class Leaders:
    """The nearest vehicle ahead on the ego's path, one entry per state that has one (``state``, an index).

    ``track`` is an index into the other road users' tracks. ``gaps_m`` are bumper to bumper, at least 0. ``ego_mps``,
    ``speeds_mps`` and ``accelerations_mps2`` (of the leader) are along the path. ``across_m``: lateral overlap of the
    two bodies. ``hardest_mps2``: the deceleration that the tyres allow on this road.
    """

    state: NDArray[np.intp]
    track: NDArray[np.intp]
    gaps_m: Values
    ego_mps: Values
    speeds_mps: Values
    accelerations_mps2: Values
    across_m: Values
    hardest_mps2: float

    @cached_property
    def closing_mps(self) -> Values:
        """The speed at which the gap closes, 0 if it does not."""
        closing = self.ego_mps - self.speeds_mps
        return np.where(closing > _CLOSING_MPS, closing, 0.0)

    @cached_property
    def times_to_collision_s(self) -> Values:
        """The gaps divided by the closing speeds; infinite if the gap is not closing."""
        return _ratio(self.gaps_m, self.closing_mps)

    @cached_property
    def needed_mps2(self) -> Values:
        """The constant deceleration that brings the ego to the leader's speed on contact; 0 if it need not brake.

        The leader keeps its acceleration and stays stopped once it has stopped (Jansson 2005, 5.3.5).
        """
        gap, closing = self.gaps_m, self.ego_mps - self.speeds_mps
        keeps = _ratio(closing**2, 2 * gap) - self.accelerations_mps2
        slows, leader = self.accelerations_mps2 < 0, np.maximum(self.speeds_mps, 0.0)
        stops_s = np.where(slows, _ratio(leader, -self.accelerations_mps2), np.inf)
        stops_m = np.where(slows, _ratio(leader**2, -2 * self.accelerations_mps2), 0.0)
        stands = _ratio(self.ego_mps**2, 2 * (gap + stops_m))
        meets_s = np.where(closing > _CLOSING_MPS, _ratio(2 * gap, closing), np.inf)
        needed = np.where(slows & (stops_s < meets_s), stands, np.where(closing > _CLOSING_MPS, keeps, 0.0))
        return np.maximum(needed, 0.0)

    @cached_property
    def times_to_brake_s(self) -> Values:
        """How long the ego may keep its speed and still brake to the leader's; infinite if the gap is not closing."""
        left = self.gaps_m - self.closing_mps**2 / (2 * self.hardest_mps2)
        return np.maximum(_ratio(left, self.closing_mps), 0.0)

    @cached_property
    def times_to_swerve_s(self) -> Values:
        """How long the ego may keep its speed and still swerve past the leader."""
        takes_s = np.sqrt(2 * self.across_m / self.hardest_mps2)
        return np.maximum(self.times_to_collision_s - takes_s, 0.0)


def _ratio(over: Values, under: Values) -> Values:
    """Return the quotient for a non-negative divisor; infinite if the divisor is 0."""
    return np.where(under > 0, over / np.where(under > 0, under, 1.0), np.inf)


@dataclass(frozen=True)
class MeasuredDrive:
    """The input of the measures: the driven states, the vehicle, and the tracks of all other road users.

    ``standing``: ids of road users that never move; ``hit``: the road user that the ego collided with at its last
    state; ``progress``: the share of the path to the goal, or None if it is unknown.
    """

    ego: Track
    accelerations_mps2: Values
    others: tuple[Track, ...]
    standing: frozenset[int]
    step_s: float
    vehicle: VehicleParameters
    hit: int | None = None
    progress: float | None = None

    def measured(self) -> Iterator[MeasuredValue]:
        """Yield the available measures, and the missing ones that have a specific reason."""
        yield from self._nearness()
        yield from self._following()
        yield from self._time_left()
        yield from self._crossing()
        yield from self._crash()
        yield from self._motion()
        if self.progress is not None:
            yield MeasuredValue(name="progress", value=self.progress)

    @cached_property
    def _met(self) -> "_Pairs":
        met = encounters(self.ego, self.others)
        ahead = ahead_of(self.ego, met) if len(met.state) else None
        return _Pairs(
            met.state,
            met.track,
            met.ego,
            met.other,
            gaps_m=gaps_m(met) if len(met.state) else np.zeros(0),
            collision_s=times_to_collision_s(met.ego, met.other),
            ahead_m=np.zeros(0) if ahead is None else ahead.gaps_m,
            ahead_mps=np.zeros(0) if ahead is None else ahead.speeds_mps,
            aside_m=np.zeros(0) if ahead is None else ahead.aside_m,
            headways_s=np.zeros(0) if ahead is None else driving_times_s(ahead.gaps_m + met.other.sizes_m[:, 0], met),
            time_gaps_s=np.zeros(0) if ahead is None else driving_times_s(ahead.gaps_m, met),
        )

    @cached_property
    def leaders(self) -> Leaders:
        """The nearest vehicle ahead at each state that has one."""
        met = self._met
        order = np.lexsort((met.ahead_m, met.state))
        order = order[np.isfinite(met.ahead_m[order])]
        _, first = np.unique(met.state[order], return_index=True)
        pairs = order[first]
        widths = (met.ego.sizes_m[pairs, 1] + met.other.sizes_m[pairs, 1]) / 2
        return Leaders(
            state=met.state[pairs],
            track=met.track[pairs],
            gaps_m=np.maximum(met.ahead_m[pairs], 0.0),
            ego_mps=met.ego.speeds_mps[pairs],
            speeds_mps=met.ahead_mps[pairs],
            accelerations_mps2=self._accelerations(met.state[pairs], met.track[pairs]),
            across_m=np.maximum(widths - met.aside_m[pairs], 0.0),
            hardest_mps2=self.vehicle.hardest_braking_mps2,
        )

    def _accelerations(self, states: NDArray[np.intp], tracks: NDArray[np.intp]) -> Values:
        """Return other road users' accelerations at the ego's given states: differences of speed, within ±8 m/s²."""
        found = np.zeros(len(states))
        for number in np.unique(tracks):
            track, chosen = self.others[int(number)], tracks == number
            if len(track.speeds_mps) > 1:
                slopes = np.gradient(track.speeds_mps, self.step_s)
                found[chosen] = slopes[states[chosen] + self.ego.first_step - track.first_step]
        return np.clip(found, -HARDEST_BRAKING_MPS2, HARDEST_BRAKING_MPS2)

    def _nearness(self) -> Iterator[MeasuredValue]:
        met = self._met
        if not len(met.state):
            return
        series = (
            ("minimum_distance_m", met.gaps_m, np.inf),
            ("minimum_time_to_collision_s", met.collision_s, LONGEST_S),
            ("minimum_time_headway_s", met.headways_s, LONGEST_S),
            ("minimum_time_gap_s", met.time_gaps_s, LONGEST_S),
            ("risk_score", risk_scores(met.gaps_m, met.collision_s).astype(float), np.inf),
            ("worst_time_to_collision_s", worst_times_s(met.ego, met.other, self._stands(met.track)), np.inf),
        )
        for name, values, longest in series:
            pair = int(np.lexsort((met.state, np.round(values, 9)))[0])
            if np.isfinite(values[pair]) and values[pair] <= longest:
                yield self._with(name, values[pair], met.state[pair], met.track[pair])

    def _stands(self, tracks: NDArray[np.intp]) -> NDArray[np.bool_]:
        never = np.array([track.obstacle_id in self.standing for track in self.others], dtype=bool)
        return never[tracks] if len(tracks) else np.zeros(0, dtype=bool)

    def _following(self) -> Iterator[MeasuredValue]:
        led = self.leaders
        if not len(led.state):
            return
        times = led.times_to_collision_s
        if times.min() <= LONGEST_S:
            yield self._of_leader("leader_time_to_collision_s", times, times.argmin())
        exposed = (times <= EXPOSED_S) & (led.state > 0)  # a step ends at its state, so the first state ends no step
        duration, depth = self.step_s * exposed.sum(), self.step_s * np.where(exposed, EXPOSED_S - times, 0.0).sum()
        for name, total in (("time_exposed_s", duration), ("time_integrated_s2", depth)):
            if exposed.any():
                worst = np.where(exposed, times, np.inf).argmin()
                yield self._with(name, total, led.state[worst], led.track[worst])
            else:
                yield MeasuredValue(name=name, value=0.0)
        margins = led.gaps_m - safe_distance_m(led.ego_mps, led.speeds_mps)
        yield self._of_leader("rss_margin_m", margins, margins.argmin())
        apart = led.gaps_m > 0
        threats = np.where(apart, led.needed_mps2 / self.vehicle.hardest_braking_mps2, 0.0)
        if threats.any():
            yield self._of_leader("brake_threat_number", np.minimum(threats, MOST_THREAT), threats.argmax())
        elif apart.any():
            yield MeasuredValue(name="brake_threat_number", value=0.0)
        closing = apart & (times <= LONGEST_S)
        if not closing.any():
            return
        needed = np.where(closing, led.closing_mps**2 / (2 * np.where(apart, led.gaps_m, 1.0)), 0.0)
        yield self._of_leader("deceleration_to_avoid_mps2", np.minimum(needed, MOST_NEEDED_MPS2), needed.argmax())
        across = np.where(
            closing, 2 * led.across_m / np.where(closing, times, 1.0) ** 2 / self.vehicle.hardest_braking_mps2, 0.0
        )
        yield self._of_leader("steer_threat_number", np.minimum(across, MOST_THREAT), across.argmax())

    def _time_left(self) -> Iterator[MeasuredValue]:
        """Yield time to brake and time to react, for leaders and for crossing road users."""
        led, met = self.leaders, self._met
        soon = led.times_to_collision_s <= CONFLICT_S
        turned = np.abs(wrap_angles(met.other.headings_rad - met.ego.headings_rad))
        crosses = (turned > np.pi / 4) & (turned < 3 * np.pi / 4) & (met.collision_s <= CONFLICT_S)
        brake, react = times_left_to_crossing(
            _chosen(met.ego, crosses), _chosen(met.other, crosses), met.collision_s[crosses], self.vehicle
        )
        state = np.concatenate([led.state[soon], met.state[crosses]])
        track = np.concatenate([led.track[soon], met.track[crosses]])
        by_leader = np.maximum(led.times_to_brake_s, led.times_to_swerve_s)[soon]
        for name, values in (
            ("time_to_brake_s", np.concatenate([led.times_to_brake_s[soon], brake])),
            ("time_to_react_s", np.concatenate([by_leader, react])),
        ):
            if len(values):
                pair = int(np.lexsort((state, np.round(values, 9)))[0])
                yield self._with(name, values[pair], state[pair], track[pair])

    def _crossing(self) -> Iterator[MeasuredValue]:
        crossing = nearest_crossing(self.ego, self.others, self.step_s, CROSSED_WITHIN_S)
        if crossing is None:
            return
        other = self.others[crossing.track]
        came, left = crossing.ego_s
        values = [("post_encroachment_time_s", crossing.post_encroachment_s, crossing.second_arrival_s)]
        values += [("encroachment_time_s", left - came, came)] if crossing.ego_whole else []
        for name, value, time_s in values:
            yield MeasuredValue(
                name=name,
                value=round(value, 9),
                time_s=round(time_s, 9),
                obstacle_id=other.obstacle_id,
                obstacle_class=other.kind,
                relation="oncoming" if crossing.turned_rad >= 3 * np.pi / 4 else "crossing",
            )

    def _crash(self) -> Iterator[MeasuredValue]:
        """Yield the change of velocity if the ego hit a road user that has a known track."""
        number = next((i for i, track in enumerate(self.others) if track.obstacle_id == self.hit), None)
        last = len(self.ego.positions) - 1
        other = None if number is None else self.others[number]
        at = None if other is None else other.index_at(self.ego.last_step)
        if number is None or other is None or at is None:
            return
        mass = np.inf if other.obstacle_id in self.standing else _MASSES_KG.get(other.kind, _CAR_KG)
        share = 1.0 if np.isinf(mass) else mass / (mass + _CAR_KG)
        away = _velocity(self.ego, last) - _velocity(other, at)
        yield self._with("delta_v_mps", share * float(np.linalg.norm(away)), last, number)

    def _motion(self) -> Iterator[MeasuredValue]:
        """Yield measures of the ego's motion, each with the time of its largest value."""
        along, step_s, ego = self.accelerations_mps2, self.step_s, self.ego
        if len(along) < 2:
            return
        limit = self.vehicle.maximum_steering_rate_radps
        angles = steering_of(ego.headings_rad, ego.speeds_mps, step_s, self.vehicle.wheelbase_m)
        figures = motion_figures(ego, along, angles, step_s)
        for name, value in figures.totals.items():
            yield MeasuredValue(name=name, value=value)
        over = np.abs(np.diff(angles) / step_s) > limit * (1 + 1e-6)
        note_on_limit = f"the vehicle's limit is {limit:g} rad/s" if over.any() else ""
        for one in figures.series:
            yield from self._largest(one, note_on_limit if one.name == "maximum_steering_rate_radps" else "")
        motion = Motion(ego.positions, ego.headings_rad, ego.speeds_mps, along)
        vehicle = self.vehicle
        drivable = drivable_steps(
            motion,
            step_s,
            wheelbase_m=vehicle.wheelbase_m,
            rear_axle_m=vehicle.rear_axle_behind_center_m,
            friction=vehicle.friction,
        )
        good = drivable & ~over
        first = None if good.all() else round(float(np.argmin(good)) * step_s, 9)
        yield MeasuredValue(name="drivable_share", value=float(good.mean()), time_s=first)

    def _largest(self, series: MotionSeries, note: str) -> Iterator[MeasuredValue]:
        """Yield the largest value of a series, with its time unless the value is 0."""
        values = series.values
        if len(values):
            at = int(np.argmax(np.round(values, 9)))
            time_s = round((at + series.first_state) * self.step_s, 9) if values[at] > 0 else None
            yield MeasuredValue(name=series.name, value=float(values[at]), time_s=time_s, note=note)

    def _of_leader(self, name: str, values: Values, at: np.intp) -> MeasuredValue:
        return self._with(name, values[at], self.leaders.state[at], self.leaders.track[at])

    def _with(self, name: str, value: float, state: int | np.intp, track: int | np.intp) -> MeasuredValue:
        other = self.others[int(track)]
        return MeasuredValue(
            name=name,
            value=float(value),
            time_s=round(int(state) * self.step_s, 9),
            obstacle_id=other.obstacle_id,
            obstacle_class=other.kind,
            relation=self._relation(int(state), other),
        )

    def _relation(self, state: int, other: Track) -> Relation:
        at = state + self.ego.first_step - other.first_step
        heading = relative_heading(self.ego, state, other, at)
        if heading != "same" and not stands(other, at):
            return heading
        side = side_of(self.ego, state, other.corners_at(at))
        return "ahead" if side == "front" else "behind" if side == "rear" else "beside"


@dataclass(frozen=True)
class _Pairs:
    """Pairs of a driven state and a nearby road user, with the quantities between them; all (n,), times in s."""

    state: NDArray[np.intp]
    track: NDArray[np.intp]
    ego: MovingRectangles
    other: MovingRectangles
    gaps_m: Values
    collision_s: Values
    ahead_m: Values
    ahead_mps: Values
    aside_m: Values
    headways_s: Values
    time_gaps_s: Values


def _chosen(bodies: MovingRectangles, chosen: NDArray[np.bool_]) -> MovingRectangles:
    return MovingRectangles(
        bodies.centers[chosen], bodies.headings_rad[chosen], bodies.sizes_m[chosen], bodies.speeds_mps[chosen]
    )


def _velocity(track: Track, index: int) -> Points:
    heading = float(track.headings_rad[index])
    velocity: Points = float(track.speeds_mps[index]) * np.array([np.cos(heading), np.sin(heading)])
    return velocity
