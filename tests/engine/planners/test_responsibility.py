"""Who answers for a danger: staged encounters with opposite verdicts, and values computed by hand."""

import math
from typing import Any

import numpy as np
import pytest
from commonroad.scenario.lanelet import LaneletNetwork, LaneletType
from commonroad.scenario.traffic_sign import TrafficSign, TrafficSignElement, TrafficSignIDGermany
from hypothesis import given
from hypothesis import strategies as st
from support.planning import lanelet_along, network_of, straight_road

from plannerforge.engine.planners.frenetix.costs import CandidateBatch, responsibility
from plannerforge.engine.planners.interface import PredictedObstacle
from plannerforge.engine.planners.lanes import LaneCenters, LaneCorridors

STEPS = 31
TIME = np.arange(STEPS) * 0.1
ROAD = straight_road(300.0, lanes=3)


def cost(ego: tuple[Any, Any], *others: PredictedObstacle, network: LaneletNetwork = ROAD) -> float:
    """Responsibility of one candidate given by its x and y at every step; it is 4.5 m × 1.8 m."""
    x, y = (np.broadcast_to(np.asarray(part, dtype=float), (STEPS,)) for part in ego)
    step_x, step_y = np.gradient(x, 0.1), np.gradient(y, 0.1)
    batch = CandidateBatch(
        x_m=x[None, :],
        y_m=y[None, :],
        heading_rad=np.arctan2(step_y, step_x)[None, :],
        speed_mps=np.hypot(step_x, step_y)[None, :],
        step_s=0.1,
        fastest_mps=float(np.hypot(step_x, step_y).max()),
        target_speed_mps=None,
        obstacles=others,
        half_length_m=2.25,
        half_width_m=0.9,
        lanes=LaneCenters(network),
        corridors=LaneCorridors(network),
    )
    return float(responsibility(batch)[0])


def other(start: tuple[float, float], velocity: tuple[float, float], heading: float | None = None) -> PredictedObstacle:
    """A car of 4.5 m × 1.8 m in uniform motion."""
    positions = np.array(start) + TIME[:, None] * np.array(velocity)
    angle = math.atan2(velocity[1], velocity[0]) if heading is None else heading
    return PredictedObstacle(
        1, positions, np.full(STEPS, angle), np.eye(2) * 0.1, 4.5, 1.8, speed_mps=math.hypot(*velocity)
    )


def change_lane(speed: float) -> tuple[Any, Any]:
    """From lane 1 to lane 2 (3.5 m to the left) within two seconds."""
    share = np.clip(TIME / 2.0, 0.0, 1.0)
    return speed * TIME, 3.5 * (3 * share**2 - 2 * share**3)


@pytest.mark.parametrize(("speed", "gap"), [(3.0, 6.5), (4.0, 3.5), (5.0, 0.5)])
def test_driving_up_to_a_standing_car_costs_by_the_gap_that_is_left(speed: float, gap: float) -> None:
    standing = other((20.0, 0.0), (0.0, 0.0))
    assert gap == 20.0 - 3.0 * speed - 4.5
    assert cost((speed * TIME, 0.0), standing) == pytest.approx(math.exp(-gap / 2.0))


@pytest.mark.parametrize(("speed", "gap"), [(8.0, 4.5), (9.0, 1.5), (11.0, 0.0)])
def test_closing_on_a_slower_lead_in_our_lane_is_the_egos_doing(speed: float, gap: float) -> None:
    lead = other((18.0, 0.0), (5.0, 0.0))
    assert gap == max(18.0 + 15.0 - 3.0 * speed - 4.5, 0.0)
    assert cost((speed * TIME, 0.0), lead) == pytest.approx(math.exp(-gap / 2.0))


def test_a_cut_in_and_a_rear_end_of_the_same_place_have_opposite_verdicts() -> None:
    ego = (10.0 * TIME, 0.0)
    cuts_in = other((8.0, 3.5), (9.0, -1.5))
    slower_lead = other((8.0, 0.0), (7.0, 0.0))
    assert cost(ego, cuts_in) == 0.0
    assert cost(ego, slower_lead) == pytest.approx(1.0)


def test_being_run_into_from_behind_is_not_the_egos_doing() -> None:
    assert cost((5.0 * TIME, 0.0), other((-20.0, 0.0), (15.0, 0.0))) == 0.0


def test_a_ghost_driver_answers_itself() -> None:
    assert cost((5.0 * TIME, 0.0), other((30.0, 0.0), (-15.0, 0.0))) == 0.0


def test_changing_lanes_into_another_is_the_egos_doing_and_keeping_the_lane_is_not() -> None:
    beside = other((-1.0, 3.5), (10.0, 0.0))
    assert cost(change_lane(10.0), beside) == pytest.approx(1.0)
    assert cost((10.0 * TIME, 0.0), beside) == 0.0


def test_a_body_over_the_line_counts() -> None:
    beside = other((-1.0, 3.5), (10.0, 0.0))
    assert cost((10.0 * TIME, 1.2), beside) == pytest.approx(math.exp(-(3.5 - 1.2 - 1.8) / 2.0))


def test_when_both_change_into_the_lane_between_them_the_ego_answers_too() -> None:
    share = np.clip(TIME / 2.0, 0.0, 1.0)
    y = 7.0 - 3.5 * (3 * share**2 - 2 * share**3)
    positions = np.stack([10.0 * TIME, y], axis=1)
    comes_in = PredictedObstacle(1, positions, np.zeros(STEPS), np.eye(2) * 0.1, 4.5, 1.8, speed_mps=10.0)
    assert cost(change_lane(10.0), comes_in) == pytest.approx(1.0)
    stays = other((0.0, 7.0), (10.0, 0.0))
    assert cost(change_lane(10.0), stays) == 0.0


def test_a_pedestrian_off_the_road_counts_if_the_ego_drives_up_to_them() -> None:
    walker = other((18.0, -2.4), (0.0, 0.3))
    assert cost((5.0 * TIME, 0.0), walker) > 0.1
    behind = other((-6.0, -2.4), (0.0, 0.3))
    assert cost((5.0 * TIME, 0.0), behind) == 0.0


def crossing(ego_sign: str | None = None, other_sign: str | None = None, *, walk: bool = False) -> LaneletNetwork:
    """Lanelet 1 along the x axis; at x = 20 m lanelet 2 comes from the right and lanelet 3 from the left."""
    way = np.linspace(-40.0, 60.0, 21)
    up = np.stack([np.full(21, 20.0), way - 10.0], axis=1)
    kinds = {LaneletType.CROSSWALK} if walk else set()
    lanes = [lanelet_along(np.stack([way, np.zeros(21)], axis=1), 1)]
    lanes += [lanelet_along(up, 2, lanelet_type=kinds), lanelet_along(up[::-1], 3, lanelet_type=kinds)]
    network = network_of(*lanes)
    for key, sign, on in ((91, ego_sign, {1}), (92, other_sign, {2, 3})):
        if sign:
            element = TrafficSignElement(TrafficSignIDGermany[sign])
            network.add_traffic_sign(TrafficSign(key, [element], on, np.zeros(2)), on)
    return network


RIGHT = other((20.0, -20.0), (0.0, 8.0))
LEFT = other((20.0, 20.0), (0.0, -8.0))


@pytest.mark.parametrize(
    ("network", "comes_from", "verdict"),
    [
        (crossing(), RIGHT, 1.0),
        (crossing(), LEFT, 0.0),
        (crossing(ego_sign="YIELD"), LEFT, 1.0),
        (crossing(other_sign="STOP"), RIGHT, 0.0),
        (crossing(ego_sign="PRIORITY"), RIGHT, 0.0),
        (crossing(walk=True), LEFT, 1.0),
    ],
    ids=["right", "left", "ego yields", "other stops", "ego has priority", "crosswalk"],
)
def test_right_of_way(network: LaneletNetwork, comes_from: PredictedObstacle, verdict: float) -> None:
    assert cost((8.0 * TIME, 0.0), comes_from, network=network) == pytest.approx(verdict)


def turning() -> LaneletNetwork:
    """Lanelet 1 goes straight on as 2 or left as 3; lanelet 4 comes towards them, 3.5 m to the left."""
    angle = np.linspace(0.0, math.pi / 2, 16)
    ahead = np.linspace(0.0, 60.0, 13)
    bend = np.stack([10.0 + 10.0 * np.sin(angle), 10.0 - 10.0 * np.cos(angle)], axis=1)
    return network_of(
        lanelet_along(np.stack([np.linspace(-20.0, 10.0, 7), np.zeros(7)], axis=1), 1, successor=[2, 3]),
        lanelet_along(np.stack([10.0 + ahead, np.zeros(13)], axis=1), 2, predecessor=[1]),
        lanelet_along(bend, 3, predecessor=[1]),
        lanelet_along(np.stack([70.0 - 1.5 * ahead, np.full(13, 3.5)], axis=1), 4),
    )


def test_turning_left_across_oncoming_traffic_is_the_egos_doing() -> None:
    angle = np.clip((8.0 * TIME - 10.0) / 10.0, 0.0, math.pi / 2)
    straight_m = np.minimum(8.0 * TIME, 10.0)
    turn = (straight_m + 10.0 * np.sin(angle), 10.0 - 10.0 * np.cos(angle))
    oncoming = other((40.0, 3.5), (-10.0, 0.0))
    assert cost(turn, oncoming, network=turning()) > 0.5
    assert cost((8.0 * TIME, 0.0), oncoming, network=turning()) == 0.0


def test_of_two_merging_vehicles_the_one_behind_is_responsible() -> None:
    x = np.linspace(-40.0, 20.0, 13)
    network = network_of(
        lanelet_along(np.stack([x, np.zeros(13)], axis=1), 1, successor=[3]),
        lanelet_along(np.stack([x, (20.0 - x) * 0.2], axis=1), 2, successor=[3]),
        lanelet_along(np.stack([np.linspace(20.0, 90.0, 15), np.zeros(15)], axis=1), 3, predecessor=[1, 2]),
    )
    ego = (10.0 * TIME, 0.0)
    along = 10.0 / math.hypot(1.0, 0.2)
    for start_x, expected in ((7.0, True), (-7.0, False)):
        merges = other((start_x, (20.0 - start_x) * 0.2), (along, -0.2 * along))
        assert (cost(ego, merges, network=network) > 0.1) is expected


@given(
    speed=st.floats(0.0, 20.0),
    x=st.floats(-60.0, 60.0),
    y=st.floats(-8.0, 12.0),
    vx=st.floats(-20.0, 20.0),
    vy=st.floats(-3.0, 3.0),
)
def test_the_cost_of_one_obstacle_is_between_0_and_1(speed: float, x: float, y: float, vx: float, vy: float) -> None:
    value = cost((speed * TIME, 0.0), other((x, y), (vx, vy)))
    assert 0.0 <= value <= 1.0


def test_far_or_missing_obstacles_cost_nothing() -> None:
    assert cost((5.0 * TIME, 0.0), other((100.0, 0.0), (0.0, 0.0))) == 0.0
    assert cost((5.0 * TIME, 0.0)) == 0.0


def test_a_candidate_costs_the_same_alone_and_among_others() -> None:
    """Its place in a corridor must not hang on how many points are looked up with it: two samples are often as near."""
    angle = 0.7
    along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
    corridor = LaneCorridors(straight_road(300.0, lanes=3, angle_rad=angle)).from_here(0.0 * along, angle, 200.0)
    assert corridor is not None
    between = (corridor.points[1:] + corridor.points[:-1]) / 2 + 0.7 * across
    together = corridor.locate(between)[0]
    alone = [float(corridor.locate(point[None, :])[0][0]) for point in between]
    assert together.tolist() == alone
