"""The order in which vehicles are numbered: by their way through the middle of the site."""

import numpy as np

from plannerforge.engine.maps.sites import RURAL_CLASSES, Site
from plannerforge.engine.network.lanelet_lookup import LaneletLookup
from plannerforge.engine.network.net_parser import SumoNet
from plannerforge.engine.network.road_network import RoadNetwork
from plannerforge.engine.scenarios.realised_site import middle_of, road_classes
from plannerforge.engine.traffic.motions import Participant
from plannerforge.schemas.generation import SiteType

SHORTEST_WAY_M = 15.0
WATCHED_STEPS = 80
ROADS_OF: dict[SiteType, frozenset[str]] = {
    "highway": frozenset({"motorway", "trunk"}),
    "ramp": frozenset({"motorway", "trunk", "motorway_link", "trunk_link", "primary_link", "secondary_link"}),
    "rural": RURAL_CLASSES,
}
"""OSM classes of the roads that a site of this type is about; sites at junctions are about all."""
LINK_CLASSES = frozenset({"motorway_link", "trunk_link"})
LOOKED_AT_EVERY = 10


def along_the_site(
    everyone: tuple[Participant, ...], site: Site, net: SumoNet, network: RoadNetwork
) -> tuple[Participant, ...]:
    """Vehicles ordered so that those come first that drive, on the roads in question, through the middle of the site.

    "The first car" is therefore one to which the site matters, not one that waits at the edge of the map.
    """
    middle = middle_of(site, net)
    lookup = LaneletLookup(network)

    def rank(vehicle: Participant) -> tuple[bool, bool, bool, float, str]:
        positions = vehicle.motion.positions
        distance = np.linalg.norm(positions[:WATCHED_STEPS] - middle, axis=1)
        stands = bool(np.linalg.norm(positions[-1] - positions[0]) < SHORTEST_WAY_M)
        nears = float(distance[0]) > float(distance.min()) + 5.0
        nearest = round(float(distance.min()) + (0.0 if nears else 100.0), 3)
        away = not _on_road(vehicle, site, net, lookup)
        return away, not _takes_ramp(vehicle, site, net, lookup), stands, nearest, vehicle.vehicle_id

    return tuple(sorted(everyone, key=rank))


def _on_road(vehicle: Participant, site: Site, net: SumoNet, lookup: LaneletLookup) -> bool:
    """Whether a vehicle begins on one of the roads that the site is about."""
    wanted = ROADS_OF.get(site.kind)
    if wanted is None:
        return True
    classes = _classes_under(vehicle, 0, net, lookup)
    return classes is not None and (not classes or bool(classes & wanted))


def _takes_ramp(vehicle: Participant, site: Site, net: SumoNet, lookup: LaneletLookup) -> bool:
    """Whether a vehicle leaves or joins the main road over a link soon: what a ramp is for. True at other sites."""
    if site.kind != "ramp":
        return True
    steps = range(0, min(len(vehicle.motion.positions), WATCHED_STEPS), LOOKED_AT_EVERY)
    passed = [classes for step in steps if (classes := _classes_under(vehicle, step, net, lookup))]
    on_link = [bool(classes & LINK_CLASSES) for classes in passed]
    return any(on_link) and not all(on_link)


def _classes_under(vehicle: Participant, step: int, net: SumoNet, lookup: LaneletLookup) -> frozenset[str] | None:
    """OSM classes of the road under a vehicle; empty inside a junction, None beside all roads."""
    lanelet = lookup.under(vehicle.motion.positions[step], float(vehicle.motion.headings_rad[step]))
    if lanelet is None:
        return None
    return frozenset() if lanelet.internal else road_classes(net.edges[lanelet.edge_id])
