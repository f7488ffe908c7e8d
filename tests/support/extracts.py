"""A small country of two drawn towns, far apart, each over four tiles, in OpenStreetMap's binary format."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import osmium
from osmium.osm import mutable

from plannerforge.engine.execution import silent
from plannerforge.engine.maps.drawn_library import LIBRARY
from plannerforge.engine.maps.extracts.indexing import index_extract
from plannerforge.schemas.generation import IndexedExtract, IndexExtractRequest

TOWN = LIBRARY / "fahrhausen.osm"
SECOND_TOWN = "Zweithausen"
APART_DEG, IDS_APART = 0.4, 100_000


def elements() -> list[Any]:
    """Return the nodes, ways and relations of both towns, in the order of a sorted file."""
    found: dict[str, list[Any]] = {"n": [], "w": [], "r": []}
    for copy in range(2):
        for element in osmium.FileProcessor(str(TOWN)):
            found[element.type_str()].append(_copied(element, copy))
    return [element for kind in "nwr" for element in sorted(found[kind], key=lambda each: int(each.id))]


def _copied(element: Any, copy: int) -> Any:
    tags = {tag.k: tag.v for tag in element.tags}
    if copy and "place" in tags:
        tags["name"] = SECOND_TOWN
    key, off = element.id + copy * IDS_APART, copy * IDS_APART
    if element.is_node():
        location = element.location.lon + copy * APART_DEG, element.location.lat
        return mutable.Node(id=key, location=location, tags=tags)
    if element.is_way():
        return mutable.Way(id=key, nodes=[node.ref + off for node in element.nodes], tags=tags)
    members = [(member.type, member.ref + off, member.role) for member in element.members]
    return mutable.Relation(id=key, members=members, tags=tags)


def written(path: Path, content: Sequence[Any]) -> Path:
    """Write nodes, ways and relations in the format of the file's name."""
    with osmium.SimpleWriter(str(path), overwrite=True) as writer:
        for element in content:
            writer.add(element)
    return path


def indexed(path: Path, folder: Path) -> IndexedExtract:
    """Return the index of an extract, in a folder that is created if missing."""
    folder.mkdir(exist_ok=True)
    return index_extract(IndexExtractRequest(path=str(path), folder=str(folder), map_id="map_country"), silent)
