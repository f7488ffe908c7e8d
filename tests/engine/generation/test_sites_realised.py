"""A net that does not show the type of its site is seen, whatever the map promised."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.generation_bench import Road, made

from plannerforge.engine.generation.sites import why_not_realised
from plannerforge.engine.maps.site_search.finder import Site
from plannerforge.engine.network.net_parser import SumoNet
from plannerforge.schemas.generation import SiteType

ARMS = [Road(f"arm{n}", f"end{n}", "middle", [(60 * x, 60 * y), (0, 0)]) for n, (x, y) in enumerate(((1, 0), (0, 1)))]
THIRD = Road("arm2", "end2", "middle", [(-60, 0), (0, 0)])
MOTORWAY = Road("main", "a", "b", kind="highway.motorway")
LINK = Road("slip", "b", "c", [(50, 0), (90, -20)], kind="highway.motorway_link")
MAIN_ROAD, STREET = Road("road", "a", "b"), Road("road", "a", "b", kind="highway.residential")
UNKNOWN = replace(MAIN_ROAD, kind="")
INTO = [Road("east", "x", "a", [(80, 0), (20, 0)]), Road("west", "y", "b", [(-80, 0), (-20, 0)])]


def arc(begin: float, end: float) -> list[tuple[float, float]]:
    return [(20 * math.cos(a), 20 * math.sin(a)) for a in np.linspace(begin, end, 9)]


HALVES = [Road("north", "a", "b", arc(0, math.pi)), Road("south", "b", "a", arc(math.pi, 2 * math.pi))]
ROUND, ENTRIES = [("north", "south"), ("south", "north")], [("east", "north"), ("west", "south")]


def ring(links: list[tuple[str, str]], aside_m: float = 0.0) -> SumoNet:
    roads = [replace(road, points=[(x + aside_m, y) for x, y in road.points]) for road in (*HALVES, *INTO)]
    return replace(made(roads, links).net, roundabout_edges=(("north", "south"),))


SHOWN = [
    ("roundabout", ring([*ROUND, *ENTRIES])),
    ("signalised_intersection", made([*ARMS, THIRD], lit=["middle"]).net),
    ("intersection", made([*ARMS, THIRD]).net),
    ("ramp", made([MOTORWAY, LINK], [("main", "slip")]).net),
    ("highway", made([MOTORWAY]).net),
    ("rural", made([MAIN_ROAD]).net),
    ("rural", made([UNKNOWN]).net),
    ("urban", made([STREET]).net),
    ("urban", made([UNKNOWN]).net),
]
LOST = [
    ("roundabout", ring([ROUND[0], *ENTRIES])),
    ("roundabout", ring([*ROUND, ENTRIES[0]])),
    ("roundabout", ring([*ROUND, *ENTRIES], aside_m=150.0)),
    ("roundabout", made([*HALVES, *INTO], [*ROUND, *ENTRIES]).net),
    ("signalised_intersection", made([*ARMS, THIRD]).net),
    ("signalised_intersection", made([*ARMS, THIRD], lit=["end0"]).net),
    ("intersection", made(ARMS).net),
    ("intersection", made([*ARMS, replace(THIRD, kind="highway.primary_link")]).net),
    ("intersection", made([replace(road, kind=MOTORWAY.kind) for road in (*ARMS, THIRD)]).net),
    ("ramp", made([MOTORWAY, LINK]).net),
    ("ramp", made([MAIN_ROAD, LINK], [("road", "slip")]).net),
    ("highway", made([MAIN_ROAD]).net),
    ("rural", made([STREET]).net),
    ("urban", made([MOTORWAY]).net),
    ("urban", made([replace(LINK, points=[(-10, 0), (10, 0)])]).net),
]


@pytest.mark.parametrize(("kind", "net"), SHOWN)
def test_a_net_that_shows_the_type_is_taken(kind: SiteType, net: SumoNet) -> None:
    assert why_not_realised(Site(kind, 50.0, 10.0, (), 1), net) is None


@pytest.mark.parametrize(("kind", "net"), LOST)
def test_a_net_that_has_lost_the_type_is_not(kind: SiteType, net: SumoNet) -> None:
    reason = why_not_realised(Site(kind, 50.0, 10.0, (), 1), net)
    assert reason == f"the {kind} at 50.00000, 10.00000 is lost when the road network is built"
