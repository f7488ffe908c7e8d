"""Maps that cannot be used end in one clear error; unusual ones are read."""

import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.maps.drawn_library import LIBRARY
from plannerforge.engine.maps.facts import read_map
from plannerforge.engine.maps.osm import LIMITS, read_osm
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
        ("<osm/>", "has no road for vehicles"),
        (f"<osm>{NODES}</osm>", "has no road for vehicles"),
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
        '<bounds minlat="-90" minlon="-180" maxlat="90" maxlon="180"/>',
    ],
    ids=["none", "of zero size", "upside down", "no number", "of the whole world"],
)
def test_the_roads_give_the_box_if_the_header_lacks_it(tmp_path: Path, bounds: str) -> None:
    facts = read(tmp_path, f"<osm>{bounds}{NODES}{way('primary')}</osm>")
    assert (facts.south, facts.west, facts.north, facts.east) == (48.0, 11.0, 48.001, 11.002)
    assert facts.country == "DEU"
    assert facts.place == "some"


def crowded(count: int) -> Iterator[str]:
    """A map with many nodes beside its only road."""
    yield f"<osm>{NODES}"
    yield from (f'<node id="{n}" lat="48.0" lon="{11 + n * 1e-7:.7f}"/>' for n in range(3, count + 1))
    yield f"{way('primary')}</osm>"


def test_many_nodes_off_the_roads_are_read(tmp_path: Path) -> None:
    assert read(tmp_path, crowded(100_000)).road_km == 0.19


@pytest.mark.skipif(sys.platform != "linux", reason="the most memory ever used is read from /proc")
def test_a_map_of_many_nodes_is_read_without_keeping_the_document(tmp_path: Path) -> None:
    (tmp_path / "many.osm").write_text("".join(crowded(150_000)))
    code = (
        "import re, sys\n"
        "from pathlib import Path\n"
        "from plannerforge.engine.maps.osm import read_osm\n"
        "def most_mb():\n"
        "    return int(re.search(r'VmHWM:\\s+(\\d+)', Path('/proc/self/status').read_text())[1]) / 1024\n"
        "before = most_mb()\n"
        "print(len(read_osm(Path(sys.argv[1])).nodes), most_mb() - before)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "many.osm")], check=True, capture_output=True, text=True
    )
    count, growth_mb = done.stdout.split()
    assert int(count) == 150_000
    assert float(growth_mb) < 80


def test_a_map_of_more_elements_than_are_read_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "many.osm"
    path.write_text("".join(crowded(1_001)))
    with pytest.raises(UnsafeInput, match="has more than 1,000 elements"):
        read_osm(path, replace(LIMITS, elements=1_000))


def test_ways_may_precede_their_nodes(tmp_path: Path) -> None:
    assert read(tmp_path, f"<osm>{way('primary')}{NODES}</osm>").road_km == 0.19


def test_a_map_of_more_bytes_than_are_read_is_refused_by_its_size(tmp_path: Path) -> None:
    path = tmp_path / "huge.osm"
    with path.open("wb") as stream:
        stream.truncate(60_000_001)
    with pytest.raises(UnsafeInput, match="60,000,001 bytes; the limit is 60,000,000"):
        read_map(ReadMapRequest(path=str(path)), silent)
