"""What a site is about, as areas that a car's way should pass: the ring, the junction, or link and main road."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.maps.sites import Site
from plannerforge.engine.network.net_parser import SumoNet
from plannerforge.engine.network.road_network import RoadLanelet, RoadNetwork
from plannerforge.engine.scenarios.realised_site import (
    FAST_ROADS,
    RAMP_LINKS,
    is_lit,
    is_ring_at,
    junctions_near,
    middle_of,
    road_classes,
)
from plannerforge.engine.traffic.motions import Participant
from plannerforge.schemas.generation import SiteType

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

HEARTS: dict[SiteType, str] = {
    "roundabout": "the ring",
    "signalised_intersection": "the junction",
    "intersection": "the junction",
    "urban": "the junction",
    "ramp": "the ramp",
}
"""What a site of a type is about, in words; those that are not named are about a whole road."""

REACH_M = 200.0
"""So far from a site's middle its parts reach: links and main roads go on beyond, to other ramps."""


class SiteHeart:
    """Tells how much of what its site is about a car's way passes."""

    def __init__(self, site: Site, net: SumoNet, network: RoadNetwork) -> None:
        middle = middle_of(site, net)
        self._name = HEARTS.get(site.kind, "")
        self._areas = [_area(network, belongs, middle) for belongs in _parts(site, net, middle)]

    @property
    def parts(self) -> int:
        """The most parts that a way can pass: two at a ramp, otherwise one."""
        return max(len(self._areas), 1)

    def parts_passed(self, car: Participant, last_step: int) -> int:
        """How many parts the car's centre is on by the step, none without the first; 1 where a road is the site."""
        from shapely import contains_xy

        if not self._areas:
            return 1
        x, y = car.motion.positions[: last_step + 1].T
        passed = [bool(contains_xy(area, x, y).any()) for area in self._areas]
        return sum(passed) if passed[0] else 0

    def missed(self, *, only_car: bool) -> str:
        """What the answer says of an ego that passes nothing of it; ``only_car``: no other could be chosen."""
        who = "the ego's way to its goal does not pass" if only_car else "no car's way to such a goal passes"
        return f"{who} {self._name} that the site is about; a goal farther ahead or another seed may change it"


def _parts(site: Site, net: SumoNet, middle: Points) -> list[Callable[[RoadLanelet], bool]]:
    """The parts of the heart, the foremost first: whether a lanelet belongs to each."""
    if site.kind == "roundabout":
        edges = {edge for ring in net.roundabout_edges if is_ring_at(net, middle, ring) for edge in ring}
        return [lambda lanelet: lanelet.edge_id in edges]
    if site.kind in ("signalised_intersection", "intersection", "urban"):
        lit = site.kind == "signalised_intersection"
        junctions = {key for key in junctions_near(net, middle) if is_lit(net, key) or not lit}
        return [lambda lanelet: lanelet.internal and _junction(lanelet) in junctions] if junctions else []
    if site.kind == "ramp":
        return [_road(net, RAMP_LINKS), _road(net, FAST_ROADS)]
    return []


def _junction(lanelet: RoadLanelet) -> str:
    """The junction that an internal lanelet lies in: SUMO names its edges ``:junction_index``."""
    return lanelet.edge_id.removeprefix(":").rpartition("_")[0]


def _road(net: SumoNet, classes: frozenset[str]) -> Callable[[RoadLanelet], bool]:
    return lambda lanelet: not lanelet.internal and bool(road_classes(net.edges[lanelet.edge_id]) & classes)


def _area(network: RoadNetwork, belongs: Callable[[RoadLanelet], bool], middle: Points) -> "BaseGeometry":
    from shapely import Point, Polygon, make_valid, prepare, union_all

    parts = [make_valid(Polygon(one.polygon)) for one in network.lanelets.values() if belongs(one)]
    area = union_all(parts).intersection(Point(*middle).buffer(REACH_M))
    prepare(area)
    return area
