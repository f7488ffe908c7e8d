"""The others in a run: what the simulation loop asks of them (:class:`Traffic`), and the others as recorded."""

from collections.abc import Set
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ...commonroad import Track, recorded_tracks, size_of
from ...vehicles import VehicleParameters
from ..interface import EgoState

if TYPE_CHECKING:
    from commonroad.scenario.scenario import Scenario
    from commonroad_dc import pycrcc


class Traffic(Protocol):
    """All road users but the ego, up to the step that the loop has come to.

    ``moving``: a track for every dynamic obstacle; those that react to the ego end at the step that was advanced to.
    ``standing``: static obstacles as tracks of one state.
    """

    @property
    def moving(self) -> tuple[Track, ...]:
        """Dynamic obstacles by ascending id."""

    @property
    def standing(self) -> tuple[Track, ...]:
        """Static obstacles."""

    @property
    def driven(self) -> tuple[Track, ...]:
        """The obstacles among the moving that react to the ego, up to the present step."""

    @property
    def on_recording(self) -> tuple[int, ...]:
        """Ids of the moving obstacles that follow their recording although the traffic is reactive."""

    def advance(self, ego: EgoState) -> None:
        """Go on to the step of the ego's new state; called for every step in order, before that step is read."""

    def hit_by(self, ego: EgoState, vehicle: VehicleParameters) -> tuple[int, str] | None:
        """Id and type of the first obstacle (by id) that the ego's rectangle overlaps at its step, or None."""


class RecordedTraffic:
    """Dynamic and static obstacles of a scenario, following their recordings; environment and phantoms are no bodies.

    ``moving``: a track for every dynamic obstacle, set-based predictions and obstacles without any prediction
    included; ``standing``: static obstacles as tracks of one state. Obstacles ``without`` are left out.
    """

    driven: tuple[Track, ...] = ()
    on_recording: tuple[int, ...] = ()

    def __init__(self, scenario: "Scenario", without: Set[int] = frozenset()) -> None:
        from commonroad_dc import pycrcc
        from commonroad_dc.collision.collision_detection.pycrcc_collision_dispatch import create_collision_object

        self.moving: tuple[Track, ...] = tuple(t for t in _all_tracks(scenario) if t.obstacle_id not in without)
        self.standing: tuple[Track, ...] = tuple(_static_track(obstacle) for obstacle in scenario.static_obstacles)
        obstacles = [*scenario.dynamic_obstacles, *scenario.static_obstacles]
        self._bodies = {
            (int(o.obstacle_id), str(o.obstacle_type.value)): create_collision_object(o)
            for o in sorted(obstacles, key=lambda o: int(o.obstacle_id))
            if int(o.obstacle_id) not in without
        }
        self._checker = pycrcc.CollisionChecker()
        for body in self._bodies.values():
            self._checker.add_collision_object(body)

    def advance(self, ego: EgoState) -> None:
        """Nothing to do: a recording does not depend on the ego."""

    def hit_by(self, ego: EgoState, vehicle: VehicleParameters) -> tuple[int, str] | None:
        """Id and type of the first obstacle (by id) that the ego's rectangle overlaps at its step, or None."""
        from commonroad_dc import pycrcc

        body = pycrcc.TimeVariantCollisionObject(ego.step)
        body.append_obstacle(rectangle(ego, vehicle))
        if not self._checker.collide(body):
            return None
        return next((who for who, shape in self._bodies.items() if shape.collide(body)), None)


def rectangle(ego: EgoState, vehicle: VehicleParameters) -> "pycrcc.RectOBB":
    """The ego's rectangle for the collision checker."""
    from commonroad_dc import pycrcc

    x, y = float(ego.position[0]), float(ego.position[1])
    return pycrcc.RectOBB(vehicle.length_m / 2, vehicle.width_m / 2, ego.heading_rad, x, y)


def _all_tracks(scenario: "Scenario") -> tuple[Track, ...]:
    tracks = recorded_tracks(scenario)
    for obstacle in scenario.dynamic_obstacles:
        if int(obstacle.obstacle_id) not in tracks:
            tracks[int(obstacle.obstacle_id)] = _occupancy_track(obstacle)
    return tuple(tracks[key] for key in sorted(tracks))


def _occupancy_track(obstacle: Any) -> Track:
    """Track of the centres of an obstacle's occupied regions, its size that of the largest one."""
    first = int(obstacle.initial_state.time_step)
    shapes = [obstacle.occupancy_at_time(first).shape]
    if obstacle.prediction is not None:
        shapes += [occupancy.shape for occupancy in obstacle.prediction.occupancy_set]
    heading = float(getattr(obstacle.initial_state, "orientation", None) or 0.0)
    speed = float(getattr(obstacle.initial_state, "velocity", None) or 0.0)
    return _track_of_shapes(obstacle, first, shapes, heading, speed)


def _static_track(obstacle: Any) -> Track:
    shape = obstacle.occupancy_at_time(obstacle.initial_state.time_step).shape
    return _track_of_shapes(obstacle, 0, [shape], 0.0, 0.0)


def _track_of_shapes(obstacle: Any, first_step: int, shapes: list[Any], heading_rad: float, speed_mps: float) -> Track:
    """``heading_rad``: that of shapes without one of their own."""
    parts = [_largest(shape) for shape in shapes]
    sizes = [size_of(part) for part in parts]
    return Track(
        obstacle_id=int(obstacle.obstacle_id),
        kind=str(obstacle.obstacle_type.value),
        length_m=max(length for length, _ in sizes),
        width_m=max(width for _, width in sizes),
        first_step=first_step,
        positions=np.array([part.center for part in parts], dtype=float),
        headings_rad=np.array([getattr(part, "orientation", heading_rad) for part in parts], dtype=float),
        speeds_mps=np.full(len(parts), speed_mps),
    )


def _largest(shape: Any) -> Any:
    parts = getattr(shape, "shapes", None)
    return max(parts, key=lambda part: float(part.shapely_object.area)) if parts else shape


_FIRST_CAPACITY = 64
"""States for which there is room at first (chosen); it doubles when full."""


class GrowingTrack:
    """A track that grows step by step, where the motion is not known before; size and type are those of ``like``."""

    def __init__(self, like: Track, first_step: int) -> None:
        self.like, self.first_step = like, first_step
        self._rows = np.empty((_FIRST_CAPACITY, 4))
        self._count = 0

    @property
    def last_step(self) -> int:
        """The last step that was added; the one before the first without any."""
        return self.first_step + self._count - 1

    def add(self, x_m: float, y_m: float, heading_rad: float, speed_mps: float) -> None:
        """Centre, heading and speed at the next step."""
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        self._rows[self._count] = x_m, y_m, heading_rad, speed_mps
        self._count += 1

    def track(self) -> Track:
        """What has been added, without copying."""
        rows = self._rows[: self._count]
        return replace(
            self.like, first_step=self.first_step, positions=rows[:, :2], headings_rad=rows[:, 2], speeds_mps=rows[:, 3]
        )
