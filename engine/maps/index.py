"""The maps at hand, and finding one by what the user calls it: place, street, crossing, road number, id, box.

What became of the files in the map folders is kept in the database, so that each is unpacked and read once and not at
every call.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from ...schemas.errors import UnknownName, closest
from ...schemas.generation import MapFacts, MapList, ScenarioType
from ...schemas.text import LONGEST_TEXT
from ..workspace import Database, versions_of
from .places import country_code, fold, place_keys

LIBRARY = Path(__file__).parent / "library"
NOT_SHOWN = "not_shown"
"""Reason of a refusal because no map shows the place, the country or the box."""
ABBREVIATIONS = {
    "str": "strasse",
    "blvd": "boulevard",
    "ave": "avenue",
    "av": "avenue",
    "rd": "road",
    "st": "street",
    "dr": "drive",
    "ne": "northeast",
    "nw": "northwest",
    "se": "southeast",
    "sw": "southwest",
    "n": "north",
    "s": "south",
    "e": "east",
    "w": "west",
    "und": "and",
    "&": "and",
}
"""Words of street names that are spelled in several ways."""
MOST_KEPT = 50_000
"""Names whose spellings are kept, because every call compares all of them (chosen)."""
Box = tuple[float, float, float, float]
"""(south, west, north, east) in degrees."""


@dataclass(frozen=True)
class MapEntry:
    """A map at hand: what it shows, and the file."""

    facts: MapFacts
    path: Path


@dataclass(frozen=True)
class MapMatch:
    """A map that shows the asked place.

    ``streets``: by their names in the map, that the site must carry; ``unnamed``: words of the request that the map
    does not name, though it names the street beside them.
    """

    entry: MapEntry
    streets: tuple[tuple[str, ...], ...] = ()
    unnamed: tuple[str, ...] = ()


def built_in_maps() -> list[MapEntry]:
    """The maps that come with the package, by id."""
    listed = MapList.model_validate_json((LIBRARY / "catalogue.json").read_bytes())
    return [MapEntry(facts, LIBRARY / facts.file_name) for facts in listed.maps]


def find_maps(
    maps: Sequence[MapEntry],
    *,
    place: str | None = None,
    country: str | None = None,
    bbox: Box | None = None,
    scenario_type: ScenarioType = "any",
) -> list[MapMatch]:
    """All maps that fit; those that hold the asked type of site first, otherwise in the order given.

    Raises:
        UnknownName: no map shows the place, country or box; the error names what can be had, the closest first.
    """
    if not maps:
        raise UnknownName("there is no map", next_step="import an .osm file with import_files")
    everywhere = matches = [MapMatch(entry, ()) for entry in maps]
    code = None if country is None else country_code(country) or country.upper()
    if country is not None and code is not None:
        matches = _in_country(matches, country, code)
    if bbox is not None:
        matches = _in_box(matches, bbox)
    if place is not None:
        shown = _showing(matches, place, code)
        if not shown:
            raise _not_shown(place, country, bbox, matches, _showing(everywhere, place, code))
        matches = shown
    return sorted(
        matches,
        key=lambda match: (
            len(match.unnamed) * 2 + (scenario_type != "any" and scenario_type not in match.entry.facts.sites)
        ),
    )


def same_street(one: str, other: str) -> bool:
    """Whether two spellings name one street: case, accents, spaces and common abbreviations are ignored."""
    return bool(_street_keys(one) & _street_keys(other))


def _in_country(matches: list[MapMatch], country: str, code: str) -> list[MapMatch]:
    """Maps that lie there, and those that may: whose own country is not known, and no other is nearer."""
    fitting = [match for match in matches if code in _countries(match.entry.facts) or not _countries(match.entry.facts)]
    if not fitting:
        known = sorted({code for match in matches for code in _countries(match.entry.facts)})
        raise UnknownName(
            f"no map lies in {country!r}", valid=known, next_step="leave country out, or import a map", reason=NOT_SHOWN
        )
    return fitting


def _countries(facts: MapFacts) -> tuple[str, ...]:
    """Where a map lies or may lie; empty where nothing is known."""
    return facts.countries_near if facts.country is None else (facts.country,)


def _in_box(matches: list[MapMatch], bbox: Box) -> list[MapMatch]:
    south, west, north, east = bbox
    fitting = [
        match
        for match in matches
        if south <= match.entry.facts.north
        and north >= match.entry.facts.south
        and west <= match.entry.facts.east
        and east >= match.entry.facts.west
    ]
    if not fitting:
        boxes = [_box_text(match.entry.facts) for match in matches]
        raise UnknownName(
            f"no map shows the box {list(bbox)}",
            valid=boxes,
            next_step="choose a box inside one of these",
            reason=NOT_SHOWN,
        )
    return fitting


def _box_text(f: MapFacts) -> str:
    return f"{f.place} [{f.south:.4f}, {f.west:.4f}, {f.north:.4f}, {f.east:.4f}]"


def _showing(found: list[MapMatch], place: str, country: str | None) -> list[MapMatch]:
    """Maps in which every part of the text (``street, city`` or ``street A / street B``) is a place or a road."""
    parts = _parts(place)
    matches = (_match(map_.entry, [place], country) or _match(map_.entry, parts, country) for map_ in found)
    return [match for match in matches if match is not None]


def _parts(place: str) -> list[str]:
    return [part.strip() for part in re.split(r"[,;/]|\s+(?:&|at|near|corner of)\s+", place) if part.strip()]


def _not_shown(
    place: str, country: str | None, bbox: Box | None, matches: list[MapMatch], elsewhere: list[MapMatch]
) -> UnknownName:
    """No map that is left shows the place; where it is shown elsewhere, box or country contradict it."""
    if elsewhere:
        limits = [f"the box {list(bbox)}"] if bbox is not None else []
        limits += [f"{country!r}"] if country is not None else []
        return UnknownName(
            f"no map shows {place!r} in {' and '.join(limits)}: it lies elsewhere",
            valid=[_box_text(match.entry.facts) for match in elsewhere],
            next_step=f"leave {' and '.join(['bbox'] * (bbox is not None) + ['country'] * (country is not None))} out, "
            "or choose another place",
            reason=NOT_SHOWN,
        )
    nameless = [
        match.entry.facts
        for match in matches
        if not match.entry.facts.places and any(_roads_called(part, match.entry.facts) for part in _parts(place))
    ]
    if nameless:
        return UnknownName(
            f"no map shows {place!r}; {nameless[0].map_id} shows such a road, but does not say in which place it lies",
            valid=[facts.map_id for facts in nameless],
            next_step="name the road alone, name its country, or add the map with its place",
            reason=NOT_SHOWN,
        )
    names = {name for match in matches for name in _names(match.entry.facts)}
    shown = sorted({match.entry.facts.place for match in matches})
    words = _words(place[:LONGEST_TEXT])
    near = closest(place[:LONGEST_TEXT], sorted(names, key=lambda name: (words.isdisjoint(_words(name)), name)), 4)
    return UnknownName(
        f"no map shows {place!r}",
        valid=[*near, *(name for name in shown if name not in near)],
        next_step="choose one of these places, or import an .osm extract of the place with import_files",
        reason=NOT_SHOWN,
    )


def _match(entry: MapEntry, parts: list[str], country: str | None) -> MapMatch | None:
    """The map with the streets that are meant, where it shows every part.

    A part that it does not name is let pass beside a street where another part names the map, or where the map knows
    no place and the caller names its country.
    """
    facts = entry.facts
    streets: list[tuple[str, ...]] = []
    unnamed: list[str] = []
    for part in (part[:LONGEST_TEXT] for part in parts):
        if _names_map(part, facts):
            continue
        roads = _roads_called(part, facts)
        if roads:
            streets.append(roads)
        else:
            unnamed.append(part)
    named = len(unnamed) + len(streets) < len(parts) or (not facts.places and country in _countries(facts))
    if unnamed and not (streets and named):
        return None
    return MapMatch(entry, tuple(streets), tuple(unnamed)) if parts else None


def _names_map(part: str, facts: MapFacts) -> bool:
    """Whether a word means the map itself: its id, its file, a place in it, or its country."""
    stem = facts.file_name.partition(".")[0]
    if fold(part) in {fold(facts.map_id), fold(facts.map_id.removeprefix("map_")), fold(facts.file_name), fold(stem)}:
        return True
    if any(place_keys(part) & place_keys(name) for name in (facts.place, *facts.places)):
        return True
    code = country_code(part)
    return code is not None and code == facts.country


def _roads_called(part: str, facts: MapFacts) -> tuple[str, ...]:
    """Roads of that name; otherwise those whose names hold all its words (``Loop 101`` in ``AZ 101 Loop``)."""
    known = (*facts.streets, *facts.refs)
    same = tuple(name for name in known if same_street(part, name))
    words = _words(part)
    return same or tuple(name for name in known if len(words) > 1 and words <= _words(name))


@lru_cache(maxsize=MOST_KEPT)
def _words(name: str) -> frozenset[str]:
    return frozenset(fold(word) for word in name.replace("-", " ").split()) - {""}


def _names(facts: MapFacts) -> list[str]:
    return [facts.place, *facts.places, *facts.streets, *facts.refs]


@lru_cache(maxsize=MOST_KEPT)
def _street_keys(name: str) -> frozenset[str]:
    words = re.sub(r"str\.(?=\s|$)", "strasse", name.casefold()).replace(".", " ").replace("-", " ").split()
    spelled = "".join(ABBREVIATIONS.get(word, word) for word in words)
    return place_keys(spelled) | place_keys(name)


@dataclass(frozen=True)
class SeenFile:
    """A file of a map folder: the map that it became, or why it was refused (the other is empty)."""

    map_id: str
    refusal: str


class SeenFiles:
    """The files that were looked at, by path; one that was changed since, or read by another version, is new again."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def find(self, path: Path) -> SeenFile | None:
        """What became of a file; None where it is new or gone."""
        query = "SELECT map_id, refusal FROM map_files WHERE path = ? AND stamp = ?"
        row = self._database.connection().execute(query, (str(path), _stamp(path))).fetchone()
        return None if row is None else SeenFile(row["map_id"], row["refusal"])

    def keep(self, path: Path, seen: SeenFile) -> None:
        """Remember what became of a file as it is now.

        Raises:
            ResourceFailure: the database cannot be written.
        """
        row = (str(path), _stamp(path), seen.map_id, seen.refusal)
        with self._database.writing() as connection:
            connection.execute("INSERT OR REPLACE INTO map_files VALUES (?, ?, ?, ?)", row)


def _stamp(path: Path) -> str:
    """Size, time of the last change and this program's version; empty for a file that is gone."""
    try:
        stat = path.stat()
    except OSError:
        return ""
    return f"{stat.st_size} {stat.st_mtime_ns} {versions_of()}"
