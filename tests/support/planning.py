"""Small CommonRoad scenarios made in code, for tests of planners."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from commonroad.common.util import AngleInterval, Interval
from commonroad.geometry.shape import Rectangle
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType, StaticObstacle
from commonroad.scenario.scenario import Scenario
from commonroad.scenario.state import CustomState, InitialState
from commonroad.scenario.trajectory import Trajectory

from plannerforge.engine.planners import safety
from plannerforge.engine.planners.driving.following import FollowedPlan
from plannerforge.engine.planners.frenetix import planner as frenetix_planner
from plannerforge.engine.planners.frenetix.planner import Frenetix
from plannerforge.engine.planners.interface import EgoState, Observation, Plan, PlanningTask
from plannerforge.engine.planners.lanes import build_road
from plannerforge.engine.planners.prediction import constant_velocity, observe
from plannerforge.engine.planners.reference_path import build_reference_path
from plannerforge.engine.planners.simulation import DrivenRun, simulate
from plannerforge.engine.planners.traffic.recorded import RecordedTraffic
from plannerforge.engine.scene.routing import find_route
from plannerforge.engine.tuning.configurations import changed_configuration, named_configuration
from plannerforge.engine.vehicles.models import BMW_320I
from plannerforge.schemas.planning import PlannerConfiguration
from plannerforge.schemas.runs import Prediction

LANE_WIDTH_M = 3.5


def as_planned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drive Frenetix's plans unchanged, even if a vehicle cannot."""
    for module in (safety, frenetix_planner):
        monkeypatch.setattr(module, "follow", lambda plan, *_: FollowedPlan(plan, 0.0, within_tyres=True))


def rotation(angle_rad: float) -> Any:
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])


def network_of(*lanelets: Lanelet) -> LaneletNetwork:
    return LaneletNetwork.create_from_lanelet_list(list(lanelets))


def lanelet_along(center: Any, lanelet_id: int, width_m: float = LANE_WIDTH_M, **links: Any) -> Lanelet:
    """Return a lanelet around a centre line of shape (n, 2)."""
    along = np.gradient(center, axis=0)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
    half = width_m / 2 * normal
    return Lanelet(center + half, center, center - half, lanelet_id, **links)


def straight_road(length_m: float = 200.0, lanes: int = 1, angle_rad: float = 0.0) -> LaneletNetwork:
    """Return parallel lanes, ids 1 (rightmost, through the origin) to ``lanes``, with the angle as heading."""
    made = []
    for lane in range(lanes):
        x = np.linspace(-20.0, length_m - 20.0, int(length_m / 5) + 1)
        center = np.stack([x, np.full_like(x, lane * LANE_WIDTH_M)], axis=1) @ rotation(angle_rad).T
        left, right = (lane + 2 if lane + 1 < lanes else None), (lane if lane > 0 else None)
        made.append(
            lanelet_along(
                center,
                lane + 1,
                adjacent_left=left,
                adjacent_left_same_direction=True if left else None,
                adjacent_right=right,
                adjacent_right_same_direction=True if right else None,
            )
        )
    return network_of(*made)


def scenario_on(network: LaneletNetwork, *obstacles: Any, step_s: float = 0.1) -> Scenario:
    scenario = Scenario(dt=step_s)
    scenario.add_objects(network)
    scenario.add_objects(list(obstacles))
    return scenario


def moving_car(
    obstacle_id: int, start: Sequence[float], velocity: Sequence[float], steps: int = 100
) -> DynamicObstacle:
    """Return a car in straight uniform motion from step 0 on."""
    speed = math.hypot(*velocity)
    heading = math.atan2(velocity[1], velocity[0])
    positions = np.array(start) + np.arange(steps + 1)[:, None] * 0.1 * np.array(velocity)
    states = [
        CustomState(time_step=i, position=positions[i], orientation=heading, velocity=speed)
        for i in range(1, steps + 1)
    ]
    shape = Rectangle(4.5, 1.8)
    initial = _initial(positions[0], heading, speed)
    return DynamicObstacle(
        obstacle_id, ObstacleType.CAR, shape, initial, TrajectoryPrediction(Trajectory(1, states), shape)
    )


def parked_car(obstacle_id: int, position: Sequence[float], heading_rad: float = 0.0) -> StaticObstacle:
    state = _initial(np.array(position, dtype=float), heading_rad, 0.0)
    return StaticObstacle(obstacle_id, ObstacleType.PARKED_VEHICLE, Rectangle(4.5, 1.8), state)


def goal_state(
    steps: tuple[int, int],
    position: Any = None,
    speed: tuple[float, float] | None = None,
    heading: tuple[float, float] | None = None,
) -> CustomState:
    values: dict[str, Any] = {"time_step": Interval(*steps)}
    if position is not None:
        values["position"] = position
    if speed is not None:
        values["velocity"] = Interval(*speed)
    if heading is not None:
        values["orientation"] = AngleInterval(*heading)
    return CustomState(**values)


def rectangle_at(x: float, y: float, angle_rad: float = 0.0, size: tuple[float, float] = (12.0, 3.5)) -> Rectangle:
    return Rectangle(*size, center=rotation(angle_rad) @ np.array([x, y]), orientation=angle_rad)


def problem_for(
    *goals: CustomState,
    speed_mps: float = 10.0,
    angle_rad: float = 0.0,
    position: Sequence[float] = (0.0, 0.0),
    lanelets: dict[int, list[int]] | None = None,
    askew_rad: float = 0.0,
) -> PlanningProblem:
    """Return an ego at a position, with the angle or another one as heading."""
    state = _initial(rotation(angle_rad) @ np.array(position), angle_rad + askew_rad, speed_mps)
    return PlanningProblem(1000, state, GoalRegion(list(goals), lanelets))


def configuration(name: str = "frenetix:Default", *changes: str) -> PlannerConfiguration:
    base = named_configuration(name)
    assert base is not None
    return changed_configuration(base, None, changes)[0]


def drive(
    scenario: Scenario,
    problem: PlanningProblem,
    config: PlannerConfiguration | None = None,
    prediction: Prediction = "constant_velocity",
    planner: Any = None,
) -> DrivenRun:
    return simulate(scenario, problem, config or configuration(), planner or Frenetix(), prediction, lambda *_: None)


FAR = goal_state((90, 100), rectangle_at(100.0, 0.0))
"""A goal on the rightmost lane, as far as an ego at 10 m/s comes in its time."""


def task_on_road(
    config: PlannerConfiguration, speed_mps: float, *obstacles: Any, goal: CustomState = FAR, lanes: int = 2
) -> tuple[PlanningTask, Observation]:
    """Return a task on a straight road, and the initial observation of an ego at the origin."""
    scenario = scenario_on(straight_road(300.0, lanes=lanes), *obstacles)
    problem, network, origin = problem_for(goal, speed_mps=speed_mps), scenario.lanelet_network, np.zeros(2)
    route = find_route(network, problem.goal, origin, 0.0, ahead_m=120.0)
    reference = build_reference_path(network, route, origin, speed_mps)
    task = PlanningTask(network, problem, config, reference, build_road(network, reference), BMW_320I, 0.1)
    ego = EgoState(0, origin, 0.0, speed_mps)
    return task, Observation(ego, observe(RecordedTraffic(scenario), ego, constant_velocity, 30, 0.1))


def drive_on_road(
    planner: Any, config: PlannerConfiguration, *obstacles: Any, goal: CustomState = FAR, lanes: int = 1, **problem: Any
) -> DrivenRun:
    """Drive a planner on a straight road among obstacles."""
    scenario = scenario_on(straight_road(300.0, lanes=lanes), *obstacles)
    return drive(scenario, problem_for(goal, **problem), config, planner=planner)


def first_plan(planner: Any, task: PlanningTask, observation: Observation) -> Plan:
    """Return a planner's plan at the start of a task."""
    planner.reset(task)
    plan: Plan = planner.plan(observation)
    return plan


def _initial(position: Any, heading_rad: float, speed_mps: float) -> InitialState:
    return InitialState(
        time_step=0,
        position=np.array(position, dtype=float),
        orientation=heading_rad,
        velocity=speed_mps,
        acceleration=0.0,
        yaw_rate=0.0,
        slip_angle=0.0,
    )
