from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from plannerforge.engine.maps.drawn_library import LIBRARY
from plannerforge.engine.maps.osm import ground_distance_m, read_osm
from plannerforge.engine.maps.road_classes import ROADS
from plannerforge.engine.maps.site_roads.cut import cut_map


@settings(max_examples=15, deadline=None)
@given(north=st.floats(-0.002, 0.002), east=st.floats(-0.003, 0.003), radius=st.floats(40, 300))
def test_all_remaining_elements_are_within_the_circle(
    tmp_path_factory: object, north: float, east: float, radius: float
) -> None:
    osm = read_osm(LIBRARY / "quadratstadt.osm")
    center = (54.60 + north, 5.30 + east)
    target = Path(str(tmp_path_factory.mktemp("cut"))) / "cut.osm"  # type: ignore[attr-defined]
    ways = cut_map(osm, center, radius, ROADS, target)
    if not ways:
        return
    cut = read_osm(target)
    used = {key for way in cut.ways for key in way.node_ids}
    for key in used:
        node = cut.nodes[key]
        assert ground_distance_m((node.latitude, node.longitude), center) <= radius + 0.5
    assert len({way.way_id for way in cut.ways}) == len(cut.ways)


def test_roads_of_other_classes_are_left_out(tmp_path: Path) -> None:
    osm = read_osm(LIBRARY / "neuland.osm")
    ways = cut_map(osm, (54.63, 5.26), 300.0, ["motorway"], tmp_path / "cut.osm")
    assert {way.road_class for way in ways} == {"motorway"}
