import bz2
import gzip
from pathlib import Path

import pytest

from plannerforge.engine.maps.drawn_library import LIBRARY
from plannerforge.engine.maps.unpacking import is_map, unpacked
from plannerforge.schemas.errors import UnsafeInput

TOWN = (LIBRARY / "fahrhausen.osm").read_bytes()


@pytest.mark.parametrize(("ending", "pack"), [(".gz", gzip.compress), (".bz2", bz2.compress)])
def test_a_packed_map_is_unpacked_under_its_own_name(tmp_path: Path, ending: str, pack: object) -> None:
    path = tmp_path / f"Town.osm{ending}"
    path.write_bytes(pack(TOWN))  # type: ignore[operator]
    folder = tmp_path / "out"
    folder.mkdir()
    plain = unpacked(path, folder)
    assert plain == folder / "Town.osm"
    assert plain.read_bytes() == TOWN


def test_a_plain_map_stays_where_it_is(tmp_path: Path) -> None:
    assert unpacked(LIBRARY / "fahrhausen.osm", tmp_path) == LIBRARY / "fahrhausen.osm"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("ending", "pack"), [(".gz", gzip.compress), (".bz2", bz2.compress)])
def test_a_bomb_is_refused_before_it_is_whole(tmp_path: Path, ending: str, pack: object) -> None:
    path = tmp_path / f"bomb.osm{ending}"
    path.write_bytes(pack(bytes(20_000_000)))  # type: ignore[operator]
    with pytest.raises(UnsafeInput, match="more than 3,000,000 bytes"):
        unpacked(path, tmp_path, limit_bytes=3_000_000)
    assert (tmp_path / "bomb.osm").stat().st_size <= 3_000_000


@pytest.mark.parametrize(("ending", "pack"), [(".gz", gzip.compress), (".bz2", bz2.compress)])
def test_a_packed_map_that_is_cut_off_or_no_archive_is_refused(tmp_path: Path, ending: str, pack: object) -> None:
    for content in (pack(TOWN)[:500], b"no archive"):  # type: ignore[operator]
        path = tmp_path / f"broken.osm{ending}"
        path.write_bytes(content)
        with pytest.raises(UnsafeInput, match="cannot be unpacked"):
            unpacked(path, tmp_path)


def test_maps_are_known_by_their_names() -> None:
    assert all(is_map(Path(name)) for name in ("a.osm", "A.OSM", "a.osm.gz", "a.osm.bz2", "a.net.xml", "a.net.xml.gz"))
    assert not any(is_map(Path(name)) for name in ("a.xml", "a.gz", "a.osm.zip"))
