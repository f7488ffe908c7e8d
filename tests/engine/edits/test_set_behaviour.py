"""Edit B."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.builders import ScenarioBuilder, crossing, driving, town_road
from support.edits import Apply

from plannerforge.engine.commonroad.tracks import Track
from plannerforge.engine.cosimulation.driver import PARAMETERS, behaviour_from, presets, usual_behaviour
from plannerforge.engine.vehicles.classes import vehicle_classes
from plannerforge.schemas.errors import InvalidRequest, UnknownName

ALONE = town_road().with_vehicles(driving(31, (10, 0), 5.0, 151))


def driven(apply: Apply, vehicle: int, builder: object, **behaviour: object) -> Track:
    return apply({"op": "set_behaviour", "vehicles": [str(vehicle)], **behaviour}, builder=builder).tracks()[vehicle]


def test_presets_act_in_their_order(apply: Apply) -> None:
    reached = {name: driven(apply, 31, ALONE, preset=name).positions[50][0] for name in presets()}
    assert reached["emergency"] > reached["aggressive"] > reached["balanced"] > reached["cautious"] > reached["eco"]


def test_the_effective_value_of_a_relative_parameter_is_reported(apply: Apply) -> None:
    first = {"op": "set_behaviour", "vehicles": ["31"], "params": ["tau=2"]}
    twice = {"op": "set_behaviour", "vehicles": ["31", "32", "33"], "params": ["tau*2", "sigma=0.1"]}
    _, told = apply(first, twice).outcome.edits
    assert told.what == "tau*2 (2 … 4) sigma=0.1 for 31, 32, 33"


def test_a_longer_headway_keeps_farther_from_the_leader(apply: Apply) -> None:
    west = math.pi
    leader, follower = (driving(key, (x, 7), 8.0, 151, heading_rad=west) for key, x in ((32, 240), (33, 270)))
    builder = town_road().with_vehicles(leader, follower)
    places = {tau: driven(apply, 33, builder, params=[f"tau={tau}"]).positions[150][0] for tau in (0.8, 3.0)}
    assert places[3.0] - places[0.8] > 8.0


WEST, NORTH = math.pi, math.pi / 2
STANDING_AHEAD = town_road().with_vehicles(
    driving(32, (150, 7), 0.0, 151, heading_rad=WEST), driving(31, (250, 7), 12.0, 151, heading_rad=WEST)
)
SLOW_AHEAD = town_road().with_vehicles(driving(32, (80, 0), 4.0, 151), driving(31, (30, 0), 12.0, 151))
IN_THE_LEFT_LANE = town_road().with_vehicles(driving(31, (10, 3.5), 10.0, 151))
YIELDING = crossing().with_vehicles(
    driving(31, (-50, 0), 8.0, 121),
    driving(40, (0, -60), 8.0, 121, heading_rad=NORTH),
    driving(41, (0, -85), 8.0, 121, heading_rad=NORTH),
)


ACTING = [
    ("accel", 1.0, 3.0, ALONE),
    ("speedFactor", 0.7, 1.2, ALONE),
    ("sigma", 0.0, 1.0, ALONE),
    ("decel", 2.0, 6.0, STANDING_AHEAD),
    ("minGap", 1.0, 6.0, STANDING_AHEAD),
    ("lcSpeedGain", 0.0, 10.0, SLOW_AHEAD),
    ("lcKeepRight", 0.0, 10.0, IN_THE_LEFT_LANE),
    ("impatience", 0.0, 1.0, YIELDING),
]
IN_TESTS_OF_THEIR_OWN = {"tau", "lcStrategic", "lcCooperative"}


def test_every_parameter_is_shown_to_act() -> None:
    assert {name for name, *_ in ACTING} | IN_TESTS_OF_THEIR_OWN == set(PARAMETERS)


@pytest.mark.parametrize(("parameter", "low", "high", "builder"), ACTING)
def test_a_parameter_acts(apply: Apply, parameter: str, low: float, high: float, builder: ScenarioBuilder) -> None:
    tracks = [driven(apply, 31, builder, params=[f"{parameter}={value}"]) for value in (low, high)]
    steps = min(len(track.positions) for track in tracks)
    assert np.abs(tracks[0].positions[:steps] - tracks[1].positions[:steps]).max() > 2.0


def test_the_eagerness_to_change_lanes_for_the_route_acts(apply: Apply) -> None:
    away = {"op": "reroute", "vehicles": ["31"], "to": ["13"]}
    beside = []
    for value in (0.1, 10):
        manner = {"op": "set_behaviour", "vehicles": ["31"], "params": [f"lcStrategic={value}", "lcKeepRight=0"]}
        beside.append(apply(away, manner, builder=IN_THE_LEFT_LANE).tracks()[31].positions[60][1])
    assert beside[0] > 3.0
    assert beside[1] < 0.5


def test_willingness_to_cooperate_lets_another_vehicle_in(apply: Apply) -> None:
    merging = replace(
        town_road().with_vehicles(driving(31, (60, 0), 8.0, 151), driving(33, (58, 3.5), 10.0, 151)), problems=()
    )
    away = {"op": "reroute", "vehicles": ["33"], "to": ["13"]}
    arrives = {}
    for value in (0, 1):
        params = [f"lcCooperative={value}", "lcKeepRight=0", "lcSpeedGain=0"]
        applied = apply(away, {"op": "set_behaviour", "vehicles": ["31"], "params": params}, builder=merging)
        arrives[value] = applied.outcome.edits[0].routes[0].arrives
    assert arrives == {0: False, 1: True}


def test_a_class_with_its_own_gap_keeps_it_and_the_report_says_so(apply: Apply) -> None:
    applied = apply({"op": "set_behaviour", "vehicles": ["34"], "preset": "cautious"})
    assert "motorcycle 34 keeps its own minGap of 2 m" in applied.outcome.edits[0].what
    usual = usual_behaviour(vehicle_classes()["motorcycle"])
    assert behaviour_from(usual, "cautious", [], 2.0).values["minGap"] == 2.0
    assert behaviour_from(usual, "cautious", ["minGap=5"], 2.0).values["minGap"] == 5.0


def test_class_and_size_stay(apply: Apply) -> None:
    applied = apply({"op": "set_behaviour", "vehicles": ["33"], "preset": "aggressive"})
    old, new = applied.base_tracks()[33], applied.tracks()[33]
    assert (new.kind, new.length_m, new.width_m) == (old.kind, old.length_m, old.width_m)


def test_parameters_are_set_on_top_of_the_preset() -> None:
    usual = usual_behaviour(vehicle_classes()["car"])
    behaviour = behaviour_from(usual, "Cautious", ["tau=2.5", "minGap*2"])
    assert behaviour.preset == "cautious"
    assert dict(behaviour.values) == {**presets()["cautious"], "tau": 2.5, "minGap": 8.0}


def test_every_preset_is_within_the_valid_ranges() -> None:
    for values in presets().values():
        assert list(values) == list(PARAMETERS)
        assert all(PARAMETERS[name].contains(value) for name, value in values.items())


def test_an_unknown_preset_is_refused_with_the_six(apply: Apply) -> None:
    with pytest.raises(UnknownName, match="no behaviour preset 'zen'") as caught:
        apply({"op": "set_behaviour", "vehicles": ["31"], "preset": "zen"})
    assert set(caught.value.valid) == set(presets())


@pytest.mark.parametrize(
    ("text", "allowed"),
    [
        ("tau=-1", "tau above 0 up to 10"),
        ("tau=0", "tau above 0 up to 10"),
        ("sigma=1.5", "sigma from 0 to 1"),
        ("accel=0", "accel above 0 up to 15"),
        ("decel=99", "decel above 0 up to 15"),
        ("lcKeepRight=-0.1", "lcKeepRight from 0 to 100"),
        ("minGap-5", "minGap from 0 to 50"),
    ],
)
def test_a_value_out_of_range_is_refused_with_the_range(apply: Apply, text: str, allowed: str) -> None:
    with pytest.raises(InvalidRequest, match="out of range") as caught:
        apply({"op": "set_behaviour", "vehicles": ["31"], "params": [text]})
    nearest, in_range = caught.value.valid
    assert in_range == allowed
    assert apply({"op": "set_behaviour", "vehicles": ["31"], "params": [nearest]}).outcome.edits[0].done


def test_an_unknown_parameter_is_refused_with_the_eleven(apply: Apply) -> None:
    with pytest.raises(UnknownName, match="hornLevel") as caught:
        apply({"op": "set_behaviour", "vehicles": ["31"], "params": ["hornLevel=0.7"]})
    assert len(caught.value.valid) == 11


def test_something_to_set_is_needed(apply: Apply) -> None:
    with pytest.raises(InvalidRequest, match="needs a preset or params"):
        apply({"op": "set_behaviour", "vehicles": ["31"]})


def test_a_parameter_set_twice_is_refused(apply: Apply) -> None:
    with pytest.raises(InvalidRequest, match="tau is set twice"):
        apply({"op": "set_behaviour", "vehicles": ["31"], "params": ["tau=1", "tau=2"]})
