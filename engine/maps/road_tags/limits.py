"""Determines the speed limit of a road: from its tags, else the legal limit of its country and kind.

Tags may contain numbers with units, lists, ``walk`` and ``none``, and codes such as ``DE:urban`` or ``DE:zone:30``
(https://wiki.openstreetmap.org/wiki/Key:maxspeed, Key:source:maxspeed, Key:maxspeed:type, Key:zone:maxspeed).
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from .access import Direction, lane_values
from .legal_speeds import MPH_KMH, LegalLimit, legal_speeds, speed_kmh

Tags = Mapping[str, str]
_SLOWEST_KMH, _FASTEST_KMH = 3.0, 200.0
"""No road has a limit below or above (chosen): other numbers are mistakes."""
_IMPLICIT_KEYS = ("maxspeed", "maxspeed:type", "source:maxspeed", "zone:maxspeed", "zone:traffic")
"""Keys that may give the kind of road for the legal limit; the first that does so decides."""
_CODE = re.compile(r"(?:([A-Za-z]{2}(?:-[A-Za-z]{2,3})?):)?(?:zone:?)?([a-z_]+|\d{1,3})(?:\s*(mph))?")
_KINDS: Mapping[str, Mapping[str, str]] = {
    "urban": {},
    "rural": {},
    "motorway": {"highway": "motorway"},
    "trunk": {"highway": "trunk"},
    "motorroad": {"motorroad": "yes"},
    "express": {"motorroad": "yes"},
    "expressway": {"motorroad": "yes"},
    "living_street": {"living_street": "yes"},
    "walk": {"living_street": "yes"},
    "bicycle_road": {"bicycle_road": "yes"},
    "cyclestreet": {"cyclestreet": "yes"},
    "nsl_single": {"dual_carriageway": "no"},
    "nsl_dual": {"dual_carriageway": "yes"},
    "nsl_restricted": {"lit": "yes"},
}
"""The tags that a code's name stands for, as the table of legal limits reads them."""
_URBAN_KINDS = frozenset({"urban", "walk", "living_street", "bicycle_road", "cyclestreet", "nsl_restricted"})
_LINK_KMH: Mapping[str, float] = {
    "motorway_link": 80.0,
    "trunk_link": 80.0,
    "primary_link": 80.0,
    "secondary_link": 80.0,
    "tertiary_link": 80.0,
    "service": 20.0,
    "track": 20.0,
    "living_street": 10.0,
}
"""Slip roads, drives and tracks have no limit of their own in most laws; SUMO's type map for OpenStreetMap gives their
usual speed (``osmNetconvert.typ.xml``).
"""


@dataclass(frozen=True)
class Limit:
    """A limit in km/h and its source.

    ``source``: ``tag``, ``code`` (a tag gives the kind of road), ``law``, ``usual`` (no known law), or
    ``driven`` (the usual speed on a slip road, drive or track, which is below what the law allows).

    ``unread``: a tag without a readable limit, as ``key=value``. ``legal``: the legal limit, if it was looked up.
    """

    kmh: float
    source: str
    unread: str = ""
    legal: LegalLimit | None = None
    urban: bool = False


@dataclass(frozen=True)
class Jurisdiction:
    """The country (ISO 3166-1 alpha-2, empty if unknown), the states that a map may be in, and a name."""

    country: str = ""
    states: tuple[str, ...] = ()
    name: str = ""


def limit_of(tags: Tags, where: Jurisdiction, *, urban: bool, direction: Direction = "forward") -> Limit:
    """Return the speed limit for cars on a road in the given direction."""
    unread = ""
    for key, value in _stated(tags, direction):
        kmh = _number(value)
        if kmh is not None:
            return Limit(kmh, "tag")
        if value.strip().lower() == "none" and not urban and (open_road := _unlimited(tags, where)) is not None:
            return open_road
        unread = unread or (f"{key}={value}" if _code(value) is None else "")
    for key in _IMPLICIT_KEYS:
        found = _code(tags.get(key, ""))
        if found is None:
            continue
        code, kind = found
        if kind.isdecimal():
            return Limit(float(kind) * (MPH_KMH if "mph" in tags[key] or code in ("GB", "US") else 1.0), "tag")
        there = _place(code, where)
        inside = kind in _URBAN_KINDS
        return _legal({**tags, **_KINDS[kind]}, there, urban=inside, source="code", capped=False)
    legal = _legal(tags, where, urban=urban, source="law")
    return Limit(legal.kmh, legal.source, unread, legal.legal, urban)


def signed_kmh(tags: Tags) -> float | None:
    """Return the limit in km/h from a sign or a zone in a road's tags, ignoring the law, or None if there is none."""
    for _, value in _stated(tags, "forward"):
        if (kmh := _number(value)) is not None:
            return kmh
    for key in _IMPLICIT_KEYS:
        found = _code(tags.get(key, ""))
        if found is not None and found[1].isdecimal():
            return float(found[1]) * (MPH_KMH if "mph" in tags[key] or found[0] in ("GB", "US") else 1.0)
    return None


def class_limits(tags: Tags) -> dict[str, float]:
    """Return the limits in km/h that apply only to trucks or only to buses, by OSM's key of the vehicle.

    The keys are ``hgv`` and ``bus``.
    """
    limits: dict[str, float] = {}
    for vehicle, keys in (("hgv", ("hgv", "goods")), ("bus", ("bus", "psv"))):
        for key in keys:
            if (kmh := _number(tags.get(f"maxspeed:{key}", ""))) is not None:
                limits.setdefault(vehicle, kmh)
    return limits


def is_tagged_urban(tags: Tags) -> bool | None:
    """Return whether a road's own tags place it in a built-up area, or None if they do not decide this."""
    for key in _IMPLICIT_KEYS:
        found = _code(tags.get(key, ""))
        if found is not None and not found[1].isdecimal():
            return found[1] in _URBAN_KINDS
    if tags.get("rural") in ("yes", "no"):
        return tags["rural"] == "no"
    return None


def conditional_limits(tags: Tags) -> list[str]:
    """Return variable limits and limits for certain times only, as ``key=value``."""
    return sorted(
        f"{key}={value}"
        for key, value in tags.items()
        if key.startswith("maxspeed") and (key.endswith(":conditional") or key == "maxspeed:variable")
    )


def _stated(tags: Tags, direction: Direction) -> Iterator[tuple[str, str]]:
    """Yield the tags that state a limit for cars in a direction, most specific first."""
    for key in ("maxspeed:motorcar", "maxspeed:motor_vehicle", "maxspeed"):
        for name in (f"{key}:{direction}", key):
            if tags.get(name):
                yield name, tags[name]
    lanes = lane_values(tags, "maxspeed", direction, oneway="maxspeed:lanes" in tags)
    numbers = {kmh: value for value in lanes if (kmh := _number(value)) is not None}
    if numbers:
        yield "maxspeed:lanes", numbers[max(numbers)]


def _number(text: str) -> float | None:
    """Return the lowest speed in a value, in km/h; None if it has no number or an implausible number."""
    plain = text.partition("@")[0]
    speeds = [speed_kmh(part.strip().replace(",", ".")) for part in re.split(r"[;|/]\s*(?!h\b)", plain) if part.strip()]
    numbers = [kmh for kmh in speeds if kmh is not None and _SLOWEST_KMH <= kmh <= _FASTEST_KMH]
    return round(min(numbers), 2) if numbers else None


def _code(text: str) -> tuple[str, str] | None:
    """Return the country and the kind of road (or a zone's number) that a code states; None for any other text."""
    match = _CODE.fullmatch(text.strip())
    if match is None or (match[2] not in _KINDS and not (match[2].isdecimal() and (match[1] or "zone" in text))):
        return None
    return (match[1] or "").upper(), match[2]


def _place(code: str, where: Jurisdiction) -> Jurisdiction:
    if not code or code.partition("-")[0] in (where.country, "UK" if where.country == "GB" else ""):
        return where
    country = {"UK": "GB"}.get(code.partition("-")[0], code.partition("-")[0])
    return Jurisdiction(country, (code,) if "-" in code else ())


def _unlimited(tags: Tags, where: Jurisdiction) -> Limit | None:
    """Return the advised speed if the country's law has roads without a limit, otherwise None."""
    fast = {**tags, "dual_carriageway": "yes", "highway": "motorway"}
    limit = _legal(fast, where, urban=False, source="code")
    return limit if limit.legal is not None and limit.legal.is_advice else None


def _legal(tags: Tags, where: Jurisdiction, *, urban: bool, source: str, capped: bool = True) -> Limit:
    plain = {key: value for key, value in tags.items() if not key.startswith("maxspeed") or key == "maxspeed:type"}
    table = legal_speeds()
    legal = table.find(where.country, plain, urban=urban, states=where.states) if where.country else None
    if legal is None:
        legal, source = table.anywhere(plain, urban=urban), "usual"
    most = _LINK_KMH.get(tags.get("highway", ""), _FASTEST_KMH) if capped else _FASTEST_KMH
    if most < legal.kmh:
        return Limit(most, "driven" if source != "code" else source, legal=legal, urban=urban)
    return Limit(legal.kmh, source, legal=legal, urban=urban)
