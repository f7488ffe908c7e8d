"""The order in which vehicles are numbered: by their way through the middle of the site."""

import numpy as np

from plannerforge.engine.maps.sites import Site
from plannerforge.engine.network.net_parser import SumoNet
from plannerforge.engine.traffic.motions import Participant

SHORTEST_WAY_M = 15.0


def along_the_site(everyone: tuple[Participant, ...], site: Site, net: SumoNet) -> tuple[Participant, ...]:
    """Vehicles ordered so that those come first that drive, and pass close by the middle of the site.

    "The first car" is therefore one to which the site matters, not one that waits at the edge of the map.
    """
    from pyproj import Proj

    if not net.projection:
        return everyone
    x, y = Proj(net.projection)(site.longitude, site.latitude)
    middle = np.array([x + net.offset_m[0], y + net.offset_m[1]])

    def rank(vehicle: Participant) -> tuple[bool, float, str]:
        positions = vehicle.motion.positions
        distance = np.linalg.norm(positions - middle, axis=1)
        stands = bool(np.linalg.norm(positions[-1] - positions[0]) < SHORTEST_WAY_M)
        ahead = 0.0 if float(distance[0]) > float(distance.min()) + 5.0 else 100.0
        return stands, round(float(distance.min()) + ahead, 3), vehicle.vehicle_id

    return tuple(sorted(everyone, key=rank))
