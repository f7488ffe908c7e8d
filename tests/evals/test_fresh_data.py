"""Fresh maps: the same seed gives the same bytes, another one others; mutated ones are read or refused by name."""

from contextlib import suppress
from pathlib import Path

import pytest

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.maps.facts import read_map
from plannerforge.evals.fresh_data import fresh_maps, mutated_maps
from plannerforge.schemas.errors import UnsafeInput
from plannerforge.schemas.generation import ReadMapRequest

pytestmark = [pytest.mark.shared_data, pytest.mark.usefixtures("shared_data")]


def contents(paths: tuple[Path, ...]) -> list[bytes]:
    return [path.read_bytes() for path in paths]


def test_a_seed_gives_the_same_maps_and_another_one_others(tmp_path: Path) -> None:
    first, again = (fresh_maps(5, tmp_path / name, 5) for name in ("first", "again"))
    other = fresh_maps(6, tmp_path / "other", 5)
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
