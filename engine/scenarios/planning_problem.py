"""The ego and its goal: one of the recorded cars becomes the planning problem, its recorded way shows the goal."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from plannerforge.engine.geometry.polyline import Points, arc_length, project
from plannerforge.engine.network.lanelet_lookup import LaneletLookup
from plannerforge.engine.network.road_network import RoadLanelet, RoadNetwork
from plannerforge.engine.scenarios.ego_way import follows_smooth_lanes
from plannerforge.engine.scenarios.goal_wish import GoalWish, Passage, check_lanelet, passage
from plannerforge.engine.scenarios.site_heart import SiteHeart
from plannerforge.engine.traffic.motions import Participant
from plannerforge.schemas.errors import InvalidRequest, NotPossible

TIME_MARGIN_S = 1.5
HEADING_MARGIN_RAD = 0.25


@dataclass(frozen=True)
class EgoWish:
    """The ego as asked: the n-th car; ``other_class`` is what was asked for instead of a car."""

    index: int | None
    other_class: str | None


@dataclass(frozen=True)
class PlanningTask:
    """Initial state and goal of the ego.

    The goal is a rectangle (length, width) in m around ``center`` (2,), turned by ``heading_rad``, to be reached within
    the steps of ``time_steps`` and headings within ``heading_margin_rad``. ``heart_passed``: how many parts of
    what the site is about the recorded way to it passes.
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
    heart_passed: int = 1


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


def choose_task(
    ego: EgoWish, goal: GoalWish, everyone: Sequence[Participant], network: RoadNetwork, heart: SiteHeart, step_s: float
) -> PlanningTask:
    """The planning task of the wished car, or of the first car that can have the wished goal.

    Cars whose recorded way can be driven come before others, of those the ones that pass on it what the site is about,
    and of those the ones whose lanes can be followed.

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
    check_lanelet(goal, network)
    lookup = LaneletLookup(network)
    best: tuple[tuple[bool, int, bool], PlanningTask] | None = None
    for car in choice:
        task = _task(car, goal, network, lookup, step_s)
        if task is None:
            continue
        task = replace(task, heart_passed=heart.parts_passed(car, task.goal_step))
        if best is not None and (car.feasible, task.heart_passed, True) <= best[0]:
            continue
        smooth = car.feasible and follows_smooth_lanes(car, task.goal_step, network, lookup)
        merit = (car.feasible, task.heart_passed, smooth)
        if best is None or merit > best[0]:
            best = merit, task
        if merit == (True, heart.parts, True):
            break
    if best is not None:
        return best[1]
    raise NotPossible(
        f"none of the {len(choice)} car(s) to choose from has a goal {goal} on its way (at least "
        f"{goal.shortest_way_m:g} m within the recording, and not around its start)",
        valid=_driven_lanelets(choice, lookup) if goal.lanelet else [],
        next_step="choose another goal, a longer duration_s, another ego or another seed",
    )


def _driven_lanelets(cars: Sequence[Participant], lookup: LaneletLookup) -> list[int]:
    """The lanelets that the cars drive over, seen twice a second."""
    passed = (_under(lookup, car, step) for car in cars for step in range(0, len(car.motion.positions), 5))
    return sorted({lanelet.lanelet_id for lanelet in passed if lanelet is not None})


def _task(
    car: Participant,
    goal: GoalWish,
    network: RoadNetwork,
    lookup: LaneletLookup,
    step_s: float,
) -> PlanningTask | None:
    there = passage(goal, car, network)
    if there is None:
        return None
    start, end = _under(lookup, car, 0), _goal_lanelet(goal, there, network, lookup)
    if start is None or end is None or not is_reachable(network, start.lanelet_id, end.lanelet_id):
        return None
    margin = round(TIME_MARGIN_S / step_s)
    asked = goal.lanelet.size_m if goal.lanelet else None
    return PlanningTask(
        ego=car,
        goal_step=there.step,
        goal_distance_m=float(arc_length(car.motion.positions)[there.step]),
        lanelet_id=end.lanelet_id,
        center=there.center,
        heading_rad=there.heading_rad,
        size_m=asked or _usual_size(end, there.center, float(car.motion.speeds_mps[there.step])),
        time_steps=(max(1, there.step - margin), there.step + margin),
        heading_margin_rad=HEADING_MARGIN_RAD,
    )


def _goal_lanelet(goal: GoalWish, there: Passage, network: RoadNetwork, lookup: LaneletLookup) -> RoadLanelet | None:
    if goal.lanelet is not None:
        return network.lanelets[goal.lanelet.lanelet_id]
    return lookup.under(there.center, there.heading_rad)


def _usual_size(lanelet: RoadLanelet, center: Points, speed_mps: float) -> tuple[float, float]:
    """A rectangle as wide as the lanelet, 2 to 3.5 m, and as long as the car drives in 0.8 s, 6 to 20 m."""
    station, _ = project(lanelet.center, center)
    width = float(np.interp(station, arc_length(lanelet.center), np.linalg.norm(lanelet.left - lanelet.right, axis=1)))
    length = min(max(6.0, 0.8 * speed_mps), 20.0)
    return round(length, 2), round(min(max(width, 2.0), 3.5), 2)


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
