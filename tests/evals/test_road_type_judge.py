"""The judge of road types sees what is right, and every type's judge sees what is wrong."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.generation_bench import NOTHING, Road, around, made, mapped

from plannerforge.evals.scoring.made_files import shows_type
from plannerforge.evals.scoring.map_evidence import MapEvidence


def arc(begin: float, end: float) -> list[tuple[float, float]]:
    return [(20 * math.cos(a), 20 * math.sin(a)) for a in np.linspace(begin, end, 9)]


LEFT_ROUND = (Road("north", "a", "b", arc(0, math.pi)), Road("south", "b", "a", arc(math.pi, 2 * math.pi)))
RIGHT_ROUND = (Road("north", "b", "a", arc(math.pi, 0)), Road("south", "a", "b", arc(2 * math.pi, math.pi)))
INTO = (Road("east", "x", "a", [(80, 0), (20, 0)]), Road("west", "y", "b", [(-80, 0), (-20, 0)]))
ENTRIES = (("east", "north"), ("west", "south"))
ROUND = (("north", "south"), ("south", "north"))
ARMS = [Road(f"arm{n}", f"end{n}", "middle", [(60 * x, 60 * y), (0, 0)]) for n, (x, y) in enumerate(((1, 0), (0, 1)))]
THIRD = Road("arm2", "end2", "middle", [(-60, 0), (0, 0)])
MOTORWAY = Road("main", "a", "b", kind="highway.motorway")
LINK = Road("slip", "b", "c", [(50, 0), (90, -20)], kind="highway.motorway_link")
SECONDARY, STREET = Road("road", "a", "b"), Road("road", "a", "b", kind="highway.residential")
HOUSES = MapEvidence(tuple(mapped((15.0, 10.0 * n), building="yes") for n in range(3)))
VILLAGE = MapEvidence((around(100.0, landuse="residential"),))
FAST, SLOW = (MapEvidence((mapped((0, -50), (0, 50), highway="x", maxspeed=limit),)) for limit in ("100", "30 mph"))


RIGHT = {
    "roundabout": (made([*LEFT_ROUND, *INTO], [*ROUND, *ENTRIES]), NOTHING),
    "signalised_intersection": (made([*ARMS, THIRD], lit=["middle"]), NOTHING),
    "intersection": (made([*ARMS, THIRD]), NOTHING),
    "highway": (made([MOTORWAY]), NOTHING),
    "ramp": (made([MOTORWAY, LINK], [("main", "slip")]), NOTHING),
    "rural": (made([SECONDARY]), NOTHING),
    "urban": (made([STREET]), NOTHING),
}
BLOCK = [(-30.0, -30.0), (30.0, -30.0), (30.0, 30.0), (-30.0, 30.0)]
SIDES = [
    [Road(f"side{n}", f"c{n}", f"c{(n + 1) % 4}", [a, b]), Road(f"-side{n}", f"c{(n + 1) % 4}", f"c{n}", [b, a])]
    for n, (a, b) in enumerate(zip(BLOCK, [*BLOCK[1:], BLOCK[0]], strict=True))
]
BLOCK_ENTRIES = [Road(f"in{n}", f"far{n}", f"c{n}", [(2 * x, 2 * y), (x, y)]) for n, (x, y) in enumerate(BLOCK[:2])]
BLOCK_LINKS = [(f"side{n}", f"side{(n + 1) % 4}") for n in range(4)] + [("in0", "side0"), ("in1", "side1")]
CORNERS = list(zip(BLOCK, [*BLOCK[1:], BLOCK[0]], strict=True))
BOX = [Road(f"side{n}", f"c{n}", f"c{(n + 1) % 4}", pair) for n, pair in enumerate(CORNERS)] + BLOCK_ENTRIES
BOX_LINKS = [(f"side{n}", f"side{(n + 1) % 4}", "l") for n in range(4)] + [("in0", "side0"), ("in1", "side1")]
FAR_ROUND = [replace(road, points=[(x, y + 100.0) for x, y in road.points]) for road in (*LEFT_ROUND, *INTO)]
FAR_CROSSING = [replace(road, points=[(x + 90.0, y) for x, y in road.points]) for road in (*ARMS, THIRD)]
FORK = [replace(road, kind=MOTORWAY.kind) for road in (*ARMS, THIRD)]
MAIN_ON = Road("on", "b", "d", [(50, 0), (150, 0)], kind=MOTORWAY.kind)
CARRIAGEWAYS = [
    Road("there", "middle", "end2", [(0, 0), (-60, 12)], name="High Street"),
    Road("back", "end3", "middle", [(-60, -12), (0, 0)], name="High Street"),
]
BEYOND, FARTHER, CLOSE = [(-50, -50), (50, -50)], [(-50.0, 0.0), (90.0, 0.0)], [(20, 0), (90, -20)]
TRUNK = "highway.trunk"
MOTORWAYS = MapEvidence((mapped((900, 0), (900, 400), highway="motorway"),))
FAR = tuple((x, y + 200.0) for x, y in SECONDARY.points)
WRONG = {
    "roundabout against the traffic": ("roundabout", made([*RIGHT_ROUND, *INTO], [*ROUND, *ENTRIES]), NOTHING),
    "ring that is not closed": ("roundabout", made([*LEFT_ROUND, *INTO], [ROUND[0], *ENTRIES]), NOTHING),
    "ring with one road into it": ("roundabout", made([*LEFT_ROUND, INTO[0]], [*ROUND, ENTRIES[0]]), NOTHING),
    "crossing of two dual carriageways": ("roundabout", made(BOX, BOX_LINKS), NOTHING),
    "roundabout in the next street": ("roundabout", made(FAR_ROUND, [*ROUND, *ENTRIES]), NOTHING),
    "block of two-way streets": (
        "roundabout",
        made([*(road for side in SIDES for road in side), *BLOCK_ENTRIES], BLOCK_LINKS),
        NOTHING,
    ),
    "crossing without lights": ("signalised_intersection", made([*ARMS, THIRD]), NOTHING),
    "lights elsewhere": ("signalised_intersection", made([*ARMS, THIRD], lit=["end0"]), NOTHING),
    "bend": ("intersection", made(ARMS), NOTHING),
    "motorway that a link leaves": ("intersection", made([MOTORWAY, MAIN_ON, LINK]), NOTHING),
    "road that parts in two": ("intersection", made([ARMS[0], *CARRIAGEWAYS]), NOTHING),
    "fork of motorways": (
        "intersection",
        made([replace(road, kind=MOTORWAY.kind) for road in (*ARMS, THIRD)]),
        NOTHING,
    ),
    "crossing down the road": ("intersection", made(FAR_CROSSING), NOTHING),
    "main road as motorway": ("highway", made([SECONDARY]), NOTHING),
    "motorway far away": ("highway", made([replace(MOTORWAY, points=FAR)]), NOTHING),
    "motorway at a town's crossing": ("highway", made([*ARMS, THIRD, replace(MOTORWAY, points=BEYOND)]), NOTHING),
    "trunk road where there are motorways": ("highway", made([replace(MOTORWAY, kind=TRUNK)]), MOTORWAYS),
    "link off a trunk road where there are motorways": (
        "ramp",
        made([replace(MOTORWAY, kind=TRUNK), LINK], [("main", "slip")]),
        MOTORWAYS,
    ),
    "ramp farther on": ("ramp", made([replace(MOTORWAY, points=FARTHER), LINK], [("main", "slip")]), NOTHING),
    "link off another road": ("ramp", made([SECONDARY, LINK], [("road", "slip")]), NOTHING),
    "link past a motorway": ("ramp", made([MOTORWAY, LINK]), NOTHING),
    "country at a ramp": ("rural", made([replace(MOTORWAY, kind=TRUNK), replace(LINK, points=CLOSE)]), FAST),
    "town in the country": ("urban", made([STREET]), FAST),
    "country road in a slow zone": ("rural", made([SECONDARY]), SLOW),
    "country without a road": ("rural", made([replace(SECONDARY, points=FAR)]), NOTHING),
    "country road in a village": ("rural", made([SECONDARY]), VILLAGE),
    "country road among houses": ("rural", made([SECONDARY]), HOUSES),
    "country road with houses along it": ("rural", made([STREET]), NOTHING),
    "town without a road": ("urban", made([]), VILLAGE),
    "town on a motorway": ("urban", made([MOTORWAY, STREET]), VILLAGE),
    "town in the fields": ("urban", made([SECONDARY]), FAST),
}


@pytest.mark.parametrize("kind", RIGHT)
def test_a_road_of_the_type_is_seen(kind: str) -> None:
    files, evidence = RIGHT[kind]
    assert shows_type(files, kind, evidence)


@pytest.mark.parametrize("case", WRONG)
def test_a_road_of_another_type_is_seen(case: str) -> None:
    kind, files, evidence = WRONG[case]
    assert not shows_type(files, kind, evidence)


def test_every_judge_of_a_type_has_a_wrong_case() -> None:
    assert {kind for kind, _, _ in WRONG.values()} == set(RIGHT)


@pytest.mark.parametrize("evidence", [HOUSES, VILLAGE, SLOW], ids=["houses", "land", "limit"])
def test_houses_land_and_limits_tell_of_a_town(evidence: MapEvidence) -> None:
    assert shows_type(made([SECONDARY]), "urban", evidence)


def test_roads_without_a_name_are_not_two_sides_of_one_road() -> None:
    fork = [replace(road, name="") for road in CARRIAGEWAYS]
    fork[0] = replace(fork[0], points=[(0, 0), (-60, 45)])
    assert shows_type(made([ARMS[0], *fork]), "intersection", NOTHING)


def test_town_and_country_are_never_both() -> None:
    for files in (made([STREET]), made([SECONDARY])):
        for evidence in (NOTHING, HOUSES, VILLAGE, FAST, SLOW):
            assert shows_type(files, "urban", evidence) != shows_type(files, "rural", evidence)


def test_a_trunk_road_is_a_highway_if_the_map_has_no_motorway() -> None:
    files = made([replace(MOTORWAY, kind=TRUNK), LINK], [("main", "slip")])
    assert shows_type(files, "highway", FAST)
    assert not shows_type(files, "highway", SLOW)
    assert shows_type(files, "ramp", NOTHING)


def test_a_limit_above_a_towns_tells_of_the_country() -> None:
    assert shows_type(made([SECONDARY]), "rural", MapEvidence((*HOUSES.mapped, *FAST.mapped)))
