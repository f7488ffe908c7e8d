"""Traffic rules as signal temporal logic over the steps of a run, graded: which ones a run broke, when and by how much.

The rules are formalised by Maierhofer and others from the German road traffic regulations (StVO) and the Vienna
convention: "Formalization of interstate traffic rules in temporal logic" (IV 2020, ``R_G…``) and "Formalization of
intersection traffic rules in temporal logic" (IV 2022, ``R_IN…``), and the solid line of the StVO. A rule yields a
signal for each road user, line or light that it concerns; the rule is broken if one of the signals is below zero.
Conditions are true or false, and the demand of a rule is graded in its own unit. ``docs/traffic_rules.md`` describes
each rule and which parts of its source are left out.

To add a rule, write a function ``(drive) -> signals``, and list it in ``TRAFFIC_RULES`` and in the docs.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...schemas.results import RuleShare
from ...schemas.reviews import RuleVerdict
from ...schemas.runs import RunRecord, drawn_place
from ..commonroad import kept_recording, signs_of
from ..geometry import Points, Values, arc_length, project_all
from ..vehicles import MONITOR_REACTION_S, STANDING_MPS
from .ruled_drive import Ahead, RuledDrive, YieldsBy
from .run_set import RunSet, tracks_in
from .temporal_logic import (
    always,
    conjunction,
    disjunction,
    historically,
    implies,
    negation,
    once,
    previously,
    since,
    truth,
)

MOST_RUNS = 200
"""Number of runs of a set that are examined (chosen): each reads its scenario, and an answer has 50 s."""
_OWN_BRAKING_MPS2, _LEAD_BRAKING_MPS2, _CUT_IN_S = 10.0, 10.5, 3.0
"""As in CommonRoad's own monitor of these rules: decelerations of the safe distance, and how long a cut-in excuses."""
_ABRUPT_MPS2 = 2.0
"""As in CommonRoad's own monitor: harder braking is abrupt, and so is braking harder than the vehicle ahead by this
much.
"""
_CRITICAL_S = 3.0
"""A collision on the present courses within this time is a compelling reason to brake (chosen)."""
_LEFT_BEFORE_S, _LEFT_AFTER_S = 1.0, 0.5
"""As in CommonRoad's own monitor: time kept clear before a vehicle with priority arrives, and after it has left."""
_STOP_S, _STOP_WITHIN_M = 3.0, 1.0
"""As in CommonRoad's own monitor: how long and how near to its line a stop sign requires standing."""


@dataclass(frozen=True)
class Signal:
    """A rule's robustness at each state of a run for one road user (``obstacle_id``) or object."""

    robustness: Values
    obstacle_id: int | None = None


@dataclass(frozen=True)
class TrafficRule:
    """A rule: its id and name, the unit of its degree, its source, and its formula."""

    rule: str
    name: str
    unit: str
    source: str
    formula: str
    signals: Callable[[RuledDrive], Iterator[Signal]]


# verdicts


def rule_verdicts(runs: RunSet, record: RunRecord) -> tuple[RuleVerdict, ...]:
    """Return the verdict of each traffic rule on a run; empty if its steps or its scenario are missing."""
    steps, path = runs.steps.get(record.run_id), runs.scenario_path(record)
    if steps is None or not steps.x_m or path is None or record.outcome == "invalid":
        return ()
    network = kept_recording(path).loaded.scenario.lanelet_network
    return judged_by_rules(RuledDrive.of(record, steps, tracks_in(runs, record, steps), network))


def judged_by_rules(drive: RuledDrive) -> tuple[RuleVerdict, ...]:
    """Return the verdict of each traffic rule on a drive, in the order of the registry."""
    return tuple(_verdict(rule, drive) for rule in TRAFFIC_RULES)


def rule_shares(runs: RunSet) -> tuple[RuleShare, ...]:
    """Return, by configuration and rule, how many of the runs to which the rule applied broke it.

    If there are more than 200 runs, only those of randomly drawn scenarios are examined, so that all configurations
    have the same scenarios.
    """
    by_scenario = list(runs.valid)
    if len(by_scenario) > MOST_RUNS:
        by_scenario.sort(key=lambda record: drawn_place(record.scenario_id))
    judged = [(record, rule_verdicts(runs, record)) for record in by_scenario[:MOST_RUNS]]
    shares: list[RuleShare] = []
    for config_id in dict.fromkeys(record.config_id for record, _ in judged):
        mine = [(record, verdicts) for record, verdicts in judged if record.config_id == config_id and verdicts]
        shares += (
            [
                _share(runs, [(record, verdicts[number]) for record, verdicts in mine])
                for number in range(len(TRAFFIC_RULES))
            ]
            if mine
            else []
        )
    return tuple(shares)


def _share(runs: RunSet, judged: Sequence[tuple[RunRecord, RuleVerdict]]) -> RuleShare:
    """Return the share of a configuration's runs that broke one rule."""
    applicable = [(record, verdict) for record, verdict in judged if verdict.robustness is not None]
    broken = sorted((-verdict.degree, record.run_id) for record, verdict in applicable if verdict.violated)
    run_ids = tuple(run_id for _, run_id in broken)
    record, rule = judged[0]
    return RuleShare(
        rule=rule.rule,
        name=rule.name,
        unit=rule.unit,
        config_id=record.config_id,
        config_name=record.config_name,
        violated=runs.rate((one for one, _ in applicable), lambda one: one.run_id in run_ids),
        worst=-broken[0][0] if broken else None,
        run_ids=run_ids,
    )


def _verdict(rule: TrafficRule, drive: RuledDrive) -> RuleVerdict:
    """Return the rule's lowest robustness and its step, and the first violation if there is one."""
    worst: tuple[float, int, Signal] | None = None
    first: int | None = None
    for signal in rule.signals(drive):
        at = int(signal.robustness.argmin())
        value = float(always(signal.robustness)[0])
        if math.isfinite(value) and (worst is None or value < worst[0]):
            worst = value, at, signal
        broken = np.flatnonzero(signal.robustness < -RuleVerdict.TOLERANCE)
        if len(broken):
            first = int(broken[0]) if first is None else min(first, int(broken[0]))
    head = {"rule": rule.rule, "name": rule.name, "unit": rule.unit}
    if worst is None:
        return RuleVerdict(**head, robustness=None)
    return RuleVerdict(
        **head,
        robustness=worst[0],
        time_s=round(worst[1] * drive.step_s, 9),
        first_s=None if first is None else round(first * drive.step_s, 9),
        obstacle_id=worst[2].obstacle_id,
    )


# the rules


def _safe_distance(drive: RuledDrive) -> Iterator[Signal]:
    for other in drive.near:
        ahead = other.is_ahead
        came_in = conjunction(truth(ahead), previously(truth(~ahead)), previously(truth(other.seen)))
        excused = once(came_in, 0, drive.steps(_CUT_IN_S))
        condition = conjunction(truth(ahead), negation(excused))
        yield Signal(implies(condition, _margin_m(drive, other)), other.obstacle_id)


def _margin_m(drive: RuledDrive, other: Ahead) -> Values:
    """Return how much farther ahead a road user is than the distance that the ego needs to stop behind it."""
    own = drive.ego.speeds_mps
    safe = own * MONITOR_REACTION_S + own**2 / (2 * _OWN_BRAKING_MPS2) - other.speed_mps**2 / (2 * _LEAD_BRAKING_MPS2)
    return np.where(other.is_ahead, other.gap_m - np.maximum(safe, 0.0), np.inf)


def _unnecessary_braking(drive: RuledDrive) -> Iterator[Signal]:
    own = drive.acceleration_mps2
    reasons = [truth(other.collision_s < _CRITICAL_S) for other in drive.near]
    for number, other in enumerate(drive.near):
        precedes = truth(other.is_ahead & (drive.nearest_ahead == number))
        brakes_too = truth(own - other.acceleration_mps2 > -_ABRUPT_MPS2)
        reasons.append(conjunction(precedes, disjunction(truth(_margin_m(drive, other) < 0), brakes_too)))
    stopping = drive.ego.speeds_mps * MONITOR_REACTION_S + drive.ego.speeds_mps**2 / (2 * _ABRUPT_MPS2)
    for line in drive.lines:
        for light in drive.lights_for(line):
            stops = ~drive.shown(light, ("GREEN", "INACTIVE"))
            reasons.append(truth(stops & (line.before_m >= -_STOP_WITHIN_M) & (line.before_m < stopping)))
    compelling = disjunction(*reasons) if reasons else truth(np.zeros(drive.count, dtype=bool))
    gentle = own + _ABRUPT_MPS2
    gentle[:1] = np.inf  # the planner does not decide how the run began
    yield Signal(disjunction(gentle, compelling))


def _speed_limit(drive: RuledDrive) -> Iterator[Signal]:
    limits = {keys: drive.roads.limit_mps(keys) for keys in set(drive.lanelets)}
    posted = np.array([limits[keys] for keys in drive.lanelets])
    yield Signal(np.where(np.isfinite(posted), posted - drive.ego.speeds_mps, np.inf))


def _solid_line(drive: RuledDrive) -> Iterator[Signal]:
    keys = {key for under in drive.lanelets for key in under}
    bounds = {key: drive.roads.solid_bounds(key) for key in sorted(keys)}
    if not any(bounds.values()):
        return
    corners = np.array([drive.ego.corners_at(index) for index in range(drive.count)])
    clear = {key: _clearance_m(bounds[key], corners) for key in bounds}
    every = [[clear[key][index] for key in under] for index, under in enumerate(drive.lanelets)]
    yield Signal(np.array([max(values, default=math.inf) for values in every]))


def _clearance_m(bounds: Sequence[tuple[Points, float]], corners: Points) -> Values:
    """Return how far inside a lanelet's solid bounds the body is at each state, negative if over a bound; (n,).

    Corners that do not project onto a segment of a bound are ahead of it or behind it, on another lanelet.
    """
    count = len(corners)
    least = np.full(count, np.inf)
    for line, sign in bounds:
        stations, offsets = project_all(line, corners.reshape(-1, 2))
        level = (stations > 1e-6) & (stations < arc_length(line)[-1] - 1e-6)
        inside = np.where(level, sign * offsets, np.inf).reshape(count, -1)
        least = np.minimum(least, inside.min(axis=1))
    return least


def _red_light(drive: RuledDrive) -> Iterator[Signal]:
    for line in drive.lines:
        for light in drive.lights_for(line):
            red = truth(drive.shown(light, ("RED", "RED_YELLOW")))
            turns_red = conjunction(red, negation(previously(red)))
            passed_before = since(red, conjunction(turns_red, truth(line.before_m < 0)))
            yield Signal(implies(conjunction(red, negation(passed_before)), line.before_m))


def _stop_sign(drive: RuledDrive) -> Iterator[Signal]:
    for line in drive.lines:
        names = {
            element.traffic_sign_element_id.name
            for sign in signs_of(drive.network, [line.lanelet.lanelet_id])
            for element in sign.traffic_sign_elements
        }
        if "STOP" not in names or drive.lights_of([line.lanelet.lanelet_id]):
            continue
        before = truth((line.before_m >= 0) & (line.before_m <= _STOP_WITHIN_M))
        stands = conjunction(before, STANDING_MPS - drive.ego.speeds_mps)
        stood = once(_holds_for(stands, drive.steps(_STOP_S)))
        passes = conjunction(previously(truth(line.before_m >= 0)), truth(line.before_m < 0))
        demand = np.where(np.isfinite(stood), stood, STANDING_MPS - drive.ego.speeds_mps)
        yield Signal(implies(passes, demand))


def _holds_for(signal: Values, steps: int) -> Values:
    """Return whether the signal held for the last ``steps`` steps; false until that many steps have passed."""
    return np.where(np.arange(len(signal)) >= steps, historically(signal, 0, steps), -np.inf)


def _yielding(by: YieldsBy) -> Callable[[RuledDrive], Iterator[Signal]]:
    def signals(drive: RuledDrive) -> Iterator[Signal]:
        for one in drive.conflicts:
            if one.by == by:
                clear = conjunction(one.until_s - _LEFT_BEFORE_S, one.since_s - _LEFT_AFTER_S)
                yield Signal(implies(truth(one.is_there), clear), one.obstacle_id)

    return signals


_INTERSTATE, _CROSSINGS = "Maierhofer et al. 2020", "Maierhofer et al. 2022"
_CLEAR = "always (in the area where both paths overlap → the other is not there within 1 s, nor was 0.5 s before)"
TRAFFIC_RULES: tuple[TrafficRule, ...] = (
    TrafficRule(
        "R_G1",
        "safe distance",
        "m",
        f"{_INTERSTATE}; StVO § 4(1)",
        "always (another is ahead on the ego's path, and did not cut in within 3 s → the gap is at least the safe one)",
        _safe_distance,
    ),
    TrafficRule(
        "R_G2",
        "no unnecessary braking",
        "m/s²",
        f"{_INTERSTATE}; StVO § 4(1)",
        "always (braking is at most 2 m/s², or there is a compelling reason)",
        _unnecessary_braking,
    ),
    TrafficRule(
        "R_G3",
        "speed limit",
        "m/s",
        f"{_INTERSTATE}; StVO § 3(3), sign 274",
        "always (the speed is at most the limit posted for the ego's lane)",
        _speed_limit,
    ),
    TrafficRule(
        "R_L1",
        "solid line",
        "m",
        "StVO annex 2, signs 295 and 296",
        "always (the body is on the inner side of the solid bounds of its lane)",
        _solid_line,
    ),
    TrafficRule(
        "R_IN1",
        "stop sign",
        "m/s",
        f"{_CROSSINGS}; StVO annex 2, sign 206",
        "always (passes the line of a stop sign → once, for 3 s, it stood within 1 m before it)",
        _stop_sign,
    ),
    TrafficRule(
        "R_IN2",
        "red light",
        "m",
        f"{_CROSSINGS}; StVO § 37(2)",
        "always (red, and the front had not passed the line when it turned red → the front is before the line)",
        _red_light,
    ),
    TrafficRule(
        "R_IN3", "priority to the right", "s", f"{_CROSSINGS}; StVO § 8(1)", _CLEAR, _yielding("right before left")
    ),
    TrafficRule("R_IN4", "priority by signs", "s", f"{_CROSSINGS}; StVO § 8(1)", _CLEAR, _yielding("signs")),
    TrafficRule(
        "R_IN5", "left turn across oncoming traffic", "s", f"{_CROSSINGS}; StVO § 9(3)", _CLEAR, _yielding("left turn")
    ),
)
"""The rules in display order."""
