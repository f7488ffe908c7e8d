"""Evaluates points: edits a base in memory, runs the planner until the encounter is resolved, and judges the outcome.

The edits and the run are those of ``modify_scenario`` and ``run_planner``: the driven states are equal bit for bit to
those of the stored scenario's run, up to the step at which this run is stopped. In a recording that is much longer than
the horizon, this holds for failures; for other points, vehicles that edits simulate react only to what happens within
the horizon.

A run is stopped after the horizon, or once every other road user is gone, is behind the ego and not faster, or stands
while the ego stands too. If there is no other road user, a run lasts until the horizon.
"""

import math
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from ...schemas.errors import InvalidRequest
from ...schemas.exploration import AvoidingDriver, EncounterSetting, Evaluation
from ...schemas.failures import BaseDrive
from ...schemas.modification import Edit, EditOperation, ModificationRequest
from ...schemas.reviews import CAREFUL_DRIVERS, Contact
from ...schemas.runs import RunRecord
from ..analysis import contact_in, driven_tracks, drivers_that_avoid
from ..commonroad import LoadedScenario, Track, kept_recording, static_tracks
from ..criticality import Encounters, encounters, gaps_m, times_to_collision_s
from ..edits import EditableScenario, NeedsFile, apply_edits
from ..execution import silent
from ..geometry import Points, Values
from ..planners import (
    DrivenRun,
    DriverPath,
    EgoState,
    Planner,
    ScenarioFile,
    check_modes,
    check_world,
    driven_ego,
    ended_after,
    is_built_in,
    lane_line,
    make_planner,
    needs_file,
    open_traffic,
    predictor,
    run_steps,
    simulate,
    uses_prediction,
)
from ..vehicles import STANDING_MPS, VehicleParameters, vehicle_of

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem

_OVER_S, _LOOKED_AT_S = 1.0, 0.2
"""The encounter is over if it looked like that for the first time, at intervals of the second (chosen)."""
_BEHIND_M = 2.0
"""The least gap behind the ego to a road user that it has passed (chosen)."""
_INTO_EGO = ("rear_end_by_other", "onto_standing_ego")
"""Contacts in which another drives into the ego; if from behind, it is not the ego's failure, because recorded and
prescribed road users do not brake.
"""
_RECORDED = "recorded"
_NO_DEMAND = "the planner was not run: its drive through the unchanged base would not collide avoidably"
HOPELESS: Final = 0.5
"""The demand of a point at which no careful driver would avoid the collision of the drive through the base."""
_Stop = Literal["encounter_over", "horizon"]
"""Why a run without a verdict was stopped."""
_FAILURES = ("collision", "off_road", "infeasible")
"""Outcomes of runs that are judged by the reference drivers."""
_WITH_NEARNESS = ("safe", "failed_unavoidably")
"""Outcomes that a search scores by how near other road users came."""


@dataclass(frozen=True)
class _Point:
    """An edited scenario, its file if there is one, and the edits that prescribe each road user's motion.

    ``is_cut``: whether simulated motions end with the horizon.
    """

    loaded: LoadedScenario
    manoeuvres: Mapping[int, str]
    infeasible: tuple[int, ...]
    path: Path | None = None
    is_cut: bool = False


@dataclass(frozen=True)
class Nearness:
    """How near other road users came to the ego: gaps (n,) in m, times to collision (n,) in s, the ego's speeds (n,).

    ``others``: the road users; ``other`` (n,): the index of the road user that each value belongs to.
    """

    others: tuple[Track, ...]
    other: NDArray[np.intp]
    gaps_m: Values
    times_s: Values
    speeds_mps: Values

    @classmethod
    def of(cls, met: Encounters, others: tuple[Track, ...]) -> "Nearness":
        """Return the gaps and times of a drive's encounters."""
        return cls(others, met.track, gaps_m(met), times_to_collision_s(met.ego, met.other), met.ego.speeds_mps)

    def least_s(self, counts: Callable[[Track], bool]) -> tuple[float, float] | None:
        """Return the smallest gap in time and time to collision, in s, to road users that count while the ego moves.

        The gap in time is the gap divided by the ego's speed. Return None if no such road user came near.
        """
        own = np.isin(self.other, [index for index, track in enumerate(self.others) if counts(track)])
        own &= self.speeds_mps >= STANDING_MPS
        if not own.any():
            return None
        return float((self.gaps_m[own] / self.speeds_mps[own]).min()), float(self.times_s[own].min())


@dataclass(frozen=True)
class DrivenPoint:
    """How the planner fares at a point, with its run; None if there was no run.

    ``nearness``: of a run without a failure, or with an unavoidable one, in which other road users came near.
    ``demand``: whether the planner has to react and could, as in ``PointScore``.
    """

    evaluation: Evaluation
    run: DrivenRun | None = None
    nearness: Nearness | None = None
    demand: float | None = None


class Evaluator:
    """Evaluates points of one base and one planner. Use it in a ``with`` block.

    Args:
        setting: the data that all points share.
        drives: receives the configuration's planner and returns the planner to run instead; by default, the
            configuration's planner runs.
        drive: the planner's drive through the unchanged base. With it, points say whether the planner has to react.

    Raises:
        InvalidRequest: the prediction does not fit the traffic or the world, or the planner does not fit the world.
        UnknownName: there is no such planner.
    """

    def __init__(
        self,
        setting: EncounterSetting,
        drives: Callable[[Planner], Planner] | None = None,
        drive: BaseDrive | None = None,
    ) -> None:
        check_modes(setting.traffic, setting.prediction, setting.world)
        check_world(setting.configuration.planner, setting.world)
        self._setting, self._drives, self._drive = setting, drives, drive
        self._reads_file = needs_file(setting.configuration.planner)

    def __enter__(self) -> "Evaluator":
        """Read the base."""
        setting = self._setting
        with ExitStack() as stack:
            self._folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            base = EditableScenario(setting.xml, setting.problem_id, setting.seed, _needed_s(setting))
            self._base = stack.enter_context(base)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Release the base."""
        self._stack.close()

    def evaluate(self, edits: Sequence[Edit]) -> Evaluation:
        """Apply edits to the base, after those that it already has, and return how the planner fares in the result.

        Raises:
            PlannerFailure: a user-supplied planner broke its contract.
            WorkerFailure: SUMO stopped.
        """
        return self.driven(edits).evaluation

    def driven(self, edits: Sequence[Edit], *, screens: bool = False) -> DrivenPoint:
        """Return the same evaluation as ``evaluate``, together with the run.

        ``screens``: run the planner only if it has to react and could, as far as this is known before the run.

        Raises:
            PlannerFailure: a user-supplied planner broke its contract.
            WorkerFailure: SUMO stopped.
        """
        point = self._point(edits)
        if isinstance(point, str):
            return _implausible(point)
        demand, run, stopped = self._run(point, screens=screens)
        if run is None:
            return DrivenPoint(Evaluation(outcome="safe", reason=_NO_DEMAND, end="not_run"), demand=demand)
        if point.is_cut and run.verdict is not None and run.verdict.outcome in _FAILURES:
            # Failures count as they are if the simulated vehicles drive up to the end of the recording.
            whole = self._point(edits, whole=True)
            if isinstance(whole, str):
                return _implausible(whole)
            if self._setting.traffic == "reactive" or not _move_alike(point, whole):
                demand, again, stopped = self._run(whole, screens=False)
                run = again or run
            point = whole
        judged = _Judged(self._setting, point, *self._problem(point.loaded), run)
        evaluation = judged.evaluation(stopped)
        near = judged.nearness if evaluation.outcome in _WITH_NEARNESS else None
        return DrivenPoint(evaluation, run, near, demand)

    def edited(self, edits: Sequence[Edit]) -> LoadedScenario | None:
        """Return the base after edits, or None if they are implausible; nothing is run."""
        point = self._point(edits)
        return None if isinstance(point, str) else point.loaded

    def _point(self, edits: Sequence[Edit], *, whole: bool = False) -> "_Point | str":
        """Return the base after edits, or why they are implausible; ``whole`` as in ``EditableScenario.edited``."""
        earlier = self._setting.earlier
        try:
            point = self._edited((*earlier, *(edit.numbered_after(len(earlier)) for edit in edits)), whole=whole)
        except InvalidRequest as refusal:
            return refusal.message
        if infeasible := [key for key in point.infeasible if not self._is_accepted(key, edits)]:
            return f"no vehicle of its class can drive the motion of {', '.join(map(str, infeasible))}"
        return point

    def _is_accepted(self, key: int, edits: Sequence[Edit]) -> bool:
        """Return whether a road user's infeasible motion is that of the base, which was stored with a warning."""
        if not edits:
            return True
        return key in self._infeasible_in_base and not any(str(key) in edit.vehicles for edit in edits)

    @cached_property
    def _infeasible_in_base(self) -> frozenset[int]:
        """The road users whose motion in the base is infeasible, because earlier edits prescribe it."""
        earlier = self._setting.earlier
        return frozenset(self._edited(earlier, whole=True).infeasible) if earlier else frozenset()

    def _edited(self, edits: tuple[Edit, ...], *, whole: bool) -> _Point:
        if not self._reads_file:
            try:
                edited = self._base.edited(edits, whole=whole)
            except NeedsFile:
                return self._written(edits)
            simulated = edited.simulated
            done = ((edit.op, step.vehicles) for edit, step in zip(simulated.edits, simulated.steps, strict=True))
            return _Point(edited.loaded, _manoeuvres(done), edited.infeasible, is_cut=edited.is_cut)
        return self._written(edits)

    def _written(self, edits: tuple[Edit, ...]) -> _Point:
        """Apply edits by writing files, for edits and planners that need them."""
        setting = self._setting
        if not edits:
            return _Point(self._base.loaded, {}, (), setting.xml)
        request = ModificationRequest(
            xml=setting.xml,
            edits=edits,
            benchmark_id=self._base.loaded.benchmark_id,
            output=self._folder,
            problem_id=setting.problem_id,
            on_conflict="refuse",
            seed=setting.seed,
        )
        outcome = apply_edits(request, silent)
        path = outcome.xml or setting.xml
        infeasible = tuple(one.vehicle_id for one in outcome.touched if not one.feasible)
        done = ((report.op, report.vehicles) for report in outcome.edits)
        return _Point(kept_recording(path, keep=False).loaded, _manoeuvres(done), infeasible, path)

    def _problem(self, loaded: LoadedScenario) -> "tuple[PlanningProblem, VehicleParameters]":
        setting = self._setting
        problem = loaded.problem(setting.problem_id)
        vehicle = vehicle_of(setting.configuration.settings, loaded.ego_class(int(problem.planning_problem_id)))
        return problem, vehicle.on_road(loaded.friction)

    def _run(self, point: _Point, *, screens: bool) -> "tuple[float | None, DrivenRun | None, _Stop]":
        """Return the demand of a point, its run unless screening makes it needless, and why the run was stopped."""
        setting, loaded = self._setting, point.loaded
        problem, vehicle = self._problem(loaded)
        file = None if point.path is None else ScenarioFile(point.path, loaded.benchmark_id)
        ending = _Ending(round(setting.horizon_s / loaded.step_s), loaded.step_s)
        with (
            ended_after(make_planner(setting.configuration.planner, file)) as own,
            open_traffic(setting.traffic, loaded, problem, vehicle, setting.seed) as traffic,
        ):
            # Traffic that reacts has no motion before the run.
            demand = None
            if self._drive is not None and setting.traffic == "recorded":
                lane = lane_line(loaded.scenario, problem, vehicle, loaded.made)
                demand = _demand(self._drive, traffic.moving, traffic.standing, loaded, lane)
                if screens and demand < 1.0:
                    return demand, None, "horizon"
            run = simulate(
                loaded.scenario,
                problem,
                setting.configuration,
                own if self._drives is None else self._drives(own),
                setting.prediction,
                silent,
                traffic,
                vehicle,
                world=setting.world,
                seed=setting.seed,
                is_over=ending.is_over,
                made=loaded.made if is_built_in(setting.configuration.planner) else None,
            )
        return demand, run, "encounter_over" if ending.by_encounter else "horizon"


def _needed_s(setting: EncounterSetting) -> float:
    """Return how long after the ego's start the motion of vehicles that edits simulate can matter before the horizon.

    A planner may know the others' future. In reactive traffic, a vehicle's motion says where it goes (half of the
    horizon is chosen in addition).
    """
    if setting.traffic == "reactive":
        return 1.5 * setting.horizon_s
    foreseen_s = setting.configuration.settings.horizon_s if setting.prediction == "ground_truth" else 0.0
    return setting.horizon_s + foreseen_s


def _implausible(reason: str) -> DrivenPoint:
    return DrivenPoint(Evaluation(outcome="implausible", reason=reason, end="not_run"))


def _move_alike(point: _Point, other: _Point) -> bool:
    """Return True if each road user of two points moves alike until the first of its two motions ends."""
    tracks, others = point.loaded.tracks, other.loaded.tracks
    return tracks.keys() == others.keys() and all(_is_beginning(track, others[key]) for key, track in tracks.items())


def _is_beginning(track: Track, other: Track) -> bool:
    """Return True if a motion equals the beginning of another, or the other equals its beginning."""
    if track is other:
        return True
    count = min(len(track.positions), len(other.positions))
    return (
        track.first_step == other.first_step
        and np.array_equal(track.positions[:count], other.positions[:count])
        and np.array_equal(track.headings_rad[:count], other.headings_rad[:count])
        and np.array_equal(track.speeds_mps[:count], other.speeds_mps[:count])
    )


def _manoeuvres(done: Iterable[tuple[EditOperation, Sequence[int]]]) -> dict[int, str]:
    """Return the operations that prescribe each road user's motion, as text; omit its addition if others follow."""
    found: dict[int, list[str]] = {}
    for op, vehicles in done:
        for key in vehicles:
            found.setdefault(key, []).append(op)
    return {
        key: "+".join(dict.fromkeys(ops[1:] if len(ops) > 1 and ops[0] == "add_vehicle" else ops))
        for key, ops in found.items()
    }


class _Ending:
    """Decides when a run is stopped: after the horizon, or once the encounter is over."""

    def __init__(self, steps: int, step_s: float) -> None:
        self.by_horizon = self.by_encounter = False
        self._steps, self._every = steps, max(round(_LOOKED_AT_S / step_s), 1)
        self._needed = math.ceil(_OVER_S / _LOOKED_AT_S)
        self._seen = 0

    def is_over(self, run: DrivenRun) -> bool:
        """Return True if the run may stop."""
        driven = len(run.states) - 1
        self.by_horizon = driven >= self._steps
        if not self.by_horizon and driven % self._every == 0:
            self._seen = self._seen + 1 if self._all_apart(run) else 0
            self.by_encounter = self._seen > self._needed
        return self.by_horizon or self.by_encounter

    def _all_apart(self, run: DrivenRun) -> bool:
        ego, length_m = run.states[-1], _length_m(run)
        if not (run.traffic.moving or run.traffic.standing):
            return False
        if run.traffic.triggers and any(one.code == "trigger_not_fired" for one in run.traffic.triggers):
            return False
        if any(track.first_step > ego.step for track in run.traffic.moving):
            return False
        return all(_is_apart(track, ego, length_m) for track in run.traffic.moving) and all(
            _is_passed(track.positions[0], track, ego, length_m) or ego.speed_mps < STANDING_MPS
            for track in run.traffic.standing
        )


def _length_m(run: DrivenRun) -> float:
    return 5.0 if run.task is None else run.task.vehicle.length_m


def _is_apart(track: Track, ego: EgoState, length_m: float) -> bool:
    """Return True if a road user is gone, is behind the ego and never faster, or stands while the ego stands."""
    at = track.index_at(ego.step)
    if at is None:
        return True
    fastest = float(track.speeds_mps[at:].max())
    if fastest < STANDING_MPS and ego.speed_mps < STANDING_MPS:
        return True
    return fastest <= ego.speed_mps and _is_passed(track.positions[at], track, ego, length_m)


def _is_passed(position: "np.ndarray", track: Track, ego: EgoState, length_m: float) -> bool:
    away = position - ego.position
    ahead_m = float(away[0]) * math.cos(ego.heading_rad) + float(away[1]) * math.sin(ego.heading_rad)
    return ahead_m < -(length_m / 2 + math.hypot(*track.size_m) / 2 + _BEHIND_M)


@dataclass(frozen=True)
class _Judged:
    """A run at a point, judged by the reference drivers."""

    setting: EncounterSetting
    point: _Point
    problem: "PlanningProblem"
    vehicle: VehicleParameters
    run: DrivenRun

    def evaluation(self, stopped: _Stop) -> Evaluation:
        """Return how the planner fared; ``stopped``: why a run without a verdict ended."""
        verdict = self.run.verdict
        if verdict is not None and verdict.outcome == "invalid":
            contact = verdict.invalid_reason == "initial_collision"
            return Evaluation(
                outcome="implausible" if contact else "invalid",
                reason=verdict.reason,
                run_outcome="invalid",
                end="not_run",
            )
        if verdict is None:
            return self._nearest().model_copy(update={"end": stopped, "reason": _STOPPED[stopped]})
        ended = {"run_outcome": verdict.outcome, "reason": verdict.reason}
        if verdict.outcome == "collision" and (hit := self._contact()) is not None:
            return self._after_contact(self._safe.model_copy(update=ended), hit)
        found = self._nearest().model_copy(update=ended)
        if verdict.outcome == "collision":
            return found.model_copy(update={"outcome": "failed_unavoidably"})
        if verdict.outcome in ("off_road", "infeasible"):
            return self._after_failure(found)
        return found

    @property
    def _step_s(self) -> float:
        return self.point.loaded.step_s

    @property
    def _lane(self) -> Points | None:
        return lane_line(self.point.loaded.scenario, self.problem, self.vehicle, self.point.loaded.made)

    @property
    def _safe(self) -> Evaluation:
        return Evaluation(outcome="safe", reason="", steps=len(self.run.states) - 1)

    @cached_property
    def _met(self) -> Encounters:
        traffic = self.run.traffic
        return encounters(driven_ego(self.run.states, self.vehicle), traffic.moving, traffic.standing)

    @cached_property
    def nearness(self) -> Nearness | None:
        """How near other road users came, or None if the ego met no road user."""
        traffic, met = self.run.traffic, self._met
        return Nearness.of(met, (*traffic.moving, *traffic.standing)) if len(met.state) else None

    def _nearest(self) -> Evaluation:
        """Return the smallest gap and time to collision of a run without a failure."""
        near, met = self.nearness, self._met
        if near is None:
            return self._safe
        gaps, times = near.gaps_m, near.times_s
        nearest, soonest = int(np.argmin(np.round(gaps, 9))), float(times.min())
        other = near.others[int(near.other[nearest])]
        return self._safe.model_copy(
            update={
                "counterpart_id": other.obstacle_id,
                "counterpart_class": other.kind,
                "manoeuvre": self.point.manoeuvres.get(other.obstacle_id, _RECORDED),
                "least_gap_m": float(gaps[nearest]),
                "least_time_to_collision_s": soonest if math.isfinite(soonest) else None,
                "ego_speed_mps": float(met.ego.speeds_mps[nearest]),
                "other_speed_mps": float(met.other.speeds_mps[nearest]),
            }
        )

    def _after_failure(self, found: Evaluation) -> Evaluation:
        """Evaluate a run that left the road or had no trajectory: avoidable if a reference driver hits nothing."""
        ego, loaded = driven_ego(self.run.states, self.vehicle), self.point.loaded
        others = (*self.run.traffic.moving, *static_tracks(loaded.scenario, ego.last_step).values())
        drivers = drivers_that_avoid(ego, others, self._lane, self._step_s, loaded.friction)
        return found.model_copy(
            update={
                "outcome": "failed_avoidably" if drivers else "failed_unavoidably",
                "time_s": round((len(self.run.states) - 1) * self._step_s, 9),
                "prevented_by": tuple(AvoidingDriver(driver=name, start="start") for name in drivers),
            }
        )

    def _after_contact(self, found: Evaluation, contact: Contact) -> Evaluation:
        """Evaluate a collision: its contact, and the verdicts of the reference drivers."""
        key = contact.obstacle_id
        return found.model_copy(
            update={
                "outcome": "failed_avoidably" if _is_avoidable(contact) else "failed_unavoidably",
                "time_s": contact.time_s,
                "counterpart_id": key,
                "counterpart_class": contact.obstacle_class,
                "manoeuvre": "" if key is None else self.point.manoeuvres.get(key, _RECORDED),
                "contact": contact.kind,
                "ego_side": contact.ego_side,
                "other_side": contact.other_side,
                "ego_speed_mps": contact.ego_speed_mps,
                "other_speed_mps": contact.other_speed_mps,
                "cause": contact.laid_to,
                "least_gap_m": 0.0,
                "least_time_to_collision_s": 0.0,
                "prevented_by": _preventing(contact),
            }
        )

    def _contact(self) -> Contact | None:
        """Explain the collision, from the same data as the review of a stored run."""
        loaded, setting, steps = self.point.loaded, self.setting, run_steps(self.run)
        record = self._record()
        last = steps.first_step + len(steps.x_m)
        tracks = static_tracks(loaded.scenario, last) | loaded.tracks | driven_tracks(steps)
        predict = predictor(setting.prediction, loaded.scenario.lanelet_network)
        return contact_in(record, steps, tracks, predict, self._lane)

    def _record(self) -> RunRecord:
        """Return a record of the run with the fields that the review of a collision needs."""
        setting, verdict = self.setting, self.run.final
        return RunRecord(
            run_id="",
            scenario_id="",
            problem_id=int(self.problem.planning_problem_id),
            config_id=setting.configuration.config_id,
            config_name=setting.configuration.name,
            planner=setting.configuration.planner,
            prediction=setting.prediction,
            traffic=setting.traffic,
            seed=setting.seed,
            world=setting.world,
            step_s=self._step_s,
            outcome=verdict.outcome,
            reason=verdict.reason,
            collision=verdict.collision,
            rejected_candidates={},
            metrics=None,
            ego_length_m=self.vehicle.length_m,
            ego_width_m=self.vehicle.width_m,
            ego_class=self.vehicle.vehicle_class,
            friction=self.vehicle.friction,
            uses_prediction=uses_prediction(setting.configuration.planner),
        )


def _demand(
    drive: BaseDrive, moving: Sequence[Track], standing: Sequence[Track], loaded: LoadedScenario, lane: Points | None
) -> float:
    """Return 0 if a drive hits no road user, 0.5 if it does and no careful driver would avoid that, otherwise 1."""
    ego, others = _track(drive), [*moving, *standing]
    met = encounters(ego, moving, standing)
    touching = np.flatnonzero(gaps_m(met) <= 0.0) if len(met.state) else np.zeros(0, dtype=int)
    if not len(touching):
        return 0.0
    hit = others[int(met.track[touching[int(np.argmin(met.state[touching]))]])].obstacle_id
    known = {track.obstacle_id: track for track in moving} | static_tracks(loaded.scenario, ego.last_step)
    first = known.pop(hit)
    path = None if lane is None else loaded.made.get(("path", id(lane)), partial(DriverPath.along, lane), lane)
    drivers = drivers_that_avoid(ego, (first, *known.values()), path, loaded.step_s, loaded.friction)
    return 1.0 if drivers else HOPELESS


def _track(drive: BaseDrive) -> Track:
    states = np.array(drive.states)
    return Track(
        obstacle_id=-1,
        kind="car",
        length_m=drive.length_m,
        width_m=drive.width_m,
        first_step=drive.first_step,
        positions=states[:, :2],
        headings_rad=states[:, 2],
        speeds_mps=states[:, 3],
    )


_STOPPED = {
    "encounter_over": "the encounter is over: all others are gone, passed, or stand",
    "horizon": "nothing happened up to the horizon",
}
"""Reasons of runs that were stopped."""


def _preventing(contact: Contact) -> tuple[AvoidingDriver, ...]:
    verdicts = () if contact.prevention is None else contact.prevention.drivers
    return tuple(
        AvoidingDriver(driver=one.driver, start=one.start)
        for one in verdicts
        if one.prevents and one.driver != "evading"
    )


def _is_avoidable(contact: Contact) -> bool:
    """Return True if UN R157's careful or fuzzy driver prevents a collision.

    If the ego cut in, a driver that takes over on the ego's own path has no time left to react. Only drivers that keep
    the ego's original lane are therefore considered.
    """
    if contact.prevention is None or (contact.kind in _INTO_EGO and contact.ego_side == "rear"):
        return False
    if contact.kind == "cut_in_by_ego":
        return any(contact.prevention.prevented_by(name, "start") for name in CAREFUL_DRIVERS)
    return contact.prevention.attributable
