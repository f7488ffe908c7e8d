"""The bench of spellings of places: what it draws from an extract, and that it leaves closed roads out."""

from pathlib import Path

from benchmarks.maps.places import _drawn, _halves
from plannerforge.engine.maps import MapEntry, built_in_maps

EXTRACT = """<?xml version="1.0"?><osm version="0.6">
<node id="1" lat="54.0" lon="5.0"><tag k="place" v="town"/><tag k="name" v="Ort"/><tag k="name:fr" v="Lieu"/></node>
<node id="2" lat="54.0" lon="5.1"/>
<way id="3"><nd ref="1"/><nd ref="2"/><tag k="highway" v="residential"/><tag k="name" v="Langenbergstraße"/>
<tag k="old_name" v="Adolfstraße"/></way>
<way id="4"><nd ref="1"/><nd ref="2"/><tag k="highway" v="residential"/><tag k="name" v="Fußgängergasse"/>
<tag k="motor_vehicle" v="no"/><tag k="alt_name" v="Gasse"/></way>
</osm>"""


def an_extract(folder: Path) -> dict[str, MapEntry]:
    path = folder / "ort.osm"
    path.write_text(EXTRACT, encoding="utf-8")
    return {"ort": MapEntry(built_in_maps()[0].facts, path)}


def test_other_names_are_drawn_from_places_and_roads_that_are_open(tmp_path: Path) -> None:
    drawn = {(asked.words, asked.road, asked.language) for asked in _drawn(an_extract(tmp_path))}
    assert drawn == {("Lieu", "", "fr"), ("Adolfstraße", "Langenbergstraße", "")}


def test_half_of_an_open_road_is_drawn(tmp_path: Path) -> None:
    assert [(asked.words, asked.road, asked.half) for asked in _halves(an_extract(tmp_path))] == [
        ("Langenberg", "Langenbergstraße", True)
    ]
