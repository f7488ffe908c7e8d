"""Parsing an XML file that nobody vouches for, once, and as fast as its size allows."""

import re
from itertools import chain
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, fromstring

from plannerforge.engine.scenarios.reader import XmlLimits, scan_root
from plannerforge.schemas.errors import UnsafeInput

_SMALL_BYTES = 20_000_000
_FEW_TAGS = 400_000
"""So many tags do no harm before their depth is known: their elements take less than 100 MB."""
_IN_UTF8 = re.compile(rb"(\xef\xbb\xbf)?<\?xml version=[\"']1\.0[\"']( encoding=[\"'](?i:utf-8)[\"'])?[^>\w]*\?>")


def parse_document(path: Path, limits: XmlLimits | None = None) -> Element:
    """The root element of an XML file that is not too large, too deep or broken, and declares no document type.

    In UTF-8 a tag begins with the byte ``<`` and a document type with ``<!DOCTYPE``: where counting bytes shows that a
    file is within the limits, only its depth is left to look at once it is parsed. Any other file is scanned before.

    Raises:
        UnsafeInput: naming what was found and the limit.
    """
    limits = limits or XmlLimits()
    try:
        content = path.read_bytes() if path.stat().st_size <= _SMALL_BYTES else b""
        if not _is_surely_within(content, limits):
            scan_root(path, limits)
            content = path.read_bytes()
        root = fromstring(content)  # noqa: S314 - entities and size were looked at
    except OSError as error:
        raise UnsafeInput(f"{path.name} cannot be read: {error.strerror}") from error
    except (ParseError, ValueError, LookupError) as error:
        raise UnsafeInput(f"{path.name} is not well-formed XML: {error}") from error
    if _is_deeper(root, limits.depth):
        raise UnsafeInput(f"{path.name} nests elements deeper than {limits.depth} levels")
    return root


def _is_surely_within(content: bytes, limits: XmlLimits) -> bool:
    return (
        _IN_UTF8.match(content) is not None
        and b"<!DOCTYPE" not in content
        and content.count(b"<") <= min(_FEW_TAGS, limits.elements)
        and content.count(b"<lanelet") <= limits.lanelets
        and len(content) <= limits.size_bytes
    )


def _is_deeper(root: Element, levels: int) -> bool:
    level = [root]
    for _ in range(levels):
        level = list(chain.from_iterable(level))
        if not level:
            return False
    return True
