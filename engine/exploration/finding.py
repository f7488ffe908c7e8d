"""The operations of a search for failures: derive a space, propose points, evaluate them, reduce a failure.

A search looks first for an attributable failure, that is, a failure that a careful or fuzzy driver avoids. Without one,
it looks for the smallest margin to the counterpart: the mean of the gap in time and the time to collision, each divided
by a value that counts as safe. The gap in time is the gap divided by the ego's speed: an ego that has stopped in front
of a road user is near it, but has done nothing wrong.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...schemas.errors import InvalidRequest
from ...schemas.exploration import Evaluation, LogicalScenario
from ...schemas.failures import (
    BaseDrive,
    EvaluatedPoint,
    EvaluatedPoints,
    FailureCell,
    PointScore,
    ProposalsRequest,
    ProposedPoints,
    SearchSpace,
    ShrinkRequest,
    Shrunk,
    SpacePoint,
    SpacePointsRequest,
    SpaceRequest,
    SpeedBand,
)
from ...schemas.modification import Edit
from ..commonroad import LoadedScenario
from ..execution import ProgressReporter
from ..planners import DrivenRun, EgoState, lane_line
from ..scene import Scene, goal_centers
from ..vehicles import VehicleParameters, vehicle_of
from .concrete import concrete_edits
from .evaluation import HOPELESS, DrivenPoint, Evaluator, Nearness
from .search import FailureSearch, Point, Score, Stratum
from .shrinking import Trials, minimal_subset, nearest_values, smallest
from .spaces import NominalMotion, SpaceBuilder, is_feasible, values_at

SAFE_GAP_S, SAFE_TTC_S = 2.0, 5.0
"""Larger gaps in time and times to collision are not critical: UN R157's driver sees danger in a time headway below
2 s. Critical times to collision are below 3 s (5 s is chosen)."""
UNAVOIDABLE = 0.5
"""The smallest score of a failure that no careful driver avoids (chosen): a milder point next to it may be avoidable.

If the ego is far from the stratum's own road user, the score is that margin: a car that runs into a braking ego from
behind says nothing about the encounter that is sought."""
_FASTEST_MPS = 30.0
SLOW_MPS, FAST_MPS = 3.0, 10.0
"""Bounds of the speed bands: walking pace, and an urban street's speed (chosen)."""
_AFTER_S = 0.5
"""A reduced failure ends this long after its failure."""
_ROOM_M = 10.0
"""A reduced map extends this much beyond the ego's start and its goal (chosen: more than half of a truck's length)."""


@dataclass(frozen=True)
class _Candidate:
    """A reduced failure: the recorded road users that it keeps without needing them, its values, map and time.

    ``area_m``: length and width of the part of the map around the ego's start; ``duration_s``: the end of its time.
    None means that nothing is cut.
    """

    kept: tuple[int, ...]
    values: tuple[float, ...]
    area_m: tuple[float, float] | None = None
    duration_s: float | None = None


def open_space(request: SpaceRequest, report: ProgressReporter) -> SearchSpace:
    """Run the planner in the unchanged base, and derive the search space from this run.

    If the planner fails in the base, there are no strata.
    """
    setting = request.setting
    with Evaluator(setting) as evaluator:
        report(0.0, "the planner drives in the unchanged base")
        first = evaluator.driven(())
        base, run = first.evaluation, first.run
        loaded = evaluator.edited(())
        if base.outcome != "safe" or run is None or loaded is None:
            return SearchSpace(base=base)
        scene = Scene.of(loaded, setting.problem_id)
        vehicle = vehicle_of(setting.configuration.settings, scene.ego.vehicle_class if scene.ego else "car")
        lane = lane_line(loaded.scenario, loaded.problem(setting.problem_id), vehicle)
        nominal = _nominal(run, scene.step_s).until(setting.horizon_s, lane)
        strata = SpaceBuilder(scene, nominal, request.base_id, setting.horizon_s).strata()
        feasible = []
        for number, stratum in enumerate(strata):
            if is_feasible(stratum, evaluator):
                feasible.append(stratum)
            report(
                (number + 1) / len(strata),
                f"{number + 1} of {len(strata)} manoeuvres checked for feasibility, the last: {stratum.summary}",
            )
    recorded = tuple(sorted({*loaded.tracks, *scene.standing}))
    return SearchSpace(base=base, strata=tuple(feasible), recorded=recorded, drive=_drive(nominal, vehicle))


def _drive(nominal: NominalMotion, vehicle: VehicleParameters) -> BaseDrive:
    states = np.column_stack([nominal.positions, nominal.headings_rad, nominal.speeds_mps]).round(4).tolist()
    return BaseDrive(
        first_step=nominal.first_step,
        states=tuple((x, y, heading, speed) for x, y, heading, speed in states),
        length_m=vehicle.length_m,
        width_m=vehicle.width_m,
    )


def _nominal(run: DrivenRun, step_s: float) -> NominalMotion:
    states = run.states
    return NominalMotion(
        np.array([state.position for state in states]),
        np.array([state.heading_rad for state in states]),
        np.array([state.speed_mps for state in states]),
        states[0].step,
        step_s,
    )


def propose_points(request: ProposalsRequest, report: ProgressReporter) -> ProposedPoints:
    """Return the next points of a search after the given scores, which are those of whole batches."""
    report(0.0, "choosing the next points")
    strata = [Stratum(name, dimensions) for name, dimensions in request.strata]
    scores = [
        Score(score.value, None if score.cell is None else score.cell.key, score.demand) for score in request.scores
    ]
    points = FailureSearch(strata, request.seed).resumed(scores).ask()
    return ProposedPoints(points=tuple(_asked(one) for one in points))


def _asked(point: Point) -> SpacePoint:
    return SpacePoint(stratum=point.stratum, shares=point.values, screened=point.way == "demand")


def evaluate_in_space(request: SpacePointsRequest, report: ProgressReporter) -> EvaluatedPoints:
    """Return how the planner fares at points."""
    strata = {stratum.name: stratum for stratum in request.strata}
    done = []
    with Evaluator(request.setting, drive=request.drive) as evaluator:
        for number, point in enumerate(request.points):
            done.append(evaluated(evaluator, strata[point.stratum], point, request.recorded))
            report((number + 1) / len(request.points), strata[point.stratum].summary)
    return EvaluatedPoints(points=tuple(done))


def evaluated(
    evaluator: Evaluator, stratum: LogicalScenario, point: SpacePoint, recorded: Sequence[int]
) -> EvaluatedPoint:
    """Evaluate the planner at a point of a stratum, and return the result with the point's score."""
    try:
        edits = concrete_edits(stratum, values_at(stratum, point.shares))
    except InvalidRequest as refusal:
        refused = Evaluation(outcome="implausible", reason=refusal.message, end="not_run")
        return EvaluatedPoint(point=point, evaluation=refused, score=PointScore(value=None))
    driven = evaluator.driven(edits, screens=point.screened)
    score = scored(stratum, driven, recorded)
    score = score.model_copy(update={"demand": driven.demand})
    return EvaluatedPoint(point=point, edits=edits, evaluation=driven.evaluation, score=score)


def scored(stratum: LogicalScenario, driven: DrivenPoint, recorded: Sequence[int]) -> PointScore:
    """Return the score of a point."""
    evaluation = driven.evaluation
    if driven.run is None or not evaluation.counts_as_run:
        return PointScore(value=None)
    if evaluation.outcome == "failed_avoidably":
        speed = evaluation.ego_speed_mps or 0.0
        return PointScore(value=round(-1.0 - speed / _FASTEST_MPS, 4), cell=cell_of(stratum, evaluation, recorded))
    margin = round(_margin(driven.nearness, lambda key: _is_own(stratum, key, recorded)), 4)
    if evaluation.outcome == "failed_unavoidably" or driven.demand == HOPELESS:
        return PointScore(value=max(margin, UNAVOIDABLE))
    return PointScore(value=margin)


def _margin(near: Nearness | None, counts: Callable[[int], bool]) -> float:
    """Return the smallest margin between the moving ego and some road users: 0 at contact, 1 if no one comes near."""
    least_s = None if near is None else near.least_s(lambda track: counts(track.obstacle_id))
    if least_s is None:
        return 1.0
    gap, soonest = min(least_s[0], SAFE_GAP_S) / SAFE_GAP_S, least_s[1]
    return (gap + (min(soonest, SAFE_TTC_S) / SAFE_TTC_S if math.isfinite(soonest) else 1.0)) / 2.0


def _is_own(stratum: LogicalScenario, obstacle_id: int, recorded: Sequence[int]) -> bool:
    """Return True if a road user is the counterpart of a stratum: an added one, or one that its edits refer to."""
    return obstacle_id not in recorded or obstacle_id in named_vehicles_of(stratum)


def named_vehicles_of(stratum: LogicalScenario) -> frozenset[int]:
    """Return the recorded road users that a stratum's edits refer to."""
    words = [word for edit in stratum.edits for word in edit.get("vehicles", ())]
    return frozenset(int(word) for word in words if str(word).isdigit())


def cell_of(stratum: LogicalScenario, evaluation: Evaluation, recorded: Sequence[int]) -> FailureCell:
    """Return the cell of a failure: counterpart and manoeuvre, contact, speed band and cause."""
    key = evaluation.counterpart_id
    if key is None:
        who = "no one"
    elif _is_own(stratum, key, recorded):
        who = stratum.name
    else:
        who = f"{evaluation.counterpart_class} {key} as recorded"
    return FailureCell(
        counterpart=who,
        contact=evaluation.contact or evaluation.run_outcome or "failure",
        speed=speed_band(evaluation.ego_speed_mps),
        cause=evaluation.cause or "",
    )


def speed_band(speed_mps: float | None) -> SpeedBand:
    """Return the band of the ego's speed at a failure."""
    if speed_mps is None:
        return "any"
    return "slow" if speed_mps < SLOW_MPS else "middle" if speed_mps < FAST_MPS else "fast"


def shrink_failure(request: ShrinkRequest, report: ProgressReporter) -> Shrunk:
    """Reduce a failure to a simpler scenario in which the planner fails in the same way.

    The reduced scenario has fewer road users, a smaller map, values nearer to the base, and a shorter time span. The
    time is cut last: before, it would keep values from moving to where the failure happens later.

    Raises:
        InvalidRequest: there is no failure at the point.
    """
    with Evaluator(request.setting) as evaluator:
        return shrunk(evaluator, request, report)


def shrunk(evaluator: Evaluator, request: ShrinkRequest, report: ProgressReporter) -> Shrunk:
    """Do the same as ``shrink_failure``, with an evaluator that is already open."""
    stratum = request.stratum
    values = tuple(round(one, 4) for one in values_at(stratum, request.point.shares).values())
    first = evaluator.evaluate(_edits(stratum, values))
    if not first.has_failed:
        raise InvalidRequest(
            f"there is no failure to reduce: {first.reason}", next_step="give a point at which the planner fails"
        )
    needed = {*named_vehicles_of(stratum), *([] if first.counterpart_id is None else [first.counterpart_id])}
    others = [key for key in request.recorded if key not in needed]
    ended_s: dict[_Candidate, float | None] = {}

    def remains(candidate: _Candidate) -> bool:
        try:
            edits = _reduced(stratum, request.recorded, needed, candidate)
        except InvalidRequest:
            return False
        again = evaluator.evaluate(edits)
        ended_s[candidate] = again.time_s
        return is_same_failure(first, again)

    trials: Trials[_Candidate] = Trials(remains, request.most_runs)
    report(0.1, "leaving out road users")
    subset = minimal_subset(others, lambda kept: trials(_Candidate(kept, values)))
    report(0.4, "cutting the map")
    found = _Candidate(subset.items, values)
    whole = evaluator.edited(())
    areas = [] if whole is None else _areas_m(whole, request.setting.problem_id)
    found = replace(found, area_m=smallest(areas, lambda area: trials(replace(found, area_m=area))))
    report(0.6, "moving parameters back")
    base = tuple(round(parameter.base_value, 4) for parameter in stratum.parameters)
    near = nearest_values(values, base, lambda tried: trials(replace(found, values=tried)))
    found = replace(found, values=near.values)
    failed_s = ended_s.get(found, first.time_s)
    if failed_s is not None:
        report(0.8, "cutting the time")
        until = round(failed_s + _AFTER_S, 2)
        found = replace(found, duration_s=smallest([until], lambda one: trials(replace(found, duration_s=one))))
    edits = _reduced(stratum, request.recorded, needed, found)
    evaluation = evaluator.evaluate(edits)
    small = whole if found.area_m is None else evaluator.edited(edits)
    added = sum(edit.op == "add_vehicle" for edit in edits)
    names = [parameter.name for parameter in stratum.parameters]
    return Shrunk(
        edits=edits,
        values=dict(zip(names, near.values, strict=True)),
        evaluation=evaluation,
        runs=trials.runs,
        road_users_before=len(request.recorded) + added,
        road_users=len(subset.items) + len(needed.intersection(request.recorded)) + added,
        kept=subset.items,
        needed=tuple(names[index] for index in near.changed),
        is_minimal=subset.is_minimal,
        lanelets_before=_lanelets(whole),
        lanelets=_lanelets(small),
        area_m=found.area_m,
        duration_s=found.duration_s,
    )


def _lanelets(loaded: LoadedScenario | None) -> int:
    return 0 if loaded is None else len(loaded.scenario.lanelet_network.lanelets)


def _areas_m(loaded: LoadedScenario, problem_id: int | None) -> list[tuple[float, float]]:
    """Return lengths and widths of areas around the ego's start, along its heading, each about half of the one before.

    The first is about half of the map. The last just contains the goal, without which no planner could start.
    """
    problem = loaded.problem(problem_id)
    ego, goals = EgoState.of(problem.initial_state), goal_centers(problem)
    lanelets = loaded.scenario.lanelet_network.lanelets
    far_m = float(np.abs(np.concatenate([one.polygon.vertices for one in lanelets]) - ego.position).max())
    away = np.array([ego.position, *goals]) - ego.position
    cos, sin = math.cos(ego.heading_rad), math.sin(ego.heading_rad)
    least = [2 * (math.ceil(float(np.abs(away @ axis).max())) + _ROOM_M) for axis in ((cos, sin), (-sin, cos))]
    areas: list[tuple[float, float]] = []
    while not areas or areas[-1] != (least[0], least[1]):
        far_m = float(math.ceil(far_m / 2)) if far_m > 1.0 else 0.0
        areas.append((max(2 * far_m, least[0]), max(2 * far_m, least[1])))
    return areas


def _edits(stratum: LogicalScenario, values: Sequence[float]) -> tuple[Edit, ...]:
    names = (parameter.name for parameter in stratum.parameters)
    return concrete_edits(stratum, dict(zip(names, values, strict=True)))


def _reduced(
    stratum: LogicalScenario, recorded: Sequence[int], needed: set[int], candidate: _Candidate
) -> tuple[Edit, ...]:
    """Return the edits for only some of the road users, with different values, and a smaller map and time."""
    removed = [str(key) for key in recorded if key not in candidate.kept and key not in needed]
    edits = [*_edits(stratum, candidate.values)]
    if removed:
        edits.append(Edit(op="remove_vehicle", vehicles=removed))
    area_m, duration_s = candidate.area_m, candidate.duration_s
    if area_m is not None:
        edits.append(Edit(op="crop", at="ego", rectangle_m=[*area_m], duration_s=duration_s))
    elif duration_s is not None:
        edits.append(Edit(op="crop", duration_s=duration_s))
    return tuple(edits)


def is_same_failure(first: Evaluation, second: Evaluation) -> bool:
    """Return True if two failures have the same counterpart, contact, cause and verdict."""
    return all(
        getattr(first, name) == getattr(second, name)
        for name in ("outcome", "run_outcome", "counterpart_id", "contact", "cause")
    )
