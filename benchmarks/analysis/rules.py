"""Checks reported traffic rule violations, their degree and their start on synthetic drives.

The seed draws 12 drives of each of 15 kinds on a crossing built for them. The kinds are following, cut-ins, hard
braking with and without a reason, speeding, crossing a solid line, red and yellow lights, stop signs, and crossing
traffic (from the right, from the left, with signs, oncoming). The truth is arithmetic on the construction of each drive
and shares nothing with the product.

Keys:

- ``rules_right``: share of drives with their rule reported correctly: broken or kept, by how much (within 0.02 of its
  unit) and from which state on.
- ``rules_silent``: share of drives with no other rule reported as broken.
- ``rule_cases``: number of drives.
"""

import math
import random
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from commonroad.common.common_lanelet import LineMarking, StopLine
from commonroad.scenario.intersection import Intersection, IntersectionIncomingElement
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.traffic_light import (
    TrafficLight,
    TrafficLightCycle,
    TrafficLightCycleElement,
    TrafficLightState,
)
from commonroad.scenario.traffic_sign import TrafficSign, TrafficSignElement, TrafficSignIDGermany

from plannerforge.engine.analysis.ruled_drive import RuledDrive
from plannerforge.engine.analysis.traffic_rules import judged_by_rules
from plannerforge.engine.commonroad import Track

from ..harness import Figures, SeededBench, share

STEP_S, LENGTH_M, WIDTH_M, LANE_M = 0.1, 4.5, 1.8, 3.5
ALIKE = 0.02
EAST, CROSS, AWAY, NORTH, UP, FARTHER, WEST, BACK, HOME, LEFT = range(1, 11)
"""Lanelets: the ego's approach, crossing and exit; traffic from the right; oncoming traffic; a left turn."""
SOUTH, DOWN = 11, 12
"""Lanelets of traffic from the left."""
Signs = dict[int, TrafficSignIDGermany]


@dataclass(frozen=True)
class Motion:
    """A road user: x, y, heading and speed at every state."""

    x: Sequence[float]
    y: Sequence[float]
    heading: Sequence[float]
    speed: Sequence[float]


@dataclass(frozen=True)
class Case:
    """A drive about one rule: the truth is its robustness at every state, infinite if it does not apply."""

    rule: str
    ego: Motion
    truth: Sequence[float]
    others: tuple[Motion, ...] = ()
    limit_mps: float | None = None
    solid: bool = False
    lights: tuple[tuple[TrafficLightState, int], ...] = ()
    signs: tuple[tuple[int, TrafficSignIDGermany], ...] = ()


# the crossing


def _lanelet(
    number: int, center: Sequence[tuple[float, float]], before: Sequence[int], after: Sequence[int], solid: bool
) -> Lanelet:
    points = np.array(center, dtype=float)
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.column_stack([-along[:, 1], along[:, 0]]) * LANE_M / 2
    marking = LineMarking.SOLID if solid else LineMarking.DASHED
    return Lanelet(
        points + aside,
        points,
        points - aside,
        number,
        predecessor=list(before),
        successor=list(after),
        line_marking_left_vertices=marking,
        line_marking_right_vertices=LineMarking.DASHED,
    )


def _straight(start: tuple[float, float], end: tuple[float, float], count: int = 31) -> list[tuple[float, float]]:
    shares = [index / (count - 1) for index in range(count)]
    return [(start[0] + (end[0] - start[0]) * part, start[1] + (end[1] - start[1]) * part) for part in shares]


def crossing(case: Case) -> LaneletNetwork:
    """Return two crossing roads of two lanes each at the origin, with the lights, signs and lines of a case."""
    half = LANE_M / 2
    turn = [(-10 + (10 + half) * math.sin(a), 10 - (10 + half) * math.cos(a)) for a in np.linspace(0, math.pi / 2, 31)]
    network = LaneletNetwork()
    for lanelet in (
        _lanelet(EAST, _straight((-150, -half), (-10, -half)), [], [CROSS, LEFT], case.solid),
        _lanelet(CROSS, _straight((-10, -half), (10, -half)), [EAST], [AWAY], False),
        _lanelet(AWAY, _straight((10, -half), (250, -half)), [CROSS], [], False),
        _lanelet(NORTH, _straight((half, -150), (half, -10)), [], [UP], False),
        _lanelet(UP, _straight((half, -10), (half, 10)), [NORTH], [FARTHER], False),
        _lanelet(FARTHER, _straight((half, 10), (half, 250)), [UP, LEFT], [], False),
        _lanelet(WEST, _straight((150, half), (10, half)), [], [BACK], False),
        _lanelet(BACK, _straight((10, half), (-10, half)), [WEST], [HOME], False),
        _lanelet(HOME, _straight((-10, half), (-250, half)), [BACK], [], False),
        _lanelet(LEFT, turn, [EAST], [FARTHER], False),
        _lanelet(SOUTH, _straight((-half, 150), (-half, 10)), [], [DOWN], False),
        _lanelet(DOWN, _straight((-half, 10), (-half, -10)), [SOUTH], [], False),
    ):
        network.add_lanelet(lanelet)
    network.add_intersection(
        Intersection(
            100,
            [
                IntersectionIncomingElement(
                    101, {EAST}, successors_straight={CROSS}, successors_left={LEFT}, left_of=102
                ),
                IntersectionIncomingElement(102, {NORTH}, successors_straight={UP}, left_of=103),
                IntersectionIncomingElement(103, {WEST}, successors_straight={BACK}, left_of=104),
                IntersectionIncomingElement(104, {SOUTH}, successors_straight={DOWN}, left_of=101),
            ],
        )
    )
    where = np.array([-10.0, -LANE_M])
    if case.lights:
        elements = [TrafficLightCycleElement(state, steps) for state, steps in case.lights]
        network.add_traffic_light(TrafficLight(200, where, TrafficLightCycle(elements)), {EAST})
    limit = [(EAST, TrafficSignIDGermany.MAX_SPEED, [str(case.limit_mps)])] if case.limit_mps is not None else []
    for number, (lanelet, sign, values) in enumerate([*((at, kind, []) for at, kind in case.signs), *limit]):
        element = TrafficSignElement(sign, values)
        network.add_traffic_sign(TrafficSign(300 + number, [element], {lanelet}, where), {lanelet})
    ends = network.find_lanelet_by_id(EAST)
    ends.stop_line = StopLine(ends.left_vertices[-1], ends.right_vertices[-1], LineMarking.SOLID)
    return network


# motions


def moving(start: float, speeds: Sequence[float], place: Callable[[float], tuple[float, float, float]]) -> Motion:
    """Return a motion along a path from an arc length on, with a speed at every state; a place is x, y and heading."""
    stations = [start]
    for before, after in pairwise(speeds):
        stations.append(stations[-1] + (before + after) / 2 * STEP_S)
    poses = [place(station) for station in stations]
    return Motion([p[0] for p in poses], [p[1] for p in poses], [p[2] for p in poses], list(speeds))


def eastward(station: float) -> tuple[float, float, float]:
    """Return a place on the ego's path, which crosses the origin at arc length 0."""
    return station, -LANE_M / 2, 0.0


def northward(station: float) -> tuple[float, float, float]:
    """Return a place on the path of traffic from the right."""
    return LANE_M / 2, station, math.pi / 2


def westward(station: float) -> tuple[float, float, float]:
    """Return a place on the path of oncoming traffic."""
    return -station, LANE_M / 2, math.pi


def southward(station: float) -> tuple[float, float, float]:
    """Return a place on the path of traffic from the left."""
    return -LANE_M / 2, -station, -math.pi / 2


def turning_left(station: float) -> tuple[float, float, float]:
    """Return a place on the ego's path until 10 m before the origin, then a quarter circle to the left, then
    straight.
    """
    radius = 10 + LANE_M / 2
    if station <= -10:
        return eastward(station)
    angle = (station + 10) / radius
    if angle >= math.pi / 2:
        return LANE_M / 2, 10 + station + 10 - radius * math.pi / 2, math.pi / 2
    return -10 + radius * math.sin(angle), 10 - radius * math.cos(angle), angle


def even(speed: float, seconds: float) -> list[float]:
    """Return the same speed for a time."""
    return [speed] * (round(seconds / STEP_S) + 1)


def slowing(speed: float, seconds: float, begins: float, by: float) -> list[float]:
    """Return speeds that decrease evenly from a time on, down to a stop at most."""
    return [max(speed - by * max(step * STEP_S - begins, 0.0), 0.0) for step in range(round(seconds / STEP_S) + 1)]


# the drives


def drawn(choice: random.Random) -> Iterator[Case]:
    """Return one drive of each kind."""
    yield from _behind_another(choice)
    yield from _braking(choice)
    yield from _limits(choice)
    yield from _lights(choice)
    yield from _stops(choice)
    yield from _ways(choice)


def _safe_m(own: float, other: float) -> float:
    return max(0.4 * own + own**2 / 20 - other**2 / 21, 0.0)


def _behind_another(choice: random.Random) -> Iterator[Case]:
    own, other, seconds = choice.uniform(8, 20), choice.uniform(8, 20), choice.uniform(2, 4)
    gap = _safe_m(own, other) + choice.uniform(-4, 6)
    gap = max(gap, (own - other) * seconds + 1, 1.0)
    ego = moving(-120, even(own, seconds), eastward)
    leader = moving(-120 + gap + LENGTH_M, even(other, seconds), eastward)
    gaps = [b - a - LENGTH_M for a, b in zip(ego.x, leader.x, strict=True)]
    yield Case("R_G1", ego, [value - _safe_m(own, other) for value in gaps], (leader,))
    seconds, comes_s = 5.0, choice.uniform(0.5, 1.2)
    other = own + choice.uniform(0.0, 1.0)
    gap = choice.uniform(1.0, 5.0)
    ego = moving(-120, even(own, seconds), eastward)
    cutter = moving(-120 + gap + LENGTH_M, even(other, seconds), eastward)
    comes = math.ceil(comes_s / STEP_S)
    aside = [LANE_M / 2 if step < comes else -LANE_M / 2 for step in range(len(cutter.x))]
    margins = [b - a - LENGTH_M - _safe_m(own, other) for a, b in zip(ego.x, cutter.x, strict=True)]
    excused = range(comes + round(3 / STEP_S) + 1)
    truth = [math.inf if step in excused else value for step, value in enumerate(margins)]
    yield Case("R_G1", ego, truth, (Motion(cutter.x, aside, cutter.heading, cutter.speed),))


def _braking(choice: random.Random) -> Iterator[Case]:
    own, by, begins, seconds = choice.uniform(12, 20), choice.uniform(1, 6), choice.uniform(0.5, 1.0), 2.5
    ego = moving(-120, slowing(own, seconds, begins, by), eastward)
    graded = [math.inf, *((b - a) / STEP_S + 2 for a, b in pairwise(ego.speed))]
    yield Case("R_G2", ego, graded)
    gap = _safe_m(own, own) + 15 + choice.uniform(0, 5)
    leader = moving(-120 + gap + LENGTH_M, slowing(own, seconds, begins, by), eastward)
    yield Case("R_G2", ego, [math.inf] * len(graded), (leader,))
    own, by = choice.uniform(9, 12), choice.uniform(2.5, 4.0)
    ego = moving(-10 - LENGTH_M / 2 - own**2 / (2 * by) - 1.0, slowing(own, 2.0, 0.0, by), eastward)
    yield Case("R_G2", ego, [math.inf] * len(ego.x), lights=((TrafficLightState.RED, 400),))


def _limits(choice: random.Random) -> Iterator[Case]:
    own, limit = choice.uniform(8, 20), choice.uniform(8, 20)
    ego = moving(-140, even(own, 3.0), eastward)
    yield Case("R_G3", ego, [limit - own] * len(ego.x), limit_mps=limit)
    beside, begins = choice.uniform(0.0, 1.6), choice.uniform(0.5, 1.5)
    straight = moving(-140, even(choice.uniform(8, 15), 4.0), eastward)
    away = [beside * min(max(step * STEP_S - begins, 0.0) / 2.0, 1.0) for step in range(len(straight.x))]
    ego = Motion(straight.x, [-LANE_M / 2 + one for one in away], straight.heading, straight.speed)
    yield Case("R_L1", ego, [LANE_M / 2 - WIDTH_M / 2 - one for one in away], solid=True)


def _lights(choice: random.Random) -> Iterator[Case]:
    own, changes = choice.uniform(8, 14), choice.uniform(1.0, 4.0)
    ego = moving(-10 - LENGTH_M / 2 - own * choice.uniform(1.5, 3.0), even(own, 4.0), eastward)
    before = [-10 - (x + LENGTH_M / 2) for x in ego.x]
    at = max(round(changes / STEP_S), 1)
    passed = before[at] < 0 if at < len(before) else True
    truth = [math.inf if step < at or passed else value for step, value in enumerate(before)]
    cycle = ((TrafficLightState.GREEN, at), (TrafficLightState.RED, 400))
    yield Case("R_IN2", ego, truth, lights=cycle)
    yellow = ((TrafficLightState.YELLOW, 400), (TrafficLightState.RED, 10))
    yield Case("R_IN2", ego, [math.inf] * len(before), lights=yellow)


def _stops(choice: random.Random) -> Iterator[Case]:
    stands_s = choice.choice([0.0, 1.0, 4.0])
    own = choice.uniform(3, 6)
    start = -10 - LENGTH_M / 2 - 0.5 - own * 2
    if stands_s:
        speeds = [*even(own, 2.0), *even(0.0, stands_s)]
        speeds += [min(step * 0.2, own) for step in range(1, 30)]
    else:
        speeds = even(own, 4.0)
    ego = moving(start, speeds, eastward)
    fronts = [x + LENGTH_M / 2 for x in ego.x]
    truth = [math.inf] * len(fronts)
    passes = next(step for step, front in enumerate(fronts) if front > -10)
    near = [step for step in range(passes) if -11 <= fronts[step] <= -10]
    windows = [near[i : i + 31] for i in range(len(near) - 30)]
    truth[passes] = max(
        (min(0.1 - ego.speed[s] for s in window) for window in windows), default=0.1 - ego.speed[passes]
    )
    yield Case("R_IN1", ego, truth, signs=((EAST, TrafficSignIDGermany.STOP),))


def _ways(choice: random.Random) -> Iterator[Case]:
    yield_sign = ((EAST, TrafficSignIDGermany.YIELD), (SOUTH, TrafficSignIDGermany.PRIORITY))
    own_way = ((EAST, TrafficSignIDGermany.PRIORITY), (NORTH, TrafficSignIDGermany.YIELD))
    box = (0.0, LANE_M, -LANE_M, 0.0)
    left_box = (-LANE_M, 0.0, -LANE_M, 0.0)
    for rule, come, area, signs in (
        ("R_IN3", northward, box, ()),
        ("R_IN4", southward, left_box, yield_sign),
        ("", southward, left_box, ()),
        ("", northward, box, own_way),
    ):
        own, other = choice.uniform(6, 12), choice.uniform(6, 12)
        arrives, later = choice.uniform(2.0, 3.0), choice.uniform(-2.5, 2.5)
        ego = moving(-own * arrives, even(own, 6.0), eastward)
        crosses = moving(-other * max(arrives + later, 0.3), even(other, 6.0), come)
        kept = [math.inf] * len(ego.x) if not rule else _kept_clear(ego, crosses, area)
        yield Case(rule or "R_IN3", ego, kept, (crosses,), signs=signs)
    own, other = choice.uniform(5, 8), choice.uniform(6, 12)
    arrives, later = choice.uniform(2.5, 3.0), choice.uniform(-2.0, 3.0)
    ego = moving(-own * arrives, even(own, 6.0), turning_left)
    comes = moving(-other * max(arrives + later, 0.3), even(other, 6.0), westward)
    yield Case("R_IN5", ego, _kept_clear_turning(ego, comes), (comes,))


def _kept_clear(ego: Motion, other: Motion, area: tuple[float, float, float, float]) -> list[float]:
    """Return the clear seconds beyond the required ones, at the states with the ego in a rectangle."""
    return _clear(
        [_in_box(ego, i, area) for i in range(len(ego.x))], [_in_box(other, i, area) for i in range(len(other.x))]
    )


def _in_box(one: Motion, index: int, area: tuple[float, float, float, float]) -> bool:
    along_x = abs(math.cos(one.heading[index])) > 0.5
    long, wide = (LENGTH_M, WIDTH_M) if along_x else (WIDTH_M, LENGTH_M)
    x, y = one.x[index], one.y[index]
    return x - long / 2 <= area[1] and x + long / 2 >= area[0] and y - wide / 2 <= area[3] and y + wide / 2 >= area[2]


def _kept_clear_turning(ego: Motion, other: Motion) -> list[float]:
    """Return the same for a left turn: the arc of its lane overlaps the oncoming lane in a strip, sampled by points."""
    a, b = (part.ravel() for part in np.meshgrid(np.linspace(-0.5, 0.5, 91), np.linspace(-0.5, 0.5, 37)))

    def there(one: Motion, index: int) -> bool:
        cosine, sine = math.cos(one.heading[index]), math.sin(one.heading[index])
        x = one.x[index] + a * LENGTH_M * cosine - b * WIDTH_M * sine
        y = one.y[index] + a * LENGTH_M * sine + b * WIDTH_M * cosine
        away = np.hypot(x + 10, y - 10)
        in_turn = (away >= 10) & (away <= 10 + LANE_M) & (x >= -10) & (y <= 10)
        return bool((in_turn & (y >= 0) & (y <= LANE_M) & (x <= 10)).any())

    return _clear([there(ego, i) for i in range(len(ego.x))], [there(other, i) for i in range(len(other.x))])


def _clear(ours: Sequence[bool], theirs: Sequence[bool]) -> list[float]:
    truth = []
    for step, inside in enumerate(ours):
        after = min((other - step for other, there in enumerate(theirs) if there and other >= step), default=math.inf)
        before = min((step - other for other, there in enumerate(theirs) if there and other <= step), default=math.inf)
        truth.append(min(after * STEP_S - 1.0, before * STEP_S - 0.5) if inside else math.inf)
    return truth


# the judgement


def _track(motion: Motion, number: int) -> Track:
    return Track(
        obstacle_id=number,
        kind="car",
        length_m=LENGTH_M,
        width_m=WIDTH_M,
        first_step=0,
        positions=np.column_stack([motion.x, motion.y]),
        headings_rad=np.array(motion.heading, dtype=float),
        speeds_mps=np.array(motion.speed, dtype=float),
    )


def are_rules_reported(case: Case) -> tuple[bool, bool]:
    """Return whether the rule of a case is reported correctly, and whether no other rule is reported as broken."""
    ego = _track(case.ego, -1)
    felt = np.diff(ego.speeds_mps, prepend=ego.speeds_mps[:1]) / STEP_S
    others = {number + 1: _track(one, number + 1) for number, one in enumerate(case.others)}
    verdicts = {one.rule: one for one in judged_by_rules(RuledDrive(ego, felt, others, crossing(case), STEP_S))}
    verdict = verdicts[case.rule]
    least = min(case.truth)
    first = next((step for step, value in enumerate(case.truth) if value < -0.01), None)
    begins = None if verdict.first_s is None else round(verdict.first_s / STEP_S)
    if verdict.robustness is None or math.isinf(least):
        right = first is None and not verdict.violated
    else:
        right = abs(verdict.robustness - least) <= ALIKE and begins == first
    if not right:
        sys.stderr.write(f"{case.rule}: truth {least:.3f} from state {first} on, told {verdict}\n")
    silent = [one for one in verdicts.values() if one.violated and one.rule != case.rule and one.rule in _OTHER_RULES]
    for one in silent:
        sys.stderr.write(f"a drive about {case.rule} is told to break {one.in_words()}\n")
    return right, not silent


_OTHER_RULES = ("R_G3", "R_L1", "R_IN1", "R_IN2", "R_IN3", "R_IN4", "R_IN5")
"""Rules that a drive about another one cannot break: all but those about leaders and braking."""


def compared(seed: int, each: int) -> Figures:
    """Compare the given number of drives of each kind."""
    choice = random.Random(seed)  # noqa: S311 - reproducible, not secret
    told = [are_rules_reported(case) for _ in range(each) for case in drawn(choice)]
    return {
        "rules_right": share(right for right, _ in told),
        "rules_silent": share(silent for _, silent in told),
        "rule_cases": len(told),
    }


def measure(bench: SeededBench) -> Figures:
    """Measure the keys above on 12 drives of each kind, or the bench's limit."""
    return compared(bench.seed, bench.limit or 12)
