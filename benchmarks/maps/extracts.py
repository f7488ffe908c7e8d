"""Extracts of OpenStreetMap in memory, and the part of Overpass's query language that requests them.

This code is independent of the product, which only sees the responses to its queries.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Box = tuple[float, float, float, float]
"""(south, west, north, east) in degrees."""
Key = tuple[str, int]
"""``node``, ``way`` or ``relation``, and its id."""
_PARTS = re.compile(
    r'\s*("(?:[^"\\]|\\.)*"|\'(?:[^\'\\]|\\.)*\'|->|!=|!~|[\[\]();:=~,<>]|\.?[A-Za-z_][A-Za-z0-9_]*|\._|-?\d+(?:\.\d+)?|\.)'
)


class QueryError(ValueError):
    """A query that is not understood, as Overpass says it."""


@dataclass
class Extract:
    """All of an extract: nodes as (latitude, longitude, tags), ways as (node ids, tags), relations.

    ``renamed``: names and numbers of roads in place of others.
    """

    path: Path
    renamed: Mapping[str, str] = field(default_factory=dict)
    nodes: dict[int, tuple[float, float, dict[str, str]]] = field(default_factory=dict)
    ways: dict[int, tuple[tuple[int, ...], dict[str, str]]] = field(default_factory=dict)
    relations: dict[int, tuple[tuple[tuple[str, int, str], ...], dict[str, str]]] = field(default_factory=dict)

    @classmethod
    def read(
        cls,
        path: Path,
        *,
        middle: tuple[float, float] | None = None,
        renamed: Mapping[str, str] | None = None,
        nameless: bool = False,
    ) -> "Extract":
        """Read a file; with ``middle`` (latitude, longitude) move it there with its distances kept.

        ``nameless``: without the settlements and addresses that reveal its true place.
        """
        import osmium

        found = cls(path, renamed=renamed or {})
        for entity in osmium.FileProcessor(str(path)):
            tags = {tag.k: found.renamed.get(tag.v, tag.v) for tag in entity.tags}
            if nameless:
                tags = {key: value for key, value in tags.items() if not key.startswith(("place", "addr:", "is_in"))}
                if tags.get("highway") == "motorway_junction":
                    tags.pop("name", None)
            if entity.is_node():
                if entity.location.valid():
                    found.nodes[entity.id] = (entity.lat, entity.lon, tags)
            elif entity.is_way():
                found.ways[entity.id] = (tuple(node.ref for node in entity.nodes), tags)
            elif entity.is_relation():
                members = tuple(
                    ({"n": "node", "w": "way", "r": "relation"}[m.type], m.ref, m.role) for m in entity.members
                )
                found.relations[entity.id] = (members, tags)
        if middle is not None:
            found._move(middle)
        return found

    def _move(self, middle: tuple[float, float]) -> None:
        """Put the middle of its roads elsewhere; degrees of longitude become as many as the same metres are there."""
        south, west, north, east = self.box
        from_lat, from_lon = (south + north) / 2, (west + east) / 2
        stretch = float(np.cos(np.radians(from_lat)) / np.cos(np.radians(middle[0])))
        self.nodes = {
            key: (middle[0] + lat - from_lat, middle[1] + (lon - from_lon) * stretch, tags)
            for key, (lat, lon, tags) in self.nodes.items()
        }
        for cached in ("box", "_boxes"):
            self.__dict__.pop(cached, None)

    @cached_property
    def box(self) -> Box:
        """Around all roads; of one without any a point in the sea."""
        used = [
            self.nodes[node][:2]
            for nodes, tags in self.ways.values()
            if "highway" in tags
            for node in nodes
            if node in self.nodes
        ] or [(0.0, 0.0)]
        south, west = np.min(np.array(used), axis=0).tolist()
        north, east = np.max(np.array(used), axis=0).tolist()
        return south, west, north, east

    @cached_property
    def _boxes(self) -> tuple[list[int], NDArray[np.float64]]:
        """The ways that have a node, and around each (south, west, north, east), shape (n, 4)."""
        keys: list[int] = []
        boxes: list[list[float]] = []
        for key, (nodes, _) in self.ways.items():
            points = np.array([self.nodes[node][:2] for node in nodes if node in self.nodes])
            if len(points):
                keys.append(key)
                boxes.append([*points.min(axis=0).tolist(), *points.max(axis=0).tolist()])
        return keys, np.array(boxes).reshape(-1, 4)

    def nodes_in(self, box: Box) -> set[int]:
        """Return nodes inside a box."""
        south, west, north, east = box
        return {key for key, (lat, lon, _) in self.nodes.items() if south <= lat <= north and west <= lon <= east}

    def ways_in(self, box: Box) -> set[int]:
        """Return the ways that lie partly inside a box, even if no node of theirs does."""
        from shapely import LineString
        from shapely import box as rectangle

        south, west, north, east = box
        keys, boxes = self._boxes
        near = (boxes[:, 0] <= north) & (boxes[:, 2] >= south) & (boxes[:, 1] <= east) & (boxes[:, 3] >= west)
        area = rectangle(west, south, east, north)
        found: set[int] = set()
        for index in np.flatnonzero(near).tolist():
            points = [self.nodes[node][:2] for node in self.ways[keys[index]][0] if node in self.nodes]
            inside = any(south <= lat <= north and west <= lon <= east for lat, lon in points)
            if inside or (len(points) > 1 and LineString([(lon, lat) for lat, lon in points]).intersects(area)):
                found.add(keys[index])
        return found

    def tags(self, key: Key) -> dict[str, str]:
        """Return the tags of an element."""
        kind, number = key
        held = {"node": self.nodes, "way": self.ways, "relation": self.relations}[kind]
        return held[number][-1]  # type: ignore[index,no-any-return]

    def center(self, key: Key) -> tuple[float, float] | None:
        """Return the middle of the box around an element; None for relations."""
        kind, number = key
        if kind == "node":
            return self.nodes[number][:2]
        if kind == "relation":
            return None
        points = [self.nodes[node][:2] for node in self.ways[number][0] if node in self.nodes]
        lats, lons = [lat for lat, _ in points], [lon for _, lon in points]
        return ((min(lats) + max(lats)) / 2, (min(lons) + max(lons)) / 2) if points else None


@dataclass(frozen=True)
class QueryResult:
    """The result of a query: its format (json or xml), the elements and their notation."""

    format: str
    elements: tuple[dict[str, Any], ...]


def run_query(text: str, extract: Extract) -> QueryResult:
    """Carry a query out on an extract.

    Raises:
        QueryError: it is not understood.
    """
    return _Run(text, extract).run()


class _Run:
    """One query: its tokens in order, the named sets."""

    def __init__(self, text: str, extract: Extract) -> None:
        self._words, self._extract = _words(text), extract
        self._at = 0
        self._sets: dict[str, set[Key]] = {"_": set()}
        self._settings: dict[str, str] = {}
        self._out: list[dict[str, Any]] = []

    def run(self) -> QueryResult:
        while self._peek() == "[":
            self._setting()
        if self._settings:
            self._take(";")
        while self._peek():
            self._statement()
        return QueryResult(self._settings.get("out", "xml"), tuple(self._out))

    def _peek(self) -> str:
        return self._words[self._at] if self._at < len(self._words) else ""

    def _take(self, wanted: str = "") -> str:
        word = self._peek()
        if not word or (wanted and word != wanted):
            raise QueryError(f"parse error: {wanted or 'more'} expected - {word or 'end of input'} found.")
        self._at += 1
        return word

    def _setting(self) -> None:
        self._take("[")
        name = self._take()
        self._take(":")
        value = ""
        while self._peek() != "]":
            value += self._take()
        self._take("]")
        if name not in ("out", "timeout", "maxsize", "bbox", "date"):
            raise QueryError(f"parse error: Unknown setting {name}")
        self._settings[name] = value

    def _statement(self) -> None:
        if self._peek() == "out":
            self._output()
            return
        found = self._selection()
        name = "_"
        if self._peek() == "->":
            self._take()
            name = self._take().removeprefix(".")
        self._take(";")
        self._sets[name] = found

    def _selection(self) -> set[Key]:
        word = self._take()
        if word == "(":
            found: set[Key] = set()
            while self._peek() != ")":
                found |= self._selection()
                if self._peek() == "->":
                    self._take()
                    self._take()
                self._take(";")
            self._take(")")
            return found
        if word in (">", "<"):
            while self._peek() in (">", "<"):
                self._take()
            return self._members(self._sets["_"])
        if word.startswith("."):
            return set(self._sets.get(word.removeprefix("."), set()))
        if word in ("node", "way", "rel", "relation", "nwr"):
            return self._query(word)
        raise QueryError(f"parse error: Unknown type {word!r}")

    def _query(self, kind: str) -> set[Key]:
        kinds = {"rel": ("relation",), "nwr": ("node", "way", "relation")}.get(kind, (kind,))
        among: set[Key] | None = None
        tests: list[Callable[[Mapping[str, str]], bool]] = []
        if self._peek().startswith(".") and self._peek() != ".":
            among = set(self._sets[self._take().removeprefix(".")])
        while self._peek() in ("[", "("):
            if self._peek() == "[":
                tests.append(self._tag_filter())
            else:
                held = self._area_filter(kinds)
                among = held if among is None else among & held
        if among is None:
            among = {(k, n) for k, held in self._everything() if k in kinds for n in held}
        return {key for key in among if key[0] in kinds and all(test(self._extract.tags(key)) for test in tests)}

    def _everything(self) -> Sequence[tuple[str, Iterable[int]]]:
        return (("node", self._extract.nodes), ("way", self._extract.ways), ("relation", self._extract.relations))

    def _tag_filter(self) -> Callable[[Mapping[str, str]], bool]:
        self._take("[")
        key = _unquoted(self._take())
        operator = self._take()
        if operator == "]":
            return lambda tags: key in tags
        value = _unquoted(self._take())
        flags = re.RegexFlag(0)
        if self._peek() == ",":
            self._take()
            self._take("i")
            flags = re.IGNORECASE
        self._take("]")
        if operator in ("=", "!="):
            return lambda tags: (tags.get(key) == value) == (operator == "=")
        if operator in ("~", "!~"):
            pattern = re.compile(value, flags)
            wanted = operator == "~"
            return lambda tags: (key in tags and bool(pattern.search(tags[key]))) == wanted
        raise QueryError(f"parse error: Unknown operator {operator}")

    def _area_filter(self, kinds: Sequence[str]) -> set[Key]:
        self._take("(")
        first = self._take()
        if first in ("w", "bw", "bn"):
            source = self._take().removeprefix(".") if self._peek().startswith(".") else "_"
            self._take(")")
            return self._related(first, self._sets.get(source, set()))
        if first == "poly":
            self._take(":")
            values = [float(part) for part in _unquoted(self._take()).split()]
            self._take(")")
            return self._within((min(values[::2]), min(values[1::2]), max(values[::2]), max(values[1::2])), kinds)
        numbers = [float(first)]
        while self._peek() == ",":
            self._take()
            numbers.append(float(self._take()))
        self._take(")")
        if len(numbers) == 1:
            return {(kind, int(numbers[0])) for kind in kinds}
        if len(numbers) != 4 or not (-90 <= numbers[0] <= numbers[2] <= 90):
            raise QueryError("static error: invalid bounding box")
        return self._within((numbers[0], numbers[1], numbers[2], numbers[3]), kinds)

    def _within(self, box: Box, kinds: Sequence[str]) -> set[Key]:
        nodes = {("node", key) for key in self._extract.nodes_in(box)} if "node" in kinds else set()
        ways = {("way", key) for key in self._extract.ways_in(box)} if "way" in kinds else set()
        return nodes | ways

    def _related(self, how: str, source: set[Key]) -> set[Key]:
        if how == "w":
            return {key for key in self._members(source) if key[0] == "node"}
        kind = {"bw": "way", "bn": "node"}[how]
        wanted = {number for k, number in source if k == kind}
        return {
            ("relation", key)
            for key, (members, _) in self._extract.relations.items()
            if any(k == kind and number in wanted for k, number, _ in members)
        }

    def _members(self, source: set[Key]) -> set[Key]:
        ways = {number for kind, number in source if kind == "way"}
        return {("node", node) for way in ways for node in self._extract.ways[way][0] if node in self._extract.nodes}

    def _output(self) -> None:
        self._take("out")
        words: list[str] = []
        while self._peek() != ";":
            words.append(self._take())
        self._take(";")
        most = next((int(word) for word in words if word.isdecimal()), None)
        keys = sorted(self._sets["_"], key=lambda key: (("node", "way", "relation").index(key[0]), key[1]))
        self._out += [self._written(key, words) for key in keys[:most]]

    def _written(self, key: Key, words: Sequence[str]) -> dict[str, Any]:
        kind, number = key
        element: dict[str, Any] = {"type": kind, "id": number}
        only_tags = "tags" in words or "ids" in words
        if kind == "node" and not only_tags:
            element |= {
                "lat": round(self._extract.nodes[number][0], 7),
                "lon": round(self._extract.nodes[number][1], 7),
            }
        if "center" in words and (center := self._extract.center(key)) is not None:
            at = {"lat": round(center[0], 7), "lon": round(center[1], 7)}
            element |= at if kind == "node" else {"center": at}
        if kind == "way" and not only_tags:
            element["nodes"] = list(self._extract.ways[number][0])
        if kind == "relation" and not only_tags:
            members = self._extract.relations[number][0]
            element["members"] = [{"type": k, "ref": n, "role": role} for k, n, role in members]
        tags = self._extract.tags(key)
        if tags and not {"skel", "ids"} & set(words):
            element["tags"] = tags
        return element


def _words(text: str) -> list[str]:
    words: list[str] = []
    at = 0
    text = re.sub(r"/\*.*?\*/|//[^\n]*", " ", text, flags=re.DOTALL).rstrip()
    while at < len(text):
        found = _PARTS.match(text, at)
        if found is None:
            raise QueryError(f"parse error: {text[at : at + 12]!r} is not understood")
        words.append(found[1])
        at = found.end()
    return words


def _unquoted(word: str) -> str:
    if word[:1] not in "\"'":
        return word
    return re.sub(r"\\(.)", r"\1", word[1:-1])
