"""The location of a search: country and city in any spelling, as conditions on what the catalogue holds."""

import sqlite3
from dataclasses import dataclass

from plannerforge.engine.catalog.constraints import Constraint
from plannerforge.engine.catalog.places import country_code, place_keys
from plannerforge.schemas.errors import UnknownName, closest


@dataclass(frozen=True)
class Places:
    """What the catalogue holds: countries, and places with their countries, alphabetically."""

    countries: tuple[str, ...]
    places: tuple[tuple[str, str], ...]


def known_places(connection: sqlite3.Connection, among: frozenset[int] | None = None) -> Places:
    """All countries and places of the catalogue, or of these entries."""
    if among is None:
        rows = connection.execute("SELECT DISTINCT place, country FROM catalog_scenarios").fetchall()
    else:
        every = connection.execute("SELECT place, country, number FROM catalog_scenarios")
        rows = [row[:2] for row in every if row[2] in among]
    places = tuple(sorted({(str(row[0]), str(row[1])) for row in rows}))
    return Places(tuple(sorted({country for _, country in places})), places)


def location_constraints(connection: sqlite3.Connection, country: str | None, city: str | None) -> list[Constraint]:
    """Conditions for the country and the city; neither has to be in the catalogue.

    Raises:
        UnknownName: the country is neither an ISO alpha-3 code nor a known name.
    """
    found = []
    if country is not None:
        code = country_code(country)
        if code is None:
            raise UnknownName(
                f"'{country}' is no country",
                valid=closest(country, known_places(connection).countries),
                next_step="give the ISO 3166-1 alpha-3 code, ZAM for artificial networks",
            )
        query = "SELECT number FROM catalog_scenarios WHERE country = ?"
        found.append(Constraint("location", f"country {code}", query, (code,)))
    if city is not None:
        keys = tuple(sorted(place_keys(city)))
        holes = ", ".join("?" * len(keys))
        query = f"SELECT DISTINCT number FROM catalog_words WHERE kind = 'place' AND word IN ({holes})"  # noqa: S608 - only ? marks
        found.append(Constraint("location", f"city {city.strip()}", query, keys))
    return found
