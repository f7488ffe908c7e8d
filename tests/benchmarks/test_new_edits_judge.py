"""The judge of the new edits: what it reads, and what it takes for a crossing at red."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from support.builders import crossing, driving

from benchmarks.modification.new_edits.red_lights import red_crossings
from benchmarks.modification.written_tracks import Light, RoadUser, WrittenFile


def written(tmp_path: Path, phases: tuple[tuple[int, str], ...]) -> WrittenFile:
    path = replace(crossing(), vehicles=(driving(32, (-40.0, 0.0), 10.0, 60),)).write(tmp_path / "a.xml")
    file = WrittenFile.read(path)
    lanes = file.lanes | {1: replace(file.lanes[1], lights=(900,))}
    return replace(file, lanes=lanes, lights={900: Light(900, phases, 0, "all", active=True)})


def test_a_file_is_read_with_lanes_and_states(tmp_path: Path) -> None:
    file = written(tmp_path, ())
    assert file.lanes[1].successors == (2,)
    assert file.users[32].speeds.tolist() == [10.0] * 60
    assert file.lane_of(np.array([-30.0, 0.5]), 0.1) == 1


def test_a_crossing_at_red_is_found(tmp_path: Path) -> None:
    (found,) = red_crossings(written(tmp_path, ((300, "red"),)), 32, 0)
    assert (found.lane, found.step) == (1, 29)


def test_crossing_at_green_and_stopping_at_the_line_are_not_red_light_running(tmp_path: Path) -> None:
    assert red_crossings(written(tmp_path, ((100, "green"), (100, "red"))), 32, 0) == []
    file = written(tmp_path, ((300, "red"),))
    user = file.users[32]
    waits = user.places.copy()
    waits[25:] = waits[25]
    standing = RoadUser(32, "car", user.length_m, user.width_m, 0, waits, user.headings, user.speeds)
    assert red_crossings(replace(file, users={32: standing}), 32, 0) == []


def test_a_vehicle_that_could_not_stop_any_more_is_excused(tmp_path: Path) -> None:
    assert red_crossings(written(tmp_path, ((25, "green"), (300, "red"))), 32, 0) == []
    assert len(red_crossings(written(tmp_path, ((5, "green"), (300, "red"))), 32, 0)) == 1
