"""The earth that the local services serve for the corpus's requests.

Real extracts are at their places. A place without an extract gets a substitute: an extract moved there with its
distances kept and its roads renamed as the request needs.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from plannerforge.evals.scoring.map_evidence import MapEvidence, read_evidence

from .extracts import Box, Extract
from .loopback import Place, places_in, settlement

_WITHIN_DEG = 0.3
"""Largest distance between extracts of one town."""
_ALIASES = frozenset(
    {"Korca", "Korce", "Nuremberg", "Garching bei München", "Munich", "Newcastle", "Vaduz", "Liechtenstein"}
)
"""Names in ``places.json`` that are not of a part of the first one."""


@dataclass(frozen=True)
class StandIn:
    """An extract that replaces a place: its new middle, the names of its roads, a part of the town."""

    file: str
    latitude: float
    longitude: float
    renamed: Mapping[str, str]
    part: str = ""


def _substitute(file: str, latitude: float, longitude: float, part: str = "") -> StandIn:
    return StandIn(file, latitude, longitude, {}, part)


STAND_INS: Mapping[str, StandIn] = {
    "gen-d051": _substitute("o2s_arizona_highways.osm", 31.30, 121.35),
    "gen-d052": _substitute("ALB_Korce-1.osm", 40.417, -3.703),
    "gen-d053": _substitute("Laufamholzstrasse.osm", 50.937, 6.960),
    "gen-d054": _substitute("munich.osm", 37.498, 127.028, part="Gangnam"),
    "gen-d055": _substitute("USA_Memphis-1.osm", 43.653, -79.383),
    "gen-d056": StandIn("bautzen.osm", 53.571, 9.929, {"A 4": "A 7"}),
    "gen-d057": StandIn("o2s_arizona_highways.osm", 39.953, -75.141, {"AZ 101 Loop": "I 95"}),
    "gen-d058": _substitute("ALB_Korce-1.osm", 41.902, 12.496),
    "gen-d059": _substitute("West-Oakland.osm", 52.373, 4.893),
    "gen-d060": _substitute("o2s_tempe_light_rail.osm", 21.028, 105.854),
    "gen-d061": _substitute("map_without_crossing_nodes.osm", 47.378, 8.540),
    "gen-d062": _substitute("krautsand.osm", 43.318, 11.331),
    "gen-d063": StandIn(
        "map_without_crossing_nodes.osm", 48.867, 2.364, {"Tutzinger-Hof-Platz": "Place de la République"}
    ),
    "gen-d064": _substitute("Laufamholzstrasse.osm", 50.087, 14.421),
    "gen-d065": _substitute("ALB_Korce-1.osm", -1.950, 30.059),
    "gen-d066": _substitute("o2s_perth_stretched_lights.osm", 35.682, 139.767),
    "gen-d067": _substitute("garching_intersection.osm", 50.062, 19.938),
    "gen-d068": _substitute("bautzen.osm", 45.764, 4.836),
    "gen-d069": _substitute("o2s_northgate_dual_carriageway.osm", 38.424, 27.143),
    "gen-d070": _substitute("berlin-siegessaeule.osm", 44.494, 11.343),
    "gen-d071": _substitute("o2s_tempe_light_rail.osm", 38.708, -9.137),
    "gen-d072": _substitute("West-Oakland.osm", 31.240, 121.490, part="the Bund"),
    "gen-d073": _substitute("West-Oakland.osm", 41.879, -87.636),
    "gen-d074": StandIn("bautzen.osm", 59.913, 10.754, {"A 4": "E 6"}),
    "gen-d075": _substitute("HND_Santa_Barbara-1.osm", 63.933, -20.997),
    "gen-d076": _substitute("USA_Memphis-1.osm", -34.604, -58.382),
    "gen-d077": _substitute("o2s_st_georges_cycletrack.osm", -1.286, 36.817),
    "gen-d078": _substitute("o2s_cycleway_rejoin_road.osm", -33.925, 18.424),
    "gen-d079": StandIn("false_positive_u_turns.osm", 51.305, -0.520, {"A167(M)": "M25"}),
    "gen-d080": _substitute("o2s_borough_sausage_links.osm", -33.861, 151.210),
    "gen-d081": _substitute("munich.osm", 47.071, 15.439),
    "gen-d082": _substitute("Laufamholzstrasse.osm", 48.208, 16.373),
    "gen-d083": _substitute("o2s_arizona_highways.osm", 52.091, 5.122),
    "gen-d084": _substitute("o2s_northgate_dual_carriageway.osm", 60.170, 24.938),
    "gen-d085": StandIn("o2s_arizona_highways.osm", 25.198, 55.274, {"Pima Freeway": "Sheikh Zayed Road"}),
    "gen-d087": _substitute("West-Oakland.osm", 40.7597, -73.98155),
    "gen-d088": _substitute("West-Oakland.osm", 59.328, 18.060),
    "gen-d096": _substitute("ALB_Korce-1.osm", 37.984, 23.728),
    "gen-d100": _substitute("Laufamholzstrasse.osm", 47.918, 106.917),
}
"""Requests of the corpus for places without an extract; traffic keeps to the same side in both places."""


@dataclass(frozen=True)
class Region:
    """A served extract: an equivalent file (moved if it replaces a place), and the town's names.

    ``most``: the number of sites of a type, if ``places.json`` counts them.
    """

    extract: Extract
    file: Path
    towns: tuple[str, ...]
    country: str
    most: Mapping[str, int] = field(default_factory=dict)

    @cached_property
    def evidence(self) -> MapEvidence:
        """Return the map's evidence at any spot, for the judges."""
        return read_evidence(self.file)


@dataclass(frozen=True)
class Earth:
    """All served data: the regions by their request or file, and Nominatim's knowledge."""

    regions: Mapping[str, Region]
    places: tuple[Place, ...]

    @property
    def extracts(self) -> list[Extract]:
        """The extracts."""
        return [region.extract for region in self.regions.values()]


def earth_for(lines: Sequence[Mapping[str, Any]], maps: Path, scratch: Path) -> Earth:
    """Return the extracts that a corpus's requests name, at their places, and substitutes for other places.

    ``scratch`` receives the moved ones.
    """
    shown = json.loads((maps / "places.json").read_text(encoding="utf-8"))
    regions: dict[str, Region] = {}
    for line in lines:
        name = line["map"]
        if name is not None and name not in regions:
            extract = Extract.read(maps / name)
            file = _as_xml(extract, scratch / f"{len(regions)}.osm") if name.endswith(".pbf") else maps / name
            most = {
                "signalised_intersection": int(shown[name]["contains"]["signalised_crossings"]["count"]),
                "roundabout": int(shown[name]["contains"]["roundabouts"]["count"]),
            }
            regions[name] = Region(extract, file, tuple(shown[name]["places"]), shown[name]["country"], most)
        elif name is None and line["id"] in STAND_INS:
            regions[line["id"]] = _stand_in(STAND_INS[line["id"]], line["truth"]["location"], maps, scratch)
    return Earth(regions, (*_towns(regions), *_roads_and_sights(regions), *_springfields()))


def _stand_in(wanted: StandIn, where: Mapping[str, Any], maps: Path, scratch: Path) -> Region:
    extract = Extract.read(
        maps / wanted.file, middle=(wanted.latitude, wanted.longitude), renamed=wanted.renamed, nameless=True
    )
    file = _as_xml(extract, scratch / f"at_{wanted.latitude}_{wanted.longitude}.osm")
    towns = (where["city"], wanted.part) if wanted.part else (where["city"],)
    return Region(extract, file, towns, where["country"])


def _as_xml(extract: Extract, path: Path) -> Path:
    import osmium
    from osmium.osm import mutable

    with osmium.SimpleWriter(str(path), overwrite=True) as writer:
        for key in sorted(extract.nodes):
            lat, lon, tags = extract.nodes[key]
            writer.add_node(mutable.Node(id=key, location=(lon, lat), tags=tags))
        for key in sorted(extract.ways):
            nodes, tags = extract.ways[key]
            writer.add_way(mutable.Way(id=key, nodes=list(nodes), tags=tags))
    return path


def _towns(regions: Mapping[str, Region]) -> list[Place]:
    """Return every town once, with a box around all of its extracts, and its parts."""
    boxes: dict[tuple[str, str], Box] = {}
    parts: list[Place] = []
    for region in regions.values():
        first, *others = region.towns
        box = region.extract.box
        for name in (first, *(other for other in others if other in _ALIASES)):
            known = boxes.get((name, region.country))
            near = known is None or abs(known[0] - box[0]) < _WITHIN_DEG
            boxes[name, region.country] = box if known is None or not near else _around_both(known, box)
        parts += [
            settlement([other], region.country, box, importance=0.4, kind="suburb", city=first)
            for other in others
            if other not in _ALIASES
        ]
    return [settlement([name], country, box) for (name, country), box in boxes.items()] + parts


def _around_both(one: Box, other: Box) -> Box:
    return min(one[0], other[0]), min(one[1], other[1]), max(one[2], other[2]), max(one[3], other[3])


def _roads_and_sights(regions: Mapping[str, Region]) -> list[Place]:
    return [
        place for region in regions.values() for place in places_in(region.extract, region.towns[0], region.country)
    ]


def _springfields() -> list[Place]:
    """Return towns of one name with about equal importance."""
    towns = {"Illinois": (39.799, -89.644), "Missouri": (37.209, -93.292), "Massachusetts": (42.101, -72.590)}
    return [
        settlement(["Springfield"], "USA", (lat - 0.1, lon - 0.1, lat + 0.1, lon + 0.1), state=state, importance=rank)
        for (state, (lat, lon)), rank in zip(towns.items(), (0.6, 0.59, 0.57), strict=True)
    ]
