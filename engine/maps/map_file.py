"""Files that scenarios are made from: OpenStreetMap extracts and SUMO networks."""

from pathlib import Path

from plannerforge.engine.maps.net_map import read_net_map
from plannerforge.engine.maps.osm_reader import OsmMap, read_osm
from plannerforge.engine.maps.unpacking import is_net


def read_map_file(path: Path) -> OsmMap:
    """Scan and read a map of either kind; of a network it is a ``NetMap``.

    Raises:
        UnsafeInput: the file is hostile, broken, no map, or holds no road for vehicles.
    """
    return read_net_map(path) if is_net(path) else read_osm(path)
