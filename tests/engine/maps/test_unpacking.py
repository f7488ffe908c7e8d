import bz2
import gzip
from pathlib import Path

import pytest

from plannerforge.engine.maps.drawn_library import LIBRARY
from plannerforge.engine.maps.unpacking import is_map, named_by_content, root_element, stored_name, unpacked
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


def test_a_plain_map_stays_in_place(tmp_path: Path) -> None:
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


@pytest.mark.parametrize(
    ("name", "stored"),
    [
        ("a.osm", "map.osm"),
        ("A.OSM.PBF", "map.osm"),
        ("a.osm.xml.gz", "map.osm"),
        ("a.net.xml", "map.net.xml"),
        ("a.net.xml.bz2", "map.net.xml"),
        ("a.xml", "map.xml"),
        ("a.xodr", "map.xodr"),
        ("a.town", "map.osm"),
    ],
)
def test_a_map_is_stored_under_the_ending_of_its_format(name: str, stored: str) -> None:
    assert stored_name(Path(name)) == stored


@pytest.mark.parametrize("name", ["web.osm.xml", "town.xml", "town.net.xml", "town.osm"])
def test_the_content_tells_the_format_of_a_map(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(TOWN)
    folder = tmp_path / "out"
    folder.mkdir()
    named = named_by_content(tmp_path / name, folder)
    assert (named.name, named.read_bytes()) == (name if name == "town.osm" else f"{name.split('.')[0]}.osm", TOWN)


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress])
def test_a_packed_map_is_recognised_by_its_first_bytes(tmp_path: Path, pack: object) -> None:
    path = tmp_path / "town.osm"
    path.write_bytes(pack(TOWN))  # type: ignore[operator]
    folder = tmp_path / "out"
    folder.mkdir()
    assert root_element(path) == "osm"
    assert unpacked(path, folder).read_bytes() == TOWN


def test_a_map_that_is_not_packed_may_have_the_name_of_a_packed_one(tmp_path: Path) -> None:
    path = tmp_path / "town.osm.gz"
    path.write_bytes(TOWN)
    assert named_by_content(unpacked(path, tmp_path), tmp_path) == tmp_path / "town.osm"


@pytest.mark.parametrize(
    ("text", "root"),
    [
        ("<?xml version='1.0'?>\n<!-- <net> -->\n<osm/>", "osm"),
        ("\ufeff<x:OpenDRIVE xmlns:x='y'>", "OpenDRIVE"),
        ("<commonRoad>", "commonRoad"),
        ("<html>", None),
        ("osm: 1", None),
        ("<!-- never closed <osm>", None),
        ("", None),
    ],
)
def test_the_root_element_is_found_behind_comments(tmp_path: Path, text: str, root: str | None) -> None:
    (tmp_path / "file").write_text(text, encoding="utf-8")
    assert root_element(tmp_path / "file") == root
    (tmp_path / "file").write_text(text, encoding="utf-16")
    assert root_element(tmp_path / "file") == root
