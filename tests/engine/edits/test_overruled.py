"""An edit of which those that follow leave nothing is not done, and what keeps a vehicle from its aim is named."""

from typing import Any

import pytest
from support.builders import Lane, ScenarioBuilder, driving, line, town_road
from support.edits import Apply

FREE = town_road().with_vehicles(driving(31, (70, 0), 10.0, 101), driving(35, (165, 0), 8.0, 101))


def lane(side: str, time_s: float) -> dict[str, Any]:
    return {"op": "change_lane", "vehicles": ["31"], "lane": side, "time_s": time_s}


def held(speed: str, time_s: float) -> dict[str, Any]:
    return {"op": "set_speed", "vehicles": ["31"], "speed": speed, "time_s": time_s}


def sent(target: str) -> dict[str, Any]:
    return {"op": "reroute", "vehicles": ["31"], "to": [target]}


def behaving(*params: str, preset: str | None = None) -> dict[str, Any]:
    return {"op": "set_behaviour", "vehicles": ["31"], "preset": preset, "params": list(params)}


def goal(lanelet: str) -> dict[str, Any]:
    return {"op": "set_goal", "to": [lanelet]}


TRUCK = {"op": "add_vehicle", "vehicle_class": "truck", "at": "2", "position": "120m"}


@pytest.mark.parametrize(
    ("first", "second", "why"),
    [
        (sent("2"), sent("11"), "later edits override it"),
        (held("3m/s", 2.0), held("15m/s", 2.0), "later edits override it"),
        (TRUCK, {"op": "remove_vehicle", "vehicles": ["new:0"]}, "a later edit removes its vehicles"),
        (held("3m/s", 2.0), {"op": "remove_vehicle", "vehicles": ["31"]}, "a later edit removes its vehicles"),
        (goal("1"), goal("11"), "a later edit replaces it"),
        (behaving(preset="eco"), behaving(preset="aggressive"), "later edits override it"),
        (behaving("tau=2"), behaving("tau=0.5", "sigma=0"), "later edits override it"),
        (behaving("tau*2"), behaving("minGap*2", preset="balanced"), "later edits override it"),
    ],
)
def test_an_edit_without_remaining_effect_is_not_done(
    apply: Apply, first: dict[str, Any], second: dict[str, Any], why: str
) -> None:
    one, other = apply(first, second, builder=FREE).outcome.edits
    assert not one.done
    assert one.what.endswith(f"; {why}")
    assert other.done


def test_an_edit_that_was_carried_out_before_another_one_took_over_is_done(apply: Apply) -> None:
    one, other = apply(lane("left", 1.0), lane("right", 6.0), builder=FREE).outcome.edits
    assert (one.done, other.done) == (True, True)
    assert one.routes[0].arrives
    assert all(edit.done for edit in apply(held("6m/s", 0.0), held("15m/s", 4.0), builder=FREE).outcome.edits)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (behaving(preset="eco"), behaving("tau=0.5")),
        (behaving("tau=2"), behaving("tau*2")),
        (behaving("tau=2"), behaving("minGap=1")),
        (behaving(preset="eco"), behaving(preset="aggressive") | {"vehicles": ["35"]}),
    ],
)
def test_a_partly_applied_behaviour_is_done(apply: Apply, first: dict[str, Any], second: dict[str, Any]) -> None:
    assert all(edit.done for edit in apply(first, second, builder=FREE).outcome.edits)


def test_a_speed_replaced_before_it_is_reached_is_reported(apply: Apply) -> None:
    what = apply(held("3m/s", 1.0), held("15m/s", 1.5), builder=FREE).outcome.edits[0].what
    assert what.endswith("another edit sets its speed to 15.0 m/s from 1.5 s")


def test_a_replaced_target_is_not_reported_as_a_missing_gap(apply: Apply) -> None:
    first, _ = apply(sent("2"), sent("11"), builder=FREE).outcome.edits
    assert first.routes[0].reason == "a later edit sends it elsewhere"


def test_the_missing_gap_is_named_before_the_end_of_the_network(apply: Apply) -> None:
    road = (Lane(1, line((0, 0), (150, 0)), left=(2, True)), Lane(2, line((0, 3.5), (150, 3.5)), right=(1, True)))
    wall = [driving(key, (5 + 9 * place, 3.5), 10.0, 101) for place, key in enumerate(range(40, 56))]
    builder = ScenarioBuilder(road, (driving(31, (115, 0), 12.0, 101), *wall))
    (route,) = apply(lane("left", 0.5), builder=builder).outcome.edits[0].routes
    missing, _, in_the_way = route.reason.partition("; ")
    assert missing == "no room to change into lanelet 2 before it leaves the network on lanelet 1"
    assert in_the_way == "in the way: vehicle 52, vehicle 53, vehicle 51"


def test_a_change_without_enough_time_is_reported(apply: Apply) -> None:
    (route,) = apply(lane("left", 9.7), builder=FREE).outcome.edits[0].routes
    assert route.reason == "no time to change into lanelet 2 before the scenario ends at 10.0 s"
