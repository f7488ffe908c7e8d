"""Files that scenarios are made from: OpenStreetMap extracts and SUMO networks.

The scenarios of one call are mostly made from one map, so a process keeps the one that it read last.
"""

from functools import cache
from pathlib import Path

from plannerforge.engine.maps.net_map import read_net_map
from plannerforge.engine.maps.osm_reader import OsmMap, read_osm
from plannerforge.engine.maps.unpacking import is_net
from plannerforge.schemas.errors import UnsafeInput

FileState = tuple[Path, int, int, int]
"""What tells a file from another, and from itself after a change: path, number on the disk, time of change, size."""


class LastMap:
    """The map that was read last; a map is never changed, so whoever asks next may have the same one."""

    def __init__(self) -> None:
        self._kept: tuple[FileState, OsmMap] | None = None

    def get(self, path: Path) -> OsmMap:
        """The map in the file as it is now, read only where it is another one or has changed.

        Raises:
            UnsafeInput: the file is hostile, broken, no map, or holds no road for vehicles.
        """
        state = _state_of(path)
        if self._kept is None or self._kept[0] != state:
            self._kept = None  # two large maps at once may be more than a worker's memory
            self._kept = state, read_net_map(path) if is_net(path) else read_osm(path)
        return self._kept[1]


def read_map_file(path: Path) -> OsmMap:
    """Scan and read a map of either kind; of a network it is a ``NetMap``.

    Raises:
        UnsafeInput: the file is hostile, broken, no map, or holds no road for vehicles.
    """
    return _last_map().get(path)


@cache
def _last_map() -> LastMap:
    """One for the process: a worker does one thing at a time."""
    return LastMap()


def _state_of(path: Path) -> FileState:
    try:
        found = path.stat()
    except OSError as error:
        raise UnsafeInput(f"{path.name} cannot be read: {error.strerror}") from error
    return path.absolute(), found.st_ino, found.st_mtime_ns, found.st_size
