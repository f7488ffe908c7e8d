"""The road network of a CommonRoad file as it stands there, defects included.

commonroad-io repairs or refuses what does not fit: it drops references into nothing, and a repeated id ends its
reading. Checks on its network cannot see that. Here nothing is resolved: references stay numbers.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.geometry.polyline import Points, Values, without_repeats

if TYPE_CHECKING:
    from shapely import Polygon


@dataclass(frozen=True)
class NeighbourElement:
    """A lanelet beside another, and whether it is said to lead the same way."""

    lanelet_id: int
    same_direction: bool


@dataclass(frozen=True)
class StopLineElement:
    """A stop line: its points (n, 2), none where it lies at the lanelet's end, and the ids it refers to."""

    points: Points
    sign_ids: tuple[int, ...]
    light_ids: tuple[int, ...]


@dataclass(frozen=True)
class LaneletElement:
    """A lanelet as written: bounds (n, 2) in metres, of any length; ``markings`` of the left and right bound."""

    lanelet_id: int
    left: Points
    right: Points
    markings: tuple[str, ...]
    predecessors: tuple[int, ...]
    successors: tuple[int, ...]
    left_neighbour: NeighbourElement | None
    right_neighbour: NeighbourElement | None
    stop_line: StopLineElement | None
    types: tuple[str, ...]
    users: tuple[str, ...]
    sign_ids: tuple[int, ...]
    light_ids: tuple[int, ...]

    @property
    def neighbours(self) -> tuple[NeighbourElement, ...]:
        """The lanelets beside this one, left before right."""
        return tuple(beside for beside in (self.left_neighbour, self.right_neighbour) if beside is not None)

    @cached_property
    def is_drawn(self) -> bool:
        """Whether the bounds make a ribbon: two or more finite points each, as many on the left as on the right."""
        finite = bool(np.isfinite(self.left).all() and np.isfinite(self.right).all())
        return finite and len(self.left) == len(self.right) >= 2

    @cached_property
    def center(self) -> Points:
        """Centre line of shape (n, 2) of a drawn lanelet: the middle of the bounds."""
        middle: Points = (self.left + self.right) / 2
        return middle

    @cached_property
    def path(self) -> Points:
        """The centre line of a drawn lanelet without repeated points."""
        return without_repeats(self.center)

    @cached_property
    def widths_m(self) -> Values:
        """Distance of the bounds' points of one number, shape (n,), of a drawn lanelet."""
        widths: Values = np.linalg.norm(self.left - self.right, axis=1)
        return widths

    @cached_property
    def polygon(self) -> "Polygon":
        """The area of a drawn lanelet, made valid where the bounds cross."""
        from shapely import Polygon

        area = Polygon(np.concatenate([self.right, self.left[::-1]]))
        return area if area.is_valid else area.buffer(0)


@dataclass(frozen=True)
class SignElement:
    """A traffic sign: (number, additional values) of each of its plates, position (2,) or None."""

    sign_id: int
    plates: tuple[tuple[str, tuple[str, ...]], ...]
    position: Points | None


@dataclass(frozen=True)
class LightElement:
    """A traffic light: (steps, colour) of its phases."""

    light_id: int
    phases: tuple[tuple[int, str], ...]
    position: Points | None
    active: bool


@dataclass(frozen=True)
class IncomingElement:
    """An arm of an intersection: lanelets that lead in, lanelets that lead on, the arm to its right."""

    incoming_id: int
    lanelet_ids: tuple[int, ...]
    exit_ids: tuple[int, ...]
    left_of: int | None


@dataclass(frozen=True)
class IntersectionElement:
    """An intersection and its arms."""

    intersection_id: int
    incomings: tuple[IncomingElement, ...]


@dataclass(frozen=True)
class RoadDocument:
    """The network of one file in the file's order; ``country`` is that of the benchmark id.

    ``ids``: all ids of the file with the element's name, vehicles and planning problems included.
    """

    country: str
    lanelets: tuple[LaneletElement, ...]
    signs: tuple[SignElement, ...]
    lights: tuple[LightElement, ...]
    intersections: tuple[IntersectionElement, ...]
    ids: tuple[tuple[int, str], ...]

    @cached_property
    def by_id(self) -> dict[int, LaneletElement]:
        """Lanelets by id; of a repeated id the first."""
        return {lanelet.lanelet_id: lanelet for lanelet in reversed(self.lanelets)}

    @cached_property
    def drawn(self) -> tuple[LaneletElement, ...]:
        """The lanelets whose bounds make a ribbon."""
        return tuple(lanelet for lanelet in self.lanelets if lanelet.is_drawn)

    @cached_property
    def joins(self) -> tuple[tuple[LaneletElement, LaneletElement], ...]:
        """Every drawn lanelet with each of its drawn successors, itself left out."""
        pairs = ((one, self.by_id.get(key)) for one in self.drawn for key in one.successors)
        return tuple((one, other) for one, other in pairs if other is not None and other is not one and other.is_drawn)
