"""Stores the rows of coverage plans in the workspace's database, row by row, so that no plan is kept in memory.

A row is planned before its scenario is generated, and contains everything that determines the scenario. An interrupted
plan can therefore continue with the waiting rows. Numbers increase in planning order.
"""

import json
import sqlite3
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

from ..workspace import Database, stored_json

RowState = Literal["held", "waiting", "made", "refused", "failed", "passed"]
"""``held``: made outside the plan. ``passed``: never made, because its site does not suit the row."""
Levels = tuple[int | None, ...]
"""The level index for each factor; None if the plan does not have the level."""
Hopeless = frozenset[tuple[str, str, int, int]]
"""Levels that sites of a map do not fit: the name of the sites, the map, the factor, the level."""
_TABLE = """
CREATE TABLE IF NOT EXISTS plan_rows (
    plan_id TEXT NOT NULL,
    number INTEGER NOT NULL,
    lap INTEGER NOT NULL,
    levels TEXT NOT NULL,
    spot TEXT NOT NULL,
    place TEXT NOT NULL,
    map_id TEXT NOT NULL,
    site_index INTEGER NOT NULL,
    seed INTEGER NOT NULL,
    state TEXT NOT NULL,
    scenario_id TEXT NOT NULL DEFAULT '',
    reused INTEGER NOT NULL DEFAULT 0,
    reason TEXT NOT NULL DEFAULT '',
    PRIMARY KEY (plan_id, number)
) WITHOUT ROWID
"""
_BY_STATE = "CREATE INDEX IF NOT EXISTS plan_rows_by_state ON plan_rows (plan_id, state, map_id, number)"
_REQUESTS = """
SELECT DISTINCT json_remove(json_extract(recipe, '$.arguments'), '$.map_content', '$.place', '$.country',
    '$.attribution', '$.index', '$.site_index', '$.site_step', '$.most_sites', '$.most_rounds') FROM artifacts
WHERE kind = 'scenario' AND json_extract(recipe, '$.tool') = 'generate_scenarios'
"""


@dataclass(frozen=True)
class PlanRow:
    """A scenario of a plan: its levels, and where it is generated.

    ``lap``: how many times everything had been covered before. ``spot``: the name of the kind of site; the row takes
    the next site of that kind. ``place``: the name of the map's place.
    """

    number: int
    lap: int
    levels: tuple[int, ...]
    spot: str
    place: str
    map_id: str
    site_index: int
    seed: int
    state: RowState = "waiting"


@dataclass(frozen=True)
class PlanCounts:
    """The numbers of rows that are waiting, made (``reused`` of them earlier), refused, or failed."""

    waiting: int = 0
    made: int = 0
    reused: int = 0
    refused: int = 0
    failed: int = 0

    def after(self, state: RowState, *, reused: bool) -> "PlanCounts":
        """Return the counts after a waiting row has been processed."""
        counts = {"made": self.made, "refused": self.refused, "failed": self.failed}
        counts[state] += 1
        return PlanCounts(waiting=self.waiting - 1, reused=self.reused + reused, **counts)


class PlanRows:
    """The rows of one plan."""

    def __init__(self, database: Database, plan_id: str) -> None:
        self._database, self._plan_id = database, plan_id

    def prepare(self, held: Iterable[Levels]) -> None:
        """Store the workspace's scenarios that are not part of the plan, replacing those stored before.

        Raises:
            ResourceFailure: the database cannot be written.
        """
        with self._database.writing() as connection:
            connection.execute(_TABLE)
            connection.execute(_BY_STATE)
            connection.execute("DELETE FROM plan_rows WHERE plan_id = ? AND state = 'held'", (self._plan_id,))
            connection.executemany(
                "INSERT INTO plan_rows (plan_id, number, lap, levels, spot, place, map_id, site_index, seed, state)"
                " VALUES (?, ?, 0, ?, '', '', '', 0, 0, 'held')",
                ((self._plan_id, -1 - index, json.dumps(levels)) for index, levels in enumerate(held)),
            )

    def add(self, rows: Iterable[PlanRow]) -> None:
        """Store all planned rows, or none of them.

        Raises:
            ResourceFailure: the database cannot be written.
        """
        with self._database.writing() as connection:
            connection.executemany(
                "INSERT INTO plan_rows (plan_id, number, lap, levels, spot, place, map_id, site_index, seed, state)"
                " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    (
                        *(self._plan_id, row.number, row.lap, json.dumps(row.levels), row.spot, row.place),
                        *(row.map_id, row.site_index, row.seed, row.state),
                    )
                    for row in rows
                ),
            )

    def end(
        self, row: PlanRow, state: RowState, *, scenario_id: str = "", reused: bool = False, reason: str = ""
    ) -> None:
        """Store the result of a row, and list its scenario as made from the plan.

        Raises:
            ResourceFailure: the database cannot be written.
        """
        with self._database.writing() as connection:
            connection.execute(
                "UPDATE plan_rows SET state = ?, scenario_id = ?, reused = ?, reason = ?"
                " WHERE plan_id = ? AND number = ?",
                (state, scenario_id, int(reused), reason, self._plan_id, row.number),
            )
            if scenario_id:
                connection.execute("INSERT OR IGNORE INTO parents VALUES (?, ?)", (scenario_id, self._plan_id))

    def waiting(self, limit: int) -> list[PlanRow]:
        """Return the next waiting rows, grouped by map and type of site, since a worker keeps what it built last."""
        query = "state = 'waiting' ORDER BY map_id, spot, number LIMIT ?"
        return [
            PlanRow(
                row["number"],
                row["lap"],
                tuple(stored_json(row["levels"], "a row of a plan")),
                row["spot"],
                row["place"],
                row["map_id"],
                row["site_index"],
                row["seed"],
            )
            for row in self._rows("*", query, limit)
        ]

    def counts(self) -> PlanCounts:
        """Return the number of rows in each state."""
        states = {
            row["state"]: row for row in self._rows("state, count(*) AS n, sum(reused) AS reused", "1 GROUP BY state")
        }

        def count(state: RowState) -> int:
            return int(states[state]["n"]) if state in states else 0

        reused = int(states["made"]["reused"]) if "made" in states else 0
        return PlanCounts(count("waiting"), count("made"), reused, count("refused"), count("failed"))

    def made(self) -> Iterator[Levels]:
        """Yield the distinct levels of everything made by the plan or before it."""
        rows = self._rows("DISTINCT levels", "state IN ('made', 'held')")
        return (tuple(stored_json(row["levels"], "a row of a plan")) for row in rows)

    def refused(self) -> Iterator[tuple[Levels, int, str]]:
        """Yield levels that were refused or failed, the number of times, and one of the reasons."""
        rows = self._rows(
            "levels, count(*) AS n, min(reason) AS reason",
            "state IN ('refused', 'failed') GROUP BY levels ORDER BY levels",
        )
        return (
            (tuple(stored_json(row["levels"], "a row of a plan")), int(row["n"]), str(row["reason"])) for row in rows
        )

    def hopeless(self, tries: int) -> Hopeless:
        """Return levels that were refused at least ``tries`` times and never made at sites of a kind on a map."""
        made: set[tuple[str, str, int, int]] = set()
        refused: Counter[tuple[str, str, int, int]] = Counter()
        for row in self._rows(
            "spot, map_id, levels, state, count(*) AS n",
            "number >= 0 AND state IN ('made', 'refused') GROUP BY spot, map_id, levels, state",
        ):
            levels = enumerate(stored_json(row["levels"], "a row of a plan"))
            keys = [(str(row["spot"]), str(row["map_id"]), factor, level) for factor, level in levels]
            if row["state"] == "made":
                made.update(keys)
            else:
                refused.update(dict.fromkeys(keys, int(row["n"])))
        return frozenset(key for key, times in refused.items() if times >= tries and key not in made)

    def next_number(self) -> int:
        """Return the number of the next planned row."""
        (row,) = self._rows("coalesce(max(number), -1) + 1 AS n", "number >= 0")
        return int(row["n"])

    def last_lap(self) -> int:
        """Return the last planned lap, or 0."""
        (row,) = self._rows("coalesce(max(lap), 0) AS lap", "number >= 0")
        return int(row["lap"])

    def refused_in_a_row(self) -> int:
        """Count the rows refused or failed since the last success, of those planned after full coverage."""
        (row,) = self._rows(
            "count(*) AS n",
            "lap > 0 AND state IN ('refused', 'failed') AND number > coalesce((SELECT max(number) FROM plan_rows"
            " WHERE plan_id = ? AND state = 'made'), -1)",
            self._plan_id,
        )
        return int(row["n"])

    def turns(self) -> dict[str, int]:
        """Return how many rows were planned for each kind of site."""
        rows = self._rows("spot, count(*) AS n", "number >= 0 GROUP BY spot")
        return {str(row["spot"]): int(row["n"]) for row in rows}

    def places(self) -> dict[str, int]:
        """Return how many scenarios were made at each place, most first."""
        rows = self._rows("place, count(*) AS n", "state = 'made' GROUP BY place ORDER BY n DESC, place")
        return {str(row["place"]): int(row["n"]) for row in rows}

    def scenario_ids(self, limit: int = -1) -> tuple[str, ...]:
        """Return the ids of the scenarios made, in planning order; all of them without a limit."""
        rows = self._rows("scenario_id", "state = 'made' ORDER BY number LIMIT ?", limit)
        return tuple(dict.fromkeys(str(row["scenario_id"]) for row in rows))

    def _rows(self, columns: str, condition: str, *values: object) -> list[sqlite3.Row]:
        connection = self._database.connection()
        if connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'plan_rows'").fetchone() is None:
            return []
        query = f"SELECT {columns} FROM plan_rows WHERE plan_id = ? AND {condition}"  # noqa: S608 - fixed words only
        return connection.execute(query, (self._plan_id, *values)).fetchall()


def made_before(connection: sqlite3.Connection) -> Iterator[dict[str, Any]]:
    """Yield the distinct requests that a workspace's scenarios were generated from, without place or seeds."""
    return (stored_json(row[0], "the recipe of a scenario") for row in connection.execute(_REQUESTS))
