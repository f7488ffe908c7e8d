"""People on foot at a site: how many are wanted, the ways that the site has for them, and who walks there.

A request names them as the class ``pedestrian`` among its vehicles. Only then is a site converted with pavements and
crossings: other requests give the bytes that they gave before.
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
"""People at a site where a request names the class without a number (chosen): no count per km of pavement is known."""
SPARE_SHARE, FEWEST_SPARE = 1.0, 4
"""More people than wanted begin to walk, because some meet a vehicle or each other and are left out (chosen)."""
MARKED_WITHIN_M = 20.0
"""A crossing that is built at a junction is the map's where the map marks one so near (chosen)."""
NO_WAY = "no_way_to_walk"
"""Reason of the refusal of a site where nobody can walk."""


@dataclass(frozen=True)
class Footways:
    """The ways of a site for people: of its net, and how much of them the map has."""

    net: WalkNet
    notes: tuple[str, ...]


def people_wanted(asked: VehicleDemand, density: Density, vehicles: int) -> int:
    """How many people are aimed for at a site with so many vehicles."""
    if asked.least is not None:
        return asked.least
    return round(asked.share * vehicles) or 1 if asked.share else PEOPLE[density]


def open_footways(net_path: Path) -> None:
    """Let pedestrians go first at all crossings of a new net without lights, in place."""
    yield_at_crossings(net_path)


def footways_of(net_path: Path, net: SumoNet, pavements: Pavements | None) -> Footways:
    """The ways for people in a net, and in words which of them the map has; None: the map is a net itself.

    Raises:
        NotPossible: the site has none.
    """
    ways = read_walk_net(net_path)
    if not ways.pavements:
        raise nowhere_to_walk()
    lit = sum(crossing.lit for crossing in ways.crossings.values())
    if pavements is None:
        there = f"{ways.pavement_km:.2f} km of pavements, {counted(len(ways.crossings), 'crossing')}, {lit} with lights"
        return Footways(ways, (f"{there}; those that the network lacks are guessed along roads up to 50 km/h",))
    mid_block = {f":{node}" for node in pavements.mid_block}
    in_block = sum(crossing.edge_id.partition("_")[0] in mid_block for crossing in ways.crossings.values())
    marked = _marked(ways, net, pavements.crossings) - in_block
    road_km = pavements.mapped_km + pavements.guessed_km
    guessed = f"guessed for {pavements.guessed_km:.1f} of {road_km:.1f} km of road"
    source = guessed if pavements.guessed_km else "as the map has them"
    built = counted(len(ways.crossings) - in_block, "crossing")
    between = f"; {in_block} between junctions, as the map marks them" if in_block else ""
    rule = "vehicles give way there" + (f", at {lit} by lights" if lit else "")
    note = f"pavements: {source}; {built} at junctions, {marked} marked in the map, the others guessed{between}; {rule}"
    return Footways(ways, (note,))


def nowhere_to_walk() -> NotPossible:
    """The refusal of a site without a way for people."""
    return NotPossible(
        "nobody can walk at this site: its roads are motorways, fast or closed to pedestrians, without pavements",
        next_step="leave pedestrian out of vehicles, or choose scenario_type urban or intersection, or another place",
        reason=NO_WAY,
    )


def with_walkways(network: RoadNetwork, footways: Footways) -> RoadNetwork:
    """A road network with lanelets for people."""
    return replace(network, walkways=draw_walkways(footways.net, network.next_id))


def _marked(ways: WalkNet, net: SumoNet, marked: Iterable[tuple[float, float]]) -> int:
    """How many crossings of a net lie at one that the map marks."""
    from pyproj import Proj

    if not net.projection or not (degrees := list(marked)):
        return 0
    x, y = Proj(net.projection)([east for _, east in degrees], [north for north, _ in degrees])
    points = np.stack([np.asarray(x), np.asarray(y)], axis=1) + np.array(net.offset_m)
    middles = [crossing.line.mean(axis=0) for crossing in ways.crossings.values()]
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
    """So many people and some to spare, ready to walk; ``network`` has the walkways."""
    count = wanted + max(round(SPARE_SHARE * wanted), FEWEST_SPARE)
    choice = random.Random(seed)  # noqa: S311 - reproducible, not secret
    return Pedestrians(
        plan_walks(footways.net, count, middle, duration_s=duration_s, choice=choice), network.walkways, step_s
    )


def people_among(
    pedestrians: Pedestrians, vehicles: Sequence[GeneratedVehicle], wanted: int
) -> tuple[WalkedPerson, ...]:
    """As many people as are wanted, if so many are apart from all vehicles and each other."""
    return apart(pedestrians.people(), vehicles)[:wanted]


def people_notes(people: Sequence[WalkedPerson], wanted: int) -> list[str]:
    """How many people cross a road, and how many found no room."""
    crossing = sum(person.crosses for person in people)
    few = [] if len(people) == wanted else [f"{len(people)} of {counted(wanted, 'pedestrian')} found room"]
    return [*few, f"{crossing} of {counted(len(people), 'pedestrian')} are on a crossing during the recording"]
