"""Legal speed limits where no sign is posted, by country or state and kind of road, from OpenStreetMap's table.

The table is "Default speed limits" of the OpenStreetMap Wiki (https://wiki.openstreetmap.org/wiki/Default_speed_limits,
CC BY-SA 2.0); ``scripts/pack_legal_speeds.py`` makes this module's data file from it. For every country, it gives the
limit for each kind of road, and defines the kinds in a small tag-based language.
"""

import gzip
import json
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

TABLE = Path(__file__).parent / "legal_speeds.json.gz"
MPH_KMH = 1.609344
WALK_KMH = 7.0
"""Walking pace: the highest that German courts read it as (4 to 7 km/h, OSM's Key:maxspeed)."""
_FAST_TOWN_KMH = 60.0
"""A country with more km/h for all roads, and no rule for towns, signs those in towns (chosen; Japan has 60)."""
Tags = Mapping[str, str]
_Test = Callable[[Tags, Callable[[str], bool]], bool]
"""Tests whether tags are of a kind of road; the second argument answers for other kinds that it includes."""
_MULTILANE = frozenset({"motorway", "motorway_link", "trunk", "trunk_link"})
"""Classes of one-way roads that are half of a dual carriageway; one-way streets of other classes may be ordinary."""
_MOTORWAYS = frozenset({"motorway", "motorway_link"})
_INTERSTATE = "US interstate highway"
"""A kind that the table recognises by the road's number; every motorway of the USA counts as one."""
_SLOW_MOTORWAY_KMH = 90.0
"""A country with no rule for motorways and fewer km/h for other roads signs its motorways (chosen)."""


@dataclass(frozen=True)
class LegalLimit:
    """A limit in km/h, the kind of road that it applies to, and the code of the country or state with this law.

    ``is_advice``: the law sets no limit, and this is the advised speed. ``states``: the number of states or provinces
    considered if their laws differ; the most frequent limit applies then. ``is_default``: the limit is that of all
    roads without a rule of their own.
    """

    kmh: float
    kind: str
    code: str
    is_advice: bool = False
    states: int = 1
    is_default: bool = False


class LegalSpeeds:
    """Legal speed limits of countries and states (ISO 3166-1 alpha-2, ISO 3166-2), with the kinds of road by name."""

    def __init__(
        self, kinds: Mapping[str, Sequence[str]], limits: Mapping[str, Sequence[tuple[str, Mapping[str, str]]]]
    ) -> None:
        self._kinds = {name: tuple(parse_filter(text) for text in texts if text) for name, texts in kinds.items()}
        self._strict = {name: parse_filter(texts[0]) for name, texts in kinds.items() if texts[0]}
        self._limits = limits

    def find(self, country: str, tags: Tags, *, urban: bool, states: Sequence[str] = ()) -> LegalLimit | None:
        """Return the limit for cars on a road, or None if the table has no limit for the country.

        Args:
            country: ISO 3166-1 alpha-2.
            tags: the road's tags.
            urban: whether it is in a built-up area.
            states: the codes of its possible states; if empty, all states in the table.
        """
        if tags.get("highway") in _MOTORWAYS:
            tags = {"lanes": "2", "oneway": "yes", **tags}
        found = [limit for code in self._codes(country, states) if (limit := self._of(code, tags, urban=urban))]
        if tags.get("highway") in _MOTORWAYS:
            found = [limit for limit in found if limit.kmh >= _SLOW_MOTORWAY_KMH or "motorway" in limit.kind]
        elif urban and tags.get("highway") not in _MULTILANE:
            found = [limit for limit in found if limit.kmh <= _FAST_TOWN_KMH or not limit.is_default]
        if not found:
            return None
        counts = Counter(limit.kmh for limit in found)
        kmh = min(counts, key=lambda value: (-counts[value], value))
        chosen = next(limit for limit in found if limit.kmh == kmh)
        if len(found) == 1:
            return chosen
        return LegalLimit(kmh, chosen.kind, country, chosen.is_advice, len(found))

    def anywhere(self, tags: Tags, *, urban: bool) -> LegalLimit:
        """Return the median of the limits of all countries, for a road in an unknown country.

        For a motorway, only countries with a rule for motorways count.
        """
        countries = sorted({code.partition("-")[0] for code in self._limits})
        found = [limit for code in countries if (limit := self.find(code, tags, urban=urban))]
        if tags.get("highway") in _MOTORWAYS:
            found = [limit for limit in found if "motorway" in limit.kind or limit.kind.endswith(_INTERSTATE)]
        middle = sorted(limit.kmh for limit in found)[len(found) // 2]
        return LegalLimit(middle, "urban" if urban else "rural", "", states=len(found))

    def _codes(self, country: str, states: Sequence[str]) -> list[str]:
        known = [code for code in states if code in self._limits]
        if known:
            return known
        if any("maxspeed" in speeds for _, speeds in self._limits.get(country, ())):
            return [country]
        return [code for code in self._limits if code.startswith(f"{country}-")]

    def _of(self, code: str, tags: Tags, *, urban: bool) -> LegalLimit | None:
        rules = [(name, speeds) for name, speeds in self._limits[code]]
        names = [name for name, _ in rules]
        default = names.index("") if "" in names else len(names)
        in_order = [*reversed(rules[default + 1 :]), *rules[:default], *rules[default : default + 1]]

        def is_kind(name: str) -> bool:
            if name in ("urban", "rural"):
                return urban if name == "urban" else not urban
            if name == _INTERSTATE and tags.get("highway") == "motorway":
                return True
            if name == "dual carriageway" and tags.get("highway") not in _MULTILANE:
                return name in self._strict and self._strict[name](tags, is_kind)
            return any(test(tags, is_kind) for test in self._kinds.get(name, ()))

        for name, speeds in in_order:
            if name and not is_kind(name):
                continue
            advice = speeds.get("maxspeed:advisory", "")
            kmh = speed_kmh(speeds.get("maxspeed", "")) or speed_kmh(advice)
            if kmh is not None:
                is_advice = "maxspeed" not in speeds
                kind = name or ("urban" if urban else "rural")
                return LegalLimit(round(kmh, 1), kind, code, is_advice, is_default=not name)
        return None


def speed_kmh(text: str) -> float | None:
    """Return the speed in km/h of a number with OSM's units (default km/h); None for any other text."""
    if text.strip().lower() == "walk":
        return WALK_KMH
    match = _SPEED.fullmatch(text.strip().lower())
    if match is None:
        return None
    factor = {"mph": MPH_KMH, "knots": 1.852, "knot": 1.852, "kn": 1.852}.get(match[2] or "", 1.0)
    return float(match[1]) * factor


_SPEED = re.compile(r"(\d{1,4}(?:\.\d{1,3})?)\s*(km/h|kmh|kph|mph|knots?|kn)?")


@cache
def legal_speeds() -> LegalSpeeds:
    """Return the table; it is read once."""
    document = json.loads(gzip.decompress(TABLE.read_bytes()))
    return LegalSpeeds(document["kinds"], document["limits"])


_TOKEN = re.compile(r"""\s*(\{[^}]*\}|[()]|!=|!~|<=|>=|[=~<>!]|"[^"]*"|[^\s()=~<>!"{}]+)""")
_COMPARED = frozenset({"=", "!=", "~", "!~", "<", "<=", ">", ">="})


def parse_filter(text: str) -> _Test:
    """Return the test of tags that a text in the table's language describes.

    The language has ``{kind}``, ``key``, ``!key``, ``key=value``, ``key~regex``, comparisons of numbers, ``and``,
    ``or``, and brackets.

    Raises:
        ValueError: the text is not in that language.
    """
    return _Parser(_TOKEN.findall(text)).whole()


class _Parser:
    """A recursive-descent parser for the tokens of a filter: or, and, not, single terms."""

    def __init__(self, tokens: list[str]) -> None:
        self._tokens, self._at = tokens, 0

    def whole(self) -> _Test:
        test = self._any()
        if self._at != len(self._tokens):
            raise ValueError(f"unexpected {self._tokens[self._at]!r}")
        return test

    def _next(self) -> str:
        return self._tokens[self._at] if self._at < len(self._tokens) else ""

    def _take(self) -> str:
        self._at += 1
        return self._tokens[self._at - 1] if self._at <= len(self._tokens) else ""

    def _any(self) -> _Test:
        tests = [self._all()]
        while self._next() == "or":
            self._take()
            tests.append(self._all())
        return lambda tags, ask: any(test(tags, ask) for test in tests)

    def _all(self) -> _Test:
        tests = [self._one()]
        while self._next() == "and":
            self._take()
            tests.append(self._one())
        return lambda tags, ask: all(test(tags, ask) for test in tests)

    def _one(self) -> _Test:
        term = self._take()
        if term == "!":
            test = self._one()
            return lambda tags, ask: not test(tags, ask)
        if term == "(":
            test = self._any()
            if self._take() != ")":
                raise ValueError("a bracket is not closed")
            return test
        if term.startswith("{"):
            name = term[1:-1]
            return lambda _, ask: ask(name)
        return self._comparison(term.strip('"'))

    def _comparison(self, key: str) -> _Test:
        if not key or key in _COMPARED or key in ("and", "or", ")"):
            raise ValueError(f"unexpected {key!r}")
        if self._next() not in _COMPARED:
            return lambda tags, _: key in tags
        sign, value = self._take(), self._take().strip('"')
        if sign in ("=", "!="):
            return lambda tags, _: (tags.get(key) == value) is (sign == "=")
        if sign in ("~", "!~"):
            pattern = re.compile(value)
            return lambda tags, _: (key in tags and pattern.fullmatch(tags[key]) is not None) is (sign == "~")
        bound = float(value)
        compare = {"<": float.__lt__, "<=": float.__le__, ">": float.__gt__, ">=": float.__ge__}[sign]
        return lambda tags, _: (number := _number(tags.get(key, ""))) is not None and compare(number, bound)


def _number(text: str) -> float | None:
    match = re.match(r"\d{1,9}(?:\.\d{1,6})?", text)
    return None if match is None else float(match[0])
