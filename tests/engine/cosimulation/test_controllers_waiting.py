"""A rerouted vehicle that finds no gap waits beside its target for one."""

import numpy as np
import pytest
from support.builders import Lane, ScenarioBuilder, driving, line, town_road
from support.edits import Applied, Apply

from plannerforge.schemas.errors import NotPossible

TO_LANE_2 = {"op": "reroute", "vehicles": ["36"], "to": ["2"]}


def beside_a_column(x_m: float, speed_mps: float, builder: ScenarioBuilder | None = None) -> ScenarioBuilder:
    """Vehicle 36 in lane 1, with no gap beside it in lane 2."""
    column = [driving(40 + place, (x_m - 60 + 9 * place, 3.5), speed_mps, 151) for place in range(9)]
    return (builder or town_road()).with_vehicles(driving(36, (x_m, 0), speed_mps, 151), *column)


def cut_motorway() -> ScenarioBuilder:
    """Two lanes that end with the map."""
    return ScenarioBuilder(
        (Lane(1, line((0, 0), (200, 0)), left=(2, True)), Lane(2, line((0, 3.5), (200, 3.5)), right=(1, True))), ()
    )


def fronts_m(applied: Applied) -> np.ndarray:
    """How far the front of vehicle 36 is along the road, at every step."""
    track = applied.tracks()[36]
    return np.asarray(track.positions[:, 0] + track.length_m / 2)


def hardest_braking_mps2(applied: Applied) -> float:
    """The lowest acceleration of vehicle 36."""
    return float(np.diff(applied.tracks()[36].speeds_mps).min()) / 0.1


def test_a_vehicle_that_can_stop_before_waits_for_its_lane_change(apply: Apply) -> None:
    slow = town_road().with_vehicles(driving(36, (190, 0), 3.0, 41))
    assert apply(TO_LANE_2, builder=slow).outcome.edits[0].done


def test_a_vehicle_without_a_gap_waits_at_the_end_of_its_lane(apply: Apply) -> None:
    applied = apply(TO_LANE_2, builder=beside_a_column(140, 10.0))
    (route,) = applied.outcome.edits[0].routes
    assert route.lanelets[:2] == (1, 2)
    assert route.arrives
    track = applied.tracks()[36]
    assert all(y > 1.75 for x, y in track.positions if x > 200)
    assert track.speeds_mps.min() < 5.0


@pytest.mark.parametrize("x_m", [140, 160])
def test_a_vehicle_also_waits_at_the_end_of_the_map(apply: Apply, x_m: float) -> None:
    applied = apply(TO_LANE_2, builder=beside_a_column(x_m, 10.0, cut_motorway()))
    assert applied.outcome.edits[0].routes[0].arrives
    track = applied.tracks()[36]
    assert track.speeds_mps.min() < 5.0
    assert np.all(track.positions[fronts_m(applied) > 198.0, 1] > 1.75)
    assert not applied.outcome.collisions


def test_a_vehicle_near_the_end_brakes_as_hard_as_necessary(apply: Apply) -> None:
    applied = apply(TO_LANE_2, builder=beside_a_column(184, 14.0), detail="checks")
    assert applied.outcome.edits[0].routes[0].arrives
    assert not applied.outcome.collisions
    assert -9.5 < hardest_braking_mps2(applied) < -5.5
    assert applied.outcome.touched[0].feasible


def test_a_vehicle_that_cannot_stop_before_the_end_is_refused(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="ends 8 m ahead of its front: it can neither change lanes nor stop"):
        apply(TO_LANE_2, builder=beside_a_column(190, 14.0))


def test_a_lane_change_that_only_a_short_lanelet_is_left_for_is_refused(apply: Apply) -> None:
    lanes = (
        Lane(1, line((0, 0), (100, 0)), successors=(3,), left=(2, True)),
        Lane(2, line((0, 3.5), (100, 3.5)), successors=(4,), right=(1, True)),
        Lane(3, line((100, 0), (102, 0)), successors=(5,), predecessors=(1,), left=(4, True)),
        Lane(4, line((100, 3.5), (102, 3.5)), predecessors=(2,), right=(3, True)),
        Lane(5, line((102, 0), (300, 0)), predecessors=(3,)),
    )
    builder = ScenarioBuilder(lanes, (driving(36, (97, 0), 10.0, 41),))
    with pytest.raises(NotPossible, match=r"lanelet 3, .* 4, ends 3 m ahead"):
        apply({"op": "reroute", "vehicles": ["36"], "to": ["4"]}, builder=builder)


def test_before_a_curve_a_vehicle_too_fast_brakes_harder_than_its_own_deceleration(apply: Apply) -> None:
    fast = town_road().with_vehicles(driving(36, (165, 0), 20.0, 101))
    applied = apply({"op": "reroute", "vehicles": ["36"], "to": ["12"]}, builder=fast, detail="checks")
    assert applied.outcome.edits[0].routes[0].arrives
    assert applied.outcome.touched[0].feasible
    track = applied.tracks()[36]
    there = int(np.argmax(fronts_m(applied) > 202.0))
    assert track.speeds_mps[there] < 9.0
    assert hardest_braking_mps2(applied) > -8.5


def test_a_vehicle_that_a_later_edit_sends_elsewhere_does_not_wait(apply: Apply) -> None:
    back = {"op": "reroute", "vehicles": ["36"], "to": ["11"]}
    applied = apply(TO_LANE_2, back, builder=beside_a_column(184, 14.0))
    assert [one.routes[0].arrives for one in applied.outcome.edits] == [False, True]


def test_a_vehicle_that_finds_no_gap_before_the_scenario_ends_is_reported(apply: Apply) -> None:
    wall = [driving(40 + place, (100 + 9 * place, 3.5), 1.0, 61) for place in range(11)]
    builder = cut_motorway().with_vehicles(driving(36, (150, 0), 10.0, 61), *wall)
    applied = apply(TO_LANE_2, builder=builder)
    (route,) = applied.outcome.edits[0].routes
    assert route.arrives is False
    assert route.reason == "no room to change into lanelet 2 before the scenario ends at 6.0 s"
    assert applied.tracks()[36].last_step == 60
    assert 180.0 < fronts_m(applied).max() < 190.0


def test_a_vehicle_with_several_valid_lanes_waits_for_the_first_gap(apply: Apply) -> None:
    lanes = (
        Lane(1, line((0, 0), (200, 0)), left=(2, True)),
        Lane(2, line((0, 3.5), (200, 3.5)), left=(3, True), right=(1, True)),
        Lane(3, line((0, 7), (200, 7)), right=(2, True)),
    )
    to_either = {"op": "reroute", "vehicles": ["36"], "to": ["2", "3"]}
    applied = apply(to_either, builder=beside_a_column(160, 10.0, ScenarioBuilder(lanes, ())))
    assert applied.outcome.edits[0].routes[0].arrives
    assert np.all(applied.tracks()[36].positions[fronts_m(applied) > 198.0, 1] > 1.75)


def test_several_lane_changes_fit_into_the_last_road_of_an_empty_map(apply: Apply) -> None:
    lanes = tuple(
        Lane(
            key,
            line((0, 3.5 * (key - 1)), (200, 3.5 * (key - 1))),
            left=(key + 1, True) if key < 4 else None,
            right=(key - 1, True) if key > 1 else None,
        )
        for key in (1, 2, 3, 4)
    )
    to_the_left = {"op": "reroute", "vehicles": ["36"], "to": ["4"]}
    alone = ScenarioBuilder(lanes, ()).with_vehicles(driving(36, (117, 0), 20.0, 151))
    applied = apply(to_the_left, builder=alone)
    track = applied.tracks()[36]
    assert applied.outcome.edits[0].routes[0].arrives
    assert track.speeds_mps.min() > 2.0
    assert np.abs(track.headings_rad).max() < np.radians(30)
