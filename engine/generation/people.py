"""Pedestrians at a site: how many the request needs, the footways of the site, and the walks.

A request includes them as the class ``pedestrian`` among its vehicles. Only then is a site converted with pavements and
crossings; other requests keep the bytes that they gave before.
"""

import random
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...schemas.errors import NotPossible
from ...schemas.generation import Density, VehicleDemand
from ...schemas.text import counted
from ..geometry import Points
from ..maps import Pavements
from ..network import RoadNetwork, SumoNet, WalkNet, draw_walkways, read_walk_net, yield_at_crossings
from ..traffic import GeneratedVehicle, Pedestrians, WalkedPerson, apart, plan_walks

PEOPLE: dict[Density, int] = {"low": 8, "medium": 16, "high": 30}
"""Pedestrians at a site if a request gives the class without a number (chosen): no count per km of pavement is
known.
"""
SPARE_SHARE, FEWEST_SPARE = 1.0, 4
"""More pedestrians than wanted start to walk: some collide with a vehicle or each other and are removed (chosen)."""
MARKED_WITHIN_M = 20.0
"""A crossing built at a junction is the map's if the map marks one within this distance (chosen)."""
NO_WAY = "no_way_to_walk"
"""Reason for refusing a site without footways."""


@dataclass(frozen=True)
class Footways:
    """The footways in a site's net, and notes on how many of them are on the map."""

    net: WalkNet
    notes: tuple[str, ...]


def target_pedestrians(demand: VehicleDemand, density: Density, vehicles: int) -> int:
    """Return the target number of pedestrians at a site with the given number of vehicles."""
    if demand.least is not None:
        return demand.least
    return round(demand.share * vehicles) or 1 if demand.share else PEOPLE[density]


def open_footways(net_path: Path) -> None:
    """Give pedestrians right of way at all crossings without lights of a new net, in place."""
    yield_at_crossings(net_path)


def footways_of(net_path: Path, net: SumoNet, pavements: Pavements | None) -> Footways:
    """Return the footways in a net, and a note on which of them are on the map.

    ``pavements`` is None if the map itself is a net.

    Raises:
        NotPossible: the site has no footways.
    """
    walks = read_walk_net(net_path)
    if not walks.pavements:
        raise nowhere_to_walk()
    lit = sum(crossing.lit for crossing in walks.crossings.values())
    if pavements is None:
        there = (
            f"{walks.pavement_km:.2f} km of pavements, {counted(len(walks.crossings), 'crossing')}, {lit} with lights"
        )
        return Footways(walks, (f"{there}; missing ones are guessed along roads up to 50 km/h",))
    mid_block = {f":{node}" for node in pavements.mid_block}
    in_block = sum(crossing.edge_id.partition("_")[0] in mid_block for crossing in walks.crossings.values())
    marked = _marked(walks, net, pavements.crossings) - in_block
    road_km = pavements.mapped_km + pavements.guessed_km
    guessed = f"guessed for {pavements.guessed_km:.1f} of {road_km:.1f} km of road"
    source = guessed if pavements.guessed_km else "as the map has them"
    built = counted(len(walks.crossings) - in_block, "crossing")
    between = f"; {in_block} between junctions, as the map marks them" if in_block else ""
    rule = "vehicles give way at them" + (f"; {lit} have lights" if lit else "")
    origin = f"{marked} of them from the map, the others guessed" if marked else "all guessed"
    note = f"pavements: {source}; {built} at junctions, {origin}{between}; {rule}"
    return Footways(walks, (note,))


def nowhere_to_walk() -> NotPossible:
    """Return the refusal of a site without footways."""
    return NotPossible(
        "pedestrians cannot walk at this site: its roads lack pavements and are motorways, fast or closed to them",
        next_step="leave pedestrian out of vehicles, or choose scenario_type urban or intersection, or another place",
        reason=NO_WAY,
    )


def with_walkways(network: RoadNetwork, footways: Footways) -> RoadNetwork:
    """Return a road network with lanelets for pedestrians."""
    return replace(network, walkways=draw_walkways(footways.net, network.next_id))


def _marked(footways: WalkNet, net: SumoNet, marked: Iterable[tuple[float, float]]) -> int:
    """Count the crossings of a net that are near a crossing marked on the map."""
    from pyproj import Proj

    if not net.projection or not (degrees := list(marked)):
        return 0
    x, y = Proj(net.projection)([east for _, east in degrees], [north for north, _ in degrees])
    points = np.stack([np.asarray(x), np.asarray(y)], axis=1) + np.array(net.offset_m)
    middles = [crossing.line.mean(axis=0) for crossing in footways.crossings.values()]
    return sum(bool(np.linalg.norm(points - middle, axis=1).min() < MARKED_WITHIN_M) for middle in middles)


def pedestrians_for(
    footways: Footways,
    network: RoadNetwork,
    wanted: int,
    middle: Points,
    *,
    duration_s: float,
    step_s: float,
    seed: int,
) -> Pedestrians:
    """Return the requested number of pedestrians and some spares, ready to walk; ``network`` has the walkways."""
    count = wanted + max(round(SPARE_SHARE * wanted), FEWEST_SPARE)
    choice = random.Random(seed)  # noqa: S311 - reproducible, not secret
    return Pedestrians(
        plan_walks(footways.net, count, middle, duration_s=duration_s, choice=choice), network.walkways, step_s
    )


def people_among(
    pedestrians: Pedestrians, vehicles: Sequence[GeneratedVehicle], wanted: int
) -> tuple[WalkedPerson, ...]:
    """Return up to ``wanted`` pedestrians that keep clear of all vehicles and of each other."""
    return apart(pedestrians.people(), vehicles)[:wanted]


def people_notes(people: Sequence[WalkedPerson], wanted: int) -> list[str]:
    """Describe how many pedestrians cross a road, and how many found no room."""
    crossing = sum(person.crosses for person in people)
    few = [] if len(people) == wanted else [f"{len(people)} of {counted(wanted, 'pedestrian')} found room"]
    return [*few, f"{crossing} of {counted(len(people), 'pedestrian')} use a crossing during the recording"]
