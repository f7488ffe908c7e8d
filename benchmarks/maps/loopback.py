"""Local servers for the protocols of Nominatim and Overpass, with extracts as the earth and injected faults.

``MapServers`` serves ``/search``, ``/lookup`` and ``/status`` of Nominatim below its address ``nominatim``, and
``/interpreter``, ``/status`` and ``/kill_my_queries`` of Overpass below those of its ``mirrors``. A ``Fault`` applies
to the next responses of one of them. All requests are recorded.
"""

import json
import logging
import re
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from anyascii import anyascii
from lxml import etree
from pytest_httpserver import HTTPServer
from werkzeug import Request as WebRequest
from werkzeug import Response

from .extracts import Box, Extract, QueryError, run_query

DATA_TIME = "2026-11-20T10:00:00Z"
FaultKind = Literal[
    "429",
    "504",
    "403",
    "slow",
    "cut",
    "html",
    "empty",
    "huge",
    "remark",
    "redirect",
    "garbage",
    "no_slot",
    "drip",
    "forged",
]
_HUGE_MB = 200
_MOST_SLOW_S = 60.0
_PARTS_OF_TOWNS = ("suburb", "quarter", "neighbourhood", "borough", "city_district", "hamlet")
_REACH_DEG = {"city": 0.16, "town": 0.04, "village": 0.02, "hamlet": 0.01}
"""Half the side of Nominatim's box for a settlement without an outline, by its kind; 0.01 for others."""
_SIGHTS = ("tourism", "historic", "railway", "leisure", "amenity", "place", "junction")
_SHORT = {
    "st": "street",
    "str": "strasse",
    "ave": "avenue",
    "av": "avenue",
    "rd": "road",
    "blvd": "boulevard",
    "bd": "boulevard",
    "hwy": "highway",
    "n": "north",
    "s": "south",
    "e": "east",
    "w": "west",
    "ne": "northeast",
    "nw": "northwest",
    "se": "southeast",
    "sw": "southwest",
    "and": "",
}


@dataclass(frozen=True)
class Fault:
    """A fault of a service; ``times``: number of affected requests; ``wait_s``: its Retry-After.

    ``body``: the response if the fault is ``forged``.
    """

    kind: FaultKind
    times: int = 1
    wait_s: int | None = None
    body: bytes = b""


@dataclass(frozen=True)
class Place:
    """An entry of the served Nominatim: a settlement, a road or a sight.

    ``names`` by OpenStreetMap's keys; ``address``: Nominatim's, without the country.
    """

    names: Mapping[str, str]
    category: str
    kind: str
    latitude: float
    longitude: float
    box: Box
    country: str
    address: Mapping[str, str] = field(default_factory=dict)
    importance: float = 0.1
    osm: tuple[str, int] = ("node", 1)
    line: tuple[tuple[float, float], ...] = ()

    @cached_property
    def own_words(self) -> frozenset[str]:
        """The words of all of its names."""
        return frozenset(word for name in self.names.values() for word in words_of(name))

    @cached_property
    def words_around(self) -> frozenset[str]:
        """The words of the places around it."""
        return frozenset(
            word for name in (*self.address.values(), country_name(self.country)) for word in words_of(name)
        )

    def is_called(self, words: Sequence[str]) -> bool:
        """Return True if the words name it: its own or those of places around it, and all of a settlement's own."""
        asked = frozenset(words)
        if not asked <= self.own_words | self.words_around or not asked & self.own_words:
            return False
        each = [frozenset(words_of(name)) for name in self.names.values()]
        if self.category in ("place", "boundary"):
            return any(name <= asked for name in each if name)
        rest = asked - self.words_around
        return any(rest <= name for name in each) if rest else any(name <= asked for name in each if name)

    def as_json(self, number: int) -> dict[str, Any]:
        """Return an entry of Nominatim's format jsonv2."""
        name = self.names.get("name:en") or self.names.get("name") or self.names.get("ref", "")
        address = {**self.address, "country": country_name(self.country), "country_code": alpha2(self.country)}
        if self.country == "VIR":
            address |= {"country": "United States", "country_code": "us", "ISO3166-2-lvl4": "US-VI"}
        south, west, north, east = self.box
        shape: dict[str, Any] = {"type": "Point", "coordinates": [self.longitude, self.latitude]}
        if self.line:
            shape = {"type": "LineString", "coordinates": [[lon, lat] for lat, lon in self.line]}
        return {
            "place_id": number,
            "licence": "Data © OpenStreetMap contributors, ODbL 1.0. http://osm.org/copyright",
            "osm_type": self.osm[0],
            "osm_id": self.osm[1],
            "lat": f"{self.latitude:.7f}",
            "lon": f"{self.longitude:.7f}",
            "category": self.category,
            "type": self.kind,
            "place_rank": 26 if self.line else 16,
            "importance": self.importance,
            "addresstype": "road" if self.category == "highway" else self.kind,
            "name": name,
            "display_name": ", ".join(dict.fromkeys((name, *self.address.values(), country_name(self.country)))),
            "address": address,
            "namedetails": dict(self.names),
            "boundingbox": [f"{south:.7f}", f"{north:.7f}", f"{west:.7f}", f"{east:.7f}"],
            "geojson": shape,
        }


def words_of(text: str) -> tuple[str, ...]:
    """Return the words of a name in Nominatim's comparison form: Latin letters, abbreviations expanded."""
    plain = "".join(letter if letter.isalnum() else " " for letter in anyascii(text).casefold().replace("'", ""))
    return tuple(word for part in plain.split() if (word := _SHORT.get(part, part)))


def country_name(code: str) -> str:
    """Return a country's English name by its ISO alpha-3 code."""
    from iso3166 import countries_by_alpha3

    return str(countries_by_alpha3[code].apolitical_name)


def alpha2(code: str) -> str:
    """Return a country's ISO alpha-2 code in small letters."""
    from iso3166 import countries_by_alpha3

    return str(countries_by_alpha3[code].alpha2).lower()


def settlement(
    names: Sequence[str], country: str, box: Box, *, importance: float = 0.6, kind: str = "city", **address: str
) -> Place:
    """Return a town with a box and its names."""
    middle = ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2)
    named = {"name": names[0], **{f"alt_name:{number}": name for number, name in enumerate(names[1:])}}
    return Place(
        named, "boundary", kind, *middle, box, country, address, importance, ("relation", 1 + hash_of(names[0]))
    )


def hash_of(text: str) -> int:
    """Return a number for a text, the same in every process."""
    return int.from_bytes(text.encode()[-6:], "big")


def places_in(extract: Extract, town: str, country: str) -> Iterator[Place]:
    """Return settlements, roads and sights of an extract; those that are not towns are in ``town``."""
    for key, (lat, lon, tags) in extract.nodes.items():
        if tags.get("name") or tags.get("highway") == "motorway_junction":
            yield from _point(("node", key), (lat, lon), tags, town, country)
    for key, (nodes, tags) in extract.ways.items():
        line = tuple(extract.nodes[node][:2] for node in nodes if node in extract.nodes)
        names = _names(tags)
        if not names or len(line) < 2:
            continue
        box = _around(line)
        middle = line[len(line) // 2]
        if "highway" in tags:
            yield Place(
                names, "highway", tags["highway"], *middle, box, country, {"city": town}, 0.1, ("way", key), line
            )
        elif any(sight in tags for sight in _SIGHTS):
            sight = next(sight for sight in _SIGHTS if sight in tags)
            yield Place(names, sight, tags[sight], *middle, box, country, {"city": town}, 0.15, ("way", key))


def _point(
    osm: tuple[str, int], at: tuple[float, float], tags: Mapping[str, str], town: str, country: str
) -> Iterator[Place]:
    names, kind = _names(tags), tags.get("place", "")
    reach = _REACH_DEG.get(kind, 0.01)
    if kind in (*_REACH_DEG, *_PARTS_OF_TOWNS):
        own = kind in ("city", "town", "village")
        address = {kind: tags["name"]} if own else {kind: tags["name"], "city": town}
        rank = {"city": 0.5, "town": 0.4, "village": 0.3}.get(kind, 0.2)
        box = (at[0] - reach, at[1] - reach, at[0] + reach, at[1] + reach)
        yield Place(names, "place", kind, *at, box, country, address, rank, osm)
    elif names and (tags.get("highway") == "motorway_junction" or any(sight in tags for sight in _SIGHTS)):
        category = "highway" if "highway" in tags else next(sight for sight in _SIGHTS if sight in tags)
        box = (at[0] - 5e-5, at[1] - 5e-5, at[0] + 5e-5, at[1] + 5e-5)
        yield Place(names, category, tags[category], *at, box, country, {"city": town}, 0.12, osm)


def _names(tags: Mapping[str, str]) -> dict[str, str]:
    wanted = ("name", "alt_name", "official_name", "short_name", "old_name", "loc_name", "int_name", "ref")
    return {key: value for key, value in tags.items() if key.partition(":")[0] in wanted}


def _around(line: Sequence[tuple[float, float]]) -> Box:
    lats, lons = [lat for lat, _ in line], [lon for _, lon in line]
    return min(lats), min(lons), max(lats), max(lons)


@dataclass(frozen=True)
class Request:
    """A request that came: to which service, its path, its parameters, its user agent, and when (monotonic)."""

    service: str
    path: str
    parameters: Mapping[str, str]
    user_agent: str
    at: float


@dataclass
class Mirror:
    """An Overpass service; ``data_time``: of its data; ``lacks``: tags without which it holds no element."""

    name: str
    data_time: str = DATA_TIME
    lacks: tuple[str, str] | None = None


class MapServers:
    """The services, on a free port of 127.0.0.1, until the ``with`` block ends."""

    def __init__(
        self,
        extracts: Sequence[Extract],
        places: Iterable[Place],
        mirrors: Sequence[Mirror] = (Mirror("one"), Mirror("two"), Mirror("three"), Mirror("four")),
    ) -> None:
        self.requests: list[Request] = []
        self.faults: dict[str, deque[Fault]] = {}
        self._extracts, self._mirrors = list(extracts), {mirror.name: mirror for mirror in mirrors}
        self._places = list(places)
        self._by_word: dict[str, list[int]] = {}
        for number, place in enumerate(self._places):
            for word in place.own_words:
                self._by_word.setdefault(word, []).append(number)
        self._server = HTTPServer(host="127.0.0.1", port=0, threaded=True)
        self._server.expect_request(_ANY_PATH).respond_with_handler(self._answer)
        self.stopped = threading.Event()

    @contextmanager
    def running(self) -> Iterator["MapServers"]:
        """Serve until the block is left."""
        logging.getLogger("werkzeug").setLevel(logging.CRITICAL)  # it logs each request, and each client that leaves
        self._server.start()
        try:
            yield self
        finally:
            self.stop()

    def stop(self) -> None:
        """Stop listening, so that connections are refused."""
        self.stopped.set()
        if self._server.is_running():
            self._server.stop()

    @property
    def port(self) -> int:
        """The port, known while it serves and afterwards."""
        return int(self._server.port)

    @property
    def nominatim(self) -> str:
        """The address of Nominatim."""
        return f"http://127.0.0.1:{self.port}/nominatim"

    @property
    def mirrors(self) -> tuple[str, ...]:
        """The addresses of the Overpass services."""
        return tuple(f"http://127.0.0.1:{self.port}/{name}/api" for name in self._mirrors)

    def fail(self, service: str, *faults: Fault) -> None:
        """Make a service (``nominatim`` or a mirror's name) fail next."""
        waiting = self.faults.setdefault(service, deque())
        for fault in faults:
            waiting.extend([fault] * fault.times)

    def asked(self, service: str, ending: str = "") -> list[Request]:
        """Return the requests to a service with a path ending."""
        return [one for one in self.requests if one.service == service and one.path.endswith(ending)]

    def search(self, parameters: Mapping[str, str]) -> list[dict[str, Any]]:
        """Return Nominatim's response."""
        words = words_of(parameters.get("q", ""))
        codes = {code for code in parameters.get("countrycodes", "").split(",") if code}
        numbers = {number for word in words for number in self._by_word.get(word, ())}
        found = [self._places[number] for number in sorted(numbers)]
        found = [place for place in found if place.is_called(words)]
        found = [place for place in found if not codes or (alpha2(place.country) in codes and place.country != "VIR")]
        found.sort(key=lambda place: (-place.importance, place.osm))
        return [place.as_json(number) for number, place in enumerate(found[: int(parameters.get("limit", "10"))])]

    def lookup(self, osm_ids: str) -> list[dict[str, Any]]:
        """Return Nominatim's response for ids such as ``R123,W45``."""
        asked = [part.strip() for part in osm_ids.split(",")]
        by_id = {f"{place.osm[0][0].upper()}{place.osm[1]}": place for place in self._places}
        return [by_id[one].as_json(number) for number, one in enumerate(asked) if one in by_id]

    def query(self, mirror: str, text: str) -> tuple[str, bytes]:
        """Return Overpass's response: media type and body.

        Raises:
            QueryError: the query is not understood.
        """
        held = self._mirrors[mirror]
        boxes = [tuple(map(float, box)) for box in _BOX.findall(text)]
        elements: dict[tuple[str, int], dict[str, Any]] = {}
        kind = run_query(text, Extract(Path())).format  # also explains what is wrong with the query
        for extract in self._extracts:
            if not boxes or any(_overlap(box, extract.box) for box in boxes):
                for one in run_query(text, extract).elements:
                    elements.setdefault((one["type"], one["id"]), one)
        ranks = ("node", "way", "relation")
        listed = [elements[key] for key in sorted(elements, key=lambda key: (ranks.index(key[0]), key[1]))]
        if held.lacks is not None:
            key, value = held.lacks
            listed = [one for one in listed if one.get("tags", {}).get(key) != value]
        return ("application/json", _as_json(listed, held)) if kind == "json" else ("text/xml", _as_xml(listed, held))

    def _answer(self, asked: WebRequest) -> Response:
        """Return a service's response: the requested content, or the next fault."""
        service, given = asked.path.split("/")[1], {**asked.args.to_dict(), **asked.form.to_dict()}
        agent = asked.headers.get("user-agent", "")
        self.requests.append(Request(service, asked.path, given, agent, time.monotonic()))
        fault = self._fault(service, asked.path)
        if fault is not None:
            return self._wrong(fault, service)
        if service != "nominatim":
            return self._overpass(service, asked.path, given)
        if asked.path.endswith("/search"):
            return _json(self.search(given))
        return _json(self.lookup(given.get("osm_ids", ""))) if asked.path.endswith("/lookup") else _plain(b"OK")

    def _fault(self, service: str, path: str) -> Fault | None:
        """Return the next fault; one of slots shows in the status, all others in the requested content."""
        waiting = self.faults.get(service)
        if not waiting or (waiting[0].kind == "no_slot") != path.endswith("/status"):
            return None
        return waiting.popleft()

    def _overpass(self, service: str, path: str, given: Mapping[str, str]) -> Response:
        if path.endswith("/status"):
            return _plain(_status(2, 0))
        if path.endswith("/kill_my_queries"):
            return _plain(b"(pid 1)\n")
        try:
            kind, body = self.query(service, given.get("data", ""))
        except QueryError as error:
            return Response(_page("OSM3S Response", f"line 1: {error}"), 400, content_type="text/html; charset=utf-8")
        return Response(body, content_type=kind)

    def _wrong(self, fault: Fault, service: str) -> Response:
        if fault.kind in _REFUSALS:
            after = {} if fault.wait_s is None else {"Retry-After": str(fault.wait_s)}
            return Response(_page("Error", _REFUSALS[fault.kind]), int(fault.kind), after, content_type="text/html")
        if fault.kind == "no_slot":
            return _plain(_status(0, fault.wait_s or 60))
        if fault.kind == "html":
            return Response(_page("OSM3S Response", "runtime error: open64: 0 Success"), content_type="text/html")
        if fault.kind == "redirect":
            return Response(b"", 302, {"Location": "http://127.0.0.2:9/elsewhere"})
        if fault.kind in ("slow", "cut", "huge", "drip"):
            length = {"Content-Length": "100000"} if fault.kind == "cut" else {}
            return Response(self._stream(fault.kind), 200, length, content_type="application/json")
        remark = 'runtime error: Query timed out in "query" at line 1 after 31 seconds.'
        bodies = {
            "empty": b"[]" if service == "nominatim" else _as_json([], Mirror(service)),
            "remark": _as_json([], Mirror(service), remark),
            "garbage": b'{"version": 0.6, "elements": [{"type": ',
            "forged": fault.body,
        }
        return Response(bodies[fault.kind], content_type="application/json")

    def _stream(self, kind: str) -> Iterator[bytes]:
        """Send a response that is too long, too slow, or breaks off."""
        if kind == "slow":
            self.stopped.wait(_MOST_SLOW_S)
            return
        yield b'{"version": 0.6, "elements": [\n'
        chunk = b'{"type": "node", "id": 1, "lat": 1.0, "lon": 1.0},\n' * 20_000
        for _ in range(_HUGE_MB * 1024**2 // len(chunk) if kind == "huge" else 0):
            yield chunk
        until = time.monotonic() + _MOST_SLOW_S
        while kind == "drip" and time.monotonic() < until and not self.stopped.wait(0.2):
            yield b" "


_ANY_PATH = re.compile(".*")
_REFUSALS = {"429": "rate_limited", "504": "The server is probably too busy", "403": "blocked"}


def _json(content: Any) -> Response:
    return Response(json.dumps(content), content_type="application/json; charset=utf-8")


def _plain(body: bytes) -> Response:
    return Response(body, content_type="text/plain")


_BOX = re.compile(r"\(" + ",".join([r"\s*(-?\d+(?:\.\d+)?)\s*"] * 4) + r"\)")
_FAR_DEG = 0.05


def _overlap(box: Sequence[float], other: Box) -> bool:
    return (
        box[0] <= other[2] + _FAR_DEG
        and box[2] >= other[0] - _FAR_DEG
        and box[1] <= other[3] + _FAR_DEG
        and box[3] >= other[1] - _FAR_DEG
    )


def _as_json(elements: Sequence[Mapping[str, Any]], mirror: Mirror, remark: str = "") -> bytes:
    notice = "The data included in this document is from www.openstreetmap.org. The data is made available under ODbL."
    answer = {
        "version": 0.6,
        "generator": "Overpass API 0.7.62.8 e802775f",
        "osm3s": {"timestamp_osm_base": mirror.data_time, "copyright": notice},
        "elements": list(elements),
    }
    return json.dumps(answer | ({"remark": remark} if remark else {}), indent=2, ensure_ascii=False).encode()


def _as_xml(elements: Sequence[Mapping[str, Any]], mirror: Mirror) -> bytes:
    root = etree.Element("osm", version="0.6", generator="Overpass API 0.7.62.8 e802775f")
    etree.SubElement(root, "meta", osm_base=mirror.data_time)
    for one in elements:
        at = {name: str(one[name]) for name in ("lat", "lon") if name in one}
        element = etree.SubElement(root, str(one["type"]), {"id": str(one["id"]), **at})
        for node in one.get("nodes", ()):
            etree.SubElement(element, "nd", ref=str(node))
        for member in one.get("members", ()):
            etree.SubElement(element, "member", {name: str(value) for name, value in member.items()})
        for name, value in one.get("tags", {}).items():
            etree.SubElement(element, "tag", k=name, v=value)
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8")


def _page(title: str, text: str) -> bytes:
    """Return a page as Overpass writes it in place of data."""
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<!DOCTYPE html PUBLIC "-//W3C//DTD XHTML 1.0 Strict//EN">\n'
        f"<html><head><title>{title}</title></head><body><p><strong>Error</strong>: {text}</p></body></html>"
    ).encode()


def _status(free: int, wait_s: int) -> bytes:
    """Return Overpass's status: the number of free slots, or the time of the next one."""
    now = datetime.now(UTC)
    then = now + timedelta(seconds=wait_s)
    slots = (
        f"{free} slots available now."
        if free
        else f"Slot available after: {then:%Y-%m-%dT%H:%M:%SZ}, in {wait_s} seconds."
    )
    return (
        f"Connected as: 2130706433\nCurrent time: {now:%Y-%m-%dT%H:%M:%SZ}\nAnnounced endpoint: none\nRate limit: 2\n"
        f"{slots}\nCurrently running queries (pid, space limit, time limit, start time):\n"
    ).encode()
