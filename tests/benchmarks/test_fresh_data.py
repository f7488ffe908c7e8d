"""Fresh data: the same seed gives the same bytes, another one others; what is broken is read or refused by name."""

from contextlib import suppress
from pathlib import Path

import pytest

from benchmarks.symmetries.fresh_data import fresh_maps, fresh_recordings, fresh_scenarios, mutated_maps
from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.commonroad.tracks import recorded_tracks
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.maps.facts import read_map
from plannerforge.schemas.errors import UnsafeInput
from plannerforge.schemas.generation import ReadMapRequest

pytestmark = [pytest.mark.shared_data, pytest.mark.usefixtures("shared_data")]


def contents(paths: tuple[Path, ...]) -> list[bytes]:
    return [path.read_bytes() for path in paths]


def test_a_seed_gives_the_same_maps_and_another_one_others(tmp_path: Path) -> None:
    first, again = (fresh_maps(5, tmp_path / name, 3) for name in ("first", "again"))
    other = fresh_maps(6, tmp_path / "other", 3)
    assert contents(first) == contents(again)
    assert not set(contents(first)) & set(contents(other))


def test_every_fresh_map_is_read_and_shows_a_site(tmp_path: Path) -> None:
    for path in fresh_maps(7, tmp_path, 5):
        assert read_map(ReadMapRequest(path=str(path)), silent).sites


def test_mutated_maps_are_read_or_refused_by_name(tmp_path: Path) -> None:
    for path in mutated_maps(8, tmp_path, 12):
        with suppress(UnsafeInput):
            facts = read_map(ReadMapRequest(path=str(path)), silent)
            shown = [facts.place, *facts.places, *facts.streets, *facts.refs]
            assert all(len(name) <= 200 and name.isprintable() for name in shown)


def test_a_seed_gives_the_same_recordings_and_another_one_others(tmp_path: Path) -> None:
    first, again = (fresh_recordings(5, tmp_path / name, 2) for name in ("first", "again"))
    assert contents(first) == contents(again)
    assert not {path.name for path in first} & {path.name for path in fresh_recordings(6, tmp_path / "other", 2)}


def test_fresh_recordings_are_read_or_refused_by_name(tmp_path: Path) -> None:
    for path in fresh_recordings(9, tmp_path, 6):
        with suppress(UnsafeInput):
            loaded = read_scenario(path)
            assert loaded.declared_id == path.stem
            assert recorded_tracks(loaded.scenario)


def test_every_other_fresh_scenario_is_generated(tmp_path: Path) -> None:
    recording, generated = fresh_scenarios(5, tmp_path, 2)
    assert not recording.name.startswith("ZAM_Freshtown")
    assert read_scenario(generated).benchmark_id.startswith("ZAM_Freshtown")
