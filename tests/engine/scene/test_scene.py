"""What stands and starts somewhere in a region counts by its middle."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.builders import driving, town_road

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.scene.scene import Scene

PARKED = replace(town_road().cut(3), parked=(driving(50, (120, 0), 0.0, 1),))


def scene_with(folder: Path, *replaced: tuple[str, str]) -> Scene:
    """The road with a parked car, with some of its XML in other words."""
    path = PARKED.write(folder / "scenario.xml")
    text = path.read_text(encoding="utf-8")
    for old, new in replaced:
        assert text.count(old) == 1
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return Scene.of(read_scenario(path))


def region(x_m: float, y_m: float) -> str:
    size = "<length>2.0</length><width>1.0</width><orientation>0.0</orientation>"
    return f"<position><rectangle>{size}<center><x>{x_m}</x><y>{y_m}</y></center></rectangle></position>"


def test_a_standing_obstacle_with_an_uncertain_position_is_in_its_region(tmp_path: Path) -> None:
    point = "<position><point><x>120.0000</x><y>0.0000</y></point></position>"
    scene = scene_with(tmp_path, (point, region(121.0, 0.5)))
    assert scene.standing[50].positions[0] == pytest.approx([121.0, 0.5])
    assert scene.matches[50].lanelets[0] == 1


def test_an_uncertain_start_of_the_ego_counts_by_its_middle(tmp_path: Path) -> None:
    speed = "<velocity><exact>10.0</exact></velocity><orientation><exact>0.0</exact></orientation><yawRate>"
    about = "<intervalStart>{}</intervalStart><intervalEnd>{}</intervalEnd>"
    uncertain = f"<velocity>{about.format(8.0, 9.0)}</velocity><orientation>{about.format(-0.1, 0.3)}</orientation>"
    point = "<initialState><position><point><x>40.0000</x><y>0.0000</y></point></position>"
    start = "<initialState>" + region(41.0, 0.2)
    scene = scene_with(tmp_path, (speed, uncertain + "<yawRate>"), (point, start))
    assert scene.ego is not None
    assert np.asarray(scene.ego.position) == pytest.approx([41.0, 0.2])
    assert scene.ego.speed_mps == pytest.approx(8.5)
    assert scene.ego.heading_rad == pytest.approx(0.1)
