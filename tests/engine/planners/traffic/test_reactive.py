"""Reactive traffic: SUMO's vehicles see the ego, and what they did is what is judged, measured and kept."""

import math
import random
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.builders import Lane, Problem, ScenarioBuilder, Vehicle, crossing, driving, line, swinging_bus, town_road
from support.elsewhere import digest_of_run
from support.planning import configuration

from benchmarks.planners.reactive import BrakingPlanner, drawn_approach
from plannerforge.engine.commonroad.reader import LoadedScenario, read_scenario
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.registry import check_modes, open_traffic
from plannerforge.engine.planners.runs import run_planner
from plannerforge.engine.planners.simulation import DrivenRun, simulate
from plannerforge.engine.planners.traffic.reactive import is_insertion_safe
from plannerforge.engine.planners.traffic.recorded import RecordedTraffic
from plannerforge.engine.planners.traffic.roles import TrafficRoles
from plannerforge.engine.vehicles.models import BMW_320I
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.planning import RunRequest
from plannerforge.schemas.runs import Traffic

FAR = Problem(start=(60.0, 0.0, 0.0, 10.0), goal=(190.0, 0.0, 8.0, 3.0), steps=(60, 70))


def road(*vehicles: Vehicle, parked: tuple[Vehicle, ...] = (), problem: Problem = FAR) -> ScenarioBuilder:
    return replace(town_road(), vehicles=vehicles, parked=parked, problems=(problem,))


def loaded(builder: ScenarioBuilder, folder: Path) -> LoadedScenario:
    return read_scenario(builder.write(folder / "scenario.xml"))


def braked(scenario: LoadedScenario, traffic: Traffic, braking_mps2: float = 6.0) -> DrivenRun:
    problem = scenario.problem()
    with open_traffic(traffic, scenario, problem, BMW_320I, seed=0) as others:
        return simulate(
            scenario.scenario,
            problem,
            configuration(),
            BrakingPlanner(braking_mps2),
            "constant_velocity",
            silent,
            others,
        )


def request(builder: ScenarioBuilder, folder: Path, traffic: Traffic = "reactive") -> RunRequest:
    path = builder.write(folder / "scenario.xml")
    return RunRequest(
        run_id="run_0",
        scenario_path=str(path),
        scenario_id=builder.benchmark_id,
        configuration=configuration(),
        traffic=traffic,
    )


def test_a_reactive_follower_brakes_although_the_recorded_one_hits(tmp_path: Path) -> None:
    problem = Problem(start=(0.0, 0.0, 0.0, 10.0), goal=(55.0, 0.0, 4.0, 3.0), steps=(50, 60))
    one_lane = replace(crossing(), vehicles=(driving(32, (-25.0, 0.0), 10.0, 80),), problems=(problem,))
    scenario = loaded(one_lane, tmp_path)
    recorded, reactive = braked(scenario, "recorded"), braked(scenario, "reactive")
    assert recorded.final.collision is not None
    assert recorded.final.collision.obstacle_id == 32
    assert reactive.final.collision is None
    follower = reactive.traffic.driven[0]
    assert follower.speeds_mps[-1] < 0.5
    assert follower.positions[-1][0] < reactive.states[-1].position[0] - 4.5


def test_a_long_vehicle_that_starts_with_its_front_off_the_lanes_drives_on(tmp_path: Path) -> None:
    drive = braked(loaded(road(swinging_bus(37, 80)), tmp_path), "reactive")
    (bus,) = drive.traffic.driven
    assert bus.positions[-1][1] < -80.0  # lane 13 ends at -100


def test_an_ego_across_the_line_is_seen_from_both_lanes(tmp_path: Path) -> None:
    on_the_line = replace(FAR, start=(60.0, 1.75, 0.0, 10.0))
    places = (32, (28.0, 0.0)), (33, (28.0, 3.5))
    trucks = [driving(key, at, 10.0, 100, kind="truck", size_m=(8.0, 3.0)) for key, at in places]
    run = braked(loaded(road(*trucks, problem=on_the_line), tmp_path), "reactive")
    assert run.final.collision is None
    assert all(track.positions[-1][0] < run.states[-1].position[0] for track in run.traffic.driven)


@pytest.mark.parametrize("width_m", [2.5, 3.0])
def test_passing_an_ego_near_the_line_leaves_lateral_room(width_m: float, tmp_path: Path) -> None:
    near_the_line = replace(FAR, start=(60.0, 1.2, 0.0, 10.0))
    truck = driving(33, (28.0, 3.5), 10.0, 100, kind="truck", size_m=(8.0, width_m))
    run = braked(loaded(road(truck, problem=near_the_line), tmp_path), "reactive")
    driven, ego = run.traffic.driven[0], run.states[-1]
    beside = np.abs(driven.positions[:, 0] - ego.position[0]) < 6.0
    between_m = driven.positions[beside, 1] - width_m / 2 - (ego.position[1] + BMW_320I.width_m / 2)
    assert (between_m > 0.3).all()


def moving_aside(step: int, from_x_m: float) -> tuple[float, float]:
    """From the middle of lane 1 in two seconds to its left edge, and there it stands."""
    share = min(step, 20) / 20
    return from_x_m + 10.0 * share, 1.5 * share


def test_an_ego_that_comes_over_the_line_is_seen_from_the_next_lane(tmp_path: Path) -> None:
    truck = driving(33, (18.0, 3.5), 10.0, 100, kind="truck", size_m=(8.0, 3.0))
    scenario = loaded(road(truck), tmp_path)
    with open_traffic("reactive", scenario, scenario.problem(), BMW_320I, seed=0) as traffic:
        for step in range(1, 80):
            ego = EgoState(step, np.array(moving_aside(step, 60.0)), 0.0, 5.0 if step < 20 else 0.0)
            traffic.advance(ego)
            assert not traffic.hits(ego, BMW_320I)
    assert traffic.driven[0].positions[-1][0] + 4.0 < 70.0 - BMW_320I.length_m / 2


def test_a_replayed_vehicle_that_crosses_the_line_is_seen_from_the_next_lane(tmp_path: Path) -> None:
    truck = driving(33, (18.0, 3.5), 10.0, 100, kind="truck", size_m=(8.0, 3.0))
    poses = tuple((*moving_aside(step, 70.0), 0.0, 5.0 if step < 20 else 0.0) for step in range(100))
    walker = Vehicle(60, poses, kind="pedestrian", length_m=1.6, width_m=1.6)
    behind = replace(FAR, start=(5.0, 0.0, 0.0, 0.5))
    run = braked(loaded(road(walker, truck, problem=behind), tmp_path), "reactive")
    assert run.traffic.on_recording == (60,)
    assert run.traffic.driven[0].positions[-1][0] + 4.0 < 80.0 - 0.8


@pytest.mark.parametrize("follower", [driving(32, (-20.0, 0.0), 8.0, 80), driving(32, (-20.0, -0.8), 8.0, 80)])
def test_an_ego_at_a_merge_is_on_the_lane_of_its_follower(follower: Vehicle, tmp_path: Path) -> None:
    beside = ((-90.0, -6.0), (-45.0, -3.0), (-22.0, -1.0), (-10.0, -0.3), (0.0, 0.0))
    lanes = (
        Lane(1, line((-90, 0), (0, 0)), successors=(3,)),
        Lane(2, beside, successors=(3,)),
        Lane(3, line((0, 0), (2, 0)), predecessors=(1, 2), successors=(4,)),
        Lane(4, line((2, 0), (100, 0)), predecessors=(3,)),
    )
    problem = Problem(start=(1.0, 0.0, 0.0, 3.0), goal=(60.0, 0.0, 4.0, 3.0), steps=(50, 60))
    scenario = loaded(ScenarioBuilder(lanes, (follower,), problems=(problem,)), tmp_path)
    ego = EgoState.of(scenario.problem().initial_state)
    cast = TrafficRoles.of(scenario, ego.step)
    assert cast.ego_edges(scenario.problem().goal, ego)[0] == cast.driven[0].edges[0]


@pytest.mark.shared_data
@pytest.mark.parametrize(("name", "seed"), [("DEU_Backnang-5_1_T-1", 1173584164), ("ZAM_Zip-1_56_T-1", 2730695510)])
def test_followers_brake_by_sight_if_lanes_hide_the_ego(name: str, seed: int, shared_data: Path) -> None:
    scenario = drawn_approach(read_scenario(shared_data / "data/commonroad" / f"{name}.xml"), random.Random(seed))
    assert scenario is not None
    run = braked(scenario, "reactive")
    assert run.final.collision is None
    assert run.states[-1].speed_mps == 0.0


def test_a_driven_vehicle_begins_at_its_recorded_state(tmp_path: Path) -> None:
    scenario = loaded(road(driving(32, (25.0, 0.3), 10.0, 100), driving(33, (20.0, 3.5), 9.0, 60)), tmp_path)
    problem = scenario.problem()
    with open_traffic("reactive", scenario, problem, BMW_320I, seed=0) as traffic:
        for track in traffic.moving:
            assert len(track.positions) == 1
        for step in range(1, 5):
            traffic.advance(EgoState(step, np.array([60.0 + step, 0.0]), 0.0, 10.0))
    first = {track.obstacle_id: track for track in traffic.driven}
    assert first[32].positions[0] == pytest.approx([25.0, 0.3])
    moved = np.diff(first[32].positions, axis=0)
    assert np.allclose(np.linalg.norm(moved, axis=1), 1.0, atol=0.15)
    assert first[33].speeds_mps[0] == pytest.approx(9.0)


def test_a_parked_car_is_seen_by_driven_vehicles(tmp_path: Path) -> None:
    parked = Vehicle(50, ((120.0, 0.0, 0.0, 0.0),))
    ego_elsewhere = replace(FAR, start=(20.0, 3.5, 0.0, 3.0), goal=(25.0, 3.5, 2.0, 3.0), steps=(100, 110))
    builder = road(driving(32, (70.0, 0.0), 12.0, 100), parked=(replace(parked, kind="parkedVehicle"),))
    run = braked(loaded(replace(builder, problems=(ego_elsewhere,)), tmp_path), "reactive", braking_mps2=1.0)
    driven = run.traffic.driven[0]
    past = driven.positions[:, 0] > 115.0
    assert not (past & (np.abs(driven.positions[:, 1]) < 1.8)).any()


def test_pedestrians_follow_their_recording_and_are_named(tmp_path: Path) -> None:
    walker = driving(60, (100.0, -5.0), 1.0, 80, heading_rad=math.pi / 2, kind="pedestrian", size_m=(0.6, 0.6))
    response = run_planner(request(road(walker, driving(32, (20.0, 0.0), 10.0, 80)), tmp_path), silent)
    assert response.record.on_recording == (60,)
    assert [other.obstacle_id for other in response.steps.others] == [32]


def test_a_scenario_without_vehicles_runs(tmp_path: Path) -> None:
    response = run_planner(request(road(), tmp_path), silent)
    assert response.record.outcome == "goal_reached"
    assert response.steps.others == ()


def test_ground_truth_of_reactive_traffic_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidRequest, match="constant_velocity"):
        check_modes("reactive", "ground_truth")
    with pytest.raises(InvalidRequest):
        run_planner(request(road(), tmp_path).model_copy(update={"prediction": "ground_truth"}), silent)


def test_recorded_runs_keep_no_others(tmp_path: Path) -> None:
    response = run_planner(request(road(driving(32, (20.0, 0.0), 5.0, 80)), tmp_path, "recorded"), silent)
    assert response.steps.others == ()
    assert response.record.on_recording == ()


def test_the_metrics_follow_the_others_actual_motion(tmp_path: Path) -> None:
    response = run_planner(request(road(driving(32, (35.0, 0.0), 14.0, 100)), tmp_path), silent)
    assert response.record.metrics is not None
    assert response.record.metrics.minimum_distance_m is not None
    steps, other = response.steps, response.steps.others[0]
    gaps = [steps.x_m[i] - other.x_m[i] for i in range(min(len(steps.x_m), len(other.x_m)))]
    assert response.record.metrics.minimum_distance_m == pytest.approx(min(gaps) - (4.508 + 4.5) / 2, abs=0.3)


def test_a_reactive_run_is_the_same_twice_and_in_another_process(tmp_path: Path, other_process: Executor) -> None:
    asked = request(town_road().cut(60), tmp_path)
    assert digest_of_run(asked) == digest_of_run(asked) == other_process.submit(digest_of_run, asked).result()


@pytest.mark.parametrize(
    ("gap_m", "ego_speed_mps", "room"), [(0.5, 10.0, False), (15.0, 10.0, True), (8.0, 0.0, False)]
)
def test_a_vehicle_that_would_hit_the_ego_waits(tmp_path: Path, gap_m: float, ego_speed_mps: float, room: bool) -> None:
    scenario = loaded(road(driving(32, (20.0, 0.0), 10.0, 20)), tmp_path)
    track = RecordedTraffic(scenario.scenario).moving[0]
    ego = EgoState(50, np.array([20.0 + gap_m + (4.5 + 4.508) / 2, 0.0]), 0.0, ego_speed_mps)
    assert is_insertion_safe(track, 0, RecordedTraffic(scenario.scenario, without={32}), ego, BMW_320I) is room


def test_a_road_user_that_sumo_cannot_place_stays_on_its_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keeping = TrafficRoles.keeping_to_route

    def far_from_its_route(roles: TrafficRoles, keys: frozenset[str]) -> TrafficRoles:
        """One vehicle is to keep to a route whose lanes are 20 m away from its pose."""
        kept = keeping(roles, keys | {"33"})
        aside = np.array([0.0, 20.0])
        return replace(
            kept,
            driven=tuple(
                one
                if one.key != "33"
                else replace(one, track=replace(one.track, positions=one.track.positions + aside))
                for one in kept.driven
            ),
        )

    monkeypatch.setattr(TrafficRoles, "keeping_to_route", far_from_its_route)
    others = driving(32, (90.0, 0.0), 10.0, 100), driving(33, (28.0, 3.5), 10.0, 100)
    run = braked(loaded(road(*others), tmp_path), "reactive")
    assert run.traffic.on_recording == (33,)
    track = next(one for one in run.traffic.driven if one.obstacle_id == 33)
    assert np.diff(track.positions[:, 0]) == pytest.approx(np.ones(len(track.positions) - 1), abs=1e-6)
    assert run.verdict is not None
