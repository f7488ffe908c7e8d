"""The lanelets of a track are the same however they are asked for."""

from pathlib import Path

from support.builders import Vehicle, driving, town_road

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.scene.scene import Scene


def test_the_lanelets_of_all_poses_match_those_of_each_pose(tmp_path: Path) -> None:
    for match in _scene(tmp_path).matches.values():
        assert match.at_each(151) == [match.at(index) for index in range(151)]


def test_vehicles_matched_together_are_matched_as_each_alone(tmp_path: Path) -> None:
    beside = driving(36, (20, 90), 10.0, 151)
    scene = _scene(tmp_path, *town_road().vehicles, beside, driving(37, (165, 3), 9.0, 7))
    alone = {key: scene.matcher.match(track) for key, track in scene.tracks.items()}
    assert alone[36] is None
    assert scene.matches == {key: match for key, match in alone.items() if match is not None}
    assert scene.matcher.match_all({}) == {}


def _scene(folder: Path, *vehicles: Vehicle) -> Scene:
    builder = town_road().with_vehicles(*vehicles) if vehicles else town_road()
    return Scene.of(read_scenario(builder.write(folder / "base.xml")))
