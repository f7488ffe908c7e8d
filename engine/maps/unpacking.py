"""Recognises the format of map files, and unpacks compressed files within a size limit.

Names only select candidates; the content determines what a file is.

This module imports nothing heavy, because the server's process uses it.
"""

import bz2
import gzip
import re
import shutil
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Literal, cast

from ...schemas.errors import UnsafeInput
from ...schemas.text import cited, shown_name

NET_ENDING = ".net.xml"
LANELETS_ENDING = ".xml"
BINARY_ENDING = ".osm.pbf"
DRIVE_ENDING = ".xodr"
_PACKED = (".gz", ".bz2")


@dataclass(frozen=True)
class MapFormat:
    """A map format: its file names, and how to recognise its content.

    ``ending``: the file extension of a stored map, in lower case. ``endings``: the file extensions that count as maps;
    packed files have one of these before their own extension. ``root``: the root element of its XML; empty if the
    extension alone decides.
    """

    ending: str
    endings: tuple[str, ...]
    root: str = ""


MAP_FORMATS: tuple[MapFormat, ...] = (
    MapFormat(".osm", (".osm", ".osm.xml"), "osm"),
    MapFormat(NET_ENDING, (NET_ENDING,), "net"),
    MapFormat(DRIVE_ENDING, (DRIVE_ENDING,), "OpenDRIVE"),
    MapFormat(LANELETS_ENDING, (), "commonRoad"),  # by its name, the file is a scenario
)
"""All formats except OpenStreetMap's binary one. If two endings fit a name, the first counts.

To add one, enter it here, and its reader in ``map_file.MAP_READERS``. Imports and map folders take their endings from
here.
"""
MAP_ENDINGS = (
    *(plain + packed for one in MAP_FORMATS for plain in one.endings for packed in ("", *_PACKED)),
    BINARY_ENDING,
)
_ENDINGS = {one.root: one.ending for one in MAP_FORMATS if one.root}
"""The ending that a file gets, by the root element of its XML."""
_ROOT = re.compile(r"<(?:[\w.-]{1,99}:)?([A-Za-z_][\w.-]{0,99})")
_ASIDES = {"<?": "?>", "<!--": "-->"}
"""Start and end of what may precede the root element: declarations and comments."""
_HEAD_BYTES = 16_384
"""Bytes read to find a document's root element (chosen): it comes after comments, if at all."""
ForeignFormat = Literal["OpenDRIVE", "CommonRoad", "Lanelet2"]
_LANELET_VALUE = re.compile(rb"""v\s*=\s*["']lanelet["']""")
LARGEST_BYTES = 60_000_000
"""Maximum size of a map: what a worker reads within its memory (docs/generation.md states it)."""
LARGE_BINARY_BYTES = 24_000_000
"""Maximum size of a binary extract (chosen): roads and houses of a larger one hardly ever fit into a worker."""
CHUNK_BYTES = 1 << 20
"""Bytes in memory at a time."""


def unpacked(path: Path, folder: Path, limit_bytes: int = LARGEST_BYTES) -> Path:
    """Return the map as a plain file: the file itself, or its content unpacked into the folder.

    Raises:
        UnsafeInput: the content is larger than the limit (a few bytes can contain gigabytes), or the file is broken.
    """
    packed_name = path.suffix.lower() in _PACKED
    opened = _opener(path)
    if opened is None and (not packed_name or _root_of(path) is not None):
        return path
    target, size = folder / (path.stem if packed_name else path.name), 0
    try:
        with (opened or _gunzip)(path) as source, target.open("wb") as sink:
            while chunk := source.read(CHUNK_BYTES):
                size += len(chunk)
                if size > limit_bytes:
                    raise UnsafeInput(
                        f"{shown_name(path.name)} unpacks to more than {limit_bytes:,} bytes",
                        next_step="use a smaller extract",
                    )
                sink.write(chunk)
    except (EOFError, OSError, zlib.error) as error:
        raise UnsafeInput(f"{shown_name(path.name)} cannot be unpacked: {cited(error)}") from error
    return target


def _gunzip(path: Path) -> IO[bytes]:
    return cast("IO[bytes]", gzip.open(path, "rb"))


def _bunzip(path: Path) -> IO[bytes]:
    return cast("IO[bytes]", bz2.open(path, "rb"))


_OPENERS: Mapping[bytes, Callable[[Path], IO[bytes]]] = {b"\x1f\x8b": _gunzip, b"BZh": _bunzip}
"""The function that unpacks a file, by its first bytes."""


def _opener(path: Path) -> Callable[[Path], IO[bytes]] | None:
    """Return the function that unpacks a file, or None if it is not packed."""
    with path.open("rb") as stream:
        head = stream.read(3)
    return next((opened for magic, opened in _OPENERS.items() if head.startswith(magic)), None)


def root_element(path: Path) -> str | None:
    """Return the local name of a file's root element if a map format has it, else None; unpacks the file.

    Such names are ``osm``, ``net``, ``OpenDRIVE`` and ``commonRoad``.
    """
    try:
        root = _root_of(path)
    except (EOFError, OSError, zlib.error):
        return None
    return root if root in _ENDINGS else None


def _root_of(path: Path) -> str | None:
    opened = _opener(path)
    with path.open("rb") if opened is None else opened(path) as stream:
        head = stream.read(_HEAD_BYTES)
    encoding = "utf-16" if head[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    text = head.decode(encoding, errors="replace").removeprefix("\ufeff")
    match = _ROOT.match(text, _begin_of_root(text))
    return None if match is None else match[1]


def _begin_of_root(text: str) -> int:
    """Return the index at which the root element begins, after declarations and comments."""
    at = 0
    while True:
        at += len(text[at:]) - len(text[at:].lstrip())
        closing = next((end for begin, end in _ASIDES.items() if text.startswith(begin, at)), "")
        end = text.find(closing, at + 2) if closing else -1
        if end < 0:
            return at
        at = end + len(closing)


def named_by_content(path: Path, folder: Path) -> Path:
    """Return an unpacked map with the file extension of its format: the file itself, or a copy in the folder."""
    ending = _ENDINGS.get(root_element(path) or "")
    name = path.name.lower()
    if ending is None or (name.endswith(ending) and not (ending == LANELETS_ENDING and name.endswith(NET_ENDING))):
        return path
    stem = re.sub(r"(\.osm|\.net|\.xodr|\.xml|\.gz|\.bz2)+$", "", path.name, flags=re.IGNORECASE) or "map"
    target = folder / f"{stem}{ending}"
    shutil.copyfile(path, target)
    return target


def is_map(path: Path) -> bool:
    """Return whether a file's name is that of a map."""
    return path.name.lower().endswith(MAP_ENDINGS)


def is_net(path: Path) -> bool:
    """Return whether an unpacked file's name is that of a SUMO network."""
    return path.name.lower().endswith(NET_ENDING)


def is_binary(path: Path) -> bool:
    """Return whether a file is in OpenStreetMap's binary format, by its name or, for plain .pbf, by its head."""
    name = path.name.lower()
    return name.endswith(BINARY_ENDING) or (name.endswith(".pbf") and _is_pbf(path))


def _is_pbf(path: Path) -> bool:
    """Return whether a file begins like OpenStreetMap's binary format: ``OSMHeader`` is in its first 32 bytes."""
    try:
        with path.open("rb") as stream:
            return b"OSMHeader" in stream.read(32)
    except OSError:
        return False


def is_large(path: Path) -> bool:
    """Return whether a file is a binary extract so large that it must be read into tiles."""
    return is_binary(path) and path.stat().st_size > LARGE_BINARY_BYTES


def stored_name(path: Path) -> str:
    """Return the name for storing an unpacked map: ``map`` with the extension of its format."""
    name = path.name.lower()
    plain = name.removesuffix(path.suffix.lower()) if path.suffix.lower() in _PACKED else name
    kept = (one.ending for one in MAP_FORMATS if plain.endswith((*one.endings, one.ending)))
    return f"map{next(kept, '.osm')}"


def foreign_format(path: Path) -> ForeignFormat | None:
    """Return the format of an unpacked map if it needs conversion before it can be read, otherwise None.

    A Lanelet2 map has the extension of OpenStreetMap's extracts: the content decides.
    """
    name = path.name.lower()
    if name.endswith(DRIVE_ENDING):
        return "OpenDRIVE"
    if name.endswith(LANELETS_ENDING) and not is_net(path):
        return "CommonRoad"
    return "Lanelet2" if name.endswith(".osm") and _contains_lanelets(path) else None


def _contains_lanelets(path: Path) -> bool:
    """Return whether an OpenStreetMap XML file contains lanelets; no file of streets has a tag with that value."""
    rest = b""
    with path.open("rb") as stream:
        while chunk := stream.read(CHUNK_BYTES):
            if _LANELET_VALUE.search(rest + chunk):
                return True
            rest = chunk[-64:]
    return False
