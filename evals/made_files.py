"""The files of a made scenario as the judges of the bench see them: the SUMO net, the middle, the obstacles."""

import itertools
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.network.net_parser import NetEdge, SumoNet, read_net

SIZES = {
    "car": ("car", 3.0, 6.0),
    "delivery": ("truck", 5.0, 7.0),
    "truck": ("truck", 7.0, 12.1),
    "trailer": ("truck", 12.1, 25.3),
    "bus": ("bus", 8.0, 13.5),
    "coach": ("bus", 13.5, 15.1),
    "taxi": ("taxi", 3.0, 6.0),
    "emergency": ("priorityVehicle", 4.0, 12.1),
    "motorcycle": ("motorcycle", 2.15, 2.6),
    "moped": ("motorcycle", 1.5, 2.15),
    "bicycle": ("bicycle", 1.3, 2.6),
}
"""CommonRoad's type of each class, and the lengths in m (from, below) that tell classes of one type apart."""


@dataclass(frozen=True)
class MadeFiles:
    """A made scenario: its net, its middle there in m and on the globe in degrees, its obstacles as (type, length)."""

    net: SumoNet
    middle: Points
    latitude: float
    longitude: float
    obstacles: tuple[tuple[str, float], ...]

    @classmethod
    def read(cls, folder: Path) -> "MadeFiles":
        """Read ``scenario.xml`` and ``scenario.net.xml``."""
        from pyproj import Proj

        root = etree.parse(folder / "scenario.xml").getroot()
        net = read_net(folder / "scenario.net.xml")
        latitude, longitude = (
            float(root.findtext(f"location/{tag}", "nan")) for tag in ("gpsLatitude", "gpsLongitude")
        )
        middle = np.array(Proj(net.projection)(longitude, latitude)) + np.array(net.offset_m)
        obstacles = tuple(
            (str(found.findtext("type")), float(found.findtext("shape/rectangle/length", "nan")))
            for found in root.iterfind("dynamicObstacle")
        )
        return cls(net, middle, latitude, longitude, obstacles)

    def classes(self) -> Counter[str]:
        """Vehicles by class, the ego not counted."""
        return Counter(
            name
            for kind, length in self.obstacles
            for name, (of_kind, shortest, longest) in SIZES.items()
            if kind == of_kind and shortest <= length < longest
        )

    def near(self, within_m: float) -> list[NetEdge]:
        """Roads of the net that come so near to the middle."""
        return [edge for edge in self.net.edges.values() if not edge.internal and self._distance_m(edge) < within_m]

    def is_near(self, point: Points, within_m: float) -> bool:
        """Whether a point (2,) lies so near to the middle."""
        return float(np.linalg.norm(point - self.middle)) < within_m

    def _distance_m(self, edge: NetEdge) -> float:
        lines = [self.net.lanes[lane].shape for lane in edge.lane_ids]
        points = np.vstack([np.linspace(a, b, 8) for line in lines for a, b in itertools.pairwise(line)])
        return float(np.linalg.norm(points - self.middle, axis=1).min())
