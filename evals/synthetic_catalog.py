"""A large catalogue of metadata made from real facts: places, counts, tags and speeds are mixed anew, seeded."""

import random
import sqlite3
from collections.abc import Sequence
from pathlib import Path

from plannerforge.engine.catalog.tables import add_facts, prepare
from plannerforge.schemas.scenarios import ParticipantFacts, ScenarioFacts


def make_catalog(path: Path, real: Sequence[ScenarioFacts], count: int) -> sqlite3.Connection:
    """A database with so many entries; every layer of an entry comes from another real scenario."""
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("PRAGMA journal_mode = WAL")
    prepare(connection)
    chance = random.Random(count)  # noqa: S311 - a reproducible choice, no secret
    connection.execute("BEGIN")
    for number in range(1, count + 1):
        add_facts(connection, number, _mixed(real, chance, number))
    connection.execute("COMMIT")
    return connection


def _mixed(real: Sequence[ScenarioFacts], chance: random.Random, number: int) -> ScenarioFacts:
    place, tags, roads, ego = (chance.choice(real) for _ in range(4))
    counts = {
        kind: max(1, count + chance.randint(-2, 4)) for kind, count in chance.choice(real).participants.counts.items()
    }
    egos = tuple(
        one.model_copy(update={"speed_mps": max(0.0, one.speed_mps + chance.gauss(0.0, 2.0))}) for one in ego.egos
    )
    return roads.model_copy(
        update={
            "scenario_id": f"{place.location.country}_{place.location.place}-{number}_1_T-1",
            "location": place.location,
            "tags": tags.tags,
            "participants": ParticipantFacts(dynamic=counts),
            "egos": egos,
        }
    )
