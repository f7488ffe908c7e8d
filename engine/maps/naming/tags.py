"""Reads the names in OpenStreetMap's tags: of places, roads and addresses."""

import re
import unicodedata
from collections.abc import Mapping

from .spellings import road_keys, whole_road_keys

PLACE_KINDS = (
    "city",
    "town",
    "village",
    "suburb",
    "borough",
    "quarter",
    "neighbourhood",
    "hamlet",
    "isolated_dwelling",
    "square",
    "locality",
)
"""OSM's values of ``place`` for settlements, their parts and locations in them, the larger first."""
SETTLEMENTS = frozenset(PLACE_KINDS[:3])
"""Kinds that are settlements of their own, not parts of one."""
ROAD_PLACES = frozenset(["square", "locality"])
"""Kinds that are only the roads of their name, if there are any."""
CITY_PEOPLE, TOWN_PEOPLE = 100_000, 10_000
"""Minimum inhabitants of a city and of a town (OSM's documentation of ``place``)."""
NAME_KEYS = (
    "name",
    "int_name",
    "official_name",
    "alt_name",
    "short_name",
    "loc_name",
    "old_name",
    "nat_name",
    "reg_name",
    "bridge:name",
    "tunnel:name",
)
"""OSM's tags for names; each may have a language after a colon (``name:ru``) and several names between semicolons."""
_NAME_KEY = re.compile(
    rf"(?P<key>{'|'.join(NAME_KEYS)})(?:_\d+)?"
    r"(?::(?:[a-z]{2,3}(?:[-_][A-Za-z0-9]+)*|left|right|forward|backward|[\d.-]+))?"
)
"""A name's tag with a number, a language (BCP 47), a side or years; not ``name:prefix``, ``name:etymology``, ..."""
_REF_KEYS = ("ref", "int_ref", "nat_ref", "reg_ref", "loc_ref")
"""OSM's tags for numbers of roads; each may have several between semicolons."""
_BOTH = re.compile(r"\s+[-–—/]\s+|\s*/\s*(?=\D)")
"""The separator in names of places that have two (``Bolzano - Bozen``)."""
MOST_NAMES = 400
"""Maximum number of names of one place or road: a country has one in every language (chosen)."""


def names_of(tags: Mapping[str, str]) -> list[str]:
    """Return all names in the tags, the main one first, each once."""
    found = [(match["key"], key) for key in tags if (match := _NAME_KEY.fullmatch(key))]
    found.sort(key=lambda pair: (NAME_KEYS.index(pair[0]), pair[1] != "name:en", pair[1]))
    names = (name.strip() for _, key in found for name in tags[key].split(";"))
    return list(dict.fromkeys(name for name in names if name))[:MOST_NAMES]


def place_names_of(tags: Mapping[str, str]) -> list[str]:
    """Return all names of a place in the tags, including the parts of a double name (``Bozen - Bolzano``)."""
    names = names_of(tags)
    parts = [part.strip() for name in names if _BOTH.search(name) for part in _BOTH.split(name)]
    parts += [part for name in names for part in _by_script(name)]
    return list(dict.fromkeys(name for name in (*names, *parts) if name))[:MOST_NAMES]


def _by_script(name: str) -> list[str]:
    """Return the parts of a name in two scripts (``Shubra حي شبرا``); empty for other names."""
    runs: list[tuple[bool, list[str]]] = []
    for word in name.split():
        is_latin = all(
            letter.isascii() or "LATIN" in unicodedata.name(letter, "") for letter in word if letter.isalpha()
        )
        if not runs or runs[-1][0] != is_latin:
            runs.append((is_latin, []))
        runs[-1][1].append(word)
    return [" ".join(words) for _, words in runs] if len(runs) > 1 else []


def refs_of(tags: Mapping[str, str]) -> list[str]:
    """Return all numbers of a road in the tags, the main one first, each once."""
    refs = (ref.strip() for key in _REF_KEYS for ref in tags.get(key, "").split(";"))
    return list(dict.fromkeys(ref for ref in refs if ref))


def keys_of_road(tags: Mapping[str, str]) -> frozenset[str]:
    """Return the keys of all names and numbers of a road; two spellings mean the same road if they share a key."""
    return frozenset(
        key for name in (*names_of(tags), *refs_of(tags)) for key in (*road_keys(name), *whole_road_keys(name))
    )
