"""Reads the files that scenarios are generated from: OpenStreetMap extracts, SUMO networks, lanelet networks.

Most scenarios of one call come from one map. A process therefore keeps the last map that it read, with the sites found
on that map.
"""

from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

from ...schemas.errors import UnsafeInput
from ...schemas.text import shown_name
from .foreign.lanelet_map import read_lanelet_map
from .foreign.net_map import read_net_map
from .osm import OsmMap, read_osm
from .site_search.finder import SiteFinder
from .unpacking import LANELETS_ENDING, NET_ENDING

_MOST_FINDERS = 4
"""Finders kept for one map (chosen): each stores lines and areas of all of it, and few calls set road classes."""
FileState = tuple[Path, int, int, int]
"""Identifies a file and its changes: path, inode, time of change, size."""


def read_map_file(path: Path) -> OsmMap:
    """Return the map in a file of any format; a network gives a ``NetMap``. The last map read is kept.

    Raises:
        UnsafeInput: the file is hostile, broken or not a map, or has no road for vehicles.
    """
    return _last_map().get(path)


def site_finder(osm: OsmMap, classes: Iterable[str] = ()) -> SiteFinder:
    """Return the finder of sites on a map for the given road classes; for the last map read, reuse its finder.

    ``classes``: as for ``SiteFinder``.
    """
    return _last_map().finder(osm, frozenset(classes))


@cache
def _last_map() -> "LastMap":
    """Return this process's store; a worker does one thing at a time."""
    return LastMap()


class LastMap:
    """The last map read; a map never changes, so it can be returned again."""

    def __init__(self) -> None:
        self._kept: tuple[FileState, OsmMap] | None = None
        self._finders: dict[frozenset[str], SiteFinder] = {}

    def get(self, path: Path) -> OsmMap:
        """Return the map in the file; read it only if it is not the last one or has changed.

        Raises:
            UnsafeInput: the file is hostile, broken or not a map, or has no road for vehicles.
        """
        state = _state_of(path)
        if self._kept is None or self._kept[0] != state:
            self._kept = None  # two large maps at once may exceed a worker's memory
            self._finders.clear()
            self._kept = state, _read(path)
        return self._kept[1]

    def finder(self, osm: OsmMap, classes: frozenset[str]) -> SiteFinder:
        """Return the finder of a map for road classes; keep it if it is the map that was read last."""
        if self._kept is None or self._kept[1] is not osm:
            return SiteFinder(osm, classes)
        if classes not in self._finders:
            if len(self._finders) == _MOST_FINDERS:
                self._finders.clear()
            self._finders[classes] = SiteFinder(osm, classes)
        return self._finders[classes]


def _read(path: Path) -> OsmMap:
    readers = (reader for ending, reader in MAP_READERS.items() if path.name.lower().endswith(ending))
    return next(readers, read_osm)(path)


def _state_of(path: Path) -> FileState:
    try:
        stat = path.stat()
    except OSError as error:
        raise UnsafeInput(f"{shown_name(path.name)} cannot be read: {error.strerror}") from error
    return path.absolute(), stat.st_ino, stat.st_mtime_ns, stat.st_size


MAP_READERS: dict[str, Callable[[Path], OsmMap]] = {NET_ENDING: read_net_map, LANELETS_ENDING: read_lanelet_map}
"""Readers of maps by the ending of their format (``unpacking.MAP_FORMATS``); other files are read as OpenStreetMap.

A reader returns an ``OsmMap``: for every format, sites are found on it and cut out of it, and netconvert builds them,
as with an OpenStreetMap extract.
"""
