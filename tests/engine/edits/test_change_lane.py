"""Edit T: change_lane."""

from dataclasses import replace

import pytest
from support.builders import Lane, Problem, ScenarioBuilder, driving, line, town_road
from support.edits import Apply

from plannerforge.schemas.errors import InvalidRequest, NotPossible

FREE = town_road().with_vehicles(driving(31, (70, 0), 10.0, 101))
LEFT = {"op": "change_lane", "vehicles": ["31"], "lane": "left"}


def test_a_vehicle_changes_lane_from_the_time_named_on(apply: Apply) -> None:
    applied = apply(LEFT | {"time_s": 3.0}, builder=FREE)
    old, new = applied.base_tracks()[31], applied.tracks()[31]
    assert new.positions[:31] == pytest.approx(old.positions[:31])
    assert new.positions[75][1] == pytest.approx(3.5, abs=0.4)
    assert applied.outcome.edits[0].routes[0].arrives


def test_it_stays_in_the_lane_it_was_sent_to(apply: Apply) -> None:
    keen = {"op": "set_behaviour", "vehicles": ["31"], "params": ["lcKeepRight=10"]}
    assert apply(LEFT, keen, builder=FREE).tracks()[31].positions[-1][1] > 3.0


def test_a_change_may_follow_another_one(apply: Apply) -> None:
    back = {"op": "change_lane", "vehicles": ["31"], "lane": "right", "time_s": 6.0}
    track = apply(LEFT, back, builder=FREE).tracks()[31]
    assert track.positions[60][1] > 3.0
    assert track.positions[100][1] < 0.5


def test_a_change_waits_for_a_gap(apply: Apply) -> None:
    beside = FREE.with_vehicles(*FREE.vehicles, driving(33, (69, 3.5), 10.0, 101))
    applied = apply(LEFT, builder=beside)
    assert applied.tracks()[31].positions[15][1] < 0.5
    assert not applied.outcome.collisions


def test_it_cuts_in_if_the_vehicle_behind_can_still_brake(apply: Apply) -> None:
    faster = FREE.with_vehicles(*FREE.vehicles, driving(33, (52, 3.5), 12.0, 101))
    applied = apply(LEFT, builder=faster)
    assert applied.tracks()[31].positions[30][1] > 3.0
    assert not applied.outcome.collisions


def test_it_yields_to_a_vehicle_too_fast_to_brake(apply: Apply) -> None:
    racing = FREE.with_vehicles(*FREE.vehicles, driving(33, (40, 3.5), 25.0, 101))
    applied = apply(LEFT, builder=racing)
    assert applied.tracks()[31].positions[12][1] < 0.5
    assert applied.outcome.edits[0].routes[0].arrives
    assert not applied.outcome.handed_over


def test_a_lack_of_room_is_reported(apply: Apply) -> None:
    wall = [driving(key, (20 + 10 * place, 3.5), 10.0, 101) for place, key in enumerate(range(40, 54))]
    route = apply(LEFT, builder=FREE.with_vehicles(*FREE.vehicles, *wall)).outcome.edits[0].routes[0]
    assert route.arrives is False
    assert route.reason.startswith("no room to change into lanelet")
    assert route.reason.endswith("in the way: vehicle 44, vehicle 42, vehicle 43 and others")


def test_an_ego_in_the_way_is_named_as_the_ego(apply: Apply) -> None:
    beside = replace(FREE, problems=(Problem(start=(38.0, 3.5, 0.0, 10.0), goal=(250.0, 3.5, 8.0, 3.0)),))
    route = apply(LEFT | {"time_s": 9.0}, builder=beside).outcome.edits[0].routes[0]
    assert route.reason.endswith("in the way: the ego")


def test_no_lane_on_that_side_is_refused_with_the_side_there_is(apply: Apply) -> None:
    with pytest.raises(NotPossible, match=r"on lanelet 1, .*no lane in its direction") as caught:
        apply(LEFT | {"lane": "right"}, builder=FREE)
    assert "lane=left" in caught.value.valid
    assert not caught.value.remedies, "the opposite lane is not what was requested"


def test_the_oncoming_lane_is_not_a_valid_target_of_a_lane_change(apply: Apply) -> None:
    with pytest.raises(NotPossible, match=r"on lanelet 2, .*no lane in its direction"):
        apply(LEFT, builder=FREE.with_vehicles(driving(31, (70, 3.5), 10.0, 101)))
    with pytest.raises(InvalidRequest, match="left or right"):
        apply(LEFT | {"lane": "oncoming"}, builder=FREE)


def test_a_time_at_which_it_is_not_there_is_refused_with_the_times_it_is(apply: Apply) -> None:
    with pytest.raises(InvalidRequest, match="31 is not there at 20 s") as caught:
        apply(LEFT | {"time_s": 20.0}, builder=FREE)
    assert caught.value.valid == ("time_s from 0 to 9.9",)
    with pytest.raises(InvalidRequest, match=r"31 is not there at 9\.96 s"):
        apply(LEFT | {"time_s": 9.96}, builder=FREE)


def test_a_lane_that_leads_elsewhere_is_driven_on_in(apply: Apply) -> None:
    turning = town_road().with_vehicles(driving(31, (60, 0), 10.0, 121))
    away = {"op": "reroute", "vehicles": ["31"], "to": ["13"]}
    far = replace(turning, problems=(Problem(start=(280.0, 7.0, 3.1416, 10.0), goal=(50.0, 7.0, 8.0, 3.0)),))
    reports = apply(away, LEFT, builder=far).outcome.edits
    assert reports[0].routes[0].reason == "a later edit sends it elsewhere"
    assert reports[1].routes[0].arrives


def test_two_changes_alike_are_two(apply: Apply) -> None:
    third = Lane(3, line((0.0, 7.0), (300.0, 7.0)), right=(2, True))
    lanes = (
        Lane(1, line((0.0, 0.0), (300.0, 0.0)), left=(2, True)),
        Lane(2, line((0.0, 3.5), (300.0, 3.5)), left=(3, True), right=(1, True)),
        third,
    )
    road = ScenarioBuilder(lanes=lanes, vehicles=(driving(31, (70, 0), 10.0, 121),))
    track = apply(LEFT, LEFT, builder=road).tracks()[31]
    assert track.positions[-1][1] == pytest.approx(7.0, abs=0.4)
