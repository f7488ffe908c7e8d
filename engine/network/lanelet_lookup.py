"""Which lanelet lies under a point."""

import numpy as np

from plannerforge.engine.geometry.polyline import Points, wrap_angle
from plannerforge.engine.network.road_network import RoadLanelet, RoadNetwork

WIDEST_TURN_RAD = np.pi / 3


class LaneletLookup:
    """Finds lanelets of one network by position and heading."""

    def __init__(self, network: RoadNetwork) -> None:
        from shapely import Polygon, STRtree

        self._lanelets = list(network.lanelets.values())
        self._tree = STRtree([Polygon(lanelet.polygon) for lanelet in self._lanelets])

    def under(self, position: Points, heading_rad: float) -> RoadLanelet | None:
        """The lanelet that holds a point (2,) and runs most like the heading; None off the road or across it."""
        from shapely import Point

        hits = sorted(self._tree.query(Point(*position), "covered_by"))
        turns = [
            (abs(wrap_angle(_heading_at(self._lanelets[hit].center, position) - heading_rad)), hit) for hit in hits
        ]
        fitting = [entry for entry in turns if entry[0] < WIDEST_TURN_RAD]
        return self._lanelets[min(fitting)[1]] if fitting else None


def _heading_at(line: Points, position: Points) -> float:
    """Heading of the line's segment whose middle lies nearest to the position."""
    middle = (line[:-1] + line[1:]) / 2
    index = int(np.argmin(np.linalg.norm(middle - position, axis=1)))
    step = line[index + 1] - line[index]
    return float(np.arctan2(step[1], step[0]))
