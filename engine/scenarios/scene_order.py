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


def along_the_site(
    everyone: tuple[Participant, ...], site: Site, net: SumoNet, network: RoadNetwork
) -> tuple[Participant, ...]:
    """Vehicles ordered so that those come first that drive, on the roads in question, through the middle of the site.

    "The first car" is therefore one to which the site matters, not one that waits at the edge of the map.
    """
    middle = middle_of(site, net)
    lookup = LaneletLookup(network)

    def rank(vehicle: Participant) -> tuple[bool, bool, float, str]:
        positions = vehicle.motion.positions
        distance = np.linalg.norm(positions[:WATCHED_STEPS] - middle, axis=1)
        stands = bool(np.linalg.norm(positions[-1] - positions[0]) < SHORTEST_WAY_M)
        nears = float(distance[0]) > float(distance.min()) + 5.0
        nearest = round(float(distance.min()) + (0.0 if nears else 100.0), 3)
        return not _on_road(vehicle, site, net, lookup), stands, nearest, vehicle.vehicle_id

    return tuple(sorted(everyone, key=rank))


def _on_road(vehicle: Participant, site: Site, net: SumoNet, lookup: LaneletLookup) -> bool:
    """Whether a vehicle begins on one of the roads that the site is about."""
    wanted = ROADS_OF.get(site.kind)
    if wanted is None:
        return True
    lanelet = lookup.under(vehicle.motion.positions[0], float(vehicle.motion.headings_rad[0]))
    if lanelet is None:
        return False
    return lanelet.internal or bool(road_classes(net.edges[lanelet.edge_id]) & wanted)
