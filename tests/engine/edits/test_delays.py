"""The report names what kept a late vehicle from getting on."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commonroad.scenario import traffic_light as lights
from support.builders import town_road

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.commonroad.tracks import Track
from plannerforge.engine.cosimulation.handover import HandoverTrack
from plannerforge.engine.edits.explanations import delay, is_red
from plannerforge.engine.scene.scene import Ego, Scene

LIGHT, OTHER_LIGHT = 900, 901


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    """The town road with a light at lanelet 1 that is red for three seconds and green for five."""
    loaded = read_scenario(town_road().write(tmp_path / "town.xml"))
    add_light(loaded.scenario.lanelet_network, LIGHT, ("red", 30), ("green", 50))
    return Scene.of(loaded)


def add_light(network: object, key: int, *phases: tuple[str, int]) -> None:
    elements = [lights.TrafficLightCycleElement(lights.TrafficLightState(state), steps) for state, steps in phases]
    network.add_traffic_light(lights.TrafficLight(key, np.zeros(2), lights.TrafficLightCycle(elements)), {1})


def driven(lanes: list[str], speeds_mps: list[float], first_step: int = 0) -> HandoverTrack:
    """A driven vehicle of which only its lanes and speeds count."""
    values, still = np.array(speeds_mps), np.zeros(len(speeds_mps))
    places = np.zeros((len(values), 2))
    return HandoverTrack(51, "car", 4.5, 1.8, first_step, places, still, values, still, False, tuple(lanes))


def test_standing_at_a_red_light_is_reported(scene: Scene) -> None:
    assert (
        delay(scene, driven(["e1_0"] * 30, [0.0] * 20 + [5.0] * 10), {}) == ", after 2.0 s at a red light on lanelet 1"
    )


def test_standing_at_a_green_light_is_not_waiting_for_it(scene: Scene) -> None:
    late = driven(["e1_0"] * 30, [0.0] * 20 + [5.0] * 10, first_step=35)
    assert delay(scene, late, {}) == ", after 2.0 s standing on lanelet 1"


def test_a_light_for_another_turn_that_is_green_leaves_the_red_one_open_to_doubt(scene: Scene) -> None:
    assert is_red(scene, 1, 0)
    add_light(scene.network, OTHER_LIGHT, ("green", 30), ("red", 50))
    assert not is_red(Scene.of(scene.loaded), 1, 0)


def test_driving_as_fast_as_a_slow_lanelet_allows_is_a_reason(scene: Scene) -> None:
    scene.driven_speeds_mps[1] = 3.0
    crawling = driven(["e1_0"] * 30, [3.0] * 30)
    assert delay(scene, crawling, {}) == ", on lanelets limited to 3.0 m/s (1)"
    assert delay(scene, driven(["e1_0"] * 30, [2.0] * 30), {}) == ""


def test_driving_freely_gives_no_reason(scene: Scene) -> None:
    assert delay(scene, driven(["e1_0"] * 30, [0.0] * 5 + [12.0] * 25), {}) == ""


@pytest.mark.parametrize(("speed_mps", "first_step"), [(0.0, 35), (9.0, 0)])
def test_a_vehicle_behind_another_for_most_of_the_time_is_reported_with_it(
    scene: Scene, speed_mps: float, first_step: int
) -> None:
    late = driven(["e1_0"] * 30, [speed_mps] * 30, first_step)
    ahead, farther, beside = parked(61, (8.0, 0.5)), parked(62, (20.0, 0.0)), parked(63, (8.0, 3.5))
    own, after = replace(ahead, obstacle_id=51), parked(64, (-8.0, 0.0))
    assert delay(scene, late, {61: ahead, 62: farther, 63: beside, 51: own}).endswith(" behind vehicle 61")
    assert "behind" not in delay(scene, late, {62: replace(farther, positions=farther.positions + 20.0)})
    assert "behind" not in delay(scene, late, {63: beside, 51: own, 64: after})
    assert "behind" not in delay(scene, late, {61: replace(ahead, first_step=first_step + 20)})


def test_the_ego_and_pedestrians_are_named_by_their_kind(scene: Scene) -> None:
    late, ahead = driven(["e1_0"] * 30, [9.0] * 30), parked(61, (8.0, 0.5))
    walker = replace(ahead, kind="pedestrian")
    assert delay(replace(scene, tracks={61: walker}), late, {61: walker}) == ", behind pedestrian 61"
    led = replace(scene, ego=Ego(61, 1, np.zeros(2), 0.0, 0.0, ()))
    assert delay(led, late, {61: ahead}) == ", behind the ego"


def parked(key: int, place: tuple[float, float]) -> Track:
    """A car that stands 100 steps long, from the first one on."""
    return Track(key, "car", 4.5, 1.8, 0, np.tile(place, (100, 1)), np.zeros(100), np.zeros(100))
