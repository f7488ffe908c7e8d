"""Files of maps by their names, and those that come compressed: unpacked, never into more than may be read.

Nothing heavy is imported here: the server's process asks.
"""

import bz2
import gzip
import re
import zlib
from pathlib import Path
from typing import Literal

from ...schemas.errors import UnsafeInput

NET_ENDING = ".net.xml"
LANELETS_ENDING = ".xml"
"""Of CommonRoad files; the one of SUMO's networks ends in it too, and is looked for first."""
BINARY_ENDING = ".osm.pbf"
DRIVE_ENDING = ".xodr"
MAP_ENDINGS = (
    *(plain + packed for plain in (".osm", NET_ENDING, DRIVE_ENDING) for packed in ("", ".gz", ".bz2")),
    BINARY_ENDING,
)
ForeignFormat = Literal["OpenDRIVE", "CommonRoad", "Lanelet2"]
_LANELET_VALUE = re.compile(rb"""v\s*=\s*["']lanelet["']""")
LARGEST_BYTES = 60_000_000
"""Of a map: what a worker reads within its memory (docs/generation.md states it)."""
LARGE_BINARY_BYTES = 24_000_000
"""Of a binary extract: roads and houses of a larger one are hardly ever less than what a worker reads (chosen)."""
CHUNK_BYTES = 1 << 20
"""Bytes that are in memory at a time."""


def unpacked(path: Path, folder: Path, limit_bytes: int = LARGEST_BYTES) -> Path:
    """The map as a plain file: the file itself, or its content unpacked into the folder.

    Raises:
        UnsafeInput: the content is larger than the limit (a few bytes can hold gigabytes), or the file is broken.
    """
    ending = path.suffix.lower()
    if ending not in (".gz", ".bz2"):
        return path
    target, size = folder / path.stem, 0
    opened = gzip.open if ending == ".gz" else bz2.open
    try:
        with opened(path, "rb") as source, target.open("wb") as sink:
            while chunk := source.read(CHUNK_BYTES):
                size += len(chunk)
                if size > limit_bytes:
                    raise UnsafeInput(
                        f"{path.name} unpacks to more than {limit_bytes:,} bytes", next_step="use a smaller extract"
                    )
                sink.write(chunk)
    except (EOFError, OSError, zlib.error) as error:
        raise UnsafeInput(f"{path.name} cannot be unpacked: {error}") from error
    return target


def is_map(path: Path) -> bool:
    """Whether a file is a map by its name."""
    return path.name.lower().endswith(MAP_ENDINGS)


def is_net(path: Path) -> bool:
    """Whether a file, not packed, is a SUMO network by its name."""
    return path.name.lower().endswith(NET_ENDING)


def is_binary(path: Path) -> bool:
    """Whether a file is an extract in OpenStreetMap's binary format by its name."""
    return path.name.lower().endswith(BINARY_ENDING)


def is_large(path: Path) -> bool:
    """Whether a file is a binary extract that is read into tiles without trying to read it at once."""
    return is_binary(path) and path.stat().st_size > LARGE_BINARY_BYTES


def stored_name(path: Path) -> str:
    """The name under which a map is kept, not packed: ``map`` with the ending of its kind."""
    if is_net(path):
        return f"map{NET_ENDING}"
    return "map.xml" if path.name.lower().endswith(LANELETS_ENDING) else "map.osm"


def foreign_format(path: Path) -> ForeignFormat | None:
    """The format of a map, not packed, that has to be converted before it is read; None for the others.

    A Lanelet2 map has the ending of OpenStreetMap's streets: its content tells.
    """
    name = path.name.lower()
    if name.endswith(DRIVE_ENDING):
        return "OpenDRIVE"
    if name.endswith(LANELETS_ENDING) and not is_net(path):
        return "CommonRoad"
    return "Lanelet2" if name.endswith(".osm") and _holds_lanelets(path) else None


def _holds_lanelets(path: Path) -> bool:
    """Whether a file of OpenStreetMap's XML holds lanelets: no file of streets has a tag with that value."""
    rest = b""
    with path.open("rb") as stream:
        while chunk := stream.read(CHUNK_BYTES):
            if _LANELET_VALUE.search(rest + chunk):
                return True
            rest = chunk[-64:]
    return False
