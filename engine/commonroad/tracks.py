"""Recorded motion of traffic as arrays: tracks, from commonroad-io's obstacles and from separately read states."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...schemas.errors import UnsafeInput
from ..geometry import Points, Values, oriented_rectangle, segment_lengths
from .plain_states import PlainStates

if TYPE_CHECKING:
    from commonroad.scenario.obstacle import DynamicObstacle
    from commonroad.scenario.scenario import Scenario


@dataclass(frozen=True)
class Track:
    """A recorded obstacle: its centre at every step, starting at ``first_step``.

    ``positions`` (n, 2) in metres, ``headings_rad`` (n,), ``speeds_mps`` (n,); ``kind`` is CommonRoad's obstacle type.
    """

    obstacle_id: int
    kind: str
    length_m: float
    width_m: float
    first_step: int
    positions: Points
    headings_rad: Values
    speeds_mps: Values

    @property
    def last_step(self) -> int:
        """The last step at which the obstacle is present."""
        return self.first_step + len(self.positions) - 1

    def index_at(self, step: int) -> int | None:
        """Return the index into the arrays for a time step, or None if the obstacle is not present."""
        index = step - self.first_step
        return index if 0 <= index < len(self.positions) else None

    @property
    def size_m(self) -> tuple[float, float]:
        """The length and width in m."""
        return self.length_m, self.width_m

    def corners_at(self, index: int, size_m: tuple[float, float] | None = None) -> Points:
        """Return the corners (4, 2) in m of the footprint, with the given length and width if there are any."""
        return oriented_rectangle(self.positions[index], float(self.headings_rad[index]), size_m or self.size_m)

    def front_at(self, index: int) -> Points:
        """Return the midpoint (2,) of its front end in m."""
        heading = float(self.headings_rad[index])
        front: Points = self.positions[index] + self.length_m / 2 * np.array([math.cos(heading), math.sin(heading)])
        return front

    def part(self, begin: int, end: int) -> "Track":
        """Return the states from a first index (included) to a second index (excluded)."""
        return replace(
            self,
            first_step=self.first_step + begin,
            positions=self.positions[begin:end],
            headings_rad=self.headings_rad[begin:end],
            speeds_mps=self.speeds_mps[begin:end],
        )


def recorded_tracks(scenario: "Scenario", states: "Mapping[int, PlainStates] | None" = None) -> dict[int, Track]:
    """Return tracks of all dynamic obstacles with a trajectory, by id in ascending order.

    Set-based predictions have no trajectory and are left out. For a state with a region instead of a point, the
    region's centre is used. A missing speed is computed from the distance to the next position.

    Args:
        states: by obstacle id, separately read states after the initial one; they replace the trajectory's.

    Raises:
        UnsafeInput: a state has no position.
    """
    known, step_s = states or {}, float(scenario.dt)
    tracks = [_track(obstacle, known.get(int(obstacle.obstacle_id)), step_s) for obstacle in scenario.dynamic_obstacles]
    recorded = sorted((track for track in tracks if track), key=lambda track: track.obstacle_id)
    return {track.obstacle_id: track for track in recorded}


def static_tracks(scenario: "Scenario", last_step: int) -> dict[int, Track]:
    """Return static obstacles as motionless tracks up to a step, by ascending id; a region becomes its centre.

    Each track stores a single pose in memory, for any number of steps; its arrays are read-only.
    """
    tracks = {}
    for obstacle in sorted(scenario.static_obstacles, key=lambda obstacle: int(obstacle.obstacle_id)):
        state, count = _states([obstacle.initial_state]), last_step + 1
        positions, headings_rad = (
            np.broadcast_to(state.positions, (count, 2)),
            np.broadcast_to(state.headings_rad, count),
        )
        standing = np.broadcast_to(np.zeros(1), count)
        tracks[int(obstacle.obstacle_id)] = _track_of(obstacle, 0, positions, headings_rad, standing)
    return tracks


def last_recorded_step(scenario: "Scenario") -> int:
    """Return the last time step at which any obstacle is recorded; 0 if there are no moving obstacles."""
    finals = [o.prediction.final_time_step for o in scenario.dynamic_obstacles if o.prediction is not None]
    return max((int(getattr(final, "end", final)) for final in finals), default=0)


def size_of(shape: Any) -> tuple[float, float]:
    """Return the length and width in m of a CommonRoad shape.

    For circles this is the diameter, for polygons and groups of shapes the bounding box.
    """
    if hasattr(shape, "length"):
        return float(shape.length), float(shape.width)
    if hasattr(shape, "radius"):
        return 2 * float(shape.radius), 2 * float(shape.radius)
    boxes = np.array([part.shapely_object.bounds for part in getattr(shape, "shapes", [shape])])
    extent = boxes[:, 2:].max(axis=0) - boxes[:, :2].min(axis=0)
    return float(extent[0]), float(extent[1])


def _track(obstacle: "DynamicObstacle", states: "PlainStates | None", step_s: float) -> Track | None:
    trajectory = getattr(obstacle.prediction, "trajectory", None)
    if trajectory is None:
        return None
    if not all(hasattr(state, "position") for state in trajectory.state_list):
        raise UnsafeInput(f"obstacle {obstacle.obstacle_id} has states without a position")
    first, after = _states([obstacle.initial_state]), states or _states(trajectory.state_list)
    positions = np.concatenate([first.positions, after.positions])
    given = np.concatenate([first.speeds_mps, after.speeds_mps])
    headings = np.concatenate([first.headings_rad, after.headings_rad])
    speeds = np.where(np.isnan(given), _speeds(positions, step_s), given) if np.isnan(given).any() else given
    return _track_of(obstacle, int(obstacle.initial_state.time_step), positions, headings, speeds)


def _track_of(obstacle: Any, first_step: int, positions: Points, headings_rad: Values, speeds_mps: Values) -> Track:
    key, kind = int(obstacle.obstacle_id), str(obstacle.obstacle_type.value)
    size = size_of(obstacle.obstacle_shape)
    return Track(key, kind, *size, first_step, positions, headings_rad, speeds_mps)


def _states(states: list[Any]) -> PlainStates:
    headings = np.array([middle_of(getattr(state, "orientation", 0.0)) for state in states], dtype=float)
    speeds = np.array([middle_of(getattr(state, "velocity", None)) for state in states], dtype=float)
    return PlainStates(
        positions=np.array([center_of(state.position) for state in states], dtype=float),
        columns={"orientation": headings, "velocity": speeds},
    )


def center_of(position: Any) -> Any:
    """Return the centre (2,) in m of a point or region, without its height; for several regions, the mean of their
    centres.
    """
    if hasattr(position, "shapes"):
        return np.mean([center_of(part) for part in position.shapes], axis=0)
    return (position.center if hasattr(position, "center") else position)[:2]


def middle_of(value: Any) -> float:
    """Return a value, or the midpoint of an interval; NaN for None."""
    if value is None:
        return float("nan")
    return 0.5 * (float(value.start) + float(value.end)) if hasattr(value, "start") else float(value)


def _speeds(positions: Points, step_s: float) -> Values:
    if len(positions) < 2:
        return np.zeros(len(positions))
    with np.errstate(invalid="ignore"):  # infinite coordinates: value_limits rejects them afterwards
        speed = segment_lengths(positions) / step_s
    return np.append(speed, speed[-1])
