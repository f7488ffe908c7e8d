"""OpenStreetMap's binary format (.osm.pbf) written as .osm, as far as roads, their names and surroundings need it."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from plannerforge.engine.execution.progress import ProgressReporter
from plannerforge.engine.maps.osm_reader import LIMITS
from plannerforge.schemas.errors import UnsafeInput
from plannerforge.schemas.generation import ConvertedMap, ConvertMapRequest

KEPT_KEYS = (
    "highway",
    "junction",
    "restriction",
    "place",
    "landuse",
    "building",
    "shop",
    "addr:housenumber",
    "addr:city",
    "addr:country",
)
"""Objects with any of these tags are kept, and the nodes of such ways: what sites are found, judged and named by."""


def write_as_xml(request: ConvertMapRequest, report: ProgressReporter) -> ConvertedMap:
    """Write a binary extract as XML into a folder.

    Raises:
        UnsafeInput: the file is broken, or holds more elements than may be read.
    """
    import osmium

    path = Path(request.path)
    target = Path(request.folder) / path.stem
    report(0.1, "unpacking the map")
    try:
        _check(path)
        with osmium.BackReferenceWriter(str(target), ref_src=str(path), overwrite=True) as writer:
            for element in _kept(path):
                writer.add(element)
    except (RuntimeError, ValueError) as error:  # all that osmium raises on a broken file
        raise UnsafeInput(
            f"{path.name} cannot be unpacked: {error}", next_step="get the extract again, or convert it to .osm"
        ) from error
    return ConvertedMap(path=str(target))


def _check(path: Path) -> None:
    """Read the file once: osmium's writer would leave half a map behind, without a word, where reading breaks off."""
    if sum(1 for _ in _kept(path)) > LIMITS.elements:
        raise UnsafeInput(
            f"{path.name} holds more than {LIMITS.elements:,} elements", next_step="use a smaller extract"
        )


def _kept(path: Path) -> Iterable[Any]:
    import osmium

    kept: Iterable[Any] = osmium.FileProcessor(str(path)).with_filter(osmium.filter.KeyFilter(*KEPT_KEYS))
    return kept
