"""Checks that an ego that had to stop drives on once the road is free.

Each planner drives synthetic runs on a straight road. Something blocks the lane until a drawn time, mostly after the
middle or the end of the goal's time interval, and the road is free from then on:

- a leader stands and then leaves;
- a leader waits at a red light in the file and leaves when it turns green (the planners do not read lights themselves);
- the vehicles of a queue of three leave one after the other;
- an ego starts late at a standstill behind a leader;
- a leader stands and leaves, and the goal has no place;
- a leader brakes to a standstill at the end of the goal's time interval and leaves.

``restarts``: of the runs in which the ego stood, the share in which it drives again (at least 2 m/s, and 3 m further)
within seven seconds after the last vehicle ahead left. This module examines the states itself, without the product's
analysis. It also reports the share for each planner and kind, and ``restarts_stood``, the share of runs in which the
ego stood.
"""

import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from commonroad.common.util import Interval
from commonroad.geometry.shape import Rectangle
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork, StopLine
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType
from commonroad.scenario.scenario import Scenario
from commonroad.scenario.state import CustomState, InitialState
from commonroad.scenario.traffic_light import (
    TrafficLight,
    TrafficLightCycle,
    TrafficLightCycleElement,
    TrafficLightState,
)
from commonroad.scenario.trajectory import Trajectory

from plannerforge.engine.execution import silent
from plannerforge.engine.planners import make_planner, simulate
from plannerforge.engine.tuning import named_configuration

from ..harness import Figures, SeededBench, share

CASES = 30
PLANNERS = ("frenetix", "fiss", "idm", "mp_rbfn")
_STEP_S, _STEPS = 0.1, 400
_CAR = Rectangle(4.5, 1.8)
_LIMIT_MPS, _ACCELERATION_MPS2, _BRAKES_MPS2, _STANDS_S = 15.0, 2.5, 3.0, 5.0
_IN_S, _STANDING_MPS, _DRIVING_MPS, _DRIVEN_M = 7.0, 0.5, 2.0, 3.0


@dataclass(frozen=True)
class Case:
    """Leaders by their position and departure (step), the ego's speed, and the goal's time in steps.

    ``goal_m`` is None for a goal without a place; ``comes_mps`` is the speed from which the leaders brake to a
    standstill before they leave again, 0 for leaders that stand from the beginning.
    """

    kind: str
    leaders: tuple[tuple[float, int], ...]
    speed_mps: float
    window: tuple[int, int]
    goal_m: float | None
    comes_mps: float = 0.0

    @property
    def free_step(self) -> int:
        """When the last leader leaves."""
        return max(step for _, step in self.leaders)

    def scenario(self) -> Scenario:
        """Return the road with its leaders, and with a light if they wait for one."""
        x = np.linspace(-50.0, 950.0, 201)
        left, center, right = (np.stack([x, np.full(len(x), y)], axis=1) for y in (1.75, 0.0, -1.75))
        light_x = self.leaders[0][0] + 3.0
        line = StopLine(np.array([light_x, 1.75]), np.array([light_x, -1.75]), None)
        with_light = self.kind == "red light"
        lane = Lanelet(left, center, right, 1, stop_line=line if with_light else None)
        network = LaneletNetwork.create_from_lanelet_list([lane])
        scenario = Scenario(dt=_STEP_S)
        if with_light:
            phases = [
                TrafficLightCycleElement(TrafficLightState.RED, self.free_step),
                TrafficLightCycleElement(TrafficLightState.GREEN, _STEPS),
            ]
            light = TrafficLight(900, np.array([light_x, -3.0]), TrafficLightCycle(phases))
            network.add_traffic_light(light, {1})
        scenario.add_objects(network)
        for number, (at_m, leaves) in enumerate(self.leaders):
            scenario.add_objects(_leader(100 + number, at_m, leaves, self.comes_mps))
        return scenario

    def problem(self) -> PlanningProblem:
        """Return the ego at the origin and its goal."""
        place = {} if self.goal_m is None else {"position": Rectangle(12.0, 3.5, np.array([self.goal_m, 0.0]))}
        start = _initial(0.0, self.speed_mps)
        return PlanningProblem(1, start, GoalRegion([CustomState(time_step=Interval(*self.window), **place)]))


def _initial(x_m: float, speed_mps: float) -> InitialState:
    return InitialState(
        time_step=0,
        position=np.array([x_m, 0.0]),
        orientation=0.0,
        velocity=speed_mps,
        acceleration=0.0,
        yaw_rate=0.0,
        slip_angle=0.0,
    )


def _leader(number: int, at_m: float, leaves: int, comes_mps: float) -> DynamicObstacle:
    """Return a car that stands at a place until a step and then leaves; it may arrive at a speed and brake there."""
    brakes_s = comes_mps / _BRAKES_MPS2
    stops_s = leaves * _STEP_S - _STANDS_S
    places, speeds = [], []
    for step in range(_STEPS + 1):
        time_s = step * _STEP_S
        gone_s = max(time_s - leaves * _STEP_S, 0.0)
        grows_s = min(gone_s, _LIMIT_MPS / _ACCELERATION_MPS2)
        ahead_m = _ACCELERATION_MPS2 * grows_s**2 / 2 + _LIMIT_MPS * (gone_s - grows_s)
        speed = _ACCELERATION_MPS2 * grows_s
        if comes_mps and time_s < stops_s:
            left_s = stops_s - time_s
            braking_s = min(left_s, brakes_s)
            speed = _BRAKES_MPS2 * braking_s
            ahead_m = -(_BRAKES_MPS2 * braking_s**2 / 2 + comes_mps * (left_s - braking_s))
        places.append(at_m + ahead_m)
        speeds.append(speed)
    states = [
        CustomState(time_step=step, position=np.array([places[step], 0.0]), orientation=0.0, velocity=speeds[step])
        for step in range(1, _STEPS + 1)
    ]
    start = _initial(places[0], speeds[0])
    return DynamicObstacle(number, ObstacleType.CAR, _CAR, start, TrajectoryPrediction(Trajectory(1, states), _CAR))


def cases(seed: int, count: int) -> list[Case]:
    """Return drawn cases, the kinds in turn."""
    draw = random.Random(f"{seed}: restarts")  # noqa: S311 - a sample
    kinds: tuple[Callable[[random.Random], Case], ...] = (_stands, _red_light, _queue, _late, _no_place, _brakes)
    return [kinds[number % len(kinds)](draw) for number in range(count)]


def _stands(draw: random.Random) -> Case:
    at_m = draw.uniform(30.0, 80.0)
    return Case(
        "leader", ((at_m, draw.randint(155, 230)),), draw.uniform(4, 12), (120, 180), at_m + draw.uniform(20, 80)
    )


def _red_light(draw: random.Random) -> Case:
    at_m = draw.uniform(30.0, 80.0)
    green = draw.randint(150, 220)
    return Case("red light", ((at_m, green),), draw.uniform(4, 12), (100, 180), at_m + draw.uniform(20, 80))


def _queue(draw: random.Random) -> Case:
    at_m, leaves = draw.uniform(30.0, 60.0), draw.randint(140, 190)
    leaders = tuple((at_m + 7.0 * place, leaves - 12 * place) for place in range(3))
    return Case("queue", leaders, draw.uniform(4, 12), (110, 170), at_m + draw.uniform(40, 90))


def _late(draw: random.Random) -> Case:
    at_m = draw.uniform(8.0, 14.0)
    return Case("late", ((at_m, draw.randint(105, 125)),), 0.0, (20, 110), at_m + draw.uniform(60, 120))


def _no_place(draw: random.Random) -> Case:
    at_m = draw.uniform(30.0, 80.0)
    over = 300
    return Case("no place", ((at_m, draw.randint(120, 200)),), draw.uniform(4, 12), (over - 5, over), None)


def _brakes(draw: random.Random) -> Case:
    comes_mps, leaves = draw.uniform(5.0, 8.0), draw.randint(190, 220)
    coming_s = leaves * _STEP_S - _STANDS_S
    at_m = draw.uniform(15.0, 25.0) + comes_mps * (coming_s - comes_mps / _BRAKES_MPS2 / 2)
    return Case("brakes", ((at_m, leaves),), comes_mps, (120, 180), at_m + draw.uniform(20, 60), comes_mps)


def drives_on(case: Case, planner: str) -> tuple[bool, bool]:
    """Return whether the ego stood, and whether it drives again in time after the road is free."""
    configuration = named_configuration(f"{planner}:Default")
    if configuration is None:
        raise RuntimeError(f"{planner}:Default is missing")
    run = simulate(case.scenario(), case.problem(), configuration, make_planner(planner), "constant_velocity", silent)
    speeds = np.array([state.speed_mps for state in run.states])
    places = np.array([float(state.position[0]) for state in run.states])
    free, until = case.free_step, case.free_step + round(_IN_S / _STEP_S)
    stood = bool((speeds[: free + 1] < _STANDING_MPS).any())
    after: Any = slice(free, until + 1)
    if len(speeds) <= free:
        return stood, False
    drives = bool(speeds[after].max() >= _DRIVING_MPS and places[after].max() - places[free] >= _DRIVEN_M)
    return stood, drives


def measure(bench: SeededBench) -> Figures:
    """Drive all cases with all planners."""
    drawn = cases(bench.seed, bench.limit or CASES)
    found = [(planner, case.kind, *drives_on(case, planner)) for planner in PLANNERS for case in drawn]
    figures: dict[str, float] = {"restarts": share(stood and drives for _, _, stood, drives in found)}
    for planner in PLANNERS:
        figures[f"restarts_{planner}"] = share(one[2] and one[3] for one in found if one[0] == planner)
    for kind in sorted({one[1] for one in found}):
        figures[f"restarts_{kind.replace(' ', '_')}"] = share(one[2] and one[3] for one in found if one[1] == kind)
    figures["restarts_stood"] = share(one[2] for one in found)
    return {**figures, "restarts_runs": len(found)}
