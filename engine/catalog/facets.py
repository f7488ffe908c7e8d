"""Count what the catalogue contains, in a table small enough for a model to read before it filters."""

import sqlite3
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from itertools import islice

from ...schemas.catalog import FacetCounts
from ...schemas.text import counted
from ...schemas.vocabulary import FEATURES, OBSTACLE_TYPES, SIGNS, TAGS
from .constraints import ARTIFICIAL, CIRCUMSTANCE, CIRCUMSTANCE_WORDS, is_place

PLACES_SHOWN, COUNTRIES_SHOWN, KEYS_SHOWN, LIMITS_SHOWN = 6, 12, 3, 3
"""The number of each that is shown if all facets are requested at once: a model reads the answer (chosen)."""


def scenario_facets(
    connection: sqlite3.Connection, wanted: str, within: frozenset[str] | None
) -> tuple[int, list[FacetCounts]]:
    """Return the number of scenarios, and the facets ``places``, ``tags``, ``features``, ``road_net``, ``obstacles``.

    Args:
        wanted: a single facet, which is then listed in full, or ``all``.
        within: ids to count in; None for all.
    """
    rows = connection.execute("SELECT number, scenario_id, country, place, lanes, speed_mps FROM catalog_scenarios")
    chosen = [row for row in rows.fetchall() if within is None or row[1] in within]
    numbers = frozenset(row[0] for row in chosen)
    whole = wanted != "all"
    makers: dict[str, Callable[[], list[FacetCounts]]] = {
        "places": lambda: _places([(row[2], row[3]) for row in chosen], whole),
        "tags": lambda: [
            *_words(connection, "tag", list(TAGS), numbers, "tags", whole),
            *_circumstances(connection, numbers),
        ],
        "features": lambda: _words(connection, "feature", list(FEATURES), numbers, "features", whole),
        "road_net": lambda: _road_net(connection, numbers, [row[4] for row in chosen], whole),
        "obstacles": lambda: _obstacles(connection, numbers, whole),
    }
    facets = [facet for name, make in makers.items() if wanted in ("all", name) for facet in make()]
    if wanted == "all":
        facets += _speeds([row[5] for row in chosen if row[5] is not None])
    return len(chosen), facets


def _places(pairs: list[tuple[str, str]], whole: bool) -> list[FacetCounts]:
    countries = _counted([country for country, _ in pairs if country != ARTIFICIAL])
    artificial = sum(country == ARTIFICIAL for country, _ in pairs)
    no_country = f"without {artificial} on artificial networks, {ARTIFICIAL}" if artificial else ""
    real = [(country, place) for country, place in pairs if is_place(country, place)]
    places = _counted([f"{country} {place}" if whole else place for country, place in real])
    shown = places if whole else _first(places, PLACES_SHOWN)
    hidden = len(places) - len(shown)
    invented = len({pair for pair in pairs if not is_place(*pair)})
    notes = [
        *(["only those of scenarios; facet=maps lists those of maps"] if whole else []),
        *([f"{hidden} more: facet=places"] if hidden else []),
        *([f"{counted(invented, 'invented name')} left out"] if invented else []),
    ]
    note = "; ".join(notes)
    return [
        FacetCounts(
            facet="countries", counts=countries if whole else _first(countries, COUNTRIES_SHOWN), note=no_country
        ),
        FacetCounts(facet="places", counts=shown, note=note),
    ]


def _words(
    connection: sqlite3.Connection, kind: str, known: list[str], numbers: frozenset[int], facet: str, whole: bool
) -> list[FacetCounts]:
    rows = connection.execute("SELECT word, number FROM catalog_words WHERE kind = ?", (kind,))
    counts = _counted([row[0] for row in rows if row[1] in numbers])
    none = [word for word in known if word not in counts]
    if whole:
        return [
            FacetCounts(
                facet=facet,
                counts={**counts, **dict.fromkeys(none, 0)},
                note="; ".join(["without a number: in no scenario", *_meanings(kind, counts)]),
            )
        ]
    plain = {word: count for word, count in counts.items() if ":" not in word}
    typed = next((word for word in counts if ":" in word), "")
    notes = [*([f"also {typed}"] if typed else []), *([f"in no scenario: {', '.join(none)}"] if none else [])]
    return [FacetCounts(facet=facet, counts=plain, note="; ".join(notes))]


def _meanings(kind: str, present: Iterable[str]) -> list[str]:
    """Return what the tags of the catalogue mean, which their authors chose; features and signs are documented."""
    means = [f"{tag}: {TAGS[tag]}" for tag in present if tag in TAGS] if kind == "tag" else []
    return [f"as each file's author chose: {', '.join(means)}"] if means else []


def _circumstances(connection: sqlite3.Connection, numbers: frozenset[int]) -> list[FacetCounts]:
    """Return counts of weather and times of day, if any scenario states them."""
    (facet,) = _words(connection, CIRCUMSTANCE, [], numbers, CIRCUMSTANCE_WORDS, whole=False)
    return [facet.model_copy(update={"note": "use them in tags"})] if facet.counts else []


def _road_net(
    connection: sqlite3.Connection, numbers: frozenset[int], lanes: list[int | None], whole: bool
) -> list[FacetCounts]:
    known = [*SIGNS, "traffic_light"]
    rows = connection.execute("SELECT kind, word, number FROM catalog_words WHERE kind IN ('sign@ego', 'sign@map')")
    present = [(row[0], row[1]) for row in rows if row[2] in numbers]
    on_ego = _counted([word for kind, word in present if kind == "sign@ego"])
    on_map = _counted([f"{word}@map" for kind, word in present if kind == "sign@map"])
    none = [word for word in known if f"{word}@map" not in on_map]
    extra = dict.fromkeys(none, 0) if whole else {}
    count = _counted([str(value) for value in lanes if value is not None])
    limits = connection.execute("SELECT kmh, number FROM catalog_limits WHERE scope = 'ego'").fetchall()
    posted = _counted([f"{row[0]:g}" for row in limits if row[1] in numbers])
    with_limit = len({row[1] for row in limits if row[1] in numbers})
    note = "on the ego's lane; @map: anywhere"
    note += "" if whole or not none else f"; {counted(len(none), 'key')} in no scenario"
    shown = {**on_ego, **on_map, **extra} if whole else _first(on_ego, KEYS_SHOWN) | _first(on_map, KEYS_SHOWN)
    limit_note = "; ".join(_about_limits(posted, with_limit, len(posted) if whole else LIMITS_SHOWN))
    posted = posted if whole else _first(posted, LIMITS_SHOWN)
    return [
        FacetCounts(facet="road_net", counts=shown, note=note),
        FacetCounts(facet="lanes", counts=dict(sorted(count.items(), key=lambda item: int(item[0])))),
        FacetCounts(facet="speed_limit", counts=posted, note=limit_note),
    ]


def _about_limits(posted: dict[str, int], scenarios: int, shown: int) -> Iterator[str]:
    """Yield notes on the counts by limit, which may add up to more than the number of scenarios with a limit."""
    yield f"km/h, on the ego's lane in {counted(scenarios, 'scenario')}"
    if sum(posted.values()) > scenarios:
        yield "some have several"
    if len(posted) > shown:
        yield f"{counted(len(posted) - shown, 'more limit')}: facet=road_net"


def _first(counts: dict[str, int], shown: int) -> dict[str, int]:
    return dict(islice(counts.items(), shown))


def _obstacles(connection: sqlite3.Connection, numbers: frozenset[int], whole: bool) -> list[FacetCounts]:
    rows = connection.execute("SELECT obstacle, number FROM catalog_counts WHERE count > 0")
    counts = _counted([row[0] for row in rows if row[1] in numbers])
    none = [kind for kind in OBSTACLE_TYPES if kind not in counts]
    if whole:
        counts |= dict.fromkeys(none, 0)
    note = "scenarios with at least one" + (
        f"; {counted(len(none), 'type')} in no scenario" if none and not whole else ""
    )
    return [FacetCounts(facet="obstacles", counts=counts, note=note)]


def _speeds(speeds: list[float]) -> list[FacetCounts]:
    if not speeds:
        return []
    note = f"at the start; highest {max(speeds):.0f} m/s"
    bands = [("<5m/s", 0, 5), ("5..10m/s", 5, 10), ("10..20m/s", 10, 20), (">=20m/s", 20, float("inf"))]
    counts = {name: sum(1 for speed in speeds if low <= speed < high) for name, low, high in bands}
    return [FacetCounts(facet="ego_speed", counts=counts, note=note)]


def _counted(words: list[str]) -> dict[str, int]:
    """Return the count of each word, most frequent first; equal counts are in alphabetical order."""
    return dict(sorted(Counter(words).items(), key=lambda item: (-item[1], item[0])))
