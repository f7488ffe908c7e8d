"""Where added vehicles are put, and how fast they enter there."""

from dataclasses import replace

import numpy as np
import pytest
from support.builders import Lane, Problem, ScenarioBuilder, driving, line, town_road
from support.edits import Apply

from plannerforge.engine.vehicles import vehicle_classes
from plannerforge.schemas.errors import NotPossible

SHORT = town_road().cut(31)
CAR = {"op": "add_vehicle", "vehicle_class": "car"}


@pytest.mark.parametrize(("x_m", "is_held"), [(180.0, False), (137.0, True)])
def test_a_parked_vehicle_slows_down_only_vehicles_behind_it(apply: Apply, x_m: float, is_held: bool) -> None:
    empty = replace(SHORT, vehicles=(driving(31, (70, 0), 10.0, 31),))
    parked = replace(empty, parked=(driving(50, (x_m, 7.0), 0.0, 1, heading_rad=np.pi),))
    middle = CAR | {"at": "3", "position": "middle"}
    free, beside = (float(apply(middle, builder=builder).tracks()[101].speeds_mps[0]) for builder in (empty, parked))
    assert beside > 5.0
    assert (beside < free) is is_held


def test_the_oncoming_lane_is_the_adjacent_one_not_a_nearer_one_across(apply: Apply) -> None:
    lanes = (
        Lane(1, line((0, 0), (100, 0)), left=(2, False)),
        Lane(2, line((100, 3.5), (0, 3.5)), left=(1, False)),
        Lane(3, line((62, 4), (42, -1))),
    )
    alone = ScenarioBuilder(lanes, (driving(31, (10, 0), 5.0, 31),), problems=(Problem(goal=(80.0, 0.0, 8.0, 3.0)),))
    applied = apply(CAR | {"at": "ego", "lane": "oncoming", "offset_m": 10, "speed": "0m/s"}, builder=alone)
    assert applied.tracks()[101].positions[0] == pytest.approx((50.0, 3.5), abs=0.01)


def test_several_vehicles_with_a_destination_enter_on_the_route_to_it(apply: Apply) -> None:
    edit = apply(CAR | {"at": "1", "position": "185m", "count": 2, "spacing_m": 20, "to": ["13"]}).outcome.edits[0]
    assert [route.lanelets[0] for route in edit.routes] == [1, 12]
    assert "from lanelet 1 at 185.0 m to lanelet 12 at 5.0 m, 20 m apart" in edit.what


def test_several_vehicles_on_one_lanelet_are_reported_together(apply: Apply) -> None:
    edit = apply(CAR | {"at": "13", "position": "20m", "count": 3, "spacing_m": 12}, dry_run=True).outcome.edits[0]
    assert edit.what.startswith("cars 101, 102, 103 on lanelet 13 from 20.0 to 44.0 m, 12 m apart")


def test_vehicles_that_would_overlap_are_refused_with_the_least_spacing_that_works(apply: Apply) -> None:
    row = CAR | {"at": "3", "position": "60m", "count": 3}
    with pytest.raises(NotPossible, match="1 of 3 vehicles fit 3 m apart") as caught:
        apply(row | {"spacing_m": 3})
    assert caught.value.valid == ("spacing_m=4.9",)
    assert caught.value.next_step == "choose a larger spacing_m"
    assert len(apply(row | {"spacing_m": 4.9}, dry_run=True).outcome.edits[0].vehicles) == 3


def test_several_of_which_one_has_no_place_are_refused_with_how_many_have_one(apply: Apply) -> None:
    row = CAR | {"at": "2", "position": "10m", "spacing_m": 24}
    with pytest.raises(NotPossible, match=r"2 of 4 vehicles .* by vehicle 33") as caught:
        apply(row | {"count": 4})
    assert caught.value.valid == ("count=2",)
    assert len(apply(row | {"count": 2}, dry_run=True).outcome.edits[0].vehicles) == 2


@pytest.mark.parametrize(("offset_m", "side"), [(2.0, 1), (-2.0, -1)])
def test_the_places_proposed_for_an_occupied_one_are_on_the_requested_side(
    apply: Apply, offset_m: float, side: int
) -> None:
    with pytest.raises(NotPossible, match=r"lanelet 1 at .* occupied by the ego") as caught:
        apply(CAR | {"at": "ego", "offset_m": offset_m}, builder=SHORT)
    stations = [float(value.partition("position='")[2].removesuffix("m'")) for value in caught.value.valid]
    assert stations
    assert all((station - 40.0) * side > 0 for station in stations)
    apart_m = min(abs(station - 40.0) for station in stations) - 4.508 / 2 - vehicle_classes()["car"].length_m / 2
    assert apart_m >= vehicle_classes()["car"].minimum_gap_m - 0.01
