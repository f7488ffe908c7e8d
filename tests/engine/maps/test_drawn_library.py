from pathlib import Path

import pytest

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.maps.drawn_library import LIBRARY, PLANS, draw
from plannerforge.engine.maps.facts import read_map
from plannerforge.engine.maps.index import built_in_maps
from plannerforge.schemas.errors import UnsafeInput
from plannerforge.schemas.generation import ReadMapRequest


def test_the_packaged_maps_match_the_script_s_output(tmp_path: Path) -> None:
    draw(tmp_path)
    drawn = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert drawn == {path.name: path.read_bytes() for path in LIBRARY.iterdir()}


def test_the_library_has_every_type_of_site_in_zamunda() -> None:
    maps = built_in_maps()
    assert len(maps) == len(PLANS)
    held = {kind for entry in maps for kind in entry.facts.sites}
    assert held == {"highway", "urban", "intersection", "signalised_intersection", "roundabout", "rural", "ramp"}
    assert {entry.facts.country for entry in maps} == {"ZAM"}
    assert {entry.facts.attribution for entry in maps} == {"PlannerForge, MIT"}


def test_a_foreign_extract_is_openstreetmap_s_and_has_no_country_unless_stated(tmp_path: Path) -> None:
    text = (LIBRARY / "fahrhausen.osm").read_text(encoding="utf-8")
    path = tmp_path / "Some Town.osm"
    path.write_text(text.replace('generator="PlannerForge"', 'generator="x"').replace("addr:country", "note"))
    facts = read_map(ReadMapRequest(path=str(path)), silent)
    assert facts.attribution == "© OpenStreetMap contributors, ODbL"
    assert facts.country is None
    assert facts.map_id == "map_some_town"
    assert facts.place == "Fahrhausen"


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("<osm><node id='1' lat='95' lon='0'/></osm>", "95"),
        ("<gpx/>", "<gpx>"),
        ("<osm/>", "no road"),
        ("<!DOCTYPE osm [<!ENTITY a 'b'>]><osm/>", "document type"),
        ("<osm>" * 20 + "</osm>" * 20, "deeper"),
        ("not xml", "well-formed"),
    ],
)
def test_a_hostile_or_broken_map_is_refused(tmp_path: Path, content: str, complaint: str) -> None:
    path = tmp_path / "bad.osm"
    path.write_text(content)
    with pytest.raises(UnsafeInput, match=complaint):
        read_map(ReadMapRequest(path=str(path)), silent)


def test_real_extracts_have_their_known_sites(shared_data: Path) -> None:
    expected = {
        "ALB_Korce-1.osm": {"roundabout": 1},
        "munich.osm": {"signalised_intersection": 4},
        "bautzen.osm": {"highway": None, "ramp": None},
        "o2s_montlake_roundabout.osm": {"roundabout": 1},
    }
    for name, sites in expected.items():
        found = read_map(ReadMapRequest(path=str(shared_data / "data" / "osm" / name)), silent).sites
        assert all(kind in found and count in (None, found[kind]) for kind, count in sites.items()), (name, found)
