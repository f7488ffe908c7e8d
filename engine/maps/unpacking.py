"""Files of maps by their names, and those that come compressed: unpacked, never into more than may be read."""

import bz2
import gzip
import zlib
from pathlib import Path

from ...schemas.errors import UnsafeInput

NET_ENDING = ".net.xml"
BINARY_ENDING = ".osm.pbf"
MAP_ENDINGS = (*(plain + packed for plain in (".osm", NET_ENDING) for packed in ("", ".gz", ".bz2")), BINARY_ENDING)
LARGEST_BYTES = 60_000_000
"""Of a map: what a worker reads within its memory (docs/generation.md states it)."""
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


def stored_name(path: Path) -> str:
    """The name under which a map is kept, not packed: ``map`` with the ending of its kind."""
    return f"map{NET_ENDING if is_net(path) else '.osm'}"
