"""What an empty search names instead: the values that the candidates have, nearest to what was asked for first."""

import sqlite3
from typing import Any

import pytest
from support.catalog import catalogue, facts

from plannerforge.engine.catalog.search import Search
from plannerforge.schemas.catalog import FindScenariosArguments
from plannerforge.schemas.scenarios import RoadFacts

STOP = RoadFacts(lanelets=3, signs_ego=("stop", "yield"), signs_map=("stop", "yield"), limits_ego_kmh=(30.0, 100.0))
COUNTRIES = ("ARG", "AUT", "BEL", "BRA", "CHN", "ESP", "FRA", "GRC", "ITA", "JPN", "USA")


def note(connection: sqlite3.Connection, within: list[str] | None = None, **slots: Any) -> str:
    search = Search(connection, FindScenariosArguments(**slots), within)
    emptied = search.answer("search", search.find(None), None).emptied_by
    assert emptied is not None
    return emptied.note


@pytest.fixture
def ladder() -> sqlite3.Connection:
    """Entries with 0 to 40 trucks, as many m/s, up to six lanes, in eleven countries; one with signs."""
    made = [
        facts(
            f"{COUNTRIES[index % len(COUNTRIES)]}_Town-{index + 1}_1_T-1",
            tags=["urban", "two_lane"] if index % 2 else ["highway"],
            features=["roundabout", "ramp"],
            counts={"truck": index} if index else {},
            speed_mps=float(index),
            lanes=index % 6 + 1,
            roads=STOP if index == 1 else None,
        )
        for index in range(41)
    ]
    return catalogue(made)


@pytest.mark.parametrize(
    ("slots", "named"),
    [
        ({"obstacles": ["truck>=100"]}, "truck counts: 40, 39, 38, 37, 36, 35, 34, 33 … (0 to 40)"),
        ({"obstacles": ["truck=50..60"]}, "truck counts: 40, 39"),
        ({"ego_speed": "60m/s"}, "initial speeds in m/s: 40, 39, 38"),
        ({"road_net": ["lanes>=8"]}, "lanes: 6, 5, 4, 3, 2, 1"),
        ({"road_net": ["speed_limit=90km/h"]}, "limits in km/h: 100, 30"),
        ({"features": ["horizon>=60s"]}, "horizon in s: 5"),
        ({"tags": ["multi_lane"]}, "tags: two_lane"),
        ({"features": ["intersection"]}, "features: "),
        ({"road_net": ["no_overtaking"]}, "signs on the ego's lane: "),
        ({"country": "UGA"}, "countries: USA"),
    ],
)
def test_the_nearest_values_are_named_first(ladder: sqlite3.Connection, slots: dict[str, Any], named: str) -> None:
    assert named in note(ladder, **slots)


def test_every_name_that_is_listed_is_carried_by_a_candidate(ladder: sqlite3.Connection) -> None:
    assert note(ladder, country="ARG", road_net=["no_overtaking"]).endswith("no_overtaking")
    listed = note(ladder, road_net=["no_overtaking"]).partition("lane: ")[2]
    assert set(listed.split(", ")) == {"stop", "yield", "speed_limit"}
    assert set(note(ladder, features=["intersection"]).partition("features: ")[2].split(", ")) == {"roundabout", "ramp"}


def test_excluded_values_are_not_offered(ladder: sqlite3.Connection) -> None:
    assert "existing" not in note(ladder, features=["!roundabout"])


def test_places_are_only_the_searched_ones(ladder: sqlite3.Connection) -> None:
    assert note(ladder, within=["ARG_Town-1_1_T-1"], country="JPN").endswith("countries: ARG")
