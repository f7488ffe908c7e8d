"""The map that a process read last is not read again."""

import os
import shutil
from pathlib import Path

import pytest

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.generation.generator import generate_scenario
from plannerforge.engine.generation.sites import count_sites
from plannerforge.engine.maps import map_file
from plannerforge.engine.maps.drawn_library import LIBRARY
from plannerforge.engine.maps.map_file import LastMap, read_map_file
from plannerforge.engine.maps.osm import OsmMap, read_osm
from plannerforge.schemas.errors import UnsafeInput
from plannerforge.schemas.generation import GenerationRequest, RequestedGoal


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The files that were really read, in order."""
    paths: list[Path] = []

    def noted(path: Path) -> OsmMap:
        paths.append(path)
        return read_osm(path)

    monkeypatch.setattr(map_file, "read_osm", noted)
    return paths


def test_a_call_of_several_scenarios_reads_its_map_once_and_leaves_it_as_it_is(
    tmp_path: Path, read: list[Path]
) -> None:
    path = Path(shutil.copy(LIBRARY / "fahrhausen.osm", tmp_path))
    (tmp_path / "made").mkdir()
    request = GenerationRequest(
        map_path=str(path),
        map_id="map_fahrhausen",
        place="Fahrhausen",
        country="ZAM",
        attribution="",
        scenario_type="intersection",
        duration_s=5.0,
        goal=RequestedGoal.of("steps:50"),
        folder=str(tmp_path / "made"),
    )
    count_sites(request, silent)
    generate_scenario(request, silent)
    generate_scenario(request.model_copy(update={"site_index": 1}), silent)
    assert read == [path]
    assert read_map_file(path) == read_osm(path)


def test_a_changed_file_is_read_again(tmp_path: Path, read: list[Path]) -> None:
    path, maps = tmp_path / "some.osm", LastMap()
    shutil.copy(LIBRARY / "fahrhausen.osm", path)
    first = maps.get(path)
    shutil.copy(LIBRARY / "landmoor.osm", path)
    os.utime(path, (1, 1))
    assert maps.get(path) == read_osm(path) != first
    assert len(read) == 2


def test_only_the_last_map_is_cached_and_no_map_after_a_broken_file(tmp_path: Path, read: list[Path]) -> None:
    maps, broken = LastMap(), tmp_path / "broken.osm"
    broken.write_text("<osm>")
    order = [LIBRARY / "fahrhausen.osm", LIBRARY / "landmoor.osm", LIBRARY / "fahrhausen.osm"]
    for path in order:
        maps.get(path)
    with pytest.raises(UnsafeInput):
        maps.get(broken)
    maps.get(order[-1])
    assert read == [*order, broken, order[-1]]


def test_a_missing_file_is_refused() -> None:
    with pytest.raises(UnsafeInput, match=r"gone\.osm cannot be read"):
        LastMap().get(Path("gone.osm"))


def test_the_sites_of_the_last_map_are_looked_for_once(tmp_path: Path) -> None:
    maps = LastMap()
    osm = maps.get(LIBRARY / "fahrhausen.osm")
    finder = maps.finder(osm, frozenset())
    found = finder.find("intersection")
    assert maps.finder(osm, frozenset()) is finder
    assert maps.finder(osm, frozenset({"primary"})) is not finder
    found.clear()
    assert finder.find("intersection"), "who is handed sites may reorder them"
    maps.get(LIBRARY / "landmoor.osm")
    assert maps.finder(osm, frozenset()) is not finder
