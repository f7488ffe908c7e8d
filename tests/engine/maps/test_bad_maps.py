"""Maps that cannot be used end in one clear error; unusual ones are read."""

from collections.abc import Iterable
from pathlib import Path

import pytest

from plannerforge.engine.execution.progress import silent
from plannerforge.engine.maps.draw_library import LIBRARY
from plannerforge.engine.maps.facts import read_map
from plannerforge.schemas.errors import UnsafeInput
from plannerforge.schemas.generation import MapFacts, ReadMapRequest

NODES = '<node id="1" lat="48.0" lon="11.0"/><node id="2" lat="48.001" lon="11.002"/>'


def way(highway: str, number: int = 1) -> str:
    return f'<way id="{number}"><nd ref="1"/><nd ref="2"/><tag k="highway" v="{highway}"/></way>'


def read(folder: Path, text: str | bytes | Iterable[str]) -> MapFacts:
    path = folder / "some.osm"
    with path.open("wb") as stream:
        for part in [text] if isinstance(text, str | bytes) else text:
            stream.write(part if isinstance(part, bytes) else part.encode())
    return read_map(ReadMapRequest(path=str(path)), silent)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("", "not well-formed"),
        ("<osm/>", "holds no road for vehicles"),
        (f"<osm>{NODES}</osm>", "holds no road for vehicles"),
        (f"<osm>{NODES}{way('footway')}{way('path', 2)}</osm>", "no road for vehicles, only footway, path"),
        ((LIBRARY / "neuland.osm").read_bytes()[:20_000], "not well-formed"),
        ("<!DOCTYPE osm SYSTEM 'http://127.0.0.1/x.dtd'><osm/>", "declares a document type"),
        (f"<osm>{NODES}<way id='x'/></osm>", "not readable as OpenStreetMap"),
    ],
    ids=["empty", "no content", "no ways", "only footways", "cut in the middle", "DOCTYPE", "id no number"],
)
def test_a_map_without_use_is_refused(tmp_path: Path, content: str | bytes, complaint: str) -> None:
    with pytest.raises(UnsafeInput, match=complaint):
        read(tmp_path, content)


@pytest.mark.parametrize(
    "bounds",
    [
        "",
        '<bounds minlat="48" minlon="11" maxlat="48" maxlon="11"/>',
        '<bounds minlat="49" minlon="11" maxlat="48" maxlon="12"/>',
        '<bounds minlat="nan" minlon="11" maxlat="48" maxlon="12"/>',
    ],
    ids=["none", "of zero size", "upside down", "no number"],
)
def test_where_the_header_gives_no_box_the_roads_do(tmp_path: Path, bounds: str) -> None:
    facts = read(tmp_path, f"<osm>{bounds}{NODES}{way('primary')}</osm>")
    assert (facts.south, facts.west, facts.north, facts.east) == (48.0, 11.0, 48.001, 11.002)
    assert facts.country == "DEU"
    assert facts.place == "some"


def test_many_nodes_beside_the_roads_are_read(tmp_path: Path) -> None:
    crowd = (f'<node id="{n}" lat="48.0" lon="{11 + n * 1e-7:.7f}"/>' for n in range(3, 100_000))
    facts = read(tmp_path, ["<osm>", NODES, *crowd, way("primary"), "</osm>"])
    assert facts.road_km == 0.19


def test_a_map_of_more_bytes_than_are_read_is_refused_by_its_size(tmp_path: Path) -> None:
    path = tmp_path / "huge.osm"
    with path.open("wb") as stream:
        stream.truncate(60_000_001)
    with pytest.raises(UnsafeInput, match="60,000,001 bytes; at most 60,000,000 are read"):
        read_map(ReadMapRequest(path=str(path)), silent)
