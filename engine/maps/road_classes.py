"""OSM's road classes (``highway`` values) and their groups, which follow the paper's generation intent."""

from collections.abc import Iterable

from ...schemas.errors import UnknownName, closest

STREETS = ("motorway", "trunk", "primary", "secondary", "tertiary", "residential", "unclassified", "living_street")
ROADS = (*STREETS, "service", "track")
LINKS = ("motorway_link", "trunk_link", "primary_link", "secondary_link", "tertiary_link")
THROUGH_ROADS = frozenset((*STREETS, *LINKS))
ALL_ROADS = frozenset((*ROADS, *LINKS))
FAST_ROADS = frozenset({"motorway", "trunk"})
RAMP_LINKS = frozenset({"motorway_link", "trunk_link"})
RURAL_CLASSES = frozenset({"trunk", "primary", "secondary", "tertiary", "unclassified"})
GROUPS = {"roads": ROADS, "link": LINKS, "all": (*ROADS, *LINKS)}


def resolve_road_classes(words: Iterable[str]) -> tuple[str, ...]:
    """Return the ``highway`` values that groups (roads, link, all) and single values refer to, each once.

    Raises:
        UnknownName: a word is neither a group nor a value.
    """
    values: dict[str, None] = {}
    for word in words:
        known = GROUPS.get(word) or ((word,) if word in GROUPS["all"] else None)
        if known is None:
            near = closest(word, [*GROUPS["all"], *GROUPS], len(GROUPS["all"]))
            named = [*near, *GROUPS, *GROUPS["all"]]
            raise UnknownName(f"there is no road class {word!r}", valid=dict.fromkeys(named), complete=True)
        values.update(dict.fromkeys(known))
    return tuple(values)
