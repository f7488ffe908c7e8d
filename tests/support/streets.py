"""A crossing of two streets, drawn as an OpenStreetMap extract, with the tags that a test gives to its arms."""

from collections.abc import Mapping
from pathlib import Path

from lxml import etree

from plannerforge.engine.maps.osm import OsmNode, append_node, append_object

_STEP_DEG = 0.0009
"""About 100 m northwards, and 67 m eastwards at 48° N."""
ARMS = {"west": (0, -1), "east": (0, 1), "south": (-1, 0), "north": (1, 0)}
"""The arms by their names, and where they lead (northwards, eastwards); the ways of west and south lead inwards."""


def crossing(
    target: Path,
    tags: Mapping[str, Mapping[str, str]],
    *,
    nodes: Mapping[str, Mapping[str, str]] | None = None,
    houses: bool = False,
    attributes: Mapping[str, Mapping[str, str]] | None = None,
    segments: int = 4,
) -> Path:
    """Write a crossing at 48.1° N, 11.5° E with four arms of some segments each (at most nine).

    Args:
        target: the file.
        tags: of an arm (``west``…), or of all (``all``), in addition to ``highway=secondary`` and ``maxspeed=50``; an
            empty value removes a tag.
        nodes: tags of nodes: ``middle``, or ``west2`` for the second node of an arm.
        houses: whether houses line the street from west to east.
        attributes: of an arm's way (``action``, ``visible``).
    """
    root = etree.Element("osm", {"version": "0.6", "generator": "hand"})
    named = nodes or {}
    append_node(root, OsmNode(1, 48.1, 11.5, named.get("middle", {})))
    ways = []
    for number, (arm, (north, east)) in enumerate(ARMS.items(), start=1):
        keys = [number * 10 + step for step in range(1, segments + 1)]
        for step, key in enumerate(keys, start=1):
            place = 48.1 + north * step * _STEP_DEG, 11.5 + east * step * _STEP_DEG * 1.5
            append_node(root, OsmNode(key, *place, named.get(f"{arm}{step}", {})))
        line = [1, *keys] if north + east > 0 else [*keys[::-1], 1]
        name = "Aaweg" if north == 0 else "Beweg"
        own = {"highway": "secondary", "maxspeed": "50", "name": name, **tags.get("all", {}), **tags.get(arm, {})}
        ways.append(
            (number, line, {key: value for key, value in own.items() if value}, (attributes or {}).get(arm, {}))
        )
    for house in range(24 if houses else 0):
        corner = 48.1002, 11.5 + (house - 12) * _STEP_DEG / 2
        append_node(root, OsmNode(1000 + house, *corner, {"addr:housenumber": str(house)}))
    for number, line, own, more in ways:
        append_object(root, "way", number, own, parts=[("nd", {"ref": str(key)}) for key in line])
        root[-1].attrib.update(more)
    target.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True))
    return target
