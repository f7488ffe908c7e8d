"""Choosing few matches that cover the feature space, and saying what they cover.

An entry covers values of several dimensions: features, obstacle types, lanes, bands of speed, traffic and time to
collision. The greedy choice takes whoever covers most that is not yet covered; it reaches at least 1 − 1/e of the best
cover (Nemhauser, Wolsey and Fisher 1978). When all is covered, it begins anew with the rest.
"""

import sqlite3
from collections.abc import Mapping, Sequence

from plannerforge.engine.catalog.entries import Entry
from plannerforge.schemas.catalog import Coverage

_BANDS: dict[str, tuple[float, ...]] = {
    "ego_speed_mps": (0.5, 5, 10, 15, 25),
    "obstacles_total": (1, 6, 20, 50),
    "ttc_s": (1, 3, 6, 1e8),
    "density_per_km": (2, 5, 10, 20),
}
_COLUMNS = {"ego_speed_mps": "speed_mps", "obstacles_total": "size"}
MOST_CONSIDERED = 5000

Values = frozenset[tuple[str, str]]
"""What an entry covers: pairs of dimension and value."""


def covered_values(connection: sqlite3.Connection, entries: Sequence[Entry]) -> dict[str, Values]:
    """What every entry covers, by id."""
    chosen = {entry.number: entry.scenario_id for entry in entries}
    found: dict[str, set[tuple[str, str]]] = {entry.scenario_id: set() for entry in entries}

    def add(query: str, dimension: str) -> None:
        for number, value in connection.execute(query):
            if number in chosen and value is not None:
                found[chosen[number]].add((dimension, str(value)))

    add("SELECT number, word FROM catalog_words WHERE kind = 'feature'", "features")
    add("SELECT number, obstacle FROM catalog_counts WHERE count > 0", "obstacles")
    add("SELECT number, lanes FROM catalog_scenarios", "lanes")
    add("SELECT number, country FROM catalog_scenarios", "countries")
    for dimension, edges in _BANDS.items():
        column = _COLUMNS.get(dimension, dimension)
        for number, value in connection.execute(f"SELECT number, {column} FROM catalog_scenarios"):  # noqa: S608 - fixed
            if number in chosen and value is not None:
                found[chosen[number]].add((dimension, _band(value, edges)))
    return {key: frozenset(values) for key, values in found.items()}


def most_diverse(values: Mapping[str, Values], wanted: int) -> list[str]:
    """The ids of the greedy choice in its order; ties go to whoever stands earlier in ``values``."""
    remaining, chosen = list(values), list[str]()
    covered: set[tuple[str, str]] = set()
    while remaining and len(chosen) < wanted:
        best = max(remaining, key=lambda key: len(values[key] - covered))
        if covered and not values[best] - covered:
            covered = set()
            continue
        chosen.append(best)
        remaining.remove(best)
        covered |= values[best]
        if not values[best]:
            chosen += remaining[: wanted - len(chosen)]
            break
    return chosen


def coverage(values: Mapping[str, Values], chosen: Sequence[str]) -> tuple[Coverage, ...]:
    """What the chosen ones cover of all that occurs among the matches, dimension by dimension."""
    there = frozenset().union(*values.values())
    taken = frozenset().union(*(values[key] for key in chosen))
    dimensions = sorted({dimension for dimension, _ in there})
    return tuple(
        Coverage(
            dimension=dimension,
            covered=tuple(sorted(value for name, value in taken if name == dimension)),
            missed=tuple(sorted(value for name, value in there - taken if name == dimension)),
        )
        for dimension in dimensions
    )


def _band(value: float, edges: Sequence[float]) -> str:
    for low, high in zip((None, *edges), (*edges, None), strict=True):
        if high is None:
            return f">={low:g}" if low != 1e8 else "never"
        if value < high:
            return f"<{high:g}" if low is None else f">={low:g}" if high == 1e8 else f"{low:g}..{high:g}"
    return ""
