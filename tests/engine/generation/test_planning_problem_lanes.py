from typing import cast

import numpy as np
import pytest
from support.roads import network_of_streets, street

from plannerforge.engine.generation.planning_problem import TaskSpec, choose_task, follows_smooth_lanes
from plannerforge.engine.generation.sites import SiteFocus
from plannerforge.engine.geometry.polyline import Points, headings
from plannerforge.engine.network.road_network import LaneletLookup
from plannerforge.engine.traffic.motions import GeneratedVehicle
from plannerforge.engine.vehicles.classes import vehicle_classes
from plannerforge.engine.vehicles.motion import Motion
from plannerforge.schemas.generation import RequestedEgo, RequestedGoal

ALONG_M = np.arange(0.0, 121.0)


def road_with_jog(aside_m: float, on_m: float) -> Points:
    """Straight on, with a jog to the left in the middle: so far aside on so many metres."""
    return np.stack([ALONG_M, aside_m * np.clip((ALONG_M - 60.0) / on_m, 0.0, 1.0)], axis=1)


def driven(line: Points, speed_mps: float) -> GeneratedVehicle:
    """A car that drives along a line, at most 10 s, as smoothly as recorded cars do."""
    positions = np.stack([speed_mps * 0.1 * np.arange(100), np.zeros(100)], axis=1)
    positions[:, 1] = np.interp(positions[:, 0], line[:, 0], line[:, 1])
    positions = positions[positions[:, 0] < 115.0]
    turned = np.append(headings(positions), 0.0)
    speeds = np.full(len(positions), speed_mps)
    return GeneratedVehicle("1", vehicle_classes()["car"], Motion(positions, turned, speeds, speeds * 0.0), True)


@pytest.mark.parametrize(
    ("aside_m", "on_m", "speed_mps", "smooth"),
    [(0.0, 1.0, 13.0, True), (1.5, 30.0, 13.0, True), (1.5, 4.0, 13.0, False), (1.5, 4.0, 3.0, True)],
    ids=["straight", "a long shift", "a jog", "a jog, slowly"],
)
def test_lanes_with_a_jog_cannot_be_followed_at_speed(
    aside_m: float, on_m: float, speed_mps: float, smooth: bool
) -> None:
    line = road_with_jog(aside_m, on_m)
    roads = network_of_streets(street(1, line))
    car = driven(line, speed_mps)
    assert follows_smooth_lanes(car, len(car.motion.positions) - 1, roads, LaneletLookup(roads)) is smooth


def test_a_jog_behind_the_goal_or_before_the_start_does_not_count() -> None:
    line = road_with_jog(1.5, 4.0)
    roads = network_of_streets(street(1, line))
    lookup = LaneletLookup(roads)
    assert follows_smooth_lanes(driven(line, 13.0), 20, roads, lookup)
    late = driven(line, 13.0)
    motion = Motion(
        late.motion.positions[60:], late.motion.headings_rad[60:], late.motion.speeds_mps[60:], np.zeros(30)
    )
    assert follows_smooth_lanes(GeneratedVehicle("1", late.vehicle_class, motion, True), 20, roads, lookup)


def test_a_corner_where_one_lanelet_follows_on_another_counts() -> None:
    line = road_with_jog(1.5, 4.0)
    roads = network_of_streets(street(1, line[:63], (2,)), street(2, line[62:]))
    car = driven(line, 13.0)
    assert not follows_smooth_lanes(car, len(car.motion.positions) - 1, roads, LaneletLookup(roads))


class WholeRoad:
    """A focus that every path passes, and leaves behind 60 m."""

    ways = None
    parts = 1

    @staticmethod
    def parts_passed(car: GeneratedVehicle, step: int) -> int:
        return 1

    @staticmethod
    def takes_street(car: GeneratedVehicle, last_step: int) -> bool:
        return True

    @staticmethod
    def is_on_spot(car: GeneratedVehicle, step: int) -> bool:
        return "beside" not in car.vehicle_id

    @staticmethod
    def is_left_by(car: GeneratedVehicle, step: int) -> bool:
        return True


def held_up() -> GeneratedVehicle:
    """Drives at 13 m/s, but for a jog that it takes at 2 m/s."""
    line = road_with_jog(3.0, 3.0)
    x = np.concatenate([np.arange(0.0, 55.0, 1.3), np.arange(55.0, 67.0, 0.2), np.arange(67.0, 120.0, 1.3)])
    positions = np.stack([x, np.interp(x, line[:, 0], line[:, 1])], axis=1)
    speeds = np.append(np.diff(x) / 0.1, 13.0)
    motion = Motion(positions, np.append(headings(positions), 0.0), speeds, speeds * 0.0)
    return GeneratedVehicle("1", vehicle_classes()["car"], motion, True)


def test_a_jog_that_was_driven_slowly_cannot_be_followed_fast() -> None:
    roads = network_of_streets(street(1, road_with_jog(3.0, 3.0)))
    lookup = LaneletLookup(roads)
    assert follows_smooth_lanes(held_up(), 130, roads, lookup)
    assert follows_smooth_lanes(held_up(), 130, roads, lookup, least_mps=2.0)
    assert not follows_smooth_lanes(held_up(), 130, roads, lookup, least_mps=8.0)


def test_a_task_reports_lanes_that_cannot_be_followed_at_constant_speed() -> None:
    roads, focus = network_of_streets(street(1, road_with_jog(3.0, 3.0))), cast("SiteFocus", WholeRoad())
    through, steps = (
        choose_task(TaskSpec(RequestedGoal.of(goal), RequestedEgo(), 18.0), [held_up()], roads, focus, 0.1)
        for goal in ("through", "steps:130")
    )
    assert (through.followable, steps.followable) == (False, True)
