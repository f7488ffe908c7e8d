"""From the arguments of generate_scenarios to the requests for the engine: maps, sites, classes, numbers of vehicles.

Each scenario of a call is assigned a site of a map; maps without one may stand in for a map that fails.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from ...engine.maps import Closeness, MapEntry, MapMatch, country_code, find_maps, resolve_road_classes
from ...engine.vehicles import PEDESTRIAN, vehicle_classes
from ...schemas.errors import InvalidRequest, NotPossible, Remedy, UnknownName, closest, misspelt, with_values
from ...schemas.generation import (
    NATURAL_SHARES,
    GenerateScenariosArguments,
    GenerationRequest,
    ScenarioType,
    VehicleDemand,
)
from ...schemas.grammar import parse_condition
from ...schemas.maps import Box
from ...schemas.text import cited, cited_all
from ...schemas.vocabulary import vehicle_class_of
from ..context import WorkflowContext
from ..operations import COUNT_SITES
from .conditions import read_conditions, with_natural_mix

MOST_VEHICLES = 300
"""A site of a few hundred metres holds fewer; more would only make the caller wait for the refusal."""
MOST_PEOPLE = 100
"""Pedestrians at a site (chosen): the pavements near a junction hold hardly more."""
_SHOWN_PLACES = 4
"""Places that a note or refusal names; chosen to keep it short."""
_MOST_SPARE_MAPS = 3
"""Four extracts meet at a corner; trying more would only make the caller wait for the refusal."""


@dataclass(frozen=True)
class GenerationPlan:
    """The maps that hold what was asked, in the order in which they are used, and notes for the answer."""

    matches: tuple[MapMatch, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class AssignedSite:
    """Where a scenario is made: the map, and the number of the site on it.

    Where the site fails, the one ``site_step`` further on is tried: the number of scenarios that the call makes on this
    map, so that no site is another scenario's.
    """

    match: MapMatch
    site_index: int = 0
    site_step: int = 1


@dataclass(frozen=True)
class SiteAssignment:
    """A site for every scenario, and the maps without one, which may stand in for a map that fails."""

    planned: tuple[AssignedSite, ...]
    spare: tuple[MapMatch, ...]


def plan_maps(
    arguments: GenerateScenariosArguments, maps: Sequence[MapEntry], closeness: Closeness = Closeness.PART
) -> GenerationPlan:
    """The maps for a call; those that lack the asked type are left out unless none holds it.

    The seed rotates them, so that another seed is another map where several fit.

    Raises:
        UnknownName: no map shows the place, country or box.
        NotPossible: several do, but none holds the asked type.
        InvalidRequest: a box that is none.
    """
    return plan_matches(
        arguments,
        find_maps(
            maps,
            place=arguments.place,
            country=arguments.country,
            bbox=box_of(arguments.bbox),
            scenario_type=arguments.scenario_type,
            closeness=closeness,
        ),
    )


def plan_matches(arguments: GenerateScenariosArguments, matches: Sequence[MapMatch]) -> GenerationPlan:
    """The same for maps that are known to show what was asked for.

    Raises:
        NotPossible: of several maps none holds the asked type.
        InvalidRequest: a box that is none.
    """
    holding = [m for m in matches if arguments.scenario_type in ("any", *m.entry.facts.sites)]
    if not holding and len(matches) > 1:
        raise _held_nowhere(arguments.scenario_type, matches)
    holding = holding or list(matches)
    turn = arguments.seed % len(holding)
    unnamed = sorted({word for match in holding for word in match.unnamed})
    notes = [f"the map does not name {word!r}; its street was found" for word in unnamed]
    notes += [taken for text in arguments.vehicles if (taken := _in_our_words(text)[1])]
    notes += list(dict.fromkeys(text for match in holding for text in match.understood))[:_SHOWN_PLACES]
    if (box := box_of(arguments.bbox)) is not None:
        notes += _beyond_the_maps(box, holding)
    return GenerationPlan((*holding[turn:], *holding[:turn]), tuple(notes))


def _held_nowhere(scenario_type: ScenarioType, matches: Sequence[MapMatch]) -> NotPossible:
    facts = [match.entry.facts for match in matches]
    names = [f"{cited(f.place)} ({f.map_id})" for f in facts[:_SHOWN_PLACES]]
    more = f" nor any of {len(facts) - _SHOWN_PLACES} more" * (len(facts) > _SHOWN_PLACES)
    return NotPossible(
        f"none of {len(facts)} maps holds any {scenario_type} site: not {', '.join(names)}{more}",
        valid=sorted({kind for f in facts for kind in f.sites}),
        next_step="choose one of these scenario types, or another place",
        reason="no_such_site",
    )


def _beyond_the_maps(box: Box, matches: Sequence[MapMatch]) -> list[str]:
    """A note for a box that no map shows whole, such as that of a country: what of it was looked at."""
    shown = [match.entry.facts for match in matches]
    south, west, north, east = box
    if any(f.south <= south and f.west <= west and north <= f.north and east <= f.east for f in shown):
        return []
    places = list(dict.fromkeys(facts.place for facts in shown))
    named = cited_all(places[:_SHOWN_PLACES]) + (
        f" and {len(places) - _SHOWN_PLACES} more" * (len(places) > _SHOWN_PLACES)
    )
    return [f"no map shows the whole bbox; sites were looked for where the maps lie in it: {named}"]


async def assign_sites(
    arguments: GenerateScenariosArguments, context: WorkflowContext, matches: tuple[MapMatch, ...]
) -> SiteAssignment:
    """Sites for as many scenarios as were asked for, or as many as there are.

    Raises:
        NotPossible: no map holds a fitting site; the reason of the first one.
    """
    if arguments.count == 1:
        return SiteAssignment((AssignedSite(matches[0]),), matches[1 : 1 + _MOST_SPARE_MAPS])
    counts: list[int] = []
    refusals: list[NotPossible] = []
    for match in matches:
        try:
            request = request_for(arguments, AssignedSite(match), 0)
            counts.append((await context.run(COUNT_SITES, request, share=(0.0, 0.0))).count)
        except NotPossible as refusal:
            refusals.append(refusal)
            counts.append(0)
    if not any(counts):
        raise refusals[0]
    planned = share_sites(matches, counts, arguments.count)
    taken = {site.match.entry.facts.map_id for site in planned}
    held = [match for match, count in zip(matches, counts, strict=True) if count]
    spare = [match for match in held if match.entry.facts.map_id not in taken]
    return SiteAssignment(planned, tuple(spare[:_MOST_SPARE_MAPS]))


def share_sites(matches: Sequence[MapMatch], counts: Sequence[int], wanted: int) -> tuple[AssignedSite, ...]:
    """At most ``wanted`` sites, maps in turn, none twice; ``counts``: how many sites fit on every map."""
    turns = [(site_index, place) for place, count in enumerate(counts) for site_index in range(count)]
    chosen = sorted(turns)[:wanted]
    on_map = Counter(place for _, place in chosen)
    return tuple(AssignedSite(matches[place], site_index, on_map[place]) for site_index, place in chosen)


def nth_site(counts: Sequence[int], turn: int) -> tuple[int, int, int]:
    """The map and the site number ``turn`` where maps take turns, and how often all sites were taken before.

    ``counts``: how many sites each map holds. All first sites come before all second ones, as in :func:`share_sites`.
    """
    lap, left = divmod(turn, sum(counts))
    done = 0
    while True:
        holding = [place for place, count in enumerate(counts) if count > done]
        more = min(counts[place] for place in holding) - done
        if left < more * len(holding):
            return holding[left % len(holding)], done + left // len(holding), lap
        left -= more * len(holding)
        done += more


def request_for(arguments: GenerateScenariosArguments, site: AssignedSite, index: int) -> GenerationRequest:
    """What the engine is asked for the scenario number ``index`` of a call.

    Raises:
        UnknownName: no such road class or condition.
        InvalidRequest: numbers of vehicles or conditions that cannot be meant.
    """
    facts, read = site.match.entry.facts, read_conditions(arguments)
    conditions = read.conditions
    return GenerationRequest(
        map_path=str(site.match.entry.path),
        map_id=facts.map_id,
        place=facts.place,
        country=facts.country or _code_of(arguments.country),
        attribution=facts.attribution,
        scenario_type=arguments.scenario_type,
        streets=site.match.streets,
        bbox=_meant_box(arguments, site.match),
        road_classes=() if arguments.road_classes is None else resolve_road_classes(arguments.road_classes),
        density=arguments.density,
        vehicles=with_natural_mix(demands_of(arguments, read.others), conditions),
        duration_s=arguments.duration_s,
        ego=ego_of(arguments),
        goal=arguments.goal,
        seed=arguments.seed,
        index=index,
        site_index=site.site_index,
        site_step=site.site_step,
        conditions=conditions,
        others=read.others,
        folder="",
    )


def _meant_box(arguments: GenerateScenariosArguments, match: MapMatch) -> Box | None:
    """Where sites are looked for: the asked box, the asked part of the map, or what both have in common."""
    asked, meant = box_of(arguments.bbox), match.box
    if asked is None or meant is None:
        return asked or meant
    south, west, north, east = zip(asked, meant, strict=True)
    return max(south), max(west), min(north), min(east)


def _code_of(country: str | None) -> str | None:
    """The country's code, however the caller spelled it."""
    return None if country is None else country_code(country) or country.upper()


def check_demands(arguments: GenerateScenariosArguments) -> None:
    """Look at what can be wrong with a call whatever the map is.

    Raises:
        UnknownName: a vehicle class or road class that there is not.
        InvalidRequest: numbers of vehicles that cannot be meant.
    """
    demands_of(arguments, read_conditions(arguments).others)
    if arguments.road_classes is not None:
        resolve_road_classes(arguments.road_classes)


def _check_classes(demands: Sequence[VehicleDemand], arguments: GenerateScenariosArguments) -> None:
    known = list(dict.fromkeys([*vehicle_classes(), PEDESTRIAN.name]))
    for name in (demand.vehicle_class for demand in demands):
        if name not in known:
            near = closest(name, known)
            raise UnknownName(
                f"there is no vehicle class {name!r}",
                valid=near,
                reason="unknown_class",
                remedies=[*misspelt(name, near), *_without_class(name, arguments)],
            )


def _without_class(name: str, arguments: GenerateScenariosArguments) -> list[Remedy]:
    """Return the call without the vehicles of a class; no remedy if ``vehicles`` does not name it."""
    others = [text for text in arguments.vehicles if not re.search(rf"\b{re.escape(name)}\b", text)]
    return [] if len(others) == len(arguments.vehicles) else [with_values(vehicles=others or None)]


def demands_of(arguments: GenerateScenariosArguments, others: str) -> tuple[VehicleDemand, ...]:
    """Return the vehicles that a call asks for, with the classes of its ego and of whoever makes a manoeuvre.

    Args:
        arguments: the call.
        others: the manoeuvre of another road user, such as ``cut_in:truck``; empty if none is asked for.

    Raises:
        UnknownName: a vehicle class that does not exist.
        InvalidRequest: numbers of vehicles that cannot be meant.
    """
    demands = _with_the_actor_s_class(_vehicle_demands(arguments.vehicles), others)
    demands = _with_the_ego_s_class(demands, ego_of(arguments))
    _check_classes(demands, arguments)
    return demands


def _vehicle_demands(texts: list[str]) -> tuple[VehicleDemand, ...]:
    demands = tuple(_vehicle_demand(text) for text in texts)
    asked = sum(demand.needed for demand in demands)
    on_foot = sum(demand.needed for demand in demands if demand.vehicle_class == PEDESTRIAN.name)
    if on_foot > MOST_PEOPLE:
        raise InvalidRequest(f"vehicles ask for {on_foot:,} pedestrians at one site", valid=[f"at most {MOST_PEOPLE}"])
    if asked > MOST_VEHICLES:
        raise InvalidRequest(
            f"vehicles ask for {asked:,} vehicles on one site",
            valid=[f"at most {MOST_VEHICLES} in all classes together"],
        )
    shared = sum(demand.share or 0.0 for demand in demands)
    if shared > 1:
        raise InvalidRequest(
            f"vehicles {texts} share out {shared:.0%} of the traffic",
            valid=["shares of at most 100% in all; cars are the rest"],
            next_step="lower the shares, or give numbers, such as taxi=3",
        )
    often = sorted(name for name, times in Counter(d.vehicle_class for d in demands).items() if times > 1)
    if often:
        raise InvalidRequest(
            f"vehicles {texts} name {' and '.join(often)} more than once",
            valid=["truck", "truck=2", "car=4..4", "bicycle=0"],
            next_step="name every class once, with the number of all its vehicles",
        )
    return demands


def _vehicle_demand(text: str) -> VehicleDemand:
    """``truck``: its share of traffic; ``truck=2``: a least number; ``car=4..4``: bounds on both sides; ``bicycle=0``:
    none at all; ``taxi=30%``: a share of all vehicles.
    """
    text, _ = _in_our_words(text)
    if (shared := re.fullmatch(r"\s*([a-z_]+)\s*=\s*(\d{1,3}(?:\.\d+)?)\s*%\s*", text)) is not None:
        return _shared_demand(text, shared[1], float(shared[2]) / 100)
    demand = parse_condition(text, whole=True)
    low, high = demand.interval.low, demand.interval.high
    if demand.negated:
        return VehicleDemand(vehicle_class=demand.name, least=0, most=0)
    if text.strip() == demand.name:
        return _bare_demand(demand.name)
    least = 0 if low is None else round(low)
    at_least = demand.interval.exact and least > 0
    most = None if high is None or at_least else round(high)
    if demand.value is not None or demand.scope is not None or least < 0 or (most is not None and most < least):
        raise InvalidRequest(f"vehicles {text!r} cannot be meant", valid=["truck", "truck=2", "car=4..4", "bicycle=0"])
    return VehicleDemand(vehicle_class=demand.name, least=least, most=most)


def _bare_demand(name: str) -> VehicleDemand:
    """A class without a number: as many as its natural share of traffic comes to; cars fill up the traffic anyway."""
    return VehicleDemand(vehicle_class=name, share=None if name == "car" else NATURAL_SHARES.get(name, 0.0))


def _shared_demand(text: str, name: str, share: float) -> VehicleDemand:
    if name == "car" or share > 1:
        raise InvalidRequest(
            f"vehicles {text!r} cannot be meant",
            valid=["taxi=30%: at most 100%, of any class but car; cars are the rest"],
        )
    return VehicleDemand(vehicle_class=name, share=share)


def ego_of(arguments: GenerateScenariosArguments) -> str:
    """Return the requested ego with our word for its class: ``type:lorry`` and ``lorry`` become ``type:truck``."""
    word = arguments.ego.strip().removeprefix("type:")
    known = vehicle_class_of(word)
    return arguments.ego if known is None else f"type:{known}"


def _with_the_ego_s_class(demands: tuple[VehicleDemand, ...], ego: str) -> tuple[VehicleDemand, ...]:
    """Return the demands with the class that was asked for as ego, if that is no car: it is among the others too."""
    name = ego.removeprefix("type:")
    if name in (ego, "car") or any(demand.vehicle_class == name for demand in demands):
        return demands
    return *demands, _bare_demand(name)


def _with_the_actor_s_class(demands: tuple[VehicleDemand, ...], others: str) -> tuple[VehicleDemand, ...]:
    """Return the demands with the class that has to make a manoeuvre, if it is named and they do not name it.

    Raises:
        InvalidRequest: vehicles exclude the class.
    """
    name = others.partition(":")[2]
    asked = next((demand for demand in demands if demand.vehicle_class == name), None)
    if asked is not None and asked.most == 0:
        raise InvalidRequest(
            f"others={others} needs a {name}, but vehicles excludes it", next_step=f"leave {name}=0 out of vehicles"
        )
    return demands if name in ("", "car") or asked is not None else (*demands, _bare_demand(name))


def _in_our_words(text: str) -> tuple[str, str]:
    """A demand with the class that its word means, and what was taken for what; empty where nothing was."""
    found = re.fullmatch(r"(\s*!?\s*)([^\W\d][^<>=!]*?)(\s*(?:[<>=].*)?)", text, re.DOTALL)
    name = None if found is None else vehicle_class_of(found[2])
    if found is None or name is None or name == found[2]:
        return text, ""
    return f"{found[1]}{name}{found[3]}", f"{found[2].strip()!r} is taken as {name}"


def box_of(bbox: list[float] | None) -> Box | None:
    """The box of the arguments, checked.

    Raises:
        InvalidRequest: it is none.
    """
    if bbox is None:
        return None
    if len(bbox) != 4:
        raise InvalidRequest(f"bbox has {len(bbox)} numbers", valid=["[south, west, north, east] in degrees"])
    south, west, north, east = bbox
    if not (-90 <= south < north <= 90 and -180 <= west < east <= 180):
        ordered = [min(south, north), min(west, east), max(south, north), max(west, east)]
        raise InvalidRequest(
            f"bbox {bbox} is no box",
            valid=["[south, west, north, east] in degrees, south < north"],
            remedies=[with_values(bbox=ordered)],
        )
    return south, west, north, east
