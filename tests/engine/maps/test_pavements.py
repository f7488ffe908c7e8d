"""Pavements of roads: as tags state them, as a map draws them, or guessed."""

import pytest

from plannerforge.engine.maps.osm import OsmMap, OsmNode, OsmWay
from plannerforge.engine.maps.site_roads.pavements import find_pavements

EAST_DEG = 0.001
"""About 111 m at the equator."""


def street(tags: dict[str, str], *others: OsmWay) -> OsmMap:
    """A street eastwards with two nodes, and other ways that use nodes 3 to 6, 8 m north and south of it."""
    north = 8 / 111_195
    places = {1: (0.0, 0.0), 2: (0.0, EAST_DEG), 3: (north, 0.0), 4: (north, EAST_DEG)}
    places |= {5: (-north, 0.0), 6: (-north, EAST_DEG)}
    nodes = {key: OsmNode(key, *place, {"highway": "crossing"} if key == 2 else {}) for key, place in places.items()}
    return OsmMap(nodes, (OsmWay(1, (1, 2), {"highway": "residential"} | tags), *others), (), None)


def drawn(*node_ids: int) -> OsmWay:
    """A pavement that is drawn as a way of its own."""
    return OsmWay(node_ids[0] + 10, node_ids, {"highway": "footway", "footway": "sidewalk"})


def sides(osm: OsmMap) -> tuple[str, bool]:
    """On which sides the street has pavements, and whether that is guessed."""
    found = find_pavements(osm, osm.ways[:1], (0.0, EAST_DEG / 2), 300.0)
    return found.sides[1], found.guessed_km > 0


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({"sidewalk": "left"}, ("left", False)),
        ({"sidewalk": "no"}, ("no", False)),
        ({"sidewalk:left": "no", "sidewalk:right": "yes"}, ("right", False)),
        ({"sidewalk:both": "separate"}, ("both", False)),
        ({}, ("both", True)),
        ({"maxspeed": "100"}, ("no", False)),
        ({"highway": "motorway", "sidewalk": "both"}, ("no", False)),
        ({"foot": "no"}, ("no", False)),
        ({"highway": "service"}, ("no", False)),
    ],
)
def test_meanings_of_pavement_tags(tags: dict[str, str], expected: tuple[str, bool]) -> None:
    assert sides(street(tags)) == expected


def test_pavements_drawn_next_to_a_road_belong_to_it() -> None:
    assert sides(street({}, drawn(3, 4))) == ("left", False)
    assert sides(street({}, drawn(5, 6))) == ("right", False)
    assert sides(street({}, drawn(3, 4), drawn(5, 6))) == ("both", False)


def test_roads_without_pavements_are_closed_to_pedestrians() -> None:
    osm = street({"sidewalk": "no", "name": "A"})
    found = find_pavements(osm, osm.ways, (0.0, 0.0), 300.0)
    assert found.tags_of(osm.ways[0]) == {"highway": "residential", "name": "A", "sidewalk": "no", "foot": "no"}
    assert found.crossings == ((0.0, EAST_DEG),)


@pytest.mark.parametrize(("lefthand", "outer"), [(False, "right"), (True, "left")])
def test_a_ring_has_pavements_on_its_outer_side_alone(lefthand: bool, outer: str) -> None:
    osm = street({"junction": "roundabout"})
    assert find_pavements(osm, osm.ways, (0.0, 0.0), 300.0, lefthand=lefthand).sides == {1: outer}


def block(crossing_east_deg: float, tags: dict[str, str], *others: OsmWay) -> OsmMap:
    """A street of 333 m eastwards between two side streets, with a marked crossing so far from its beginning."""
    places = {1: (0.0, 0.0), 2: (0.0, crossing_east_deg), 3: (0.0, 3 * EAST_DEG)}
    places |= {key + 10: (EAST_DEG, places[key][1]) for key in (1, 3)} | {
        21: (-EAST_DEG, 0.0),
        23: (-EAST_DEG, 3 * EAST_DEG),
    }
    nodes = {key: OsmNode(key, *place, {"highway": "crossing"} if key == 2 else {}) for key, place in places.items()}
    sides = [OsmWay(key, (key + 10, key, key + 20), {"highway": "residential"}) for key in (1, 3)]
    return OsmMap(nodes, (OsmWay(9, (1, 2, 3), {"highway": "residential"} | tags), *sides, *others), (), None)


MIDDLE_DEG = 1.5 * EAST_DEG


@pytest.mark.parametrize(
    ("osm", "in_block"),
    [
        (block(MIDDLE_DEG, {}), True),
        (block(0.2 * EAST_DEG, {}), False),
        (block(MIDDLE_DEG, {"sidewalk": "left"}), False),
        (block(MIDDLE_DEG, {}, OsmWay(8, (2, 11), {"highway": "residential"})), False),
    ],
    ids=["between", "near a junction", "a pavement on one side", "at a junction"],
)
def test_marked_crossings_between_junctions_are_in_the_middle_of_a_block(osm: OsmMap, in_block: bool) -> None:
    found = find_pavements(osm, osm.ways, (0.0, MIDDLE_DEG), 300.0)
    assert found.mid_block == ({2} if in_block else set())
    assert ("highway" in found.tags_of_node(osm.nodes[2])) is in_block


def test_a_crossing_at_the_end_of_the_cut_is_not_in_the_middle_of_a_block() -> None:
    osm = block(MIDDLE_DEG, {})
    assert find_pavements(osm, osm.ways, (0.0, 0.0), 180.0).mid_block == set()


def test_signals_of_a_crossing_at_a_junction_stay_with_its_node() -> None:
    node = OsmNode(5, 0.0, 0.0, {"highway": "crossing", "crossing": "traffic_signals"})
    osm = block(MIDDLE_DEG, {})
    assert find_pavements(osm, osm.ways, (0.0, 0.0), 300.0).tags_of_node(node) == {"crossing": "traffic_signals"}
