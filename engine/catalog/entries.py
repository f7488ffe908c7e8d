"""Entries of the catalogue by number or by id, with what results are ordered by."""

import sqlite3
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice

_AT_ONCE = 500
_MANY = 20_000
_COLUMNS = "number, scenario_id, size, ttc_s"


@dataclass(frozen=True)
class Entry:
    """A scenario with one of its planning problems: ``size`` counts obstacles, ``ttc_s`` is None without an ego."""

    number: int
    scenario_id: str
    size: int
    ttc_s: float | None


def entries_of(connection: sqlite3.Connection, numbers: frozenset[int]) -> list[Entry]:
    """These entries in the alphabetical order of their ids."""
    if len(numbers) > _MANY:
        rows = connection.execute(f"SELECT {_COLUMNS} FROM catalog_scenarios ORDER BY scenario_id")  # noqa: S608 - fixed
        return [Entry(*row) for row in rows if row[0] in numbers]
    found = [Entry(*row) for chunk in _chunks(numbers) for row in _selected(connection, "number", chunk)]
    return sorted(found, key=lambda entry: entry.scenario_id)


def numbers_of(connection: sqlite3.Connection, scenario_ids: Iterable[str]) -> dict[str, int]:
    """Numbers by id; ids that are not in the catalogue are left out."""
    rows = (row for chunk in _chunks(scenario_ids) for row in _selected(connection, "scenario_id", chunk))
    return {row[1]: row[0] for row in rows}


def _selected(connection: sqlite3.Connection, column: str, values: list[object]) -> list[sqlite3.Row]:
    holes = ", ".join("?" * len(values))
    query = f"SELECT {_COLUMNS} FROM catalog_scenarios WHERE {column} IN ({holes})"  # noqa: S608 - fixed names, ? marks
    return connection.execute(query, values).fetchall()


def _chunks(values: Iterable[object]) -> Iterable[list[object]]:
    remaining = iter(values)
    while chunk := list(islice(remaining, _AT_ONCE)):
        yield chunk
