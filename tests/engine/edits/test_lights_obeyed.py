"""Driven vehicles obey the lights of the file; one that stood without a known light is told of."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
from support.builders import Problem, ScenarioBuilder, Vehicle, crossing, driving
from support.edits import Applied, Apply, apply_to

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.registry import open_traffic
from plannerforge.engine.vehicles.models import BMW_320I

STANDING = Vehicle(32, ((-14.0, 0.0, 0.0, 0.0),) * 101)
EGO = Problem(start=(-45.0, 0.0, 0.0, 0.0), goal=(55.0, 0.0, 4.0, 3.0), steps=(50, 100))
QUEUE = replace(crossing(), vehicles=(STANDING,), problems=(EGO,))
CALM = {"op": "set_behaviour", "vehicles": ["32"], "preset": "balanced"}


def with_light(builder: ScenarioBuilder, path: Path, *phases: tuple[str, int], offset: int = 0) -> Path:
    """The file with a light at the end of the lanelet on which its first road user is."""
    text = builder.write(path).read_text()
    cycle = "".join(f"<cycleElement><duration>{n}</duration><color>{c}</color></cycleElement>" for c, n in phases)
    lane = builder.lanes[0].lanelet_id
    light = (
        f'<trafficLight id="900"><cycle>{cycle}<timeOffset>{offset}</timeOffset></cycle>'
        "<direction>all</direction><active>true</active></trafficLight>"
    )
    begin = text.index(f'<lanelet id="{lane}">')
    end = text.index("</lanelet>", begin)
    text = text[:end] + '<trafficLightRef ref="900"/>' + text[end:]
    last = text.rindex("</lanelet>") + len("</lanelet>")
    path.write_text(text[:last] + light + text[last:])
    return path


def applied_to_light(tmp_path: Path, *phases: tuple[str, int]) -> Applied:
    base = with_light(QUEUE, tmp_path / "base.xml", *phases)
    return apply_to(base, tmp_path / "out", CALM)


def test_a_car_stands_at_a_red_light_after_its_behaviour_is_edited(tmp_path: Path) -> None:
    applied = applied_to_light(tmp_path, ("red", 200), ("green", 100))
    track = applied.tracks()[32]
    assert track.front_at(len(track.positions) - 1)[0] < -9.5
    assert applied.outcome.touched[0].stood_until_s is None


def test_it_drives_off_when_its_light_turns_green(tmp_path: Path) -> None:
    track = applied_to_light(tmp_path, ("red", 40), ("green", 200)).tracks()[32]
    assert track.front_at(38)[0] < -9.5
    assert track.front_at(100)[0] > 0.0


def test_a_vehicle_that_stood_without_a_known_light_is_reported_to_drive_now(apply: Apply) -> None:
    outcome = apply(CALM, builder=QUEUE).outcome
    assert outcome.touched[0].stood_until_s == 10.0


def test_reactive_traffic_of_a_run_obeys_the_light_as_it_is_when_the_ego_starts(tmp_path: Path) -> None:
    coming = replace(QUEUE, vehicles=(driving(32, (-30.0, 0.0), 8.0, 101, first_step=0),))
    path = with_light(coming, tmp_path / "base.xml", ("red", 60), ("green", 200))
    loaded = read_scenario(path)
    ego = EgoState.of(loaded.problem().initial_state)
    places = []
    with warnings.catch_warnings(), open_traffic("reactive", loaded, loaded.problem(), BMW_320I, seed=0) as traffic:
        warnings.simplefilter("ignore")
        for step in range(1, 100):
            traffic.advance(replace(ego, step=ego.step + step))
            places.append(float(traffic.driven[0].front_at(-1)[0]))
    assert np.max(places[:58]) < -9.5
    assert places[-1] > 5.0
