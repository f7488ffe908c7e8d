"""Edit T."""

import math

import pytest
from support.builders import Lane, ScenarioBuilder, arc, driving, line, town_road
from support.edits import Apply

from plannerforge.schemas.errors import InvalidRequest, NotPossible, UnknownName


def test_a_turn_at_the_next_fork_is_driven(apply: Apply) -> None:
    applied = apply({"op": "reroute", "vehicles": ["35"], "turn": "right"})
    (route,) = applied.outcome.edits[0].routes
    assert applied.outcome.edits[0].letter == "T"
    assert route.arrives
    assert route.lanelets == (1, 12, 13)
    track = applied.tracks()[35]
    assert track.headings_rad[-1] == pytest.approx(-math.pi / 2, abs=0.05)
    assert track.positions[-1][0] == pytest.approx(220, abs=0.3)


def test_a_neighbouring_lane_as_target_is_a_lane_change(apply: Apply) -> None:
    applied = apply({"op": "reroute", "vehicles": ["31"], "to": ["2"]})
    (route,) = applied.outcome.edits[0].routes
    assert route.arrives
    assert 2 in route.lanelets
    assert applied.tracks()[31].positions[120][1] == pytest.approx(3.5, abs=0.3)


def test_an_edge_means_any_of_its_lanelets(apply: Apply) -> None:
    applied = apply({"op": "reroute", "vehicles": ["35"], "to": ["e13"]})
    assert applied.outcome.edits[0].routes[0].arrives


def test_a_reachable_target_too_far_away_gets_a_reason(apply: Apply) -> None:
    slow = driving(36, (5, 0), 2.0, 41)
    builder = town_road().with_vehicles(slow)
    applied = apply({"op": "reroute", "vehicles": ["36"], "to": ["13"]}, builder=builder)
    (route,) = applied.outcome.edits[0].routes
    assert route.arrives is False
    assert "scenario ends at 4.0 s" in route.reason


def test_an_unreachable_target_is_refused_with_reachable_ones(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="lanelet 3 cannot be reached by vehicle 31") as caught:
        apply({"op": "reroute", "vehicles": ["31"], "to": ["3"]})
    assert {"11", "12"} <= set(caught.value.valid)
    assert caught.value.valid[:2] == ("2", "21")


@pytest.mark.parametrize("edit", [{"to": ["13"]}, {"turn": "right"}])
def test_a_vehicle_right_at_a_fork_can_still_be_sent_down_the_other_branch(
    apply: Apply, edit: dict[str, object]
) -> None:
    at_fork = town_road().with_vehicles(driving(36, (200.1, 0), 8.0, 101))
    applied = apply({"op": "reroute", "vehicles": ["36"], **edit}, builder=at_fork)
    (route,) = applied.outcome.edits[0].routes
    assert route.arrives
    assert {12, 13} <= set(route.lanelets)
    assert applied.tracks()[36].positions[-1][0] == pytest.approx(220, abs=0.3)


def test_a_vehicle_past_the_fork_keeps_its_branch(apply: Apply) -> None:
    past = town_road().with_vehicles(driving(36, (208, 0), 8.0, 101))
    with pytest.raises(NotPossible, match="13 cannot be reached by vehicle 36 from lanelet 11"):
        apply({"op": "reroute", "vehicles": ["36"], "to": ["13"]}, builder=past)


def test_an_unknown_lanelet_is_refused_with_the_nearest_ids(apply: Apply) -> None:
    with pytest.raises(UnknownName, match="14 is not a lanelet") as caught:
        apply({"op": "reroute", "vehicles": ["31"], "to": ["14"]})
    assert caught.value.valid[0] == "13"


def test_a_turn_that_the_fork_does_not_have_is_refused_with_its_branches(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="cannot go left") as caught:
        apply({"op": "reroute", "vehicles": ["35"], "turn": "left"})
    assert any("right" in branch for branch in caught.value.valid)
    assert any("straight" in branch for branch in caught.value.valid)
    assert not caught.value.remedies, "the opposite turn is not what was requested"


def test_a_lane_without_a_fork_has_no_turn(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="no fork ahead"):
        apply({"op": "reroute", "vehicles": ["34"], "turn": "right"})


@pytest.mark.parametrize("edit", [{}, {"to": ["13"], "turn": "right"}])
def test_either_a_target_or_a_turn_is_needed(apply: Apply, edit: dict[str, object]) -> None:
    with pytest.raises(InvalidRequest, match="either 'to' or 'turn'"):
        apply({"op": "reroute", "vehicles": ["35"], **edit})


def test_all_vehicles_are_rerouted_or_the_edit_is_refused(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="vehicle 34"):
        apply({"op": "reroute", "vehicles": ["35", "34"], "to": ["13"]})


def test_lanelets_on_the_route_are_driven_through_in_order(apply: Apply) -> None:
    alone = town_road().with_vehicles(driving(31, (20, 0), 10.0, 281))
    route = apply({"op": "reroute", "vehicles": ["31"], "via": ["2"], "to": ["11"]}, builder=alone)
    (driven,) = route.outcome.edits[0].routes
    assert driven.arrives
    assert driven.lanelets[:2] == (1, 2)
    assert 11 in driven.lanelets


def test_a_dead_end_on_the_route_is_refused(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="11 cannot be reached by vehicle 31 from lanelet 13"):
        apply({"op": "reroute", "vehicles": ["31"], "via": ["13"], "to": ["11"]})


@pytest.mark.parametrize("target", ["13", "e13", "e13_0"])
def test_lanelets_edges_and_lanes_are_all_understood(apply: Apply, target: str) -> None:
    assert apply({"op": "reroute", "vehicles": ["31"], "to": [target]}).outcome.edits[0].routes[0].arrives


def test_a_curve_that_the_vehicle_reaches_too_fast_is_refused(apply: Apply) -> None:
    racing = town_road().with_vehicles(driving(36, (150, 0), 38.0, 30))
    with pytest.raises(NotPossible, match=r"38\.0 m/s 50 m before a curve of lanelet 12.*cannot brake enough"):
        apply({"op": "reroute", "vehicles": ["36"], "to": ["13"]}, builder=racing)


def test_a_curve_that_it_can_brake_for_is_driven(apply: Apply) -> None:
    fast = town_road().with_vehicles(driving(36, (50, 0), 25.0, 101))
    applied = apply({"op": "reroute", "vehicles": ["36"], "to": ["12"]}, builder=fast)
    assert applied.outcome.edits[0].routes[0].arrives
    assert applied.outcome.touched[0].feasible


def test_a_curve_at_the_far_end_of_a_lanelet_leaves_its_whole_length_to_brake(apply: Apply) -> None:
    late_bend = (*line((100, 0), (200, 0)), *arc((200, 12), 12, -math.pi / 2, 0)[1:])
    lanes = (Lane(1, line((0, 0), (100, 0)), successors=(2, 3)), Lane(2, late_bend), Lane(3, line((100, 0), (300, 0))))
    fast = ScenarioBuilder(lanes, (driving(36, (95, 0), 20.0, 91),))
    applied = apply({"op": "reroute", "vehicles": ["36"], "to": ["2"]}, builder=fast)
    assert applied.outcome.edits[0].routes[0].arrives
    assert applied.outcome.touched[0].feasible


def test_a_lane_change_is_refused_if_its_last_place_is_passed_too_early(apply: Apply) -> None:
    past = town_road().with_vehicles(driving(36, (199, 0), 10.0, 41))
    with pytest.raises(NotPossible, match=r"lanelet 1, .* 2, ends 0 m ahead of its front"):
        apply({"op": "reroute", "vehicles": ["36"], "to": ["2"]}, builder=past)
    later = apply({"op": "reroute", "vehicles": ["36"], "to": ["21"]}, builder=past)
    assert later.outcome.edits[0].done


def test_a_lanelet_too_short_to_be_seen_on_counts_as_driven(apply: Apply) -> None:
    joint = (
        Lane(1, line((0, 0), (100, 0)), successors=(2,)),
        Lane(2, line((100, 0), (100.5, 0)), successors=(3,), predecessors=(1,)),
        Lane(3, line((100.5, 0), (300, 0)), predecessors=(2,)),
    )
    builder = ScenarioBuilder(joint, (driving(36, (70, 0), 13.0, 41),))
    (route,) = apply({"op": "reroute", "vehicles": ["36"], "to": ["2"]}, builder=builder).outcome.edits[0].routes
    assert route.arrives
    assert route.lanelets == (1, 2, 3)


def test_behind_its_target_a_vehicle_drives_on_and_does_not_turn_back(apply: Apply) -> None:
    lanes = (
        Lane(1, line((0, 0), (200, 0)), successors=(11,), left=(2, True)),
        Lane(2, line((0, 3.5), (200, 3.5)), successors=(12,), right=(1, True)),
        Lane(11, line((200, 0), (230, 0)), successors=(21,), predecessors=(1,)),
        Lane(12, arc((200, 5.25), 1.75, -math.pi / 2, math.pi / 2), successors=(3,), predecessors=(2,)),
        Lane(21, line((230, 0), (300, 0)), predecessors=(11,)),
        Lane(3, line((200, 7), (0, 7)), predecessors=(12,)),
        Lane(31, line((201, -60), (201, -10)), successors=(32,)),
        Lane(32, line((201, -10), (201, 15)), successors=(33,), predecessors=(31,)),
        Lane(33, line((201, 15), (201, 60)), predecessors=(32,)),
    )
    builder = ScenarioBuilder(lanes, (driving(36, (100, 0), 10.0, 151),))
    (route,) = apply({"op": "reroute", "vehicles": ["36"], "to": ["2"]}, builder=builder).outcome.edits[0].routes
    assert route.arrives
    assert route.lanelets[:2] == (1, 2)
    assert not {12, 3} & set(route.lanelets)
