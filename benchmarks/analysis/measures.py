"""Checks the measures of a run against closed forms, and against CriMe on recorded traffic.

**Closed forms.** The seed draws encounters, turned and moved at random: a slower leader, a braking leader, a vehicle
that crosses at any angle, a collision, an ego that turns along a spiral, and one that jolts. Formulas of this module,
which shares no code with the product, check ``analyze_results`` with ``detail=measures`` on a run of each. The formulas
are closed, or try every start of a reaction in steps of 5 ms. A value agrees within 1 % or its resolution, if that is
larger (``RESOLUTION``: PET and ET 0.01 s, reaction times to a crossing vehicle 0.02 s). The other road user and the
time must also be right.

**CriMe** (Lin and Althoff 2023, ``commonroad-crime``) runs in its own environment (``crime_requirements.txt``), in the
folder that ``PLANNERFORGE_CRIME`` gives or a temporary one, created once. Recorded vehicles of each public file act as
the ego. CriMe measures the same time and road user that the product reports (``crime_driver.py``). A value agrees
within 1 % or half of CriMe's last digit. Comparisons are left out by conditions on the situation, never by the result,
and counted by class:

- ``not straight``: the lane, the ego or the other is turned by more than 1° against the lane at the ego, along which
  CriMe measures.
- ``leader brakes``: CriMe ignores the sign of the leader's acceleration.
- ``not on one lane``: CriMe needs both on one lanelet or on successive ones.
- ``not ahead there``: CriMe measures from the middle of the ego's lane and gives no value.

Keys:

- ``measures_agree``: share of all compared values that agree.
- ``closed_form_agree``, ``closed_form_values``: the same share and count for closed forms.
- ``crime_agree``, ``crime_values``, ``crime_files``, ``crime_not_compared``: the same for CriMe.

The share of each measure and each deviation go to standard error.
"""

import json
import math
import os
import random
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from commonroad.common.file_reader import CommonRoadFileReader
from commonroad.geometry.shape import Rectangle

from plannerforge.engine.analysis import analyse
from plannerforge.engine.execution import silent
from plannerforge.schemas.measures import MeasuredValue, RunMetrics
from plannerforge.schemas.results import AnalyseRequest
from plannerforge.schemas.runs import CollisionRecord, DrivenObstacle, RunRecord, RunSource, RunSteps

from ..harness import Figures, SeededBench, drawn, made_environment, scenario_files

STEP_S, FINE_S = 0.1, 0.005
LENGTH_M, WIDTH_M = 4.508, 1.61
BRAKING_MPS2 = ACROSS_MPS2 = 8.0
EXPOSED_S = 3.0
RESOLUTION = {
    "post_encroachment_time_s": 0.01,
    "encroachment_time_s": 0.01,
    "crossing time_to_brake_s": 0.02,
    "crossing time_to_react_s": 0.02,
}
"""Largest difference, in addition to 1 %, of values that the product searches on a grid of times."""
EACH = 40
"""Encounters of each kind."""
EGOS_A_FILE, FEWEST_STEPS = 3, 20
SHORT_M = 0.01
"""Length of the bodies for comparing worst times: we cover a body by three discs, CriMe uses the middle one."""
STRAIGHT_RAD = math.radians(1.0)
CRIME_DIGITS = {
    "leader_time_to_collision_s": 0.005,
    "deceleration_to_avoid_mps2": 0.005,
    "brake_threat_number": 0.005 / BRAKING_MPS2,
    "minimum_time_gap_s": 0.005,
    "minimum_distance_m": 0.005,
}
"""Half of CriMe's last digit; for the time gap, that of the gap in m."""
_REQUIREMENTS, _DRIVER = (Path(__file__).with_name(f"crime_{name}") for name in ("requirements.txt", "driver.py"))


@dataclass
class Tally:
    """Values that agree and that differ, by measure, and comparisons left out, by class."""

    agreeing: Counter[str] = field(default_factory=Counter)
    compared: Counter[str] = field(default_factory=Counter)
    left_out: Counter[str] = field(default_factory=Counter)
    deviations: list[str] = field(default_factory=list)

    def compare(self, name: str, told: float | None, truth: float, least: float, where: str) -> None:
        """Count a value; it agrees within 1 % or ``least``."""
        right = told is not None and abs(told - truth) <= max(0.01 * abs(truth), least, 1e-9)
        self.compared[name] += 1
        self.agreeing[name] += right
        if not right:
            self.deviations.append(f"{name}: told {told}, truth {truth:.6g} ({where})")

    @property
    def share(self) -> float:
        """The share that agrees; 0 without any."""
        return round(self.agreeing.total() / self.compared.total(), 4) if self.compared else 0.0

    def tell(self, title: str) -> None:
        """Print shares by measure, deviations and omissions to standard error."""
        for name, count in sorted(self.compared.items()):
            sys.stderr.write(f"{title}: {name} {self.agreeing[name]} of {count}\n")
        sys.stderr.writelines(f"{title}: {one}\n" for one in self.deviations)
        sys.stderr.writelines(f"{title}, not compared: {count} × {why}\n" for why, count in self.left_out.most_common())


def measure(bench: SeededBench) -> Figures:
    """Measure the keys above over 40 encounters of each kind and all files, or the bench's limit of both.

    Raises:
        LeftOut: CriMe's environment cannot be created here.
    """
    closed = closed_forms(bench.seed, bench.limit or EACH, bench.folder("measures"))
    closed.tell("closed form")
    crime, files = against_crime(bench)
    crime.tell("CriMe")
    compared = closed.compared.total() + crime.compared.total()
    return {
        "measures_agree": round((closed.agreeing.total() + crime.agreeing.total()) / max(compared, 1), 4),
        "closed_form_agree": closed.share,
        "closed_form_values": closed.compared.total(),
        "crime_agree": crime.share,
        "crime_values": crime.compared.total(),
        "crime_files": files,
        "crime_not_compared": crime.left_out.total(),
    }


# ---- closed forms


@dataclass(frozen=True)
class Moving:
    """A road user: x, y, heading and speed at each step from 0 on, and its size and class."""

    poses: tuple[tuple[float, float, float, float], ...]
    size_m: tuple[float, float] = (LENGTH_M, WIDTH_M)
    kind: str = "car"
    key: int = 7

    def moved(self, x: float, y: float, turn: float) -> "Moving":
        """Return the motion turned about the origin, then moved."""
        cosine, sine = math.cos(turn), math.sin(turn)
        poses = tuple(
            (x + px * cosine - py * sine, y + px * sine + py * cosine, heading + turn, speed)
            for px, py, heading, speed in self.poses
        )
        return Moving(poses, self.size_m, self.kind, self.key)


@dataclass(frozen=True)
class Made:
    """An encounter with its true values by measure, each with its time step (None if not required), and the other
    party.

    ``hit``: whether it ends in a collision; ``relation``: the other's relative position, if required.
    """

    name: str
    ego: Moving
    other: Moving
    truth: Mapping[str, float]
    step: int | None = None
    relation: str = ""
    hit: bool = False


def straight(x: float, y: float, heading: float, speed: float, steps: int, **changes: Any) -> Moving:
    """Return a straight motion at constant speed."""
    along = math.cos(heading), math.sin(heading)
    times = [step * STEP_S for step in range(steps)]
    return Moving(tuple((x + speed * t * along[0], y + speed * t * along[1], heading, speed) for t in times), **changes)


def closed_forms(seed: int, each: int, folder: Path) -> Tally:
    """Compare the product's values with the truth for all drawn encounters."""
    choice, tally = random.Random(seed), Tally()  # noqa: S311 - reproducible, not secret
    for make in (_following, _braking_leader, _crossing, _conflict, _crash, _spiral, _jolting):
        for _ in range(each):
            made = make(choice)
            place = choice.uniform(-500, 500), choice.uniform(-500, 500), choice.uniform(-math.pi, math.pi)
            told = reported_measures(made.ego.moved(*place), [made.other.moved(*place)], STEP_S, folder, hit=made.hit)
            for name, truth in made.truth.items():
                resolution = RESOLUTION.get(f"{made.name} {name}", RESOLUTION.get(name, 0.0))
                tally.compare(f"{made.name} {name}", told[name].value, truth, resolution, made.name)
            if made.step is not None:
                asked = [told[name] for name in made.truth if name != "risk_score"]  # it may be as low before
                moments = {(one.obstacle_id, one.relation, one.time_s) for one in asked}
                right = moments == {(made.other.key, made.relation, round(made.step * STEP_S, 9))}
                tally.compare(f"{made.name} partner and moment", float(right), 1.0, 0.0, f"{moments}")
    return tally


def reported_measures(
    ego: Moving, others: Sequence[Moving], step_s: float, folder: Path, *, hit: bool = False, first: Sequence[int] = ()
) -> dict[str, MeasuredValue]:
    """Return the product's statements about a run with these motions; ``first``: the others' first time steps."""
    x, y, heading, speed = (tuple(column) for column in zip(*ego.poses, strict=True))
    driven = tuple(
        DrivenObstacle(
            obstacle_id=other.key,
            kind=other.kind,
            length_m=other.size_m[0],
            width_m=other.size_m[1],
            first_step=begin,
            **{name: tuple(column) for name, column in zip(_COLUMNS, zip(*other.poses, strict=True), strict=True)},
        )
        for other, begin in zip(others, first or [0] * len(others), strict=True)
    )
    changes = np.gradient(speed, step_s) if len(speed) > 1 else [0.0]
    steps = RunSteps(
        first_step=0,
        x_m=x,
        y_m=y,
        heading_rad=heading,
        speed_mps=speed,
        acceleration_mps2=tuple(float(value) for value in changes),
        plan_steps=(),
        costs={},
        others=driven,
    )
    path, last = folder / "steps.json", len(x) - 1
    path.write_text(steps.model_dump_json(), encoding="utf-8")
    collision = CollisionRecord(obstacle_id=others[0].key, kind="car", step=last, time_s=last * step_s) if hit else None
    record = RunRecord(
        run_id="run_made",
        scenario_id="ZAM_Made-1_1_T-1",
        problem_id=1,
        config_id="cfg_made",
        config_name="made",
        planner="made",
        prediction="constant_velocity",
        traffic="recorded",
        seed=0,
        step_s=step_s,
        outcome="collision" if hit else "goal_reached",
        reason="made",
        collision=collision,
        rejected_candidates={},
        metrics=_NOTHING_STORED,
        ego_length_m=ego.size_m[0],
        ego_width_m=ego.size_m[1],
    )
    request = AnalyseRequest(
        results=("run_made",), runs=(RunSource(record=record, steps_path=str(path)),), detail="measures"
    )
    return {one.name: one for one in analyse(request, silent).measures}


_COLUMNS = ("x_m", "y_m", "heading_rad", "speed_mps")
_NOTHING: dict[str, Any] = dict.fromkeys(RunMetrics.model_fields)
_NOTHING_STORED = RunMetrics.model_construct(**_NOTHING)
"""Disables stored values, so that the analysis computes every value."""


def _following(choice: random.Random) -> Made:
    """Return a slower leader at constant speeds; the last step with the smallest gap is decisive."""
    steps, ego, slower = 11, choice.uniform(8, 30), choice.uniform(2, 6)
    aside, first = choice.uniform(-0.7, 0.7), choice.uniform(20, 45)
    length, width = choice.uniform(3.5, 12), choice.uniform(1.5, 2.4)
    other = straight(first, aside, 0.0, ego - slower, steps, size_m=(length, width))
    gap = first - (steps - 1) * STEP_S * slower - (LENGTH_M + length) / 2
    time, overlap = gap / slower, (WIDTH_M + width) / 2 - abs(aside)
    brake = max((gap - slower**2 / (2 * BRAKING_MPS2)) / slower, 0.0)
    radius = math.hypot(LENGTH_M / 6, WIDTH_M / 2) + math.hypot(length / 6, width / 2)

    def apart(t: float) -> float:
        ahead = first - (steps - 1) * STEP_S * slower - (LENGTH_M + length) / 3 - slower * t
        return math.hypot(ahead, aside) - radius - BRAKING_MPS2 * t**2

    truth = {
        "minimum_distance_m": gap,
        "minimum_time_to_collision_s": time,
        "leader_time_to_collision_s": time,
        "minimum_time_gap_s": gap / ego,
        "minimum_time_headway_s": (gap + length) / ego,
        "worst_time_to_collision_s": _root(apart, 0.0, time),
        "deceleration_to_avoid_mps2": slower**2 / (2 * gap),
        "brake_threat_number": slower**2 / (2 * gap) / BRAKING_MPS2,
        "steer_threat_number": 2 * overlap / time**2 / ACROSS_MPS2,
        "rss_margin_m": gap - max(ego * 0.75 + ego**2 / (2 * 4.0) - (ego - slower) ** 2 / (2 * 8.0), 0.0),
    }
    truth["risk_score"] = (sum(gap > at for at in _RISK) + sum(time > at for at in _RISK)) // 2
    if time <= 10.0:
        truth["time_to_brake_s"] = brake
        truth["time_to_react_s"] = max(brake, time - math.sqrt(2 * overlap / ACROSS_MPS2), 0.0)
    return Made("following", straight(0, 0, 0, ego, steps), other, truth, steps - 1, "ahead")


_RISK = (0.0, 0.5, 1.0, 3.0, 5.0)
"""Steps of the risk score, in m and in s."""


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Find the root of a falling function by bisection."""
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (middle, high) if function(middle) > 0 else (low, middle)
    return low


def _braking_leader(choice: random.Random) -> Made:
    """Return a leader that brakes from the ego's speed, with exposure summed and the largest threat over all steps."""
    steps, speed, by, gap = 21, choice.uniform(8, 25), choice.uniform(1, 6), choice.uniform(12, 30)
    times = [step * STEP_S for step in range(steps)]
    places = [(speed * min(t, speed / by) - by * min(t, speed / by) ** 2 / 2, max(speed - by * t, 0.0)) for t in times]
    other = Moving(tuple((gap + LENGTH_M + place, 0.0, 0.0, now) for place, now in places))
    slopes = [places[1][1] - places[0][1], *(b[1] - a[1] for a, b in zip(places, places[2:], strict=False))]
    slopes = [slope / (STEP_S if i == 0 else 2 * STEP_S) for i, slope in enumerate(slopes)]
    slopes.append((places[-1][1] - places[-2][1]) / STEP_S)
    threats, exposed, depth = [], 0.0, 0.0
    for t, (place, now), slope in zip(times, places, slopes, strict=True):
        left, closing = gap + place - speed * t, speed - now
        if left <= 0:
            continue
        time = left / closing if closing > 0 else math.inf
        if t > 0:  # a step counts by the state at its end
            exposed += STEP_S * (time <= EXPOSED_S)
            depth += STEP_S * max(EXPOSED_S - time, 0.0)
        threats.append(_needed(left, speed, now, slope))
    truth = {
        "time_exposed_s": exposed,
        "time_integrated_s2": depth,
        "brake_threat_number": min(max(threats) / BRAKING_MPS2, 5.0),
    }
    if any(gap + place - speed * t <= 0 for t, (place, _) in zip(times, places, strict=True)):
        return _braking_leader(choice)
    return Made("braking leader", straight(0, 0, 0, speed, steps), other, truth)


def _needed(gap: float, ego: float, leader: float, slope: float) -> float:
    """Find the smallest constant deceleration that stays clear of a leader with a constant one, by trying.

    The gap while both brake is smallest when both are equally fast, or when both stand.
    """

    def clear(braking: float) -> bool:
        def place(speed: float, by: float, t: float) -> float:
            t = min(t, speed / by) if by > 0 else t
            return speed * t - by * t**2 / 2

        ends = [ego / braking]
        if slope + braking > 0 and ego > leader:
            ends.append((ego - leader) / (slope + braking))
        if slope < 0:
            ends.append(leader / -slope)
        ends = [end for end in ends if end <= ego / braking + 1e-12]
        return all(gap + place(leader, -slope, end) - place(ego, braking, end) >= 0 for end in ends)

    if clear(1e-6):
        return 0.0
    low, high = 1e-6, 1e4
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (low, middle) if clear(middle) else (middle, high)
    return high


def _crossing(choice: random.Random) -> Made:
    """Return paths that cross at an angle; each is in the other's band as long as its corners are."""
    angle = choice.uniform(math.radians(55), math.radians(125)) * choice.choice((-1, 1))
    ego, other = choice.uniform(5, 15), choice.uniform(5, 15)
    length, width = choice.uniform(3.5, 8), choice.uniform(1.5, 2.4)
    sine, cosine = abs(math.sin(angle)), abs(math.cos(angle))
    own_m = (width + LENGTH_M * sine + WIDTH_M * cosine) / 2 / sine
    their_m = (WIDTH_M + length * sine + width * cosine) / 2 / sine
    begin_m, between = own_m + choice.uniform(8, 20), choice.uniform(0.4, 4)
    came, left = (begin_m - own_m) / ego, (begin_m + own_m) / ego
    if choice.random() < 0.5 and came - between - 2 * their_m / other > 0.2:
        comes, second = came - between - 2 * their_m / other, came
    else:
        comes = second = left + between
    away = comes * other + their_m
    steps = math.ceil(max(left, comes + 2 * their_m / other) / STEP_S) + 4
    along = math.cos(angle), math.sin(angle)
    met = straight(begin_m - away * along[0], -away * along[1], angle, other, steps, size_m=(length, width))
    truth = {"post_encroachment_time_s": between, "encroachment_time_s": left - came}
    del second
    return Made("crossing", straight(0, 0, 0, ego, steps), met, truth)


def _conflict(choice: random.Random) -> Made:
    """Return the remaining reaction times to a vehicle on a crossing collision course, by trying every start."""
    ego, other = choice.uniform(6, 16), choice.uniform(4, 12)
    side = choice.choice((-1.0, 1.0))
    met_m, late = choice.uniform(18, 35), choice.uniform(-0.25, 0.25)
    begin = met_m / ego * other + late * other
    steps = 2
    met = straight(met_m, -side * begin, side * math.pi / 2, other, steps)

    reach_x, reach_y = (LENGTH_M + WIDTH_M) / 2, (WIDTH_M + LENGTH_M) / 2
    coming = np.arange(0.0, 20.0, FINE_S)
    both = (np.abs(ego * coming - met_m) < reach_x) & (np.abs(other * coming - begin) < reach_y)
    if not both.any():
        return _conflict(choice)
    meets = float(coming[both.argmax()])
    t = np.arange(0.0, meets + 3.0, FINE_S)
    latest = {}
    for name, manoeuvre in _MANOEUVRES.items():
        latest[name] = 0.0
        for start in np.arange(meets, 0.0, -FINE_S):
            x, y = manoeuvre(ego, t, float(start))
            if not ((np.abs(x - met_m) < reach_x) & (np.abs(y - side * (other * t - begin)) < reach_y)).any():
                latest[name] = float(start)
                break
    later = max(latest.values())
    # The run has two states; the second one, a step later, leaves a step less.
    truth = {"time_to_brake_s": max(latest["brake"] - STEP_S, 0.0), "time_to_react_s": max(later - STEP_S, 0.0)}
    return Made("crossing", straight(0, 0, 0, ego, steps), met, truth)


_Places = tuple[Any, Any]
"""The ego's distance ahead and to the side, by times."""


def _brakes(speed: float, t: Any, begin: float) -> _Places:
    since = np.clip(t - begin, 0.0, speed / BRAKING_MPS2)
    return speed * np.minimum(t, begin) + speed * since - BRAKING_MPS2 / 2 * since**2, 0.0 * t


def _accelerates(speed: float, t: Any, begin: float) -> _Places:
    return speed * t + 11.5 * min(7.319 / speed, 1.0) / 2 * np.maximum(t - begin, 0.0) ** 2, 0.0 * t


def _swerves(to: float) -> Callable[[float, Any, float], _Places]:
    half = math.sqrt(3.5 / ACROSS_MPS2)

    def manoeuvre(speed: float, t: Any, begin: float) -> _Places:
        since = np.clip(t - begin, 0.0, 2 * half)
        rest = np.maximum(since - half, 0.0)
        first = ACROSS_MPS2 / 2 * np.minimum(since, half) ** 2
        return speed * t, to * (first + ACROSS_MPS2 * half * rest - ACROSS_MPS2 / 2 * rest**2)

    return manoeuvre


_MANOEUVRES = {"brake": _brakes, "accelerate": _accelerates, "left": _swerves(1.0), "right": _swerves(-1.0)}


def _crash(choice: random.Random) -> Made:
    """Return a collision at any angle; the ego absorbs the velocity difference by the other's share of the mass."""
    kind, mass = choice.choice((("car", 1500.0), ("truck", 12_000.0), ("motorcycle", 250.0), ("pedestrian", 75.0)))
    ego, speed, heading = choice.uniform(3, 20), choice.uniform(0, 15), choice.uniform(-math.pi, math.pi)
    steps = 11
    last = (steps - 1) * STEP_S
    x, y = ego * last + 2.0 - speed * last * math.cos(heading), -speed * last * math.sin(heading)
    other = straight(x, y, heading, speed, steps, kind=kind)
    away = math.hypot(ego - speed * math.cos(heading), speed * math.sin(heading))
    truth = {"delta_v_mps": away * mass / (mass + 1500.0)}
    return Made("crash", straight(0, 0, 0, ego, steps), other, truth, hit=True)


def _spiral(choice: random.Random) -> Made:
    """Return an ego that accelerates or brakes evenly into a clothoid, with its accelerations in closed form."""
    steps, fine = 31, 200
    speed, by = choice.uniform(8, 15), choice.uniform(-2.0, 2.0)
    sharper = choice.uniform(0.001, 0.003) * choice.choice((-1, 1))
    poses, x, y = [], 0.0, 0.0
    for number in range((steps - 1) * fine + 1):
        t = number * STEP_S / fine
        station, now = speed * t + by * t**2 / 2, speed + by * t
        heading = sharper * station**2 / 2
        if number % fine == 0:
            poses.append((x, y, heading, now))
        x, y = x + now * STEP_S / fine * math.cos(heading), y + now * STEP_S / fine * math.sin(heading)
    last = (steps - 1) * STEP_S
    end = last - STEP_S / 2  # of the last turn, which is that between two states
    across = [abs((speed + by * t) ** 2 * sharper * (speed * t + by * t**2 / 2)) for t in (STEP_S / 2, end)]
    truth = {
        "maximum_acceleration_mps2": max(by, 0.0),
        "maximum_braking_mps2": max(-by, 0.0),
        "distance_m": speed * last + by * last**2 / 2,
        "duration_s": last,
        "mean_speed_mps": speed + by * last / 2,
    }
    rate = [
        abs(sharper) * ((speed + by * t) ** 3 + 2 * by * (speed + by * t) * (speed * t + by * t**2 / 2))
        for t in np.linspace(STEP_S, last - STEP_S, 200)
    ]
    steering = [
        abs(2.579 * sharper * (speed + by * t) / (1 + (2.579 * sharper * (speed * t + by * t**2 / 2)) ** 2))
        for t in np.linspace(STEP_S, last - STEP_S, 200)
    ]
    if by > 0:  # then all of these are largest at the end, which is no edge of the run
        truth["maximum_lateral_acceleration_mps2"] = max(across)
        truth["maximum_planar_acceleration_mps2"] = math.hypot(max(across), by)
        truth["maximum_lateral_jerk_mps3"] = max(rate)
        truth["maximum_steering_rate_radps"] = max(steering)
    far_away = straight(10_000.0, 0.0, 0.0, 0.0, steps)
    return Made("spiral", Moving(tuple(poses)), far_away, truth)


def _jolting(choice: random.Random) -> Made:
    """Return an ego on a straight line with a cosine over full periods as acceleration, so its jerk is a sine."""
    steps, most, speed = 61, choice.uniform(0.5, 3.0), choice.uniform(10, 25)
    last = (steps - 1) * STEP_S
    turning = 2 * math.pi / last
    times = [step * STEP_S for step in range(steps)]
    poses = tuple(
        (
            speed * t + most / turning**2 * (math.cos(turning * t) - 1),
            0.0,
            0.0,
            speed - most / turning * math.sin(turning * t),
        )
        for t in times
    )
    truth = {
        "maximum_jerk_mps3": most * turning,
        "maximum_planar_jerk_mps3": most * turning,
        "mean_squared_jerk": (most * turning) ** 2 / 2,
        "maximum_acceleration_mps2": most,
    }
    return Made("jolting", Moving(poses), straight(10_000.0, 0.0, 0.0, 0.0, steps), truth)


# ---- CriMe


def against_crime(bench: SeededBench) -> tuple[Tally, int]:
    """Compare the product's values for recorded vehicles with CriMe's; also return the number of files.

    Raises:
        LeftOut: CriMe's environment cannot be created here.
    """
    interpreter = prepared_environment() / "bin" / "python"
    folder, tally, files = bench.folder("crime"), Tally(), 0
    with _Crime(interpreter) as crime:
        for path in scenario_files(bench.shared / "data" / "commonroad", bench.limit or MOST_FILES):
            before = tally.compared.total()
            for ego, step_s, others in _recorded(path):
                _compare(path, (ego, step_s, others), crime, tally, folder)
            files += tally.compared.total() > before
    return tally, files


MOST_FILES = 80
"""Number of public files (chosen): some have no vehicle that follows another."""


def prepared_environment() -> Path:
    """Return the folder of the environment, creating it if necessary.

    Raises:
        LeftOut: it cannot be created here.
    """
    return made_environment("crime", "CriMe", _REQUIREMENTS)


class _Crime:
    """CriMe in a process of its own, asked line by line."""

    def __init__(self, interpreter: Path) -> None:
        self._process = subprocess.Popen(
            [str(interpreter), "-P", str(_DRIVER)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": ""},
        )

    def __enter__(self) -> "_Crime":
        return self

    def __exit__(self, *problem: object) -> None:
        self._process.kill()
        self._process.communicate()

    def ask(self, **asked: Any) -> dict[str, Any]:
        """Return CriMe's measures, or ``fault`` if it fails."""
        assert self._process.stdin is not None and self._process.stdout is not None  # noqa: S101, PT018 - pipes
        self._process.stdin.write(json.dumps(asked) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"CriMe's process ended with {self._process.wait()}")
        found: dict[str, Any] = json.loads(line)
        return found


_Recorded = tuple[Moving, float, list[tuple[int, Moving]]]
"""The ego, the step in s, and the others with their first steps."""


def _recorded(path: Path) -> Iterator[_Recorded]:
    """Return recorded vehicles in place of the ego, always the same; the last state is left out, as in CriMe."""
    scenario, _ = CommonRoadFileReader(str(path)).open(lanelet_assignment=False)
    moving: dict[int, tuple[int, Moving]] = {}
    for one in scenario.dynamic_obstacles:
        if not isinstance(one.obstacle_shape, Rectangle) or not hasattr(one.prediction, "trajectory"):
            continue
        states = [one.initial_state, *one.prediction.trajectory.state_list]
        if not all(np.ndim(state.position) == 1 and hasattr(state, "velocity") for state in states):
            continue
        poses = tuple(
            (float(s.position[0]), float(s.position[1]), float(s.orientation), float(s.velocity)) for s in states
        )
        size = float(one.obstacle_shape.length), float(one.obstacle_shape.width)
        key = int(one.obstacle_id)
        moving[key] = one.initial_state.time_step, Moving(poses, size, str(one.obstacle_type.value), key)
    long = [str(key) for key, (first, one) in moving.items() if first == 0 and len(one.poses) > FEWEST_STEPS]
    for name in drawn(long, EGOS_A_FILE):
        ego = moving[int(name)][1]
        cut = Moving(ego.poses[:-1], ego.size_m, ego.kind, ego.key)
        yield cut, float(scenario.dt), [pair for key, pair in moving.items() if key != int(name)]


_OF_LEADER = {
    "leader_time_to_collision_s": "collision_s",
    "deceleration_to_avoid_mps2": "needed_mps2",
    "brake_threat_number": "threat",
    "minimum_time_gap_s": "gap_m",
}
"""Our measures of the leader, and the driver's names of CriMe's."""


def _compare(path: Path, recorded: _Recorded, crime: _Crime, tally: Tally, folder: Path) -> None:
    """Compare the product's values for a recorded vehicle with CriMe's."""
    ego, step_s, others = recorded
    where = f"{path.stem}, {ego.key}"

    def told(length_m: float | None = None) -> dict[str, MeasuredValue]:
        def body(one: Moving) -> Moving:
            return one if length_m is None else Moving(one.poses, (length_m, one.size_m[1]), one.kind, one.key)

        moved = [body(one) for _, one in others]
        return reported_measures(body(ego), moved, step_s, folder, first=[first for first, _ in others])

    def asked(kind: str, one: MeasuredValue) -> dict[str, Any]:
        step = round((one.time_s or 0.0) / step_s)
        known = {"file": str(path), "ego": ego.key, "other": one.obstacle_id, "step": step}
        return crime.ask(kind=kind, braking_mps2=BRAKING_MPS2, short_m=SHORT_M, **known)

    whole = told()
    answers: dict[tuple[int | None, float | None], dict[str, Any]] = {}
    for name, key in _OF_LEADER.items():
        one = whole[name]
        if one.value is None or one.obstacle_id is None:
            continue
        moment = one.obstacle_id, one.time_s
        found = answers.get(moment) or answers.setdefault(moment, asked("leader", one))
        speed = ego.poses[round((one.time_s or 0.0) / step_s)][3]
        _leader(tally, name, one.value, found, found.get(key), speed, f"{where}, {one.partner} at {one.time_s} s")
    closest = whole["minimum_distance_m"]
    if closest.value is not None:
        found = asked("closest", closest)
        _other(tally, "minimum_distance_m", closest.value, found, "closest_m", where)
    worst = told(SHORT_M)["worst_time_to_collision_s"]
    if worst.value:
        _other(tally, "worst_time_to_collision_s", worst.value, asked("worst", worst), "worst_s", where)


def _leader(
    tally: Tally, name: str, told: float, found: Mapping[str, Any], value: float | None, speed: float, where: str
) -> None:
    if "fault" in found or value is None:
        tally.left_out[f"{name}: {found.get('fault', 'not ahead there by CriMe')}"] += 1
    elif not found["one_lane"]:
        tally.left_out[f"{name}: not on one lane by CriMe"] += 1
    elif found["turned_rad"] > STRAIGHT_RAD:
        tally.left_out[f"{name}: not straight"] += 1
    elif name == "brake_threat_number" and found["leader_mps2"] < 0:
        tally.left_out[f"{name}: leader brakes"] += 1
    elif name == "minimum_time_gap_s":
        tally.compare(name, told * speed, value, CRIME_DIGITS[name], f"{where}: gap in m")
    else:
        tally.compare(name, told, abs(value), CRIME_DIGITS[name], where)


def _other(tally: Tally, name: str, told: float, found: Mapping[str, Any], key: str, where: str) -> None:
    if found.get(key) is None:
        tally.left_out[f"{name}: {found.get('fault', 'none by CriMe')}"] += 1
    else:
        tally.compare(name, told, found[key], CRIME_DIGITS.get(name, 0.0), where)
