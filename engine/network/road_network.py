"""A road network in CommonRoad's terms, as plain values, with a lookup of the lanelet under a point.

It is built from a SUMO net (``lanelet_builder``), written as CommonRoad XML, and used to locate generated traffic.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..geometry import Points, length_m, wrap_angle
from .lanelet_graph import LaneletGraph

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

ROAD_DECIMALS = 4
"""Decimals of a road network's coordinates in m in a file: a tenth of a millimetre, finer than any map."""
_SEAM_M = 0.02
"""Widening of lanelets for their union in m: neighbours share their bound only up to rounding."""


@dataclass(frozen=True)
class RoadLanelet:
    """A lanelet with the SUMO lane that it was made from; bounds (n, 2) in metres, ids are CommonRoad's.

    ``types`` and ``users`` are CommonRoad's values (``urban``, ``car`` …); ``allowed`` are SUMO's classes.
    """

    lanelet_id: int
    lane_id: str
    edge_id: str
    left: Points
    right: Points
    successors: tuple[int, ...]
    predecessors: tuple[int, ...]
    left_neighbour: int | None
    left_same_direction: bool
    right_neighbour: int | None
    right_same_direction: bool
    internal: bool
    types: tuple[str, ...]
    users: tuple[str, ...]
    allowed: frozenset[str]
    speed_mps: float
    street: str

    @property
    def center(self) -> Points:
        """The centre line (n, 2): the middle of the bounds."""
        middle: Points = (self.left + self.right) / 2
        return middle

    @property
    def polygon(self) -> Points:
        """The corners of the lanelet, counter-clockwise, shape (2n, 2)."""
        return np.concatenate([self.right, self.left[::-1]])

    def neighbours(self) -> tuple[int, ...]:
        """Return adjacent lanelets of the same direction."""
        sides = ((self.left_neighbour, self.left_same_direction), (self.right_neighbour, self.right_same_direction))
        return tuple(key for key, same in sides if key is not None and same)


@dataclass(frozen=True)
class SpeedSign:
    """A speed limit in m/s that applies to ``lanelet_ids``; the sign is at ``position`` (2,)."""

    sign_id: int
    speed_mps: float
    position: Points
    lanelet_ids: tuple[int, ...]


@dataclass(frozen=True)
class TrafficLight:
    """A light at the end of one lanelet: its cycle as (steps, colour), and the steps elapsed at time 0."""

    light_id: int
    lanelet_id: int
    position: Points
    cycle: tuple[tuple[int, str], ...]
    offset_steps: int
    direction: str


@dataclass(frozen=True)
class Incoming:
    """One arm of an intersection: the lanelets that lead in, and the lanelets after them by direction."""

    incoming_id: int
    lanelet_ids: tuple[int, ...]
    right: tuple[int, ...]
    straight: tuple[int, ...]
    left: tuple[int, ...]


@dataclass(frozen=True)
class Intersection:
    """A junction with at least two arms and a choice of directions."""

    intersection_id: int
    incomings: tuple[Incoming, ...]


@dataclass(frozen=True)
class Walkway:
    """A lanelet for pedestrians in both directions: a crossing, or a pavement or a corner where pavements meet.

    ``edge_id`` is SUMO's; bounds (n, 2) in metres.
    """

    lanelet_id: int
    edge_id: str
    crosses: bool
    left: Points
    right: Points


@dataclass(frozen=True)
class RoadNetwork:
    """All lanelets by id, with signs, lights and intersections; ``dropped_lanes``: those without valid bounds.

    ``lost_connections``: the net's connections from lane to lane without a route over the lanelets. ``folded_edges``:
    roads between junctions with lanelets that cross themselves however they are drawn. ``largest_id``: the largest id
    of all elements in the network's source file, or 0 if there is no such file. ``walkways`` are separate from the
    lanelets, which are for vehicles.
    """

    lanelets: dict[int, RoadLanelet]
    signs: tuple[SpeedSign, ...]
    lights: tuple[TrafficLight, ...]
    intersections: tuple[Intersection, ...]
    dropped_lanes: tuple[str, ...]
    largest_id: int = 0
    walkways: tuple[Walkway, ...] = ()
    lost_connections: tuple[tuple[str, str], ...] = ()
    folded_edges: tuple[str, ...] = ()

    @property
    def next_id(self) -> int:
        """The smallest id above all that the network uses."""
        used = [self.largest_id, *self.lanelets, *(s.sign_id for s in self.signs), *(t.light_id for t in self.lights)]
        for crossing in self.intersections:
            used.append(crossing.intersection_id)
            used.extend(i.incoming_id for i in crossing.incomings)
        used.extend(walkway.lanelet_id for walkway in self.walkways)
        return max(used, default=0) + 1

    @cached_property
    def graph(self) -> LaneletGraph:
        """The graph of the lanelets."""
        lanelets = self.lanelets.items()
        return LaneletGraph(
            length_m={key: length_m(lanelet.center) for key, lanelet in lanelets},
            successors={key: lanelet.successors for key, lanelet in lanelets},
            predecessors={key: lanelet.predecessors for key, lanelet in lanelets},
            neighbours={key: tuple(sorted(lanelet.neighbours())) for key, lanelet in lanelets},
        )

    @cached_property
    def surface(self) -> "BaseGeometry":
        """The road surface for vehicles: all lanelets, with the seams between neighbours closed."""
        from shapely import Polygon, union_all

        return union_all([Polygon(lanelet.polygon).buffer(_SEAM_M) for lanelet in self.lanelets.values()])

    def by_lane(self) -> dict[str, RoadLanelet]:
        """Return lanelets by the SUMO lane that they were made from."""
        return {lanelet.lane_id: lanelet for lanelet in self.lanelets.values()}


WIDEST_TURN_RAD = np.pi / 3
"""Chosen: a vehicle at a larger angle to a lanelet's direction does not drive along it."""


class LaneletLookup:
    """Finds lanelets of one network by position and heading."""

    def __init__(self, network: RoadNetwork) -> None:
        from shapely import Polygon, STRtree

        self._lanelets = list(network.lanelets.values())
        self._tree = STRtree([Polygon(lanelet.polygon) for lanelet in self._lanelets])

    def under(self, position: Points, heading_rad: float) -> RoadLanelet | None:
        """Return the lanelet at a point (2,) with the direction closest to the heading.

        The result is None if the point is off the road, or if the heading is across every lanelet under it.
        """
        from shapely import Point

        hits = sorted(self._tree.query(Point(*position), "covered_by"))
        turns = [
            (abs(wrap_angle(_heading_at(self._lanelets[hit].center, position) - heading_rad)), hit) for hit in hits
        ]
        fitting = [entry for entry in turns if entry[0] < WIDEST_TURN_RAD]
        return self._lanelets[min(fitting)[1]] if fitting else None


def _heading_at(line: Points, position: Points) -> float:
    """Return the heading of the line's segment with the midpoint closest to the position."""
    middle = (line[:-1] + line[1:]) / 2
    index = int(np.argmin(np.linalg.norm(middle - position, axis=1)))
    step = line[index + 1] - line[index]
    return float(np.arctan2(step[1], step[0]))
