"""Planted weaknesses of planners: a wrapper that changes what a healthy planner sees.

A weakness returns the road users that the planner sees, from the observation and the steps since each came into view.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from plannerforge.engine.planners import Observation, Plan, Planner, PlanningTask
from plannerforge.engine.planners.interface import EgoState, PredictedObstacle

Sight = Callable[[EgoState, PredictedObstacle], PredictedObstacle | None]
"""What a planner sees of a road user: None if nothing."""
_MOVES_MPS = 0.2
_PEOPLE = ("pedestrian", "bicycle")


def _place(ego: EgoState, other: PredictedObstacle) -> tuple[float, float, float]:
    """Return how far a road user is ahead and to the left, and its heading relative to the ego's."""
    away = other.positions[0] - ego.position
    cosine, sine = math.cos(ego.heading_rad), math.sin(ego.heading_rad)
    turned = math.remainder(float(other.headings_rad[0]) - ego.heading_rad, math.tau)
    return float(away[0] * cosine + away[1] * sine), float(away[1] * cosine - away[0] * sine), turned


def _unless(hidden: Callable[[EgoState, PredictedObstacle], bool]) -> Sight:
    return lambda ego, other: None if hidden(ego, other) else other


def _late(ego: EgoState, other: PredictedObstacle) -> bool:
    """Hidden above 12 m/s until the time to reach it is below 1.2 s."""
    ahead, _, turned = _place(ego, other)
    closing = ego.speed_mps - other.speed_mps * math.cos(turned)
    return ego.speed_mps > 12.0 and (closing <= 0.0 or (ahead - 4.5) / closing > 1.2)


def _faces_late(kind: str) -> Callable[[EgoState, PredictedObstacle], bool]:
    """Hidden until it is within 8 m, for one class."""
    return lambda ego, other: other.kind == kind and float(np.linalg.norm(other.positions[0] - ego.position)) > 8.0


def _as_standing(ego: EgoState, other: PredictedObstacle) -> PredictedObstacle:
    del ego
    count = len(other.positions)
    stays = np.repeat(other.positions[:1], count, axis=0)
    return replace(other, positions=stays, headings_rad=np.full(count, other.headings_rad[0]), speed_mps=0.0)


def _as_faster(ego: EgoState, other: PredictedObstacle) -> PredictedObstacle:
    """It seems to keep at least 9 m/s along its heading, so that no vehicle brakes or stands."""
    del ego
    count, heading = len(other.positions), float(other.headings_rad[0])
    ahead = np.arange(count)[:, None] * 0.1 * max(other.speed_mps, 9.0)
    there = other.positions[0] + ahead * np.array([math.cos(heading), math.sin(heading)])
    return replace(other, positions=there, speed_mps=max(other.speed_mps, 9.0))


def _is_crossing(ego: EgoState, other: PredictedObstacle) -> bool:
    return math.radians(45) < abs(_place(ego, other)[2]) < math.radians(135)


COMMON: Mapping[str, Sight] = {
    "blind_to_cyclists": _unless(lambda _, other: other.kind == "bicycle"),
    "blind_to_pedestrians": _unless(lambda _, other: other.kind == "pedestrian"),
    "blind_to_slow": _unless(lambda _, other: other.speed_mps < 1.0),
    "blind_on_the_left": _unless(lambda ego, other: _place(ego, other)[1] > 1.0),
    "blind_on_the_right": _unless(lambda ego, other: _place(ego, other)[1] < -1.0),
    "late_at_speed": _unless(_late),
    "short_sight": _unless(lambda ego, other: float(np.linalg.norm(other.positions[0] - ego.position)) > 9.0),
    "blind_to_crossing": _unless(_is_crossing),
    "blind_to_cars_ahead": _unless(
        lambda ego, other: other.kind not in _PEOPLE and abs(_place(ego, other)[2]) < math.radians(45)
    ),
    "others_seem_to_stand": _as_standing,
    "others_seem_to_drive_on": _as_faster,
}
"""Weaknesses by name that hold at every step."""
PRACTICE: Mapping[str, Sight] = {
    "blind_to_oncoming": _unless(lambda ego, other: abs(_place(ego, other)[2]) > math.radians(135)),
    "narrow_view": _unless(lambda ego, other: abs(_place(ego, other)[1]) > 0.5 * max(_place(ego, other)[0], 0.0) + 1.0),
    "blind_to_fast": _unless(lambda _, other: other.speed_mps > 6.0),
    "late_to_pedestrians": _unless(_faces_late("pedestrian")),
    "late_to_cyclists": _unless(_faces_late("bicycle")),
    "blind_when_slow": _unless(lambda ego, _: ego.speed_mps < 4.0),
    "people_seem_to_stand": lambda ego, other: _as_standing(ego, other) if other.kind in _PEOPLE else other,
    "blind_to_near_cars": _unless(
        lambda ego, other: other.kind not in _PEOPLE and float(np.linalg.norm(other.positions[0] - ego.position)) < 12.0
    ),
    "blind_to_cars_that_brake": _unless(
        lambda ego, other: other.kind not in _PEOPLE and other.speed_mps < 0.6 * ego.speed_mps
    ),
}
"""Weaknesses on which the search is developed, in other scenarios; nothing is reported on them."""
DELAYED: Mapping[str, float] = {"latency": 1.2, "slow_to_notice": 2.0}
"""``latency``: what it sees is so many seconds old. ``slow_to_notice``: a road user is seen only so many seconds after
it first moved within 40 m."""


@dataclass(frozen=True)
class Encounter:
    """An ego and a road user at a step, and how the road user behaved since it came into view.

    ``stood_s``: how long it stood before it set off.
    ``reach_s``: the time in which the ego would have reached its place when it set off. ``braking_mps2``: its hardest
    braking so far. ``age_s``: the time since it came into view.
    """

    ego: EgoState
    other: PredictedObstacle
    stood_s: float
    reach_s: float
    braking_mps2: float
    age_s: float

    def crosses_from(self, side: str) -> bool:
        """Return True if it moves across the ego's way, from a side."""
        turned = math.degrees(_place(self.ego, self.other)[2])
        return 45.0 < (turned if side == "right" else -turned) < 135.0

    @property
    def is_car(self) -> bool:
        """Whether it is a motor vehicle."""
        return self.other.kind not in _PEOPLE

    @property
    def is_oncoming(self) -> bool:
        """Whether it moves against the ego."""
        return abs(_place(self.ego, self.other)[2]) > math.radians(135)


RARE: Mapping[str, Callable[[Encounter], bool]] = {
    "runners_who_step_out_late": lambda met: (
        met.other.kind == "pedestrian"
        and met.crosses_from("left")
        and met.other.speed_mps > 2.25
        and met.stood_s > 1.5
        and met.reach_s < 3.0
    ),
    "cyclists_who_waited_on_the_right": lambda met: (
        met.other.kind == "bicycle" and met.crosses_from("right") and met.stood_s > 2.5 and met.reach_s < 2.5
    ),
    "slow_walkers_from_the_right": lambda met: (
        met.other.kind == "pedestrian"
        and met.crosses_from("right")
        and 0.0 < met.other.speed_mps < 1.1
        and met.stood_s < 1.5
    ),
    "late_emergency_braking": lambda met: met.is_car and met.braking_mps2 > 7.6 and met.age_s > 3.0,
}
"""Weaknesses by name that need a combination which chance rarely hits: True if the planner does not see the road user.

How rarely, is measured with the benchmark."""
RARE_PRACTICE: Mapping[str, Callable[[Encounter], bool]] = {
    "fast_oncoming": lambda met: met.is_oncoming and met.other.speed_mps > 8.0,
    "runners_from_the_right": lambda met: (
        met.other.kind == "pedestrian" and met.crosses_from("right") and met.other.speed_mps > 2.0
    ),
    "cyclists_who_just_came": lambda met: (
        met.other.kind == "bicycle" and met.crosses_from("left") and met.stood_s < 0.7
    ),
    "emergency_braking": lambda met: met.is_car and met.braking_mps2 > 7.0 and 1.5 < met.age_s < 2.5,
}
"""Rare weaknesses on which the search is developed, in other scenarios; nothing is reported on them."""
NAMES = (*COMMON, *DELAYED)


class Weak:
    """A planner with a weakness; everything else is the healthy planner's."""

    def __init__(self, healthy: Planner, weakness: str) -> None:
        self._healthy, self._sees = healthy, _Sees(weakness)

    def reset(self, task: PlanningTask) -> None:
        """Begin a run."""
        self._healthy.reset(task)
        self._sees.begin(task)

    def plan(self, observation: Observation) -> Plan:
        """Return the healthy planner's plan for what it sees."""
        return self._healthy.plan(replace(observation, obstacles=self._sees.of(observation)))


class Watch:
    """A healthy planner; ``altered`` names the weaknesses that would have changed what it saw.

    A run in which a weakness changes nothing is the healthy planner's run, so it needs no run of its own.
    """

    def __init__(self, healthy: Planner, weaknesses: Sequence[str]) -> None:
        self.altered: set[str] = set()
        self._healthy, self._watched = healthy, {name: _Sees(name) for name in weaknesses}

    def reset(self, task: PlanningTask) -> None:
        """Begin a run."""
        self._healthy.reset(task)
        for sees in self._watched.values():
            sees.begin(task)

    def plan(self, observation: Observation) -> Plan:
        """Return the healthy planner's plan."""
        for name, sees in self._watched.items():
            if name not in self.altered and not _are_same(sees.of(observation), observation.obstacles):
                self.altered.add(name)
        return self._healthy.plan(observation)


def _are_same(some: Sequence[PredictedObstacle], others: Sequence[PredictedObstacle]) -> bool:
    return len(some) == len(others) and all(
        one is other
        or (
            one.speed_mps == other.speed_mps
            and np.array_equal(one.positions, other.positions)
            and np.array_equal(one.headings_rad, other.headings_rad)
        )
        for one, other in zip(some, others, strict=True)
    )


@dataclass
class _History:
    """A road user since the step at which it came into view; ``set_off``: the step at which it first moved."""

    first: int
    last: int
    speed_mps: float
    set_off: int | None = None
    reach_s: float = math.inf
    braking_mps2: float = 0.0

    def add(self, ego: EgoState, other: PredictedObstacle, step_s: float) -> None:
        """Add a step."""
        if ego.step > self.last:
            braking = (self.speed_mps - other.speed_mps) / ((ego.step - self.last) * step_s)
            self.braking_mps2 = max(self.braking_mps2, braking)
        self.last, self.speed_mps = ego.step, other.speed_mps
        if self.set_off is None and other.speed_mps > _MOVES_MPS:
            self.set_off = ego.step
            self.reach_s = _place(ego, other)[0] / max(ego.speed_mps, _MOVES_MPS)


class _Sees:
    """What a planner with a weakness sees, step by step."""

    def __init__(self, weakness: str) -> None:
        self._weakness = weakness
        self._sight = {**COMMON, **PRACTICE}.get(weakness)
        self._hides = {**RARE, **RARE_PRACTICE}.get(weakness)
        self._delay_s = DELAYED.get(weakness, 0.0)

    def begin(self, task: PlanningTask) -> None:
        """Begin a run."""
        self._delay = round(self._delay_s / task.step_s)
        self._seen: deque[tuple[int, tuple[PredictedObstacle, ...]]] = deque()
        self._noticed: dict[int, int] = {}
        self._histories: dict[int, _History] = {}
        self._step_s = task.step_s

    def of(self, observation: Observation) -> tuple[PredictedObstacle, ...]:
        """Return the road users that it sees; called at every step."""
        obstacles: Sequence[PredictedObstacle] = observation.obstacles
        if self._sight is not None:
            seen = (self._sight(observation.ego, other) for other in obstacles)
            return tuple(other for other in seen if other is not None)
        if self._hides is not None:
            met = ((self._encounter(observation.ego, other), other) for other in obstacles)
            return tuple(other for encounter, other in met if not self._hides(encounter))
        if self._weakness == "latency":
            return tuple(self._old(observation))
        return tuple(other for other in obstacles if self._has_noticed(observation.ego, other))

    def _encounter(self, ego: EgoState, other: PredictedObstacle) -> Encounter:
        history = self._histories.setdefault(other.obstacle_id, _History(ego.step, ego.step, other.speed_mps))
        history.add(ego, other, self._step_s)
        return Encounter(
            ego=ego,
            other=other,
            stood_s=((ego.step if history.set_off is None else history.set_off) - history.first) * self._step_s,
            reach_s=history.reach_s,
            braking_mps2=history.braking_mps2,
            age_s=(ego.step - history.first) * self._step_s,
        )

    def _old(self, observation: Observation) -> Sequence[PredictedObstacle]:
        now = observation.ego.step
        self._seen.append((now, observation.obstacles))
        while len(self._seen) > 1 and self._seen[1][0] <= now - self._delay:
            self._seen.popleft()
        step, seen = self._seen[0]
        return seen if step <= now - self._delay else [_as_standing(observation.ego, one) for one in seen]

    def _has_noticed(self, ego: EgoState, other: PredictedObstacle) -> bool:
        near = float(np.linalg.norm(other.positions[0] - ego.position)) < 40.0
        if near and other.speed_mps > _MOVES_MPS:
            self._noticed.setdefault(other.obstacle_id, ego.step)
        return ego.step - self._noticed.get(other.obstacle_id, ego.step) >= self._delay
