"""Recorded motion of the traffic as arrays."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from plannerforge.engine.geometry.polyline import Points, Values
from plannerforge.engine.scenarios.plain_states import PlainStates
from plannerforge.schemas.errors import UnsafeInput

if TYPE_CHECKING:
    from commonroad.scenario.obstacle import DynamicObstacle
    from commonroad.scenario.scenario import Scenario


@dataclass(frozen=True)
class Track:
    """A recorded obstacle: its centre at every step from ``first_step`` on.

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
        """The last step at which the obstacle is there."""
        return self.first_step + len(self.positions) - 1

    def index_at(self, step: int) -> int | None:
        """Index into the arrays for a time step, or None where the obstacle is not there."""
        index = step - self.first_step
        return index if 0 <= index < len(self.positions) else None


def recorded_tracks(scenario: "Scenario", states: Mapping[int, PlainStates] | None = None) -> dict[int, Track]:
    """Tracks of all dynamic obstacles that carry a trajectory, by id in ascending order.

    Set-based predictions have no trajectory and are left out; states that give a region instead of a point count by
    the region's centre, and a missing speed is the distance to the next position.

    Args:
        states: by obstacle id, states after the initial one that were read apart and stand for the trajectory's.

    Raises:
        UnsafeInput: a state says nowhere to be.
    """
    known = states or {}
    found = [_track(one, known.get(int(one.obstacle_id)), float(scenario.dt)) for one in scenario.dynamic_obstacles]
    return {track.obstacle_id: track for track in sorted((t for t in found if t), key=lambda t: t.obstacle_id)}


def last_recorded_step(scenario: "Scenario") -> int:
    """The last time step at which any obstacle is recorded; 0 without moving obstacles."""
    finals = [o.prediction.final_time_step for o in scenario.dynamic_obstacles if o.prediction is not None]
    return max((int(getattr(final, "end", final)) for final in finals), default=0)


def size_of(shape: Any) -> tuple[float, float]:
    """Length and width in metres of a CommonRoad shape; circles give their diameter, polygons their bounding box."""
    if hasattr(shape, "length"):
        return float(shape.length), float(shape.width)
    if hasattr(shape, "radius"):
        return 2 * float(shape.radius), 2 * float(shape.radius)
    vertices = np.asarray(shape.vertices)
    extent = vertices.max(axis=0) - vertices.min(axis=0)
    return float(extent[0]), float(extent[1])


def _track(obstacle: "DynamicObstacle", states: PlainStates | None, step_s: float) -> Track | None:
    trajectory = getattr(obstacle.prediction, "trajectory", None)
    if trajectory is None:
        return None
    if not all(hasattr(state, "position") for state in trajectory.state_list):
        raise UnsafeInput(f"obstacle {obstacle.obstacle_id} has states without a position")
    first, after = _states([obstacle.initial_state]), states or _states(trajectory.state_list)
    positions = np.concatenate([first.positions, after.positions])
    given = np.concatenate([first.speeds_mps, after.speeds_mps])
    length, width = size_of(obstacle.obstacle_shape)
    return Track(
        obstacle_id=int(obstacle.obstacle_id),
        kind=str(obstacle.obstacle_type.value),
        length_m=length,
        width_m=width,
        first_step=int(obstacle.initial_state.time_step),
        positions=positions,
        headings_rad=np.concatenate([first.headings_rad, after.headings_rad]),
        speeds_mps=np.where(np.isnan(given), _speeds(positions, step_s), given) if np.isnan(given).any() else given,
    )


def _states(states: list[Any]) -> PlainStates:
    return PlainStates(
        positions=np.array([center_of(state.position) for state in states], dtype=float),
        headings_rad=np.array([middle_of(getattr(state, "orientation", 0.0)) for state in states], dtype=float),
        speeds_mps=np.array([middle_of(getattr(state, "velocity", None)) for state in states], dtype=float),
    )


def center_of(position: Any) -> Any:
    """A point's or region's centre (2,) in m, without its height; of several regions, the middle of their centres."""
    if hasattr(position, "shapes"):
        return np.mean([center_of(part) for part in position.shapes], axis=0)
    return (position.center if hasattr(position, "center") else position)[:2]


def middle_of(value: Any) -> float:
    """A value as it is, or the middle of an interval; NaN for None."""
    if value is None:
        return float("nan")
    return 0.5 * (float(value.start) + float(value.end)) if hasattr(value, "start") else float(value)


def _speeds(positions: Points, step_s: float) -> Values:
    if len(positions) < 2:
        return np.zeros(len(positions))
    with np.errstate(invalid="ignore"):  # infinite coordinates: whoever reads files refuses them afterwards
        speed = np.linalg.norm(np.diff(positions, axis=0), axis=1) / step_s
    return np.append(speed, speed[-1])
