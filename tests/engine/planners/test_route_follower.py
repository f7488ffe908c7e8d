"""A planner of one's own in two lines: it follows its route at the speed that it asks for."""

import dataclasses

import numpy as np
import pytest
from support.planning import configuration, drive_on_road, task_on_road

from plannerforge.engine.planners import Observation, Plan, PlanningTask, RouteFollower
from plannerforge.engine.planners.external.conformance import check_planner


class Steady:
    """Drives along its route at one speed."""

    def __init__(self, speed_mps: float) -> None:
        self.speed_mps = speed_mps

    def reset(self, task: PlanningTask) -> None:
        self.route = RouteFollower(task)

    def plan(self, observation: Observation) -> Plan:
        return Plan(self.route.trajectory(observation.ego, self.speed_mps))


@pytest.mark.parametrize("speed_mps", [0.0, 0.5, 10.0])
@pytest.mark.parametrize("target_mps", [0.0, 8.0])
def test_its_motions_keep_the_contract(speed_mps: float, target_mps: float) -> None:
    task, observation = task_on_road(configuration("idm"), speed_mps)
    assert check_planner(lambda: Steady(target_mps), task, observation) == ()


def test_the_speed_is_reached_and_kept() -> None:
    task, observation = task_on_road(configuration("idm"), 10.0)
    slower = RouteFollower(task).trajectory(observation.ego, 4.0, deceleration_mps2=3.0)
    assert slower is not None
    faster = RouteFollower(task).trajectory(observation.ego, 12.0, acceleration_mps2=1.0)
    assert faster is not None
    assert slower.speeds_mps[[0, 10, 20, 30]].tolist() == pytest.approx([10.0, 7.0, 4.0, 4.0])
    assert faster.speeds_mps[[0, 10, 20, 30]].tolist() == pytest.approx([10.0, 11.0, 12.0, 12.0])
    way_m = np.linalg.norm(np.diff(faster.positions, axis=0), axis=1).sum()
    assert way_m == pytest.approx(np.trapezoid(faster.speeds_mps, dx=0.1), abs=0.05)


def test_an_ego_off_its_route_is_led_back_to_it() -> None:
    task, observation = task_on_road(configuration("idm"), 10.0)
    beside = dataclasses.replace(observation.ego, position=np.array([0.0, 1.2]), heading_rad=0.1)
    motion = RouteFollower(task).trajectory(beside, 10.0, horizon_s=5.0)
    assert motion is not None
    assert motion.positions[0].tolist() == pytest.approx([0.0, 1.2])
    assert motion.headings_rad[0] == pytest.approx(0.1)
    assert abs(motion.positions[-1, 1]) < 0.05


def test_it_drives_to_its_goal() -> None:
    assert drive_on_road(Steady(10.0), configuration("idm")).verdict.outcome == "goal_reached"
