"""The judges of generated scenarios see what is right, and every one of them sees what is wrong."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from plannerforge.engine.network.net_parser import ROAD_CLASSES, Connection, NetEdge, NetLane, SumoNet
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.evals.generation_judge import MadeFiles, holds_vehicles, lies_at_street, lies_in, shows_type
from plannerforge.evals.generation_motion import is_drivable, meet
from plannerforge.evals.map_evidence import METRES_A_DEGREE, MapEvidence, Mapped

NOTHING = MapEvidence(())
LATITUDE, LONGITUDE = 50.0, 10.0


@dataclass(frozen=True)
class Road:
    """A one-way road of a net between two junctions, from point to point in m."""

    key: str
    begin: str
    end: str
    points: Sequence[tuple[float, float]] = ((-50.0, 0.0), (50.0, 0.0))
    kind: str = "highway.secondary"


def made(roads: Sequence[Road], links: Sequence[tuple[str, str]] = (), lit: Sequence[str] = ()) -> MadeFiles:
    """A scenario with its middle at (0, 0); ``links`` are turns from road to road, ``lit`` junctions with lights."""
    lanes = [NetLane(f"{r.key}_0", r.key, 0, 10.0, 3.2, ROAD_CLASSES, np.array(r.points), False) for r in roads]
    net = SumoNet(
        lanes={lane.lane_id: lane for lane in lanes},
        edges={r.key: NetEdge(r.key, r.begin, r.end, False, r.kind, "", (f"{r.key}_0",)) for r in roads},
        connections=tuple(Connection(a, b, f"{a}_0", f"{b}_0", None, "s", None, -1) for a, b in links),
        junction_types=dict.fromkeys(lit, "traffic_light"),
        signals={},
        roundabout_edges=(),
        projection="",
        offset_m=(0.0, 0.0),
        lefthand=False,
    )
    return MadeFiles(net, np.zeros(2), LATITUDE, LONGITUDE, ())


def mapped(*offsets_m: tuple[float, float], **tags: str) -> Mapped:
    """Something at (north, east) of the middle in m."""
    east_m = METRES_A_DEGREE * math.cos(math.radians(LATITUDE))
    places = [(LATITUDE + north / METRES_A_DEGREE, LONGITUDE + east / east_m) for north, east in offsets_m]
    return Mapped(np.array(places), tags)


def around(half_m: float, **tags: str) -> Mapped:
    """A square around the middle."""
    return mapped(*((half_m * a, half_m * b) for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1))), **tags)


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
    "any": (made([SECONDARY]), NOTHING),
}
BLOCK = [(-30.0, -30.0), (30.0, -30.0), (30.0, 30.0), (-30.0, 30.0)]
SIDES = [
    [Road(f"side{n}", f"c{n}", f"c{(n + 1) % 4}", [a, b]), Road(f"-side{n}", f"c{(n + 1) % 4}", f"c{n}", [b, a])]
    for n, (a, b) in enumerate(zip(BLOCK, [*BLOCK[1:], BLOCK[0]], strict=True))
]
BLOCK_ENTRIES = [Road(f"in{n}", f"far{n}", f"c{n}", [(2 * x, 2 * y), (x, y)]) for n, (x, y) in enumerate(BLOCK[:2])]
BLOCK_LINKS = [(f"side{n}", f"side{(n + 1) % 4}") for n in range(4)] + [("in0", "side0"), ("in1", "side1")]
FAR = tuple((x, y + 200.0) for x, y in SECONDARY.points)
WRONG = {
    "roundabout against the traffic": ("roundabout", made([*RIGHT_ROUND, *INTO], [*ROUND, *ENTRIES]), NOTHING),
    "ring that is not closed": ("roundabout", made([*LEFT_ROUND, *INTO], [ROUND[0], *ENTRIES]), NOTHING),
    "ring with one road into it": ("roundabout", made([*LEFT_ROUND, INTO[0]], [*ROUND, ENTRIES[0]]), NOTHING),
    "block of two-way streets": (
        "roundabout",
        made([*(road for side in SIDES for road in side), *BLOCK_ENTRIES], BLOCK_LINKS),
        NOTHING,
    ),
    "crossing without lights": ("signalised_intersection", made([*ARMS, THIRD]), NOTHING),
    "lights elsewhere": ("signalised_intersection", made([*ARMS, THIRD], lit=["end0"]), NOTHING),
    "bend": ("intersection", made(ARMS), NOTHING),
    "main road as motorway": ("highway", made([SECONDARY]), NOTHING),
    "motorway far away": ("highway", made([replace(MOTORWAY, points=FAR)]), NOTHING),
    "link off another road": ("ramp", made([SECONDARY, LINK], [("road", "slip")]), NOTHING),
    "link past a motorway": ("ramp", made([MOTORWAY, LINK]), NOTHING),
    "country without a road": ("rural", made([replace(SECONDARY, points=FAR)]), NOTHING),
    "country road in a village": ("rural", made([SECONDARY]), VILLAGE),
    "country road among houses": ("rural", made([SECONDARY]), HOUSES),
    "country road with houses along it": ("rural", made([STREET]), NOTHING),
    "town without a road": ("urban", made([]), VILLAGE),
    "town on a motorway": ("urban", made([MOTORWAY, STREET]), VILLAGE),
    "town in the fields": ("urban", made([SECONDARY]), FAST),
    "nothing near": ("any", made([replace(SECONDARY, points=FAR)]), NOTHING),
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


def test_a_limit_above_a_towns_tells_of_the_country() -> None:
    assert shows_type(made([SECONDARY]), "rural", MapEvidence((*HOUSES.mapped, *FAST.mapped)))


def test_the_middle_has_to_lie_in_the_box() -> None:
    files = made([SECONDARY])
    assert lies_in(files, (49.9, 9.9, 50.1, 10.1), 0.0)
    for box in ((50.01, 9.9, 50.1, 10.1), (49.9, 9.9, 49.99, 10.1), (49.9, 10.01, 50.1, 10.1), (49.9, 9.9, 50.1, 9.99)):
        assert not lies_in(files, box, 0.0001)


@pytest.mark.parametrize(
    ("street", "right"),
    [
        ("High Street", True),
        ("A4", True),
        ("High Street, Redfield", True),
        ("Low Street", False),
        ("High Street, Whitefield", False),
        ("Far Lane", False),
    ],
)
def test_the_street_has_to_be_named_near_the_middle(street: str, *, right: bool) -> None:
    high = mapped((0, -400), (0, 400), highway="primary", name="Upper High Street", ref="B 2;A 4")
    far = mapped((900, 0), (900, 400), highway="primary", name="Far Lane")
    assert lies_at_street(made([]), street, ["Redfield"], MapEvidence((high, far))) == right


@pytest.mark.parametrize(
    ("wished", "right"),
    [
        ({"car": (2, 2), "trailer": (1, None), "moped": (1, None)}, True),
        ({"car": (3, None)}, False),
        ({"car": (1, 1)}, False),
        ({"truck": (1, None)}, False),
        ({"motorcycle": (1, None)}, False),
    ],
)
def test_classes_are_told_by_type_and_length_and_counted(
    wished: dict[str, tuple[int, int | None]], *, right: bool
) -> None:
    obstacles = (("car", 4.5), ("car", 4.5), ("truck", 16.5), ("motorcycle", 2.1))
    assert holds_vehicles(replace(made([]), obstacles=obstacles), wished) == right


def track(first_step: int = 0, offset: tuple[float, float] = (0.0, 0.0), aside_m: float = 0.0) -> Track:
    """A car at 10 m/s along x, which at step 10 may jump aside."""
    steps = np.arange(30)
    positions = np.stack([steps + offset[0], offset[1] + aside_m * (steps > 10)], axis=1)
    return Track(1, "car", 4.5, 1.8, first_step, positions, np.zeros(30), np.full(30, 10.0))


def test_overlaps_are_seen_at_the_same_time_only() -> None:
    assert meet(track(), track(offset=(4.0, 1.0)))
    assert not meet(track(), track(offset=(4.6, 0.0)))
    assert not meet(track(), track(offset=(0.0, 1.9)))
    assert meet(track(), track(offset=(0.0, 6.0), aside_m=-6.0))
    assert meet(track(), track(first_step=5, offset=(5.0, 0.0)))
    assert not meet(track(), track(first_step=40))


def test_a_jump_cannot_be_driven() -> None:
    assert is_drivable(track(), 0.1)
    assert not is_drivable(track(aside_m=0.5), 0.1)


def test_evidence_is_read_from_the_file(tmp_path: Path) -> None:
    from plannerforge.evals.map_evidence import read_evidence

    path = tmp_path / "map.osm"
    path.write_text(
        '<osm><node id="1" lat="50" lon="10"/><node id="2" lat="50.0001" lon="10"/>'
        '<way id="3"><nd ref="1"/><nd ref="2"/><nd ref="9"/><tag k="highway" v="primary"/>'
        '<tag k="name" v="Rue de l\'Église"/><tag k="maxspeed" v="70"/></way></osm>',
        encoding="utf-8",
    )
    evidence = read_evidence(path)
    assert evidence.names_near("rue de l'eglise", 50.0, 10.001, 100.0)
    assert not evidence.names_near("rue de l'eglise", 50.0, 10.002, 100.0)
    assert evidence.limits_kmh(50.0, 10.0, 5.0) == [70.0]
