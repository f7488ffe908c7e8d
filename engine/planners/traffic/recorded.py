"""The other road users in a run: the interface for the loop (:class:`Traffic`), and recorded traffic."""

import math
from collections.abc import Iterable, Mapping, Set
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ....schemas.runs import TriggerOutcome
from ...commonroad import LoadedScenario, Track, recorded_tracks, size_of
from ...vehicles import VehicleParameters
from ..interface import EgoState

if TYPE_CHECKING:
    from commonroad.scenario.obstacle import DynamicObstacle
    from commonroad.scenario.scenario import Scenario
    from commonroad_dc import pycrcc

_ROOM_M = 0.1
"""Rectangles with corners this far apart do not touch, whatever the rounding (chosen)."""


class Traffic(Protocol):
    """All road users but the ego, up to the current step of the loop.

    ``moving``: a track for every dynamic obstacle; those that react to the ego end at the current step. ``standing``:
    static obstacles as tracks of one state.
    """

    @property
    def moving(self) -> tuple[Track, ...]:
        """The tracks of the dynamic obstacles, by ascending id."""

    @property
    def standing(self) -> tuple[Track, ...]:
        """The static obstacles, as tracks of one state."""

    @property
    def driven(self) -> tuple[Track, ...]:
        """The moving obstacles that react to the ego, up to the present step."""

    @property
    def on_recording(self) -> tuple[int, ...]:
        """Ids of the moving obstacles that follow their recording although the traffic is reactive."""

    @property
    def triggers(self) -> tuple[TriggerOutcome, ...]:
        """The triggers of scripted motions by road user, and whether they have fired up to the present step."""

    def advance(self, ego: EgoState) -> None:
        """Advance to the step of the ego's new state; call this for every step in order, before reading the traffic at
        that step.
        """

    def hits(self, ego: EgoState, vehicle: VehicleParameters) -> tuple[tuple[int, str], ...]:
        """Return id and type of all obstacles that overlap the ego's rectangle at the ego's step, by ascending id."""


class RecordedTraffic:
    """Dynamic and static obstacles as recorded; environment and phantom obstacles have no bodies.

    ``moving``: a track for every dynamic obstacle, including set-based predictions and obstacles without any
    prediction; ``standing``: static obstacles as tracks of one state. Obstacles in ``without`` are left out.
    """

    driven: tuple[Track, ...] = ()
    on_recording: tuple[int, ...] = ()
    triggers: tuple[TriggerOutcome, ...] = ()

    def __init__(
        self,
        scenario: "Scenario",
        without: Set[int] = frozenset(),
        tracks: Mapping[int, Track] | None = None,
        exact: Set[int] = frozenset(),
    ) -> None:
        """Read the obstacles of a scenario.

        Args:
            scenario: The scenario of commonroad-io.
            without: Ids of obstacles to leave out.
            tracks: The tracks of its trajectories, if known.
            exact: The obstacles that have exact points and headings in all states after the first.
        """
        dynamic, static = scenario.dynamic_obstacles, scenario.static_obstacles
        tracks = _all_tracks(dynamic, recorded_tracks(scenario) if tracks is None else tracks)
        bodies = {int(one.obstacle_id): one for one in (*dynamic, *static) if int(one.obstacle_id) not in without}
        self.moving: tuple[Track, ...] = tuple(tracks[key] for key in sorted(tracks.keys() - without))
        self.standing: tuple[Track, ...] = tuple(_static_track(obstacle) for obstacle in static)
        self._kinds = {key: str(obstacle.obstacle_type.value) for key, obstacle in bodies.items()}
        rectangles = sorted(key for key in bodies.keys() & exact if _is_exact_rectangle(bodies[key]))
        self._rectangles = _Rectangles({key: (tracks[key], bodies[key].obstacle_shape) for key in rectangles})
        self._others = _bodies_of({key: bodies[key] for key in sorted(bodies.keys() - set(rectangles))})

    @classmethod
    def of(cls, loaded: LoadedScenario, without: Set[int] = frozenset()) -> "RecordedTraffic":
        """Return the obstacles of a file, with the tracks that reading it produced."""
        return cls(loaded.scenario, without, loaded.tracks, loaded.plain_states.keys())

    def advance(self, ego: EgoState) -> None:
        """Do nothing, since a recording does not depend on the ego."""

    def hits(self, ego: EgoState, vehicle: VehicleParameters) -> tuple[tuple[int, str], ...]:
        """Return id and type of all obstacles that overlap the ego's rectangle at the ego's step, by ascending id."""
        from commonroad_dc import pycrcc

        body = pycrcc.TimeVariantCollisionObject(ego.step)
        body.append_obstacle(rectangle(ego, vehicle))
        hit = self._rectangles.hit_by(ego, vehicle)
        hit += [key for key, other in self._others.items() if other.collide(body)]
        return tuple((key, self._kinds[key]) for key in sorted(hit))


class _Rectangles:
    """Tracks of obstacles that are rectangles with an exact pose at every step, with their CommonRoad shapes, by id.

    commonroad-dc creates a body for each step of each obstacle before a run; here bodies are created once the ego is
    near.
    """

    def __init__(self, tracks: Mapping[int, tuple[Track, Any]]) -> None:
        self._keys, self._shapes = list(tracks), [shape for _, shape in tracks.values()]
        recorded = [track for track, _ in tracks.values()]
        self._first = np.array([track.first_step for track in recorded], dtype=int)
        self._counts = np.array([len(track.positions) for track in recorded], dtype=int)
        self._begin = np.cumsum(self._counts) - self._counts
        centres = [track.positions + shape.center for track, shape in tracks.values()]
        self._centres = np.concatenate([np.empty((0, 2)), *centres])
        self._headings_rad = np.concatenate([np.empty(0), *(track.headings_rad for track in recorded)])
        self._reach_m = np.array([math.hypot(*track.size_m) / 2 for track in recorded])

    def hit_by(self, ego: EgoState, vehicle: VehicleParameters) -> list[int]:
        """Return the ids of all that overlap the ego's rectangle at its step, ascending."""
        index = ego.step - self._first
        there = np.flatnonzero((index >= 0) & (index < self._counts))
        rows = self._begin[there] + index[there]
        away_m = np.linalg.norm(self._centres[rows] - ego.position, axis=1)
        near = away_m <= self._reach_m[there] + math.hypot(vehicle.length_m, vehicle.width_m) / 2 + _ROOM_M
        body = rectangle(ego, vehicle)
        return [
            self._keys[one]
            for one, row in zip(there[near].tolist(), rows[near].tolist(), strict=True)
            if self._body(one, row).collide(body)
        ]

    def _body(self, one: int, row: int) -> "pycrcc.RectOBB | pycrcc.RectAABB":
        """Return the body that commonroad-dc creates for the shape as commonroad-io turns and moves it."""
        from commonroad.common.util import make_valid_orientation
        from commonroad_dc import pycrcc

        shape = self._shapes[one]
        half_m, centre = (shape.length / 2, shape.width / 2), self._centres[row].tolist()
        heading_rad = make_valid_orientation(shape.orientation + float(self._headings_rad[row]))
        if heading_rad == 0.0:
            return pycrcc.RectAABB(*half_m, *centre)
        return pycrcc.RectOBB(*half_m, heading_rad, *centre)


def _bodies_of(obstacles: Mapping[int, Any]) -> dict[int, "pycrcc.CollisionObject"]:
    """Return obstacles' bodies at all steps, as commonroad-dc's own function would, but without loading matplotlib."""
    return {key: _body_of_obstacle(obstacle) for key, obstacle in obstacles.items()}


def _body_of_obstacle(obstacle: Any) -> "pycrcc.CollisionObject":
    """Return a static obstacle's shape, present at every step, or a dynamic one's shapes from its first step."""
    from commonroad.scenario.obstacle import StaticObstacle
    from commonroad_dc import pycrcc

    first = obstacle.initial_state.time_step
    shape = obstacle.occupancy_at_time(first).shape
    if isinstance(obstacle, StaticObstacle):
        return _body_of_shape(shape)
    motion = pycrcc.TimeVariantCollisionObject(first)
    motion.append_obstacle(_body_of_shape(shape))
    for occupancy in obstacle.prediction.occupancy_set if obstacle.prediction is not None else ():
        motion.append_obstacle(_body_of_shape(occupancy.shape))
    return motion


def _body_of_shape(shape: Any) -> "pycrcc.CollisionObject":
    """Return the body of one of CommonRoad's four kinds of shapes."""
    from commonroad.geometry.shape import Circle, Rectangle, ShapeGroup
    from commonroad_dc import pycrcc

    if isinstance(shape, ShapeGroup):
        group = pycrcc.ShapeGroup()
        for part in shape.shapes:
            group.add_shape(_body_of_shape(part))
        return group
    if isinstance(shape, Circle):
        return pycrcc.Circle(shape.radius, *shape.center)
    if not isinstance(shape, Rectangle):
        corners = shape.vertices
        return pycrcc.Triangle(*corners.ravel()) if len(corners) == 3 else pycrcc.Polygon(corners.tolist(), [])
    half_m = 0.5 * shape.length, 0.5 * shape.width
    if math.isclose(shape.orientation, 0.0):
        return pycrcc.RectAABB(*half_m, *shape.center)
    return pycrcc.RectOBB(*half_m, shape.orientation, *shape.center)


def _is_exact_rectangle(obstacle: Any) -> bool:
    """Return True if an obstacle with exact later states is one rectangle that also starts at an exact pose."""
    state, shape = obstacle.initial_state, obstacle.obstacle_shape
    return (
        hasattr(shape, "length")
        and obstacle.prediction.wheelbase_lengths is None
        and not state.is_uncertain_position
        and not state.is_uncertain_orientation
    )


def rectangle(ego: EgoState, vehicle: VehicleParameters) -> "pycrcc.RectOBB":
    """Return the ego's rectangle for the collision checker."""
    from commonroad_dc import pycrcc

    x, y = float(ego.position[0]), float(ego.position[1])
    return pycrcc.RectOBB(vehicle.length_m / 2, vehicle.width_m / 2, ego.heading_rad, x, y)


def _all_tracks(obstacles: "Iterable[DynamicObstacle]", recorded: Mapping[int, Track]) -> dict[int, Track]:
    """Return, by id, the recorded tracks and tracks of the regions that all other obstacles occupy."""
    others = {int(one.obstacle_id): one for one in obstacles if int(one.obstacle_id) not in recorded}
    return {**recorded, **{key: _occupancy_track(one) for key, one in others.items()}}


def _occupancy_track(obstacle: Any) -> Track:
    """Return a track of the centres of an obstacle's occupied regions, with the size of the largest region."""
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
    """Return a track of shapes; ``heading_rad`` applies to shapes that have no heading of their own."""
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
"""Initial capacity in states (chosen); it doubles when full."""


class GrowingTrack:
    """A track of an unknown motion that grows step by step; size and type are those of ``like``."""

    def __init__(self, like: Track, first_step: int) -> None:
        self.like, self.first_step = like, first_step
        self._rows = np.empty((_FIRST_CAPACITY, 4))
        self._count = 0

    @property
    def last_step(self) -> int:
        """The last step that was added, or the step before the first."""
        return self.first_step + self._count - 1

    def add(self, x_m: float, y_m: float, heading_rad: float, speed_mps: float) -> None:
        """Add centre, heading and speed at the next step."""
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        self._rows[self._count] = x_m, y_m, heading_rad, speed_mps
        self._count += 1

    def track(self) -> Track:
        """Return the added states without copying them."""
        rows = self._rows[: self._count]
        return replace(
            self.like, first_step=self.first_step, positions=rows[:, :2], headings_rad=rows[:, 2], speeds_mps=rows[:, 3]
        )
