"""Checks that OpenStreetMap roads match their tags: small drawn crossings, countries' limits, real towns.

Keys:

- ``tags_right``: share of drawn crossings (``osm_tags.tsv``) with a west arm that matches OpenStreetMap's documentation
  of its tags, or for which the answer reports that it does not. ``tags_held_right``: the same for the held-out ones.
  ``tags_drawn``, ``tags_told`` (not as documented, but reported), ``tags_wrong`` (the first ones).
- ``limits_right``: share of countries and kinds of road (town street, road outside, motorway, all without a signed
  limit) that get the country's legal limit; ``limits_wrong`` lists the others.
- ``town_over_60``: roads without a limit in towns of the real extracts, by this module's own reading of the map, that
  get more than 60 km/h, except motorways and trunk roads; ``town_roads``: number of roads examined.
"""

import csv
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import cos, hypot, radians
from pathlib import Path

import numpy as np
from lxml import etree
from pyproj import Proj

from plannerforge.engine.execution import silent
from plannerforge.engine.generation.site_network import SiteNetwork, build_network
from plannerforge.engine.maps import OsmMap, RoadReader, Site, jurisdiction_of, read_map_file, site_finder
from plannerforge.engine.maps.osm import OsmWay
from plannerforge.engine.network import RoadLanelet
from plannerforge.schemas.errors import NotPossible, UnsafeInput
from plannerforge.schemas.generation import GenerationRequest

from ...harness import Figures, share
from ..bench import MapsBench

_CASES = Path(__file__).parent / "osm_tags.tsv"
_LIMITS = """
AUT 50 100 130 | BEL 50 70 120 | BGR 50 90 140 | HRV 50 90 130 | CZE 50 90 130
DNK 50 80 130 | FIN 50 80 120 | FRA 50 80 130 | DEU 50 100 130 | GRC 50 90 130
HUN 50 90 130 | IRL 50 80 120 | ITA 50 90 130 | LTU 50 90 130 | LUX 50 90 130
NLD 50 80 130 | NOR 50 80 110 | POL 50 90 140 | PRT 50 90 120 | ROU 50 90 130
SVK 50 90 130 | SVN 50 90 130 | ESP 30 90 120 | SWE 50 70 110 | CHE 50 80 120
GBR 48 97 113 | RUS 60 90 110 | UKR 50 90 130 | TUR 50 90 120 | ISR 50 80 110
JPN 60 60 100 | KOR 50 60 100 | CHN 50 70 120 | ZAF 60 100 120 | AUS 50 100 100
NZL 50 100 100 | ARG 60 110 130 | CHL 50 100 120 | ALB 40 80 110 | BIH 50 80 130
"""
"""By country the limits in km/h in towns, outside and on motorways: "Speed limits by country" of Wikipedia
(https://en.wikipedia.org/wiki/Speed_limits_by_country), and the traffic law of countries for which it gives a range.
"""
_LATITUDE, _LONGITUDE, _STEP_M = 54.6, 5.2, 100.0
"""A place in the North Sea, so that no settlement known to the product decides whether a drawn road is in a town."""
_ARMS = {"west": (-1, 0), "east": (1, 0), "south": (0, -1), "north": (0, 1)}
_SHOWN = 12
_ASIDE_M = 0.3
"""Tolerance for the middle of a road against its tags (chosen: a tenth of a lane)."""
_NEAREST_HOUSE_M = 60.0
_TOWN_CLASSES = frozenset({"primary", "secondary", "tertiary", "residential", "unclassified", "living_street"})
_EXCLUDED_LIMITS = ("maxspeed", "source:maxspeed", "zone:maxspeed", "zone:traffic")


def measure(bench: MapsBench) -> Figures:
    """Draw, build and judge; see the module."""
    return {**_tag_figures(bench), **_limit_figures(bench), **_town_figures(bench)}


@dataclass(frozen=True)
class Verdict:
    """Whether a road matches its tags, and whether a note reports that it does not."""

    right: bool
    told: bool


def _tag_figures(bench: MapsBench) -> Figures:
    cases = drawn_cases()[: bench.limit]
    verdicts = [(case, judged(case, bench.folder(f"tags{number}"))) for number, case in enumerate(cases)]
    wrong = [case["west"] or case["nodes"] for case, verdict in verdicts if not (verdict.right or verdict.told)]
    held = [verdict for case, verdict in verdicts if case["part"] == "held"]
    return {
        "tags_right": share(verdict.right or verdict.told for _, verdict in verdicts),
        "tags_held_right": share(verdict.right or verdict.told for verdict in held),
        "tags_drawn": len(verdicts),
        "tags_held": len(held),
        "tags_told": sum(verdict.told and not verdict.right for _, verdict in verdicts),
        "tags_wrong": "; ".join(wrong[:_SHOWN]),
    }


def drawn_cases() -> list[dict[str, str]]:
    """Return the cases: tags of the west arm and of nodes, the truth by OSM's documentation, and permitted notes.

    ``part`` is ``held`` for cases written next to the reader of tags and first examined when it was done.
    """
    with _CASES.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream, delimiter="\t", quoting=csv.QUOTE_NONE))


def legal_limits() -> list[dict[str, str]]:
    """Return the table of limits: ``country``, ``town``, ``rural``, ``motorway``."""
    rows = _LIMITS.replace("\n", "|").split("|")
    return [
        dict(zip(("country", "town", "rural", "motorway"), row.split(), strict=True)) for row in rows if row.strip()
    ]


def judged(case: Mapping[str, str], folder: Path) -> Verdict:
    """Build the west arm of a case in an empty folder; return whether it is right, and whether a note says it is
    not.
    """
    nodes: dict[str, dict[str, str]] = {}
    if case["nodes"]:
        name, _, tags = case["nodes"].partition(":")
        nodes[name] = _tags(tags)
    of_all = {"lanes": "6"} if "turns_in" in case["right"] else {}  # room for every lane that leads there
    if _tags(case["west"]).get("maxspeed") == "":  # limits posted on the other arms would tell that it is in a town
        of_all["maxspeed"] = ""
    path = _drawn(folder / "map.osm", {"west": {"lanes": "", **_tags(case["west"])}}, nodes, of_all=of_all)
    try:
        built = _built(path, case["country"], folder)
    except (NotPossible, UnsafeInput) as refusal:
        return Verdict(False, _is_reported([refusal.message], case["told"]))
    arm = _Arm(built)
    right = all(arm.holds(term) for term in case["right"].split() if term != "told_only")
    return Verdict(right and case["right"] != "told_only", _is_reported(built.notes, case["told"]))


def _is_reported(notes: tuple[str, ...] | list[str], word: str) -> bool:
    """Return True if a note names the road (or the kind of junction) and the word of its tag."""
    return bool(word) and any(word in note and ("West" in note or "barrier" in note) for note in notes)


def _tags(text: str) -> dict[str, str]:
    return dict(pair.split("=", 1) for pair in text.split(" & ")) if text else {}


def _drawn(
    target: Path,
    arms: Mapping[str, Mapping[str, str]],
    nodes: Mapping[str, Mapping[str, str]],
    *,
    of_all: Mapping[str, str] | None = None,
    houses: bool = False,
) -> Path:
    """Write a crossing of four arms called West, East, South, North; the ways of West and South lead inwards."""
    root = etree.Element("osm", {"version": "0.6"})

    def node(key: int, east_m: float, north_m: float, tags: Mapping[str, str]) -> None:
        latitude = _LATITUDE + north_m / 111_195.0
        longitude = _LONGITUDE + east_m / (111_195.0 * cos(radians(_LATITUDE)))
        element = etree.SubElement(root, "node", {"id": str(key), "lat": f"{latitude:.7f}", "lon": f"{longitude:.7f}"})
        for tag, value in tags.items():
            etree.SubElement(element, "tag", {"k": tag, "v": value})

    node(1, 0.0, 0.0, nodes.get("middle", {}))
    lines = []
    for number, (arm, (east, north)) in enumerate(_ARMS.items(), start=1):
        keys = [10 * number + step for step in range(1, 5)]
        for step, key in enumerate(keys, start=1):
            node(key, east * step * _STEP_M, north * step * _STEP_M, nodes.get(f"{arm}{step}", {}))
        line = [1, *keys] if arm in ("east", "north") else [*keys[::-1], 1]
        tags = {"highway": "secondary", "maxspeed": "50", "name": arm.title(), **(of_all or {}), **arms.get(arm, {})}
        lines.append((number, line, {key: value for key, value in tags.items() if value}))
    for house in range(40 if houses else 0):
        along, beside = (house - 20) * 20.0, 18.0
        node(1000 + house, along, beside, {"addr:housenumber": str(house)})
        node(2000 + house, beside, along, {"addr:housenumber": str(house)})
    for number, line, tags in lines:
        way = etree.SubElement(root, "way", {"id": str(number)})
        for key in line:
            etree.SubElement(way, "nd", {"ref": str(key)})
        for tag, value in tags.items():
            etree.SubElement(way, "tag", {"k": tag, "v": value})
    target.write_bytes(etree.tostring(root))
    return target


def _built(path: Path, country: str, folder: Path) -> SiteNetwork:
    request = GenerationRequest(
        map_path=str(path), map_id="map_drawn", place="Drawn", country=country, attribution="", folder=str(folder)
    )
    osm = read_map_file(path)
    site = Site("urban", _LATITUDE, _LONGITUDE, (), 1)
    return build_network(request, osm, site, 900.0, folder, silent)


class _Arm:
    """The west arm of a built crossing, for checks against a case."""

    def __init__(self, built: SiteNetwork) -> None:
        x, y = Proj(built.net.projection)(_LONGITUDE, _LATITUDE)
        self._middle = np.array([x + built.net.offset_m[0], y + built.net.offset_m[1]])
        west_deg = _LONGITUDE - 2 * _STEP_M / (111_195.0 * cos(radians(_LATITUDE)))
        self._outer = np.array(Proj(built.net.projection)(west_deg, _LATITUDE)) + built.net.offset_m
        self._all = built.network.lanelets
        west = [lanelet for lanelet in self._all.values() if lanelet.street == "West" and not lanelet.internal]
        self._in = self._from_left([lanelet for lanelet in west if self._comes(lanelet)])
        self._out = [lanelet for lanelet in west if not self._comes(lanelet)]

    def holds(self, term: str) -> bool:
        """Return True if a term of a case is true; ``!`` negates it."""
        if term.startswith("!"):
            return not self.holds(term[1:])
        name, _, value = term.partition("=")
        if name in ("car", "truck", "bus", "motorcycle"):
            return any(name in lanelet.users for lanelet in (*self._in, *self._out))
        if value and name in ("kmh", "in", "out"):
            lanelets = {"kmh": [*self._in, *self._out], "in": self._in, "out": self._out}[name]
            return bool(lanelets) and all(abs(each.speed_mps * 3.6 - float(value)) < 0.6 for each in lanelets)
        if name == "aside":
            return abs(self.aside_m() - float(value)) < _ASIDE_M
        return _TERMS[name](self, value)

    def aside_m(self) -> float:
        """Return how far the middle of the lanes is left of its nodes, towards the junction, 200 m before it."""
        outer = self._outer
        ahead = (self._middle - outer) / hypot(*(self._middle - outer))
        beside = []
        for lanelet in (*self._in, *self._out):
            along = (lanelet.center - outer) @ ahead
            if along.min() < 0 < along.max():
                order = np.argsort(along)
                left = (lanelet.center - outer) @ np.array([-ahead[1], ahead[0]])
                beside.append(float(np.interp(0.0, along[order], left[order])))
        return float(np.mean(beside))

    def _comes(self, lanelet: RoadLanelet) -> bool:
        first, last = (hypot(*(point - self._middle)) for point in (lanelet.center[0], lanelet.center[-1]))
        return bool(last < first)

    def _near(self, lanelets: list[RoadLanelet]) -> list[RoadLanelet]:
        """Return those that touch the junction; a road may be cut into pieces."""
        reach = [min(hypot(*(each.center[end] - self._middle)) for end in (0, -1)) for each in lanelets]
        return [each for each, distance in zip(lanelets, reach, strict=True) if distance < min(reach) + 15.0]

    @staticmethod
    def _from_left(lanelets: list[RoadLanelet]) -> list[RoadLanelet]:
        """Sort inward lanes from the left: they lead east, so further north is further left."""
        return sorted(lanelets, key=lambda lanelet: -float(lanelet.center[-1][1]))

    def gone(self) -> bool:
        """Return True if no motor vehicle may use it."""
        return not any(set(lanelet.users) & {"car", "truck", "bus"} for lanelet in (*self._in, *self._out))

    def cars(self, inward: bool) -> int:
        """Return the lanes in a direction that are open to cars, at the junction."""
        return sum("car" in each.users for each in self._near(self._in if inward else self._out))

    def lanes(self, inward: bool) -> int:
        """Return the lanes in a direction that are open to cars or buses, at the junction."""
        return sum(bool({"car", "bus"} & set(each.users)) for each in self._near(self._in if inward else self._out))

    def widths(self) -> list[float]:
        """Return the widths of all lanes in m."""
        return [
            float(np.median(np.linalg.norm(lanelet.left - lanelet.right, axis=1)))
            for lanelet in (*self._in, *self._out)
        ]

    def is_dead(self) -> bool:
        """Return True if no route leads from the outer end of the arm to another street."""
        outer = max(self._in, key=lambda lanelet: hypot(*(lanelet.center[0] - self._middle)), default=None)
        if outer is None:
            return True
        seen, waiting = {outer.lanelet_id}, [outer.lanelet_id]
        while waiting:
            for following in self._all[waiting.pop()].successors:
                if following not in seen:
                    seen.add(following)
                    waiting.append(following)
        return not any(self._all[key].street in ("East", "South", "North") for key in seen)

    def turns(self) -> str:
        """Return the directions of the inward lanes, from left to right."""
        sides = {"North": "left", "East": "straight", "South": "right"}
        lanes = []
        for lanelet in self._from_left(self._near(self._in)):
            streets = {street for street in self._streets_after(lanelet) if street in sides}
            lanes.append(",".join(sorted(sides[street] for street in streets)))
        return "|".join(lanes)

    def _streets_after(self, lanelet: RoadLanelet) -> Iterator[str]:
        waiting = list(lanelet.successors)
        while waiting:
            following = self._all[waiting.pop()]
            if following.internal:
                waiting += following.successors
            else:
                yield following.street


_TERMS: Mapping[str, Callable[[_Arm, str], bool]] = {
    "gone": lambda arm, _: arm.gone(),
    "dead": lambda arm, _: arm.is_dead(),
    "wide": lambda arm, _: bool(arm.widths()) and min(arm.widths()) >= 2.0,
    "oneway_in": lambda arm, _: arm.cars(True) > 0 and arm.cars(False) == 0,
    "oneway_out": lambda arm, _: arm.cars(False) > 0 and arm.cars(True) == 0,
    "car_in": lambda arm, value: arm.cars(True) == int(value),
    "car_out": lambda arm, value: arm.cars(False) == int(value),
    "lanes_in": lambda arm, value: arm.lanes(True) == int(value),
    "lanes_out": lambda arm, value: arm.lanes(False) == int(value),
    "turns_in": lambda arm, value: arm.turns() == value,
}


def _limit_figures(bench: MapsBench) -> Figures:
    countries = legal_limits()[: bench.limit]
    wrong, looked = [], 0
    for row in countries:
        for kind in ("town", "rural", "motorway"):
            folder = bench.folder(f"limit_{row['country']}_{kind}")
            fast = {"highway": "motorway", "oneway": "yes"} if kind == "motorway" else {}
            path = _drawn(folder / "map.osm", {}, {}, of_all={"maxspeed": "", **fast}, houses=kind == "town")
            built = _built(path, row["country"], folder)
            speeds = {round(lanelet.speed_mps * 3.6) for lanelet in built.network.lanelets.values() if lanelet.street}
            looked += 1
            if speeds != {int(row[kind])}:
                wrong.append(f"{row['country']} {kind} {sorted(speeds)}")
    right = round(1 - len(wrong) / max(looked, 1), 4)
    return {"limits_right": right, "limits_looked": looked, "limits_wrong": "; ".join(wrong[:_SHOWN])}


def _town_figures(bench: MapsBench) -> Figures:
    over, looked = [], 0
    for path in sorted(bench.maps.glob("*.osm"))[: bench.limit]:
        osm = read_map_file(path)
        reader = RoadReader(site_finder(osm).built_up, jurisdiction_of("DEU", osm.bounds[:2]), lefthand=False)
        houses = _House(osm)
        for way in osm.roads(_TOWN_CLASSES):
            if any(key in way.tags for key in _EXCLUDED_LIMITS) or not houses.line(osm, way):
                continue
            looked += 1
            nodes = [osm.nodes[key] for key in way.node_ids]
            tags = reader.tags_of(way, nodes, way.tags)
            if tags is not None and float(tags["maxspeed"]) > 60.0:
                over.append(f"{path.stem} way {way.way_id}")
    return {"town_over_60": len(over), "town_roads": looked, "town_over": "; ".join(over[:_SHOWN])}


class _House:
    """The houses of a map, in cells of the distance that makes a street a town's."""

    def __init__(self, osm: OsmMap) -> None:
        self._scale = 111_195.0 * cos(radians(osm.bounds[0]))
        built = [node.position for node in osm.nodes.values() if "addr:housenumber" in node.tags]
        built += [osm.nodes[way.node_ids[0]].position for way in osm.ways if "building" in way.tags]
        self._cells = {self._cell(*position) for position in built}

    def line(self, osm: OsmMap, way: OsmWay) -> bool:
        """Return True if houses are near most nodes of a road."""
        places = [osm.nodes[key].position for key in way.node_ids]
        near = 0
        for latitude, longitude in places:
            row, column = self._cell(latitude, longitude)
            near += any((row + i, column + j) in self._cells for i in (-1, 0, 1) for j in (-1, 0, 1))
        return near > 0.7 * len(places)

    def _cell(self, latitude: float, longitude: float) -> tuple[int, int]:
        return int(latitude * 111_195.0 // _NEAREST_HOUSE_M), int(longitude * self._scale // _NEAREST_HOUSE_M)
