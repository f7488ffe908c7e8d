"""How fast an added vehicle enters whose speed was left open: as the traffic of its lane, however the lane is cut."""

import math

import pytest
from support.builders import Lane, ScenarioBuilder, Vehicle, driving, line
from support.edits import Apply

from plannerforge.engine.vehicles import vehicle_classes

CAR = vehicle_classes()["car"]
WHOLE = (Lane(1, line((0, 0), (300, 0))),)
CUT = (Lane(1, line((0, 0), (105, 0)), successors=(2,)), Lane(2, line((105, 0), (300, 0)), predecessors=(1,)))
CUT_BEFORE = (Lane(2, line((0, 0), (95, 0)), successors=(1,)), Lane(1, line((95, 0), (300, 0)), predecessors=(2,)))
USUAL_MPS = 0.8 * 50 / 3.6
"""80% of what an urban lane allows."""


def entry_mps(apply: Apply, *vehicles: Vehicle, lanes: tuple[Lane, ...] = WHOLE, at_m: float = 100.0) -> float:
    """The speed with which a car enters at x = 100 m."""
    begins_m = lanes[-1].center[0][0] if lanes is CUT_BEFORE else 0.0
    added = {"op": "add_vehicle", "vehicle_class": "car", "at": "1", "position": f"{at_m - begins_m}m"}
    applied = apply(added, builder=ScenarioBuilder(lanes, vehicles, problems=()))
    (entered,) = applied.outcome.edits[0].vehicles
    return float(applied.tracks()[entered].speeds_mps[0])


def test_without_traffic_it_is_a_little_slower_than_the_lane_allows(apply: Apply) -> None:
    far = driving(31, (170.0, 0.0), 5.0, 61)
    assert entry_mps(apply, far) == pytest.approx(USUAL_MPS, abs=0.01)


def test_the_nearest_vehicle_of_the_lane_sets_it(apply: Apply) -> None:
    ahead, farther = driving(31, (140.0, 0.0), 9.0, 61), driving(32, (155.0, 0.0), 7.0, 61)
    assert entry_mps(apply, farther, ahead) == pytest.approx(9.0)
    assert entry_mps(apply, driving(31, (80.0, 0.0), 6.0, 61), farther) == pytest.approx(6.0)


def test_a_near_standing_leader_leaves_room_to_brake(apply: Apply) -> None:
    leader = driving(31, (108.0, 0.0), 4.0, 61)
    entered = entry_mps(apply, leader, driving(32, (98.0 - CAR.length_m, 0.0), 4.0, 61))
    assert entered <= 4.0
    standing, gap_m = driving(31, (115.0, 0.0), 0.0, 61), 15.0 - (4.5 + CAR.length_m) / 2
    moving_behind = driving(32, (88.0, 0.0), 8.0, 11)
    allowed = math.sqrt(2 * CAR.deceleration_mps2 * (gap_m - CAR.minimum_gap_m))
    assert entry_mps(apply, standing, moving_behind) == pytest.approx(min(8.0, allowed))


@pytest.mark.parametrize("lanes", [CUT, CUT_BEFORE], ids=["next lanelet", "lanelet before"])
@pytest.mark.parametrize(
    "vehicle",
    [driving(31, (125.0, 0.0), 7.0, 61), driving(31, (111.0, 0.0), 2.0, 61), driving(31, (75.0, 0.0), 8.0, 61)],
    ids=["leader", "slow leader", "follower"],
)
def test_cut_lanelets_are_one_lane(apply: Apply, lanes: tuple[Lane, ...], vehicle: Vehicle) -> None:
    assert entry_mps(apply, vehicle, lanes=lanes) == pytest.approx(entry_mps(apply, vehicle), abs=1e-6)
