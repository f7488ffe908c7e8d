"""Which site of which map every scenario of a call is made at, and the maps that are left when one fails."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from plannerforge.engine.maps.index import MapMatch
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.generation import GenerateScenariosArguments, SiteCount
from plannerforge.tools.call import ToolCall
from plannerforge.tools.generation_plan import request_for

SITES_TIMEOUT_S = 180.0
MOST_SPARE_MAPS = 3
"""Four extracts meet at a corner; trying more would only make the caller wait for the refusal."""


@dataclass(frozen=True)
class Order:
    """One scenario: its map, the number of its site there, and how far on the sites lie that may stand in for it."""

    match: MapMatch
    site_index: int = 0
    site_step: int = 1


@dataclass(frozen=True)
class Orders:
    """One order for every scenario, and the maps without one, which may stand in for a map that fails."""

    planned: tuple[Order, ...]
    spare: tuple[MapMatch, ...]


async def plan_orders(arguments: GenerateScenariosArguments, call: ToolCall, matches: tuple[MapMatch, ...]) -> Orders:
    """Orders for as many scenarios as were asked for, or for as many as there are sites.

    Raises:
        NotPossible: no map holds a fitting site; the reason of the first one.
    """
    if arguments.count == 1:
        return Orders((Order(matches[0]),), matches[1 : 1 + MOST_SPARE_MAPS])
    counts: list[int] = []
    refusals: list[NotPossible] = []
    for match in matches:
        try:
            counts.append(await _site_count(arguments, call, match))
        except NotPossible as refusal:
            refusals.append(refusal)
            counts.append(0)
    if not any(counts):
        raise refusals[0]
    planned = share_out(matches, counts, arguments.count)
    taken = {order.match.entry.facts.map_id for order in planned}
    held = [match for match, count in zip(matches, counts, strict=True) if count]
    spare = [match for match in held if match.entry.facts.map_id not in taken]
    return Orders(planned, tuple(spare[:MOST_SPARE_MAPS]))


def share_out(matches: Sequence[MapMatch], counts: Sequence[int], wanted: int) -> tuple[Order, ...]:
    """At most ``wanted`` orders, maps in turn, no site twice; ``counts``: how many sites fit on every map.

    The step of an order is how many scenarios its map has, so that a site that stands in is never another order's.
    """
    turns = [(site_index, place) for place, count in enumerate(counts) for site_index in range(count)]
    chosen = sorted(turns)[:wanted]
    on_map = Counter(place for _, place in chosen)
    return tuple(Order(matches[place], site_index, on_map[place]) for site_index, place in chosen)


async def _site_count(arguments: GenerateScenariosArguments, call: ToolCall, match: MapMatch) -> int:
    request = request_for(arguments, match, 0, 0)
    entry_point = "plannerforge.engine.scenarios.site_choice:count_sites"
    return (await call.run(entry_point, request, SiteCount, timeout_s=SITES_TIMEOUT_S, share=(0.0, 0.0))).count
