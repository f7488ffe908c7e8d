"""MP-RBFN: its primitives are motions of the single-track model, and its planner does what its channels ask."""

from typing import Any

import numpy as np
import pytest
from support.planning import (
    FAR,
    configuration,
    drive_on_road,
    first_plan,
    goal_state,
    moving_car,
    parked_car,
    rectangle_at,
    scenario_on,
    straight_road,
    task_on_road,
)

from plannerforge.engine.planners.driving.drivability import violated_limit
from plannerforge.engine.planners.external.conformance import check_planner
from plannerforge.engine.planners.interface import EgoState, Observation, Plan, PlanningTask
from plannerforge.engine.planners.lanes import build_road
from plannerforge.engine.planners.prediction import constant_velocity, observe
from plannerforge.engine.planners.rbfn.candidates import PathTable
from plannerforge.engine.planners.rbfn.costs import CHANNELS, ChannelBatch, RoadEdge
from plannerforge.engine.planners.rbfn.network import (
    Motions,
    PrimitiveEnds,
    PrimitiveNetwork,
    driven_poses,
    motion_primitives,
)
from plannerforge.engine.planners.rbfn.planner import RadialBasisPrimitives
from plannerforge.engine.planners.registry import make_planner
from plannerforge.engine.planners.traffic.recorded import RecordedTraffic
from plannerforge.engine.tuning.tunings import tuning_of
from plannerforge.engine.vehicles.models import BMW_320I

ORIGIN = np.zeros(2)
NETWORK = PrimitiveNetwork.shipped()
TIMES = np.linspace(0.0, 3.0, 301)
BESIDE = {"x": 24.0, "y": 3.0, "turn": 0.1, "curvature": 0.01, "speed": 10.0}


def made(speed: float = 8.0, curvature: float = -0.01, duration: float = 2.7, **end: float) -> tuple[Motions, Any]:
    values = BESIDE | end
    keys = ("x", "y", "turn", "curvature", "speed")
    ends = PrimitiveEnds(np.array([duration]), *(np.array([values[key]]) for key in keys))
    return motion_primitives(NETWORK, speed, curvature, ends, TIMES[: round(duration / 0.01) + 1])


def rows(motions: Motions) -> tuple[Any, ...]:
    return tuple(values[0] for values in vars(motions).values())


def test_a_primitive_begins_and_ends_as_requested() -> None:
    x, y, heading, speed, curvature = rows(made()[0])
    assert (x[0], y[0], heading[0], speed[0], curvature[0]) == pytest.approx((0.0, 0.0, 0.0, 8.0, -0.01))
    assert (x[-1], y[-1], heading[-1]) == pytest.approx((24.0, 3.0, 0.1), abs=1e-6)
    assert (speed[-1], curvature[-1]) == pytest.approx((10.0, 0.01))


def test_a_primitive_is_a_motion_of_the_single_track_model() -> None:
    x, y, heading, speed, curvature = rows(made()[0])
    along, across = np.gradient(x, TIMES[1]), np.gradient(y, TIMES[1])
    inner = slice(2, -2)
    assert np.hypot(along, across)[inner] == pytest.approx(speed[inner], abs=0.03)
    assert np.arctan2(across, along)[inner] == pytest.approx(heading[inner], abs=0.003)
    assert np.gradient(heading, TIMES[1])[inner] == pytest.approx((speed * curvature)[inner], abs=0.01)


def test_the_network_s_error_before_closing_is_small() -> None:
    inputs = np.array([[0.9, -0.2, 0.1, 0.1, 0.2, 1.12], [1.5, 0.5, 0.4, 0.8, 0.6, 0.6]])
    x, y, heading = driven_poses(*NETWORK.profiles(inputs))
    assert np.hypot(x[:, -1] - np.cos(inputs[:, 2]), y[:, -1] - np.sin(inputs[:, 2])).max() < 0.005
    assert np.abs(heading[:, -1] - inputs[:, 3]).max() < 0.01


def test_a_mirrored_end_gives_the_mirrored_primitive() -> None:
    x, y, heading, speed, curvature = rows(made()[0])
    ends = PrimitiveEnds(*(np.array([value]) for value in (2.7, 24.0, -3.0, -0.1, -0.01, 10.0)))
    other = rows(motion_primitives(NETWORK, 8.0, 0.01, ends, TIMES[:271])[0])
    for mine, theirs, side in zip((x, y, heading, speed, curvature), other, (1, -1, -1, 1, -1), strict=True):
        assert theirs == pytest.approx(side * mine, abs=1e-5)


def test_ends_that_were_not_learnt_are_reported() -> None:
    assert made()[1].tolist() == [True]
    assert made(y=30.0)[1].tolist() == [False]
    assert made(speed=30.0)[1].tolist() == [False]


def test_the_table_of_a_path_knows_a_circle() -> None:
    angle = np.linspace(0.0, 2.0, 60)
    table = PathTable(20.0 * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1))
    _, _, heading, curvature = table.at(np.array([20.0]))[0]
    assert (heading, curvature) == pytest.approx((1.0, 0.05), abs=1e-3)
    station, offset, _ = table.coordinates(np.array([0.0]), np.array([2.0]), np.array([3.0]))
    assert (station[0], offset[0]) == pytest.approx((0.0, 2.0), abs=0.02)


def task_for(speed: float, *obstacles: Any, goal: Any = FAR, changes: tuple[str, ...] = ()) -> Any:
    return task_on_road(configuration("mp_rbfn", *changes), speed, *obstacles, goal=goal)


def planned(task: PlanningTask, observation: Observation) -> Plan:
    return first_plan(RadialBasisPrimitives(NETWORK), task, observation)


def driven_run(*obstacles: Any, changes: tuple[str, ...] = (), **options: Any) -> Any:
    return drive_on_road(RadialBasisPrimitives(NETWORK), configuration("mp_rbfn", *changes), *obstacles, **options)


@pytest.mark.parametrize("speed", [0.0, 0.2, 10.0])
def test_it_keeps_the_contract(speed: float) -> None:
    for goal in (FAR, goal_state((40, 60), rectangle_at(60.0, 3.5))):
        task, observation = task_for(speed, parked_car(7, (40.0, 0.0)), goal=goal)
        assert check_planner(lambda: make_planner("mp_rbfn"), task, observation) == ()


def test_its_motion_is_drivable() -> None:
    task, observation = task_for(12.0, parked_car(7, (30.0, 0.0)))
    trajectory = planned(task, observation).trajectory
    assert trajectory is not None
    assert violated_limit(trajectory, BMW_320I, 0.1) is None


def test_it_reaches_a_goal_on_the_next_lane() -> None:
    run = driven_run(goal=goal_state((40, 70), rectangle_at(60.0, 3.5)), lanes=2)
    assert run.final.outcome == "goal_reached"
    assert max(abs(state.yaw_rate_radps) for state in run.states) < 0.5


def test_it_swerves_around_a_parked_car_and_returns() -> None:
    run = driven_run(parked_car(7, (50.0, -0.6)), lanes=2)
    assert run.final.outcome == "goal_reached"
    assert max(state.position[1] for state in run.states) > 1.0
    assert abs(run.states[-1].position[1]) < 0.3


def test_it_stops_at_a_closed_road_and_stays() -> None:
    run = driven_run(parked_car(7, (60.0, 0.0)))
    assert run.final.outcome == "timeout"
    assert run.states[-1].speed_mps < 0.2  # it still closes the last half metre of the gap
    assert run.states[-1].position[0] > 45.0


def test_it_starts_from_a_stand() -> None:
    assert (
        driven_run(speed_mps=0.0, goal=goal_state((100, 120), rectangle_at(60.0, 0.0))).final.outcome == "goal_reached"
    )


def test_it_keeps_behind_a_slower_car() -> None:
    run = driven_run(moving_car(7, (20.0, 0.0), (5.0, 0.0)), goal=goal_state((60, 65), rectangle_at(100.0, 0.0)))
    assert run.final.outcome != "collision"
    assert run.states[60].speed_mps < 7.0


def test_channels_are_the_weights_in_their_order() -> None:
    tuning = tuning_of("mp_rbfn")
    assert list(CHANNELS) == list(tuning.weights)
    assert [preset.short_name for preset in tuning.presets.values()] == [
        "Default",
        "Comfort",
        "Balanced",
        "Sporty",
        "Safety",
    ]


def test_a_channel_counts_only_with_a_weight() -> None:
    none = tuple(f"{name}=0" for name in CHANNELS)
    assert not planned(*task_for(10.0, changes=none)).costs
    assert set(planned(*task_for(10.0, changes=(*none, "prediction=1", "orientation_offset=2"))).costs) == {
        "prediction",
        "orientation_offset",
    }


def test_the_channels_of_two_candidates_match_a_manual_computation() -> None:
    scenario = scenario_on(straight_road(300.0, lanes=1), moving_car(7, (20.0, 0.0), (0.0, 0.0)))
    reference = task_for(10.0)[0].reference
    ego = EgoState(0, ORIGIN, 0.0, 10.0)
    obstacles = observe(RecordedTraffic(scenario), ego, constant_velocity, 30, 0.1)
    batch = ChannelBatch(
        steps=np.array([10, 20]),
        x_m=np.array([[5.0, 10.0], [5.0, 10.0]]),
        y_m=np.array([[0.0, 0.0], [0.3, 0.6]]),
        offset_m=np.array([[0.0, 0.0], [0.3, -0.6]]),
        turned_rad=np.array([[0.0, 0.0], [0.1, 0.05]]),
        final_mps=np.array([10.0, 12.0]),
        desired_mps=10.0,
        obstacles=obstacles,
        vehicle=BMW_320I,
        edge=RoadEdge(build_road(scenario.lanelet_network, reference)),
    )
    found = {name: channel(batch) for name, channel in CHANNELS.items()}
    assert found["distance_to_reference_path"] == pytest.approx([0.0, 0.45 / 3.0])
    assert found["distance_to_reference_path_final"] == pytest.approx([0.0, 0.6 / 3.0])
    assert found["velocity_offset_final"] == pytest.approx([0.0, 0.16])
    assert found["orientation_offset"] == pytest.approx([0.0, (0.04 + 0.01) / 2])
    assert found["orientation_offset_final"] == pytest.approx([0.0, 0.01])
    deviation = (obstacles[0].length_m + BMW_320I.length_m) / 4  # touching bodies are two deviations apart
    variance = deviation**2 + float(np.broadcast_to(obstacles[0].covariance, (31, 2, 2))[20, 0, 0])
    assert found["prediction"][0] == pytest.approx(4.0 * variance / 10.0**2)
    clearances = [1.75 - y - BMW_320I.width_m / 2 for y in (0.0, 0.3, 0.6)]
    first, second, third = (min((0.5 / clearance) ** 2, 1.0) for clearance in clearances)
    assert found["distance_to_boundary"] == pytest.approx([first, (second + third) / 2], rel=0.05)
