"""A vehicle that is inside a junction at the hand-over changes lanes there by steering over, as far as it rolls."""

import numpy as np
import pytest
from support.builders import Lane, ScenarioBuilder, driving, line
from support.edits import Applied, Apply

from plannerforge.engine.cosimulation.plans import lane_change_track
from plannerforge.schemas.errors import NotPossible

TO_THE_LEFT = {"op": "reroute", "vehicles": ["36"], "to": ["12"]}
BOUNDARY_M = 1.75


def straight_on_through_a_crossing(x_m: float, speed_mps: float = 8.0) -> ScenarioBuilder:
    """Two lanes side by side, inside the crossing too (100 … 130 m); vehicle 36 is in the right one."""
    lanes = (
        Lane(1, line((0, 0), (100, 0)), successors=(11,), left=(2, True)),
        Lane(2, line((0, 3.5), (100, 3.5)), successors=(12,), right=(1, True)),
        Lane(11, line((100, 0), (130, 0)), successors=(21,), predecessors=(1,), left=(12, True)),
        Lane(12, line((100, 3.5), (130, 3.5)), successors=(22,), predecessors=(2,), right=(11, True)),
        Lane(31, line((115, -60), (115, -10)), successors=(32,)),
        Lane(32, line((115, -10), (115, 15)), successors=(33,), predecessors=(31,)),
        Lane(33, line((115, 15), (115, 60)), predecessors=(32,)),
        Lane(21, line((130, 0), (200, 0)), predecessors=(11,), left=(22, True)),
        Lane(22, line((130, 3.5), (200, 3.5)), predecessors=(12,), right=(21, True)),
    )
    return ScenarioBuilder(lanes, (driving(36, (x_m, 0), speed_mps, 151),))


def fronts(applied: Applied) -> np.ndarray:
    """The front of vehicle 36 at every step, shape (n, 2)."""
    track = applied.tracks()[36]
    ahead = np.stack([np.cos(track.headings_rad), np.sin(track.headings_rad)], axis=1)
    return np.asarray(track.positions + track.length_m / 2 * ahead)


@pytest.mark.parametrize(("x_m", "speed_mps"), [(103, 0.0), (123.5, 1.0), (121, 5.0), (103, 14.0), (99, 2.0)])
def test_it_is_across_before_the_junction_ends(apply: Apply, x_m: float, speed_mps: float) -> None:
    applied = apply(TO_THE_LEFT, builder=straight_on_through_a_crossing(x_m, speed_mps), detail="checks")
    (route,), (vehicle,) = applied.outcome.edits[0].routes, applied.outcome.touched
    assert route.lanelets[:3] == (11, 12, 22)
    assert route.arrives
    front, track = fronts(applied), applied.tracks()[36]
    assert track.positions[0] == pytest.approx((x_m, 0))
    assert front[front[:, 0] <= 130.0][-1, 1] > BOUNDARY_M
    assert front[-1, 1] == pytest.approx(3.5, abs=0.3)
    assert vehicle.feasible
    assert (vehicle.handover_jump_m or 0.0) <= 0.05
    assert (vehicle.handover_speed_step_mps or 0.0) <= 1.0
    assert not applied.outcome.collisions


def test_the_lane_after_the_junction_is_reached_in_the_junction_as_a_last_resort(apply: Apply) -> None:
    builder = straight_on_through_a_crossing(103)
    parting = {21: line((130, 0), (200, -20)), 22: line((130, 3.5), (200, 25))}
    lanes = [lane for lane in builder.lanes if lane.lanelet_id not in parting]
    lanes += [Lane(key, center, predecessors=(key - 10,)) for key, center in parting.items()]
    apart = ScenarioBuilder(tuple(lanes), builder.vehicles)
    (route,) = apply({"op": "reroute", "vehicles": ["36"], "to": ["22"]}, builder=apart).outcome.edits[0].routes
    assert route.lanelets == (11, 12, 22)
    assert route.arrives


@pytest.mark.parametrize(("x_m", "speed_mps"), [(124.5, 1.0), (112, 15.5)])
def test_one_without_the_room_to_steer_over_is_refused(apply: Apply, x_m: float, speed_mps: float) -> None:
    with pytest.raises(NotPossible, match=r"from lanelet 11 to 12 inside a junction: at .* m are left") as refused:
        apply(TO_THE_LEFT, builder=straight_on_through_a_crossing(x_m, speed_mps))
    assert "22, 11, 21" in refused.value.text


def test_a_vehicle_held_up_before_it_is_across_does_not_arrive(apply: Apply) -> None:
    builder = straight_on_through_a_crossing(103)
    wall = [driving(40, (113, 3.5), 0.0, 151), driving(41, (113, 0), 0.0, 151)]
    applied = apply(TO_THE_LEFT, builder=builder.with_vehicles(*builder.vehicles, *wall))
    (route,) = applied.outcome.edits[0].routes
    assert route.arrives is False
    assert route.reason == (
        "it stands on lanelet 11 when the scenario ends at 15.0 s, after 13.8 s standing on lanelet 11 "
        "behind vehicle 41"
    )
    assert fronts(applied)[:, 1].max() < BOUNDARY_M
    assert not applied.outcome.collisions


def test_a_route_into_the_junction_changes_lanes_before_it(apply: Apply) -> None:
    (route,) = apply(TO_THE_LEFT, builder=straight_on_through_a_crossing(40.0)).outcome.edits[0].routes
    assert route.lanelets[:3] == (1, 2, 12)
    assert route.arrives


def test_a_vehicle_that_can_change_only_after_the_junction_changes_there(apply: Apply) -> None:
    behind = {"op": "reroute", "vehicles": ["36"], "to": ["22"]}
    (route,) = apply(behind, builder=straight_on_through_a_crossing(94, 12.0)).outcome.edits[0].routes
    assert route.arrives


@pytest.mark.parametrize("target", [11, 12])
def test_of_two_routes_through_a_junction_the_one_to_the_target_is_driven(apply: Apply, target: int) -> None:
    crossing = [lane for lane in straight_on_through_a_crossing(0).lanes if lane.lanelet_id in (31, 32, 33)]
    lanes = (
        Lane(1, line((0, 0), (100, 0)), successors=(11, 12)),
        Lane(11, line((100, 0), (130, 0)), successors=(21,), predecessors=(1,)),
        Lane(12, line((100, 0), (130, 3.5)), successors=(22,), predecessors=(1,)),
        Lane(21, line((130, 0), (200, 0)), predecessors=(11,), left=(22, True)),
        Lane(22, line((130, 3.5), (200, 3.5)), predecessors=(12,), right=(21, True)),
        *crossing,
    )
    builder = ScenarioBuilder(lanes, (driving(36, (40, 0), 8.0, 151),))
    (route,) = (
        apply({"op": "reroute", "vehicles": ["36"], "to": [str(target)]}, builder=builder).outcome.edits[0].routes
    )
    assert route.arrives
    assert route.lanelets == (1, target, target + 10)


def test_a_later_edit_that_sends_it_straight_on_keeps_it_in_its_lane(apply: Apply) -> None:
    back = {"op": "reroute", "vehicles": ["36"], "to": ["21"]}
    applied = apply(TO_THE_LEFT, back, builder=straight_on_through_a_crossing(103))
    assert applied.outcome.edits[1].routes[0].arrives
    assert np.abs(fronts(applied)[:, 1]).max() < 0.5


def test_it_moves_aside_only_as_far_as_it_rolls() -> None:
    rolled = np.concatenate([np.zeros(20), np.linspace(0, 15, 31)])
    onward = np.stack([2.3 + rolled, np.full(51, 3.5)], axis=1)
    track, across = lane_change_track(np.array([2.3, 0.0]), np.array([2.3, 0.0]), onward, 15.0)
    assert track[:20] == pytest.approx(np.tile([2.3, 0.0], (20, 1)))
    assert track[-1] == pytest.approx(onward[-1])
    assert np.all(np.diff(track[:, 1]) <= 0.36 * np.diff(track[:, 0]) + 1e-9)
    assert across == [y >= 0.6 * 3.5 for y in track[:, 1]]


def test_in_a_curve_it_steers_over_across_the_curve() -> None:
    angles = np.linspace(0, 1, 41)
    onward = 20.0 * np.stack([np.sin(angles), 1 - np.cos(angles)], axis=1) + np.array([0.0, 3.5])
    track, _ = lane_change_track(np.array([-0.5, 0.0]), np.array([0.0, 0.0]), onward, 40.0)
    beside_m = np.linalg.norm(track - np.array([0.0, 23.5]), axis=1) - 20.0
    assert np.all(np.diff(beside_m) < 0.01)
    assert beside_m[0] == pytest.approx(3.5, abs=0.1)
