"""Handmade facts for tests of the catalogue alone."""

import sqlite3
from collections.abc import Mapping, Sequence

from plannerforge.engine.catalog.constraints import constraints_of, location_constraints
from plannerforge.engine.catalog.funnel import Funnel
from plannerforge.engine.catalog.tables import add_facts, prepare
from plannerforge.schemas.catalog import FindScenariosArguments
from plannerforge.schemas.scenarios import EgoFacts, LocationFacts, ParticipantFacts, RoadFacts, ScenarioFacts


def facts(
    scenario_id: str = "DEU_Munich-1_1_T-1",
    *,
    tags: Sequence[str] = (),
    features: Sequence[str] = (),
    counts: Mapping[str, int] | None = None,
    speed_mps: float = 10.0,
    lanes: int = 1,
    roads: RoadFacts | None = None,
    source: str = "",
) -> ScenarioFacts:
    country, place = scenario_id.split("-")[0].split("_")
    ego = EgoFacts(
        problem_id=1,
        speed_mps=speed_mps,
        x_m=0.0,
        y_m=0.0,
        heading_rad=0.0,
        lanes=lanes,
        lanelets=(1,),
        goal_forms=("time",),
        goal_first_step=0,
        goal_last_step=50,
    )
    return ScenarioFacts(
        scenario_id=scenario_id,
        format_version="2020a",
        step_s=0.1,
        horizon_steps=50,
        location=LocationFacts(country=country, place=place),
        tags=tuple(sorted(tags)),
        features=tuple(sorted(features)),
        roads=roads or RoadFacts(lanelets=3),
        participants=ParticipantFacts(dynamic=dict(counts or {})),
        egos=(ego,),
        source=source,
    )


def catalogue(all_facts: Sequence[ScenarioFacts]) -> sqlite3.Connection:
    connection = sqlite3.connect(":memory:")
    prepare(connection)
    for number, one in enumerate(all_facts, start=1):
        add_facts(connection, number, one)
    return connection


def funnel(connection: sqlite3.Connection, arguments: FindScenariosArguments) -> Funnel:
    location = location_constraints(connection, arguments.country, arguments.city)
    return Funnel(connection, constraints_of(arguments, location))


def found(connection: sqlite3.Connection, arguments: FindScenariosArguments) -> list[str]:
    ids = dict(connection.execute("SELECT number, scenario_id FROM catalog_scenarios").fetchall())
    return sorted(ids[number] for number in funnel(connection, arguments).matches)
