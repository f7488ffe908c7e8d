"""Of the sites of a map, those are chosen that show what a request names."""

from pathlib import Path

from plannerforge.engine.generation.sites import fitting_sites
from plannerforge.engine.maps.drawn_library import Sketch
from plannerforge.engine.maps.osm import OsmMap, read_osm
from plannerforge.schemas.generation import GenerationRequest


def drawn(folder: Path, sketch: Sketch) -> OsmMap:
    sketch.write(folder / "map.osm")
    return read_osm(folder / "map.osm")


def request(folder: Path, **asked: object) -> GenerationRequest:
    known = {"map_path": str(folder / "map.osm"), "map_id": "map_a", "place": "Town", "country": "ZAM"}
    return GenerationRequest.model_validate({**known, "attribution": "", "folder": "", **asked})


def test_a_ramp_of_the_requested_road_is_preferred_to_one_that_leads_to_it(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-800, 0), (0, 0), (800, 0)], "motorway", "", ref="A 1", oneway="yes")
    sketch.road([(0, 0), (300, -400), (300, -1000)], "motorway_link", "", oneway="yes")
    sketch.road([(-800, -1000), (300, -1000), (2000, -1000), (2800, -1000)], "motorway", "", ref="A 2", oneway="yes")
    sketch.road([(2000, -1000), (2200, -1100), (2200, -1200)], "motorway_link", "", oneway="yes")
    osm = drawn(tmp_path, sketch)
    sites = fitting_sites(osm, request(tmp_path, scenario_type="ramp", streets=(("A 2",),)))
    assert sites
    assert all(site.streets[0] == "A 2" for site in sites)
    assert all(abs(site.latitude - osm.nodes[site.mark].latitude) < 1e-3 for site in sites)
    assert not any(abs(site.latitude - 50.0) < 1e-3 for site in sites)


def test_sites_nearest_to_the_middle_of_the_requested_box_come_first(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(0, 0), (1000, 0), (2000, 0), (3000, 0)], "secondary", "Main Road")
    for number, east in enumerate((1000, 2000)):
        sketch.road([(east, 0), (east, 300)], "residential", f"Side Road {number}")
    osm = drawn(tmp_path, sketch)
    east_half = request(tmp_path, scenario_type="intersection", bbox=(49.99, 8.0, 50.01, 8.06))
    west_half = request(tmp_path, scenario_type="intersection", bbox=(49.99, 7.98, 50.01, 8.04))
    assert [site.streets[-1] for site in fitting_sites(osm, east_half)] == ["Side Road 1", "Side Road 0"]
    assert [site.streets[-1] for site in fitting_sites(osm, west_half)] == ["Side Road 0", "Side Road 1"]
