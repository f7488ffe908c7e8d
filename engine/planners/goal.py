"""CommonRoad's goal region in all its forms.

Lanelets, shapes or a free position; speed and heading intervals; several states of which one has to be met.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from plannerforge.engine.geometry.polyline import Points, arc_length
from plannerforge.engine.planners.interface import EgoState

if TYPE_CHECKING:
    from commonroad.planning.goal import GoalRegion
    from shapely.geometry.base import BaseGeometry

Timing = Literal["early", "in_time", "late"]


@dataclass(frozen=True)
class GoalStatus:
    """How one ego state relates to one goal state; a condition that the goal does not state is met."""

    position: bool
    heading: bool
    speed: bool
    timing: Timing

    @property
    def reached(self) -> bool:
        """All conditions hold."""
        return self.position and self.heading and self.speed and self.timing == "in_time"

    @property
    def all_but_time(self) -> bool:
        """Everything holds except possibly the time."""
        return self.position and self.heading and self.speed


@dataclass(frozen=True)
class Window:
    """First and last time step of a goal state."""

    first: int
    last: int


@dataclass(frozen=True)
class GoalCondition:
    """Time, area (None: any place) and speed interval in m/s (None: any speed) of one goal state."""

    window: Window
    area: "BaseGeometry | None"
    speed_mps: tuple[float, float] | None


class Goal:
    """The goal region of a planning problem; one of its states has to be met."""

    def __init__(self, region: "GoalRegion") -> None:
        self._states = list(region.state_list)
        self.windows = tuple(Window(*_bounds(state.time_step)) for state in self._states)
        self._areas = [_area(getattr(state, "position", None)) for state in self._states]

    @property
    def first_step(self) -> int:
        """The first step at which the goal can be reached."""
        return min(window.first for window in self.windows)

    @property
    def last_step(self) -> int:
        """The last step at which the goal can be reached."""
        return max(window.last for window in self.windows)

    @property
    def conditions(self) -> tuple["GoalCondition", ...]:
        """What each goal state asks for."""
        return tuple(
            GoalCondition(window, area, _interval(getattr(state, "velocity", None)))
            for state, area, window in zip(self._states, self._areas, self.windows, strict=True)
        )

    @property
    def has_position(self) -> bool:
        """Whether every goal state asks for a place."""
        return all(area is not None for area in self._areas)

    @property
    def speed_mps(self) -> float | None:
        """The middle of the first speed interval that a goal state names."""
        for state in self._states:
            if getattr(state, "velocity", None) is not None:
                low, high = _bounds_of_number(state.velocity)
                return (max(low, 0.01) + max(high, 0.01)) / 2
        return None

    def status(self, ego: EgoState) -> list[GoalStatus]:
        """How the ego stands to each goal state."""
        return [self._status(index, ego) for index in range(len(self._states))]

    def holds(self, point: Points) -> bool:
        """Whether a point lies in the area of any goal state."""
        import shapely

        return any(area is None or shapely.intersects_xy(area, point[0], point[1]) for area in self._areas)

    @property
    def center(self) -> Points | None:
        """A point in the middle of the first goal state's area, shape (2,); None where the position is free."""
        if not self._areas or self._areas[0] is None:
            return None
        inner = self._areas[0].representative_point()
        middle = self._areas[0].centroid
        chosen = middle if self._areas[0].intersects(middle) else inner
        return np.array([chosen.x, chosen.y])

    def stations_on(self, path: Points) -> tuple[float, float] | None:
        """Where a path is inside the goal's area: first and last arc length in m; None where it never is."""
        import shapely

        inside = np.zeros(len(path), dtype=bool)
        for area in self._areas:
            if area is not None:
                inside |= shapely.intersects_xy(area, path[:, 0], path[:, 1])
        found = np.flatnonzero(inside)
        stations = arc_length(path)
        return (float(stations[found[0]]), float(stations[found[-1]])) if len(found) else None

    def _status(self, index: int, ego: EgoState) -> GoalStatus:
        import shapely

        state, area, window = self._states[index], self._areas[index], self.windows[index]
        timing: Timing = "early" if ego.step < window.first else "late" if ego.step > window.last else "in_time"
        return GoalStatus(
            position=area is None or bool(shapely.intersects_xy(area, ego.position[0], ego.position[1])),
            heading=_angle_within(ego.heading_rad, getattr(state, "orientation", None)),
            speed=_within(ego.speed_mps, getattr(state, "velocity", None)),
            timing=timing,
        )


def _area(position: Any) -> Any:
    """The area of a goal position as a shapely geometry; None where the goal has no position."""
    import shapely

    if position is None:
        return None
    parts = [part.shapely_object for part in getattr(position, "shapes", [position])]
    area = shapely.union_all(shapely.make_valid(np.array(parts, dtype=object)))
    shapely.prepare(area)
    return area


def _bounds(step: Any) -> tuple[int, int]:
    low, high = _bounds_of_number(step)
    return int(low), int(high)


def _bounds_of_number(value: Any) -> tuple[float, float]:
    return (float(value.start), float(value.end)) if hasattr(value, "start") else (float(value), float(value))


def _interval(value: Any) -> tuple[float, float] | None:
    return None if value is None else _bounds_of_number(value)


def _within(value: float, interval: Any) -> bool:
    if interval is None:
        return True
    low, high = _bounds_of_number(interval)
    return low <= value <= high


def _angle_within(angle_rad: float, interval: Any) -> bool:
    """Whether an angle lies in an interval on the circle, whatever multiples of 2π either is written with."""
    if interval is None:
        return True
    low, high = _bounds_of_number(interval)
    if high - low >= math.tau:
        return True
    beyond = (angle_rad - low) % math.tau
    return beyond <= high - low + 1e-9 or math.tau - beyond < 1e-9
