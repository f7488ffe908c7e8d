"""Converts maps in other formats, as an operation for a worker because the files are untrusted."""

from pathlib import Path

from ....schemas.generation import ConvertedMap, ConvertMapRequest
from ...execution import ProgressReporter
from ..unpacking import NET_ENDING, foreign_format
from .lanelet2 import convert_lanelet2
from .lanelet_map import write_network
from .net_map import untraced_links
from .opendrive import convert_opendrive


def convert_roads(request: ConvertMapRequest, report: ProgressReporter) -> ConvertedMap:
    """Write an OpenDRIVE file as a SUMO network, or a Lanelet2 map or CommonRoad file as a CommonRoad road network.

    A SUMO network is not changed; the result reports what its lanelets will lack.

    Raises:
        UnsafeInput: the file is hostile or broken, or has no road.
    """
    source, folder = Path(request.path), Path(request.folder)
    report(0.1, "converting the map")
    kind = foreign_format(source)
    stem = source.name.removesuffix(source.suffix)
    if kind is None:
        target, lost = source, tuple(untraced_links(source))
    elif kind == "OpenDRIVE":
        target = folder / f"{stem}{NET_ENDING}"
        lost = convert_opendrive(source, target, folder)
    elif kind == "Lanelet2":
        target = folder / f"{stem}.xml"
        lost = convert_lanelet2(source, target)
    else:
        target = folder / f"{stem}.roads.xml"
        lost = write_network(source, target)
    return ConvertedMap(path=str(target), lost=lost)
