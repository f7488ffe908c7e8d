"""Traffic lights and posted speeds of a file hold for the vehicles that SUMO drives."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.builders import town_road

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.network.sumo_export.layout import NetLayout
from plannerforge.engine.network.sumo_export.speeds import lowered_by_curves, posted_speeds, straight_speeds
from plannerforge.engine.network.sumo_export.writer import Signal, signals_of, sumo_net

STEP_S = 0.1
CYCLE = (("red", 30), ("redYellow", 10), ("green", 50), ("yellow", 10))


@pytest.fixture
def network(tmp_path: Path) -> Any:
    """The lanelet network of the town road."""
    return read_scenario(town_road().write(tmp_path / "town.xml")).scenario.lanelet_network


def add_light(network: Any, key: int, lanelet: int, offset: int = 0, direction: str = "all") -> Any:
    """Put a light with four phases at a lanelet."""
    from commonroad.scenario import traffic_light as lights

    elements = [lights.TrafficLightCycleElement(lights.TrafficLightState(state), steps) for state, steps in CYCLE]
    cycle = lights.TrafficLightCycle(elements, time_offset=offset)
    light = lights.TrafficLight(key, np.zeros(2), cycle, active=True, direction=lights.TrafficLightDirection(direction))
    network.add_traffic_light(light, {lanelet})
    return light


def write(network: Any, folder: Path, signals: tuple[Signal, ...]) -> Path:
    layout, path = NetLayout.of(network), folder / "town.net.xml"
    speeds_mps = lowered_by_curves(layout, straight_speeds(layout, {}))
    path.write_text(sumo_net(layout, speeds_mps, signals), encoding="utf-8")
    return path


@pytest.mark.parametrize("offset", [0, 37, -20])
def test_a_light_has_the_letter_of_its_colour_at_every_step(network: Any, offset: int) -> None:
    light = add_light(network, 900, 1, offset)
    (signal,) = signals_of(network, STEP_S)
    letters = {"red": "r", "redYellow": "u", "green": "G", "yellow": "y"}
    shown = [signal.letter_at(step * STEP_S) for step in range(250)]
    assert shown == [letters[light.get_state_at_time_step(step).value] for step in range(250)]


@pytest.mark.parametrize("offset", [0, 1, 37, 99, 250, -20])
def test_sumo_shows_the_colour_of_every_step(network: Any, tmp_path: Path, offset: int) -> None:
    import libsumo

    light = add_light(network, 900, 1, offset)
    path = write(network, tmp_path, signals_of(network, STEP_S))
    letters = {"red": "r", "redYellow": "u", "green": "G", "yellow": "y"}
    try:
        libsumo.start(["sumo", "-n", str(path), "--step-length", str(STEP_S), "--no-step-log", "--no-warnings"])
        for step in range(220):
            libsumo.simulationStep()
            expected = letters[light.get_state_at_time_step(step).value]
            assert set(libsumo.trafficlight.getRedYellowGreenState("tl900").upper()) == {expected.upper()}
    finally:
        libsumo.close()


def test_a_light_for_a_direction_leaves_the_other_paths_free(network: Any, tmp_path: Path) -> None:
    add_light(network, 900, 1, direction="right")
    text = write(network, tmp_path, signals_of(network, STEP_S)).read_text(encoding="utf-8")
    controlled = [line for line in text.splitlines() if 'tl="tl900"' in line]
    assert len(controlled) == 1
    assert 'to="e12"' in controlled[0]


def test_a_light_that_is_off_or_has_no_cycle_is_left_out(network: Any) -> None:
    add_light(network, 900, 1).active = False
    add_light(network, 901, 2).traffic_light_cycle.cycle_elements = []
    assert signals_of(network, STEP_S) == ()


def test_a_posted_speed_counts_until_a_faster_recording(network: Any) -> None:
    from commonroad.scenario.traffic_sign import TrafficSign, TrafficSignElement, TrafficSignIDZamunda

    element = TrafficSignElement(TrafficSignIDZamunda.MAX_SPEED, ["8.5"])
    network.add_traffic_sign(TrafficSign(950, [element], {13}, np.zeros(2)), {13})
    posted = posted_speeds(network)
    assert posted == {13: 8.5}
    layout = NetLayout.of(network)
    assert lowered_by_curves(layout, straight_speeds(layout, {}, posted))[13] == 8.5
    assert lowered_by_curves(layout, straight_speeds(layout, {13: 10.0}, posted))[13] == pytest.approx(10.5)
