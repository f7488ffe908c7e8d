"""Checks that analyses find why egos stood and braked, on synthetic runs.

Each run is drawn at random on its own road, straight or curved, with a light, a crossing road, other road users and a
goal as its kind requires. The ego's speed over time and the reason for it are given in closed form, so the truth is
known by construction. This module shares no code with the product.

An ego stands at a light (red, turned green long ago, or always green), behind a vehicle (standing, or driven away), in
a queue, before a crossing vehicle, or in the goal before its time. It also stands without a vehicle ahead, on an empty
road, with an oncoming vehicle or one far ahead. It is late behind a slower vehicle or alone. An ego brakes for a
vehicle, a light, a crossing vehicle, a curve, or the goal's time. It also brakes without a reason, gently or hard, with
an empty road or a faster vehicle far ahead. It is hit from behind after either.

Keys:

- ``standing_right``: share of the runs of the first kinds with all stretches reported correctly: code, other road user,
  start within half a second. There must be no further stretch of standing or being held up, except held up by the same
  vehicle while stopping behind it.
- ``braking_right``: the same for the second kinds, and for runs that were hit also the attribution of the collision.
- ``standing_runs``, ``braking_runs``: their numbers.

Seed 19 was used during development; figures are reported for seed 20.
"""

import math
import random
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from commonroad.common.common_lanelet import LineMarking, StopLine
from commonroad.common.file_writer import CommonRoadFileWriter, OverwriteExistingFile
from commonroad.common.util import Interval
from commonroad.geometry.shape import Rectangle
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
from commonroad.scenario.intersection import Intersection, IntersectionIncomingElement
from commonroad.scenario.lanelet import Lanelet, LaneletType
from commonroad.scenario.scenario import Location, Scenario, ScenarioID
from commonroad.scenario.state import CustomState, InitialState
from commonroad.scenario.traffic_light import (
    TrafficLight,
    TrafficLightCycle,
    TrafficLightCycleElement,
    TrafficLightState,
)

from plannerforge.engine.analysis import analyse, review_runs
from plannerforge.engine.execution import silent
from plannerforge.schemas.measures import RunMetrics
from plannerforge.schemas.results import AnalyseRequest
from plannerforge.schemas.reviews import PaceMoment
from plannerforge.schemas.runs import (
    CollisionRecord,
    DrivenObstacle,
    ReviewRequest,
    RunRecord,
    RunSource,
    RunSteps,
    ScenarioSource,
)

from ..harness import Figures, SeededBench, share

EACH = 8
"""Runs of each kind."""
STEP_S, LENGTH_M, WIDTH_M, LANE_M = 0.1, 4.508, 1.61, 3.5
OTHER_M = 4.5
LINE_M, INSIDE_M, ROAD_M = 100.0, 20.0, 420.0
"""Positions of the stop line, the end of the crossing and the end of the road, which begins at −80 m."""
BEGIN_M = -80.0
WITHIN_S = 0.5
Speed = Callable[[float], float]
"""Speed in m/s over time in s."""


@dataclass(frozen=True)
class Other:
    """Another road user on the road or the crossing one: its start along its path, and its speed over time."""

    key: int
    begin_m: float
    speed: Speed
    way: str = "along"
    """``along``, ``oncoming`` or ``across``."""


@dataclass(frozen=True)
class Stretch:
    """An expected stretch: its code, when it begins (None if that does not matter), and the road user it concerns."""

    code: str
    since_s: float | None = None
    other: int | None = None


Lights = tuple[tuple[TrafficLightState, int], ...]
"""Colours with their durations in steps."""


@dataclass(frozen=True)
class Made:
    """A run: the speed of the ego, its surroundings, and the truth about it.

    ``lights``: colours with their durations in steps. ``curve``: curvature of the road in 1/m, with start and end.
    ``goal_m``, ``goal_steps``: position and time window of the goal. ``hit_by``: the road user that touches the ego at
    the end, and the attribution of the collision.
    """

    speed: Speed
    duration_s: float
    truth: tuple[Stretch, ...]
    others: tuple[Other, ...] = ()
    lights: Lights = ()
    curve: tuple[float, float, float] = (0.0, BEGIN_M, ROAD_M)
    goal_m: tuple[float, float] = (ROAD_M - 40.0, ROAD_M - 20.0)
    goal_steps: tuple[int, int] = (100, 200)
    late: bool = False
    finding: str = ""
    hit_by: tuple[int, str] | None = None


# speeds


def steady(speed: float) -> Speed:
    """Return a constant speed."""
    return lambda _: speed


def stopping(speed: float, begins: float, by: float) -> Speed:
    """Return a constant speed, then braking by so much to a stop."""
    return lambda t: max(speed - by * max(t - begins, 0.0), 0.0)


def slowing(speed: float, begins: float, by: float, to: float) -> Speed:
    """Return a constant speed, then braking by so much to a lower speed."""
    return lambda t: max(speed - by * max(t - begins, 0.0), to)


def starting(before: Speed, begins: float, by: float, to: float) -> Speed:
    """Return the given speed up to a time, and from then an acceleration from standstill to a speed."""
    return lambda t: before(t) if t < begins else min(by * (t - begins), to)


def stop_m(speed: float, begins: float, by: float) -> float:
    """Return the stopping distance."""
    return speed * begins + speed**2 / (2 * by)


def travelled(speed: Speed, until_s: float) -> list[float]:
    """Return stations at every step, by the speeds at both ends of each."""
    steps = round(until_s / STEP_S)
    speeds = [speed(index * STEP_S) for index in range(steps + 1)]
    stations = [0.0]
    for before, after in pairwise(speeds):
        stations.append(stations[-1] + (before + after) / 2 * STEP_S)
    return stations


RED, GREEN = TrafficLightState.RED, TrafficLightState.GREEN


def _approach(choice: random.Random, to_m: float) -> tuple[float, float, float, Speed]:
    """Return a speed profile that stops gently after so many metres, and when and how hard it brakes."""
    speed, by = choice.uniform(6, 11), choice.uniform(1.2, 1.9)
    begins = (to_m - speed**2 / (2 * by)) / speed
    return speed, begins, by, stopping(speed, begins, by)


def _curve(choice: random.Random) -> tuple[float, float, float]:
    return choice.choice((0.0, 1.0, -1.0)) * choice.uniform(1 / 500, 1 / 200), BEGIN_M, ROAD_M


def _front_at(line_m: float) -> float:
    """Return the arc length of the ego's centre if its front is at the given one."""
    return line_m - LENGTH_M / 2


def standing(choice: random.Random) -> Iterator[tuple[str, Made]]:
    """Yield one run of each kind of standing."""
    way = _curve(choice)
    short, stays = choice.uniform(0.5, 4.0), choice.uniform(6, 12)
    # at a red light, which turns green as the ego starts, or not at all
    speed, begins, by, stop = _approach(choice, _front_at(LINE_M) - short)
    stands = begins + speed / by
    goes = stands + stays
    lights = ((RED, round(goes / STEP_S)), (GREEN, 400))
    red = Stretch("stood_at_red", stands)
    yield "red", Made(starting(stop, goes + 0.8, 1.5, 9), goes + 8, (red,), lights=lights, curve=way)
    # after the light has turned green, and before one that is green all the time
    green = Stretch("stood_at_green", goes)
    yield "turned green", Made(stop, goes + stays, (red, green), lights=lights, curve=way)
    only = Stretch("stood_at_green", stands)
    oncoming = (Other(9, 300.0, steady(choice.uniform(6, 12)), "oncoming"),)
    yield "green", Made(stop, stands + stays, (only,), oncoming, lights=((GREEN, 900), (RED, 10)), curve=way)
    # behind one that stands, and one that has driven away
    gap = choice.uniform(1.0, 6.0)
    place = choice.uniform(50, 90)
    speed, begins, by, stop = _approach(choice, place - gap - (LENGTH_M + OTHER_M) / 2)
    stands = begins + speed / by
    behind = Stretch("stood_behind_vehicle", stands, 7)
    yield "leader", Made(stop, stands + stays, (behind,), (Other(7, place, steady(0.0)),), curve=way)
    leaves, pace = stands + choice.uniform(3, 6), choice.uniform(1.5, 2.5)
    drives = Other(7, place, starting(steady(0.0), leaves, pace, 12.0))
    gone = leaves + math.sqrt(2 * (12.5 - gap) / pace)
    yield (
        "leader gone",
        Made(stop, gone + stays, (behind, Stretch("stood_without_cause", gone)), (drives,), curve=way),
    )
    # in a queue
    spaced = choice.uniform(1.5, 4.0)
    queue = tuple(Other(7 + n, place + n * (OTHER_M + spaced), steady(0.0)) for n in range(choice.choice((2, 3))))
    queued = Stretch("stood_in_queue", stands, 7)
    yield "queue", Made(stop, stands + stays, (queued,), queue, curve=way)
    red_line = ((RED, 900), (GREEN, 10))
    first = Other(7, LINE_M - choice.uniform(0.5, 2.0) - OTHER_M / 2, steady(0.0))
    speed, begins, by, stop = _approach(choice, first.begin_m - gap - (LENGTH_M + OTHER_M) / 2)
    stands = begins + speed / by
    queued = Stretch("stood_in_queue", stands, 7)
    yield "queue at red", Made(stop, stands + stays, (queued,), (first,), lights=red_line, curve=way)
    # before one that crosses
    speed, begins, by, stop = _approach(choice, _front_at(LINE_M) - short)
    stands = begins + speed / by
    passes, theirs = stands + choice.uniform(3.0, 6.0), choice.uniform(6, 12)
    crosses = Other(7, -theirs * passes, steady(theirs), "across")
    gives = Stretch("stood_to_give_way", stands, 7)
    yield "gives way", Made(starting(stop, passes + 1.2, 1.5, 9), passes + 6, (gives,), (crosses,))
    # in the goal before its time
    goal = (place - 8.0, place + 8.0)
    speed, begins, by, stop = _approach(choice, place)
    stands = begins + speed / by
    until = round((stands + stays) / STEP_S)
    waits = Stretch("stood_in_goal", stands)
    yield ("goal", Made(stop, stands + stays - 0.5, (waits,), curve=way, goal_m=goal, goal_steps=(until, until + 20)))
    # behind no vehicle
    alone = Stretch("stood_without_cause", stands)
    yield "nobody", Made(stop, stands + stays, (alone,), curve=way)
    yield "nobody, oncoming", Made(stop, stands + stays, (alone,), oncoming, curve=way)
    far = (Other(7, place + choice.uniform(35, 60), steady(choice.choice((0.0, 8.0)))),)
    yield "nobody near", Made(stop, stands + stays, (alone,), far, curve=way)
    # late, behind a slower vehicle and by itself
    slow, headway = choice.uniform(3.5, 6.0), choice.uniform(1.2, 2.4)
    start = headway * slow + (LENGTH_M - OTHER_M) / 2

    def late(
        profile: Speed, duration_s: float, truth: tuple[Stretch, ...], others: tuple[Other, ...], named: str
    ) -> Made:
        """Return a run that misses its goal's time, and the finding that is to say why."""
        return Made(profile, duration_s, truth, others, (), way, (180.0, 200.0), (100, 150), late=True, finding=named)

    held = Stretch("held_up", 0.0, 7)
    leader = Other(7, max(start, OTHER_M + 2.0), steady(slow))
    yield "late behind", late(steady(slow), 22.0, (held,), (leader,), "held_up")
    ahead = Other(7, slow * choice.uniform(5.0, 8.0) + 2 * OTHER_M, steady(slow))
    yield "late alone", late(steady(slow), 22.0, (), (ahead,), "")
    yield "late standing", late(stop, stands + 25.0, (alone,), (), "stood_late")


def braking(choice: random.Random) -> Iterator[tuple[str, Made]]:
    """Yield one run of each kind of braking; goals require the ego's first speed or a higher one."""
    way = _curve(choice)
    speed, begins = choice.uniform(8, 13), choice.uniform(1.0, 2.5)
    hard, gentle = choice.uniform(6.0, 10.3), choice.uniform(2.4, 3.2)

    def soon(
        profile: Speed,
        duration_s: float,
        truth: Stretch,
        others: tuple[Other, ...] = (),
        lights: Lights = (),
        hit_by: tuple[int, str] | None = None,
    ) -> Made:
        """Return a run with a goal that does not require less than the initial speed."""
        goal: tuple[float, float] = (300.0, 320.0)
        return Made(profile, duration_s, (truth,), others, lights, way, goal, (80, 180), hit_by=hit_by)

    none = Stretch("braked_without_cause", begins)
    quick = slowing(speed, begins, hard, choice.uniform(0.5, 3.0))
    mild = slowing(speed, begins, gentle, choice.uniform(3.0, 5.0))
    yield "nothing, hard", soon(quick, begins + 5, none)
    yield "nothing, gently", soon(mild, begins + 5, none)
    far = Other(7, choice.uniform(50, 58), steady(speed + choice.uniform(1, 4)))
    yield "far ahead, hard", soon(quick, begins + 4, none, (far,))
    # for a vehicle: one that brakes, and one that is much slower
    braked = Stretch("braked_for_vehicle", begins, 7)
    gap = speed * choice.uniform(1.0, 1.6)
    brakes = Other(7, gap + (LENGTH_M + OTHER_M) / 2, slowing(speed, begins - 0.6, hard, 1.0))
    yield "leader brakes", soon(slowing(speed, begins, hard * 0.9, 1.0), begins + 4, braked, (brakes,))
    theirs = choice.uniform(1.0, 3.0)
    needs = (speed - theirs) ** 2 / (2 * 3.0)
    slower = Other(7, needs + 2 + (speed - theirs) * begins + (LENGTH_M + OTHER_M) / 2, steady(theirs))
    yield "slower leader", soon(slowing(speed, begins, 3.0, theirs), begins + 5, braked, (slower,))
    # for a light
    stop_by = choice.uniform(2.3, 3.2)
    at = _front_at(LINE_M) - choice.uniform(0.5, 2.5)
    late = (at - speed**2 / (2 * stop_by)) / speed
    red = Stretch("braked_for_light", late)
    stop = stopping(speed, late, stop_by)
    yield "light", soon(stop, late + speed / stop_by + 1, red, lights=((RED, 900), (GREEN, 10)))
    green = ((GREEN, 900), (RED, 10))
    yield ("green light", soon(stop, late + speed / stop_by + 1, Stretch("braked_without_cause", late), lights=green))
    # for one that crosses
    passes = late + speed / stop_by
    across = choice.uniform(6, 12)
    crosses = Other(7, -across * (passes + 0.5), steady(across), "across")
    gives = Stretch("braked_to_give_way", late, 7)
    yield "crossing", Made(stop, passes + 1, (gives,), (crosses,), goal_m=(300.0, 320.0), goal_steps=(80, 180))
    # for a curve
    radius = choice.uniform(12, 20)
    slow = math.sqrt(2.0 * radius)
    fast = choice.uniform(11, 14)
    before = (fast**2 - slow**2) / (2 * 2.6)
    at_s = (60.0 - before) / fast
    yield (
        "curve",
        Made(
            slowing(fast, at_s, 2.6, slow),
            at_s + (fast - slow) / 2.6 + 3,
            (Stretch("braked_for_curve", at_s),),
            curve=(1 / radius, 60.0, 60.0 + radius * math.pi / 2),
            goal_m=(140.0, 150.0),
            goal_steps=(60, 140),
        ),
    )
    # for the goal's time
    wait = slowing(speed, begins, gentle, 3.0)
    far_m = travelled(wait, 25.0)[-1]
    yield (
        "goal's time",
        Made(
            wait,
            begins + 6,
            (Stretch("braked_for_goal", begins),),
            curve=way,
            goal_m=(far_m - 8.0, far_m + 8.0),
            goal_steps=(240, 260),
        ),
    )
    # hit from behind after braking without and with a reason
    for name, around, truth, laid in (
        ("hit, nothing", (), none, "ego"),
        ("hit, leader", (brakes,), braked, "recording"),
    ):
        profile = slowing(speed, begins, hard * 0.9, 1.0)
        follower = Other(8, -speed * 0.9 - (LENGTH_M + OTHER_M) / 2, steady(speed))
        touch = _touch_s(profile, follower)
        if touch is not None:
            yield name, soon(profile, touch, truth, (*around, follower), hit_by=(8, laid))


def _touch_s(ego: Speed, follower: Other) -> float | None:
    """Return when a follower first touches an ego at a step, or None if it does not within 15 s."""
    own, theirs = travelled(ego, 15.0), travelled(follower.speed, 15.0)
    for index, (a, b) in enumerate(zip(own, theirs, strict=True)):
        if a - (follower.begin_m + b) <= (LENGTH_M + OTHER_M) / 2:
            return round(index * STEP_S, 9)
    return None


# the road


def _pose(curve: tuple[float, float, float], station: float, aside: float = 0.0) -> tuple[float, float, float]:
    """Return x, y and heading at a station and offset to the left of a road that is straight but for one curve."""
    bend, begins, ends = curve
    if bend == 0.0 or station <= begins:
        return station, aside, 0.0
    turned, beyond = bend * (min(station, ends) - begins), max(station - ends, 0.0)
    x = begins + math.sin(turned) / bend + beyond * math.cos(turned)
    y = (1 - math.cos(turned)) / bend + beyond * math.sin(turned)
    return x - aside * math.sin(turned), y + aside * math.cos(turned), math.remainder(turned, math.tau)


def _lanelet(
    key: int, centre: Sequence[tuple[float, float, float]], before: Sequence[int], after: Sequence[int]
) -> Lanelet:
    points = np.array([(x, y) for x, y, _ in centre])
    aside = np.array([(-math.sin(turn), math.cos(turn)) for _, _, turn in centre]) * LANE_M / 2
    return Lanelet(
        points + aside,
        points,
        points - aside,
        key,
        predecessor=list(before),
        successor=list(after),
        lanelet_type={LaneletType.URBAN},
    )


APPROACH, ACROSS, AWAY, ONCOMING, SIDE, OVER, BEYOND = range(1, 8)


def scenario_of(made: Made, name: str) -> tuple[Scenario, PlanningProblemSet]:
    """Return the road with its light, crossing and goal; the run's steps hold the other road users."""
    scenario = Scenario(STEP_S, ScenarioID.from_benchmark_id(name, "2020a"))

    def along(first: float, last: float, aside: float = 0.0) -> list[tuple[float, float, float]]:
        return [
            _pose(made.curve, float(s), aside) for s in np.linspace(first, last, max(round(abs(last - first) / 2), 2))
        ]

    lanelets = [
        _lanelet(APPROACH, along(BEGIN_M, LINE_M), [], [ACROSS]),
        _lanelet(ACROSS, along(LINE_M, LINE_M + INSIDE_M), [APPROACH], [AWAY]),
        _lanelet(AWAY, along(LINE_M + INSIDE_M, ROAD_M), [ACROSS], []),
    ]
    back = [_turned(pose) for pose in reversed(along(BEGIN_M, LINE_M, LANE_M))]
    lanelets.append(_lanelet(ONCOMING, back, [], []))
    has_crossing = any(other.way == "across" for other in made.others)
    if has_crossing:
        middle = LINE_M + INSIDE_M / 2
        for key, (low, high) in ((SIDE, (-150.0, -10.0)), (OVER, (-10.0, 10.0)), (BEYOND, (10.0, 150.0))):
            centre = [(middle, float(y), math.pi / 2) for y in np.linspace(low, high, 40)]
            lanelets.append(_lanelet(key, centre, [key - 1] if key != SIDE else [], [key + 1] if key != BEYOND else []))
    approach = lanelets[0]
    approach.stop_line = StopLine(approach.left_vertices[-1], approach.right_vertices[-1], LineMarking.SOLID)
    scenario.add_objects(lanelets)
    network = scenario.lanelet_network
    incomings = [IntersectionIncomingElement(101, {APPROACH}, successors_straight={ACROSS})]
    if has_crossing:
        incomings.append(IntersectionIncomingElement(102, {SIDE}, successors_straight={OVER}))
    network.add_intersection(Intersection(100, incomings))
    if made.lights:
        elements = [TrafficLightCycleElement(state, steps) for state, steps in made.lights]
        place = np.array(approach.right_vertices[-1])
        network.add_traffic_light(TrafficLight(200, place, TrafficLightCycle(elements)), {APPROACH})
    x, y, turn = _pose(made.curve, sum(made.goal_m) / 2)
    area = Rectangle(made.goal_m[1] - made.goal_m[0], LANE_M, np.array([x, y]), turn)
    goal = GoalRegion([CustomState(time_step=Interval(*made.goal_steps), position=area)])
    x, y, turn = _pose(made.curve, 0.0)
    start = InitialState(
        time_step=0,
        position=np.array([x, y]),
        orientation=turn,
        velocity=made.speed(0.0),
        acceleration=0.0,
        yaw_rate=0.0,
        slip_angle=0.0,
    )
    return scenario, PlanningProblemSet([PlanningProblem(1, start, goal)])


def _driven(made: Made, other: Other) -> DrivenObstacle:
    steps = round((made.duration_s + 8.0) / STEP_S)
    stations = [other.begin_m + station for station in travelled(other.speed, steps * STEP_S)]
    middle = LINE_M + INSIDE_M / 2
    poses = [
        (middle, station, math.pi / 2)
        if other.way == "across"
        else _turned(_pose(made.curve, 2 * other.begin_m - station, LANE_M))
        if other.way == "oncoming"
        else _pose(made.curve, station)
        for station in stations
    ]
    return DrivenObstacle(
        obstacle_id=other.key,
        kind="car",
        length_m=OTHER_M,
        width_m=1.8,
        first_step=0,
        x_m=tuple(x for x, _, _ in poses),
        y_m=tuple(y for _, y, _ in poses),
        heading_rad=tuple(turn for _, _, turn in poses),
        speed_mps=tuple(other.speed(index * STEP_S) for index in range(len(poses))),
    )


def _turned(pose: tuple[float, float, float]) -> tuple[float, float, float]:
    return pose[0], pose[1], pose[2] + math.pi


# the product's statements


@dataclass(frozen=True)
class Answer:
    """The product's statements about a run: its stretches, the attribution of its collision, and the names of its
    findings.
    """

    moments: tuple[PaceMoment, ...]
    laid_to: str | None
    findings: tuple[str, ...]


def asked(made: Made, folder: Path, number: int) -> Answer:
    """Write the run and its scenario, and ask."""
    name = f"ZAM_Made-{number}_1_T-1"
    scenario, problems = scenario_of(made, name)
    path, steps_path = folder / f"{name}.xml", folder / f"{name}.json"
    writer = CommonRoadFileWriter(scenario, problems, "bench", "bench", "bench", set(), Location())
    writer.write_to_file(str(path), OverwriteExistingFile.ALWAYS)
    stations = travelled(made.speed, made.duration_s)
    poses = [_pose(made.curve, station) for station in stations]
    speeds = [made.speed(index * STEP_S) for index in range(len(poses))]
    steps = RunSteps(
        first_step=0,
        x_m=tuple(x for x, _, _ in poses),
        y_m=tuple(y for _, y, _ in poses),
        heading_rad=tuple(turn for _, _, turn in poses),
        speed_mps=tuple(speeds),
        acceleration_mps2=(0.0, *((b - a) / STEP_S for a, b in pairwise(speeds))),
        plan_steps=(),
        costs={},
        others=tuple(_driven(made, other) for other in made.others),
    )
    steps_path.write_text(steps.model_dump_json(), encoding="utf-8")
    record = _record(made, name, stations[-1])
    runs = (RunSource(record=record, steps_path=str(steps_path)),)
    scenarios = (ScenarioSource(scenario_id=name, path=str(path)),)
    review = review_runs(ReviewRequest(runs=runs, scenarios=scenarios), silent).reviews[0]
    findings: tuple[str, ...] = ()
    if made.late:
        request = AnalyseRequest(results=(record.run_id,), runs=runs, scenarios=scenarios, detail="findings")
        findings = tuple(finding.name for finding in analyse(request, silent).findings)
    return Answer(review.pace, None if review.contact is None else review.contact.laid_to, findings)


def _record(made: Made, name: str, distance_m: float) -> RunRecord:
    hit = made.hit_by
    step = round(made.duration_s / STEP_S)
    return RunRecord(
        run_id=f"run_{name}",
        scenario_id=name,
        problem_id=1,
        config_id="cfg_made",
        config_name="made",
        planner="frenetix",
        prediction="constant_velocity",
        traffic="recorded",
        seed=0,
        step_s=STEP_S,
        outcome="collision" if hit else "timeout",
        reason="made",
        collision=CollisionRecord(obstacle_id=hit[0], kind="car", step=step, time_s=made.duration_s) if hit else None,
        rejected_candidates={},
        metrics=RunMetrics(
            duration_s=made.duration_s,
            distance_m=distance_m,
            mean_speed_mps=distance_m / made.duration_s,
            minimum_distance_m=0.0 if hit else 5.0,
            minimum_time_to_collision_s=None,
            maximum_jerk_mps3=0.0,
            mean_squared_jerk=0.0,
            maximum_lateral_acceleration_mps2=0.0,
            mean_total_cost=None,
        ),
        ego_length_m=LENGTH_M,
        ego_width_m=WIDTH_M,
    )


_LATE = ("held_up", "stood_late", "waited_late", "goal_out_of_reach")


def is_right(made: Made, answer: Answer, *, is_braking: bool) -> bool:
    """Return True if the reported stretches of one family match the construction of the run, in its order."""
    told = [one for one in answer.moments if one.code.startswith("braked") == is_braking]
    while len(told) > 1 and told[0].code == "held_up" and told[0].obstacle_id == told[1].obstacle_id:
        del told[0]
    if len(told) != len(made.truth):
        return False
    for one, truth in zip(told, made.truth, strict=True):
        late = truth.since_s is not None and abs(one.since_s - truth.since_s) > WITHIN_S
        if one.code != truth.code or late or (truth.other is not None and one.obstacle_id != truth.other):
            return False
    if made.hit_by is not None and answer.laid_to != made.hit_by[1]:
        return False
    named = [name for name in answer.findings if name in _LATE]
    return not made.late or named == ([made.finding] if made.finding else [])


def measure(bench: SeededBench) -> Figures:
    """Return the figures of the keys above, over eight runs of each kind or the bench's limit."""
    folder = bench.folder("standing")
    figures: dict[str, float | int | str] = {}
    number = 0
    for key, family in (("standing", standing), ("braking", braking)):
        choice = random.Random(f"{bench.seed} {key}")  # noqa: S311 - reproducible, not secret
        right = []
        for _ in range(bench.limit or EACH):
            for kind, made in family(choice):
                number += 1
                answer = asked(made, folder, number)
                right.append(is_right(made, answer, is_braking=key == "braking"))
                if not right[-1]:
                    told = [f"{one.code} {one.obstacle_id} {one.since_s}..{one.until_s}" for one in answer.moments]
                    sys.stderr.write(f"{kind}: made {made.truth}, {made.hit_by}, told {told}, {answer}\n")
        figures |= {f"{key}_right": share(right), f"{key}_runs": len(right)}
    return figures
