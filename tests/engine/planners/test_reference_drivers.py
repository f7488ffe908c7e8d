"""Reference drivers as planners: they keep the contract, brake as their models say, and know nothing else."""

from typing import Any

import numpy as np
import pytest
from support.planning import FAR, configuration, drive_on_road, moving_car, parked_car, task_on_road

from plannerforge.engine.planners.external.conformance import check_planner
from plannerforge.engine.planners.interface import Observation, PlanningTask
from plannerforge.engine.planners.reference_drivers.models import (
    CAR_BRAKES,
    HEAVY_BRAKES,
    CarefulDriver,
    FuzzyDriver,
    Moment,
    RssDriver,
    Seen,
    brakes_of,
)
from plannerforge.engine.planners.registry import make_planner
from plannerforge.engine.vehicles.models import BMW_320I

ORIGIN = np.zeros(2)
DRIVERS = ("r157_careful", "fsm", "rss", "full_braking", "keep_lane")


def task_for(name: str, speed: float, *obstacles: Any) -> tuple[PlanningTask, Observation]:
    return task_on_road(configuration(name), speed, *obstacles)


def driven(name: str, *obstacles: Any, changes: tuple[str, ...] = (), goal: Any = FAR) -> Any:
    config = configuration(name, *changes)
    return drive_on_road(make_planner(config.planner), config, *obstacles, goal=goal)


@pytest.mark.parametrize("name", DRIVERS)
@pytest.mark.parametrize("speed", [0.0, 10.0])
def test_it_keeps_the_contract(name: str, speed: float) -> None:
    task, observation = task_for(name, speed, parked_car(7, (40.0, 0.0)))
    assert check_planner(lambda: make_planner(name), task, observation) == ()


@pytest.mark.parametrize("name", ["r157_careful", "fsm", "rss"])
@pytest.mark.parametrize("preset", ["Default", "Verdict"])
def test_it_stops_before_a_standing_car(name: str, preset: str) -> None:
    run = driven(f"{name}:{preset}", parked_car(7, (60.0, 0.0)), changes=())
    assert run.final.outcome == "timeout"
    assert run.states[-1].position[0] < 60.0 - 2.25 - BMW_320I.length_m / 2


def test_a_driver_that_keeps_lane_and_speed_collides() -> None:
    run = driven("keep_lane", parked_car(7, (60.0, 0.0)))
    assert run.final.outcome == "collision"
    assert run.states[-1].speed_mps == pytest.approx(run.states[0].speed_mps, abs=1e-6)


def test_full_braking_begins_at_once_and_ends_standing() -> None:
    run = driven("full_braking")
    assert run.states[-1].speed_mps == 0.0
    felt = np.diff([state.speed_mps for state in run.states]) / 0.1
    assert felt.min() == pytest.approx(-CAR_BRAKES.full_mps2, abs=0.01)
    assert felt[0] == pytest.approx(-CAR_BRAKES.jerk_mps3 * 0.1, abs=0.01)


def test_the_careful_driver_reaches_its_goal_on_a_free_road_and_behind_others() -> None:
    assert driven("r157_careful").final.outcome == "goal_reached"
    behind = driven("r157_careful", moving_car(7, (40.0, 0.0), (9.0, 0.0), 150))
    assert behind.final.outcome == "goal_reached"


def brakes_at(*changes: str) -> int:
    run = driven("r157_careful:Verdict", parked_car(7, (60.0, 0.0)), changes=changes)
    return int(next(state.step for state in run.states if state.speed_mps < run.states[0].speed_mps - 0.1))


def test_a_longer_delay_brakes_later() -> None:
    assert brakes_at("delay_s=1.5") - brakes_at() == pytest.approx(7.5, abs=3)


def seen(gap_m: float, along_mps: float, aside_m: float = -1.0, slowing: float = 0.0, nearing: float = 0.0) -> Seen:
    return Seen(1, gap_m, gap_m + 9.0, aside_m, nearing, along_mps, slowing)


def first_braking_s(driver: Any, speed: float, course: Any) -> float | None:
    """When a driver first brakes that keeps its speed and sees ``course(time)``."""
    memory = driver.begin()
    for index in range(100):
        memory, wanted = driver.react(memory, Moment(index * 0.1, speed, 0.0, (course(index * 0.1),)))
        if wanted is not None:
            return round(index * 0.1, 9)
    return None


def test_the_careful_driver_brakes_1_15_s_after_its_leader_brakes_hard() -> None:
    def leader(time_s: float) -> Seen:
        braked = max(time_s - 1.0, 0.0)
        return seen(20.0 - 3.0 * braked**2, 20.0 - 6.0 * braked, slowing=6.0 if time_s >= 1.0 else 0.0)

    # perceived 0.4 s after it exceeds 5 m/s², braking 0.75 s later, on steps of 0.1 s
    assert first_braking_s(CarefulDriver(), 20.0, leader) == pytest.approx(2.2)


def test_the_careful_driver_leaves_one_alone_that_is_far_ahead_in_time() -> None:
    assert first_braking_s(CarefulDriver(), 10.0, lambda _: seen(60.0, 9.0)) is None
    assert first_braking_s(CarefulDriver(), 20.0, lambda _: seen(100.0, 20.0, slowing=6.0)) is None


def test_the_careful_driver_notices_a_cut_in_after_0_375_m() -> None:
    def cutting_in(time_s: float) -> Seen:
        return seen(12.0 - 10.0 * time_s, 10.0, aside_m=1.6 - time_s, nearing=1.0)

    # 0.375 m at 1 m/s are passed in 0.4 s; perceived at 0.8 s; braking at 1.6 s (0.75 s on steps of 0.1 s)
    assert first_braking_s(CarefulDriver(), 20.0, cutting_in) == pytest.approx(1.6)


def test_the_fuzzy_metrics_match_their_definition() -> None:
    driver = FuzzyDriver()
    # v = 20, u = 20: safe 15 + 50 − 28.57 + 2 = 38.43, unsafe 15 + 33.33 − 28.57 = 19.76, both beyond 2 m
    assert driver.unsafe_share(40.5, 20.0, 20.0) == 0.0
    assert driver.unsafe_share(21.7, 20.0, 20.0) == 1.0
    assert driver.unsafe_share(2.0 + (38.43 + 19.76) / 2, 20.0, 20.0) == pytest.approx(0.5, abs=1e-3)
    # closing at 10 without acceleration: safe 7.5 + 12.5, unsafe 7.5 + 8.33
    assert driver.critical_share(20.1, 20.0, 10.0, 0.0) == 0.0
    assert driver.critical_share(15.8, 20.0, 10.0, 0.0) == 1.0


def test_the_safe_distances_of_rss_match_their_definition() -> None:
    driver = RssDriver()
    assert driver.safe_distance_m(20.0, 20.0) == pytest.approx(15.0 + 50.0 - 25.0)
    assert driver.safe_distance_m(10.0, -10.0) == pytest.approx(2 * (7.5 + 12.5))
    assert driver.safe_aside_m(1.0) == pytest.approx(0.3 + 1.375 * 0.75 + 1.75**2 / 2)
    assert driver.safe_aside_m(-1.0) == 0.0


def test_trucks_and_buses_brake_by_less_than_cars() -> None:
    assert brakes_of("car") is CAR_BRAKES
    assert brakes_of("truck") is brakes_of("bus") is HEAVY_BRAKES
    assert HEAVY_BRAKES.full_mps2 < CAR_BRAKES.full_mps2
    assert HEAVY_BRAKES.build_up_s > CAR_BRAKES.build_up_s
