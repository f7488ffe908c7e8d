"""The ego and its goal: one of the recorded cars becomes the planning problem, its recorded way shows the goal."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plannerforge.engine.geometry.polyline import Points, arc_length, project
from plannerforge.engine.network.lanelet_lookup import LaneletLookup
from plannerforge.engine.network.road_network import RoadLanelet, RoadNetwork
from plannerforge.engine.traffic.motions import Participant
from plannerforge.schemas.errors import InvalidRequest, NotPossible

SHORTEST_WAY_M = 10.0
TIME_MARGIN_S = 1.5
HEADING_MARGIN_RAD = 0.25


@dataclass(frozen=True)
class GoalWish:
    """The goal as asked: after a number of steps, or after a distance in m on the ego's own way."""

    steps: int | None
    distance_m: float | None


@dataclass(frozen=True)
class EgoWish:
    """The ego as asked: the n-th car; ``other_class`` is what was asked for instead of a car."""

    index: int | None
    other_class: str | None


@dataclass(frozen=True)
class PlanningTask:
    """Initial state and goal of the ego.

    The goal is a rectangle (length, width) in m around ``center`` (2,), turned by ``heading_rad``, to be reached within
    the steps of ``time_steps`` and headings within ``heading_margin_rad``.
    """

    ego: Participant
    goal_step: int
    goal_distance_m: float
    lanelet_id: int
    center: Points
    heading_rad: float
    size_m: tuple[float, float]
    time_steps: tuple[int, int]
    heading_margin_rad: float


def parse_ego(text: str) -> EgoWish:
    """Read ``first``, ``index:N`` or ``type:CLASS``.

    Raises:
        InvalidRequest: none of these.
    """
    if text == "first":
        return EgoWish(None, None)
    if match := re.fullmatch(r"index:(\d{1,3})", text):
        return EgoWish(int(match[1]), None)
    if match := re.fullmatch(r"type:([a-z_]{1,30})", text):
        return EgoWish(None, None if match[1] == "car" else match[1])
    raise InvalidRequest(f"ego {text!r} cannot be read", valid=["first", "index:N (cars, from 0)", "type:CLASS"])


def parse_goal(text: str) -> GoalWish:
    """Read ``steps:N`` or ``distance_m:X``.

    Raises:
        InvalidRequest: neither of these, or outside 10 … 1000 steps or 5 … 2000 m.
    """
    if (match := re.fullmatch(r"steps:(\d{1,5})", text)) and 10 <= int(match[1]) <= 1000:
        return GoalWish(int(match[1]), None)
    if (match := re.fullmatch(r"distance_m:(\d{1,5}(?:\.\d+)?)", text)) and 5 <= float(match[1]) <= 2000:
        return GoalWish(None, float(match[1]))
    raise InvalidRequest(f"goal {text!r} cannot be read", valid=["steps:N (10 to 1000)", "distance_m:X (5 to 2000)"])


def choose_task(
    ego: EgoWish, goal: GoalWish, everyone: Sequence[Participant], network: RoadNetwork, step_s: float
) -> PlanningTask:
    """The planning task of the wished car, or of the first car that can have the wished goal.

    Cars whose recorded way can be driven come before others.

    Raises:
        NotPossible: no car, not so many cars, or none that reaches such a goal.
    """
    cars = [vehicle for vehicle in everyone if vehicle.vehicle_class.name == "car"]
    if ego.index is not None and ego.index >= len(cars):
        raise NotPossible(
            f"ego index:{ego.index} asks for car number {ego.index}; the traffic holds {len(cars)}",
            valid=[f"index:0 to index:{len(cars) - 1}"] if cars else [],
            next_step="choose a smaller index or a higher density",
        )
    choice = [cars[ego.index]] if ego.index is not None else cars
    reserve: PlanningTask | None = None
    lookup = LaneletLookup(network)
    for car in choice:
        task = _task(car, goal, network, lookup, step_s)
        if task is None:
            continue
        if car.feasible:
            return task
        reserve = reserve or task
    if reserve is not None:
        return reserve
    wish = f"{goal.steps} steps" if goal.steps is not None else f"{goal.distance_m:g} m"
    raise NotPossible(
        f"none of the {len(choice)} car(s) to choose from has a goal {wish} ahead on its way (at least "
        f"{SHORTEST_WAY_M:g} m within the recording)",
        next_step="choose a smaller goal, a longer duration_s, another ego or another seed",
    )


def _task(
    car: Participant,
    goal: GoalWish,
    network: RoadNetwork,
    lookup: LaneletLookup,
    step_s: float,
) -> PlanningTask | None:
    gone = arc_length(car.motion.positions)
    step = _goal_step(goal, gone)
    if step is None or gone[step] < (SHORTEST_WAY_M if goal.steps is not None else 4.0):
        return None
    center = car.motion.positions[step]
    start, end = _under(lookup, car, 0), _under(lookup, car, step)
    if start is None or end is None or not is_reachable(network, start.lanelet_id, end.lanelet_id):
        return None
    margin = round(TIME_MARGIN_S / step_s)
    station, _ = project(end.center, center)
    width = float(np.interp(station, arc_length(end.center), np.linalg.norm(end.left - end.right, axis=1)))
    length = min(max(6.0, 0.8 * float(car.motion.speeds_mps[step])), 20.0)
    return PlanningTask(
        ego=car,
        goal_step=step,
        goal_distance_m=float(gone[step]),
        lanelet_id=end.lanelet_id,
        center=center,
        heading_rad=float(car.motion.headings_rad[step]),
        size_m=(round(length, 2), round(min(max(width, 2.0), 3.5), 2)),
        time_steps=(max(1, step - margin), step + margin),
        heading_margin_rad=HEADING_MARGIN_RAD,
    )


def _goal_step(goal: GoalWish, gone: Points) -> int | None:
    if goal.steps is not None:
        return goal.steps if goal.steps < len(gone) else None
    reached = np.flatnonzero(gone >= (goal.distance_m or 0.0))
    return int(reached[0]) if len(reached) else None


def _under(lookup: LaneletLookup, vehicle: Participant, step: int) -> RoadLanelet | None:
    return lookup.under(vehicle.motion.positions[step], float(vehicle.motion.headings_rad[step]))


def is_reachable(network: RoadNetwork, start: int, goal: int) -> bool:
    """Whether one lanelet can be reached from another by successors and lane changes."""
    found, waiting = {start}, [start]
    while waiting:
        lanelet = network.lanelets[waiting.pop()]
        for key in (*lanelet.successors, *lanelet.neighbours()):
            if key not in found:
                found.add(key)
                waiting.append(key)
    return goal in found
