"""Pavements of roads: as tags state them, as a map draws them, or guessed."""

import pytest

from plannerforge.engine.maps.osm import OsmMap, OsmNode, OsmWay
from plannerforge.engine.maps.pavements import find_pavements

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
def test_what_tags_say_of_pavements(tags: dict[str, str], expected: tuple[str, bool]) -> None:
    assert sides(street(tags)) == expected


def test_pavements_drawn_beside_a_road_are_its_own() -> None:
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
