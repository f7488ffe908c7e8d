"""A scenario made ready for edits: its lanes as a SUMO network, its vehicles on their lanelets, its ego."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..commonroad import LoadedScenario, Track, center_of, last_recorded_step, middle_of, recorded_tracks, size_of
from ..geometry import Points, Values, project, wrap_angle
from ..network import (
    LONG_LANELET_M,
    LaneletGraph,
    NetLayout,
    Signal,
    SlowPlaces,
    lowered_by_curves,
    posted_speeds,
    signals_of,
    slow_places,
    straight_speeds,
    sumo_net,
)
from .edge_routes import EdgeGraph
from .map_matching import LaneMatch, MapMatcher

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork
    from commonroad.scenario.obstacle import DynamicObstacle
    from commonroad.scenario.scenario import Scenario

# ---------- occupied_regions
# Obstacles without a trajectory as bounding tracks: where a set-based prediction says that they may be.
#
# Who is given by occupancies cannot be driven, but is in the way like everybody else. Each part of an occupancy counts
# by an oriented rectangle around it. As these grow and turn from step to step and a track has one size, an obstacle
# becomes several tracks, one after the other or side by side.

SIZE_STEP_M = 0.5
"""Rectangles whose sides round up to the same multiple of this make one track, as large as the largest of them."""
MOVED_M = 0.05
"""A centre that moves less than this in a step says nothing about a direction."""
PIECES_PER_OBSTACLE = 10_000


@dataclass(frozen=True)
class _Box:
    """The rectangle around one part of an occupancy at a step: centre (x, y) in m, heading in rad, sides in m."""

    step: int
    center: tuple[float, float]
    heading_rad: float
    size_m: tuple[float, float]

    @property
    def size_class(self) -> tuple[int, int]:
        """Its sides in whole steps of size."""
        return math.ceil(self.size_m[0] / SIZE_STEP_M), math.ceil(self.size_m[1] / SIZE_STEP_M)


def occupied_regions(scenario: "Scenario") -> dict[int, tuple[Track, ...]]:
    """Bounding tracks of all dynamic obstacles without a trajectory, by their id in ascending order.

    Each track has an id of its own below zero. One obstacle's tracks cover all its occupancies at every step. Phantom
    obstacles are left out: nobody knows whether they exist.
    """
    found = {
        int(obstacle.obstacle_id): _tracks(obstacle, float(scenario.dt))
        for obstacle in scenario.dynamic_obstacles
        if getattr(obstacle.prediction, "trajectory", None) is None
    }
    return dict(sorted(found.items()))


def obstacle_of(track_id: int) -> int:
    """The id of the obstacle that a track stands for, which is the track's own unless it is of an occupied region."""
    return track_id if track_id >= 0 else -track_id // PIECES_PER_OBSTACLE


def _tracks(obstacle: "DynamicObstacle", step_s: float) -> tuple[Track, ...]:
    key, kind = int(obstacle.obstacle_id), str(obstacle.obstacle_type.value)
    pieces = [piece for chain in _chains(obstacle) for piece in _pieces(chain)]
    return tuple(
        Track(
            obstacle_id=-(key * PIECES_PER_OBSTACLE + number),
            kind=kind,
            length_m=max(box.size_m[0] for box in piece),
            width_m=max(box.size_m[1] for box in piece),
            first_step=piece[0].step,
            positions=np.array([box.center for box in piece]),
            headings_rad=np.array([box.heading_rad for box in piece]),
            speeds_mps=_speeds(piece, following, step_s),
        )
        for number, (piece, following) in enumerate(pieces)
    )


def _chains(obstacle: "DynamicObstacle") -> Iterator[list[_Box]]:
    """The rectangles of each part of an obstacle's occupancies, by step."""
    first = int(obstacle.initial_state.time_step)
    parts = {first: _parts(obstacle.occupancy_at_time(first).shape)}
    for occupancy in getattr(obstacle.prediction, "occupancy_set", ()):
        time = occupancy.time_step
        for step in range(int(getattr(time, "start", time)), int(getattr(time, "end", time)) + 1):
            parts.setdefault(step, _parts(occupancy.shape))
    heading = middle_of(getattr(obstacle.initial_state, "orientation", 0.0))
    for number in range(max(map(len, parts.values()))):
        shapes = [(step, parts[step][number]) for step in sorted(parts) if number < len(parts[step])]
        yield _oriented(shapes, 0.0 if math.isnan(heading) else heading)


def _parts(shape: Any) -> list[Any]:
    return list(getattr(shape, "shapes", None) or [shape])


def _oriented(shapes: list[tuple[int, Any]], heading_rad: float) -> list[_Box]:
    """Rectangles that point where their centre moves, or on as before where it stands."""
    boxes: list[_Box] = []
    for step, shape in shapes:
        center, side_rad, size = _rectangle(shape, heading_rad)
        if boxes and math.dist(center, boxes[-1].center) > MOVED_M:
            before = boxes[-1].center
            heading_rad = math.atan2(center[1] - before[1], center[0] - before[0])
        quarters = round(wrap_angle(heading_rad - side_rad) / (math.pi / 2))
        turned = size if quarters % 2 == 0 else (size[1], size[0])
        boxes.append(_Box(step, center, wrap_angle(side_rad + quarters * math.pi / 2), turned))
    return boxes


def _rectangle(shape: Any, heading_rad: float) -> tuple[tuple[float, float], float, tuple[float, float]]:
    """Centre in m, direction of one side in rad, and the sides in m (that one first) of a rectangle around a shape."""
    if hasattr(shape, "length"):
        x, y = center_of(shape)
        return (float(x), float(y)), float(shape.orientation), size_of(shape)
    if hasattr(shape, "radius"):
        x, y = center_of(shape)
        return (float(x), float(y)), heading_rad, size_of(shape)
    corners = np.asarray(shape.shapely_object.minimum_rotated_rectangle.exterior.coords)[:4]
    along, across = corners[1] - corners[0], corners[2] - corners[1]
    x, y = corners.mean(axis=0)
    size = float(np.linalg.norm(along)), float(np.linalg.norm(across))
    return (float(x), float(y)), math.atan2(along[1], along[0]), size


def _pieces(chain: list[_Box]) -> Iterator[tuple[list[_Box], _Box | None]]:
    """A chain cut where steps are missing or the size changes, each piece with the rectangle that follows it."""
    begin = 0
    for index, box in enumerate(chain):
        following = chain[index + 1] if index + 1 < len(chain) else None
        if following is None or following.step != box.step + 1 or following.size_class != box.size_class:
            yield chain[begin : index + 1], following
            begin = index + 1


def _speeds(piece: list[_Box], following: _Box | None, step_s: float) -> Values:
    """How fast the centres move, in m/s; the last one as fast as the one before where nothing follows."""
    onward = [*piece, following] if following is not None else piece
    centers, steps = np.array([box.center for box in onward]), np.array([box.step for box in onward])
    if len(onward) == 1:
        return np.zeros(1)
    speeds = np.linalg.norm(np.diff(centers, axis=0), axis=1) / (np.diff(steps) * step_s)
    return speeds if following is not None else np.append(speeds, speeds[-1])


# ---------- scene
# A scenario made ready for edits: its lanes as a SUMO network, its vehicles on their lanelets, its ego.

NOT_DRIVEN = ("pedestrian",)
"""Obstacle types that SUMO's vehicles cannot stand for: they are replayed, never driven."""


@dataclass(frozen=True)
class Ego:
    """A planning problem's start, the middle of an uncertain one.

    The centre (2,) in m, heading in rad, speed, and the lanelets there (best first).
    """

    problem_id: int
    step: int
    position: Points
    heading_rad: float
    speed_mps: float
    lanelets: tuple[int, ...]


@dataclass(frozen=True)
class _Region:
    """A bounding track of an obstacle that is given by occupancies, and its lanelets; None where it is near none."""

    obstacle_id: int
    track: Track
    match: LaneMatch | None


@dataclass(frozen=True)
class Scene:
    """The base scenario of an edit; nothing here changes while edits are applied.

    ``tracks``: recorded vehicles that move by a trajectory, by id. ``standing``: static obstacles as tracks of one
    pose. ``matches``: the lanelets of each track that was found near any. ``regions``: dynamic obstacles without a
    trajectory, which are in the way of all others.
    """

    loaded: LoadedScenario
    layout: NetLayout
    matcher: MapMatcher
    tracks: dict[int, Track]
    standing: dict[int, Track]
    matches: dict[int, LaneMatch]
    last_step: int
    ego: Ego | None
    regions: tuple[_Region, ...] = ()

    @classmethod
    def of(
        cls, loaded: LoadedScenario, recorded: dict[int, Track] | None = None, problem_id: int | None = None
    ) -> "Scene":
        """Lay out the network and match every recorded vehicle.

        Args:
            recorded: the tracks, where they are known.
            problem_id: the planning problem whose ego this is about; None for the first.
        """
        network = loaded.scenario.lanelet_network
        layout = NetLayout.of(network)
        matcher = MapMatcher.of(layout, network)
        tracks = recorded_tracks(loaded.scenario) if recorded is None else recorded
        last = last_recorded_step(loaded.scenario)
        standing = _standing(loaded, last)
        matches = matcher.match_all(tracks | standing)
        ego, regions = _ego(loaded, matcher, problem_id), _regions(loaded, matcher)
        return cls(loaded, layout, matcher, tracks, standing, matches, last, ego, regions)

    @property
    def step_s(self) -> float:
        """Duration of a time step in s."""
        return self.loaded.step_s

    @property
    def network(self) -> "LaneletNetwork":
        """The lanelet network of the file."""
        return self.loaded.scenario.lanelet_network

    @cached_property
    def edge_graph(self) -> EdgeGraph:
        """Routes of edges."""
        return EdgeGraph(self.layout)

    @cached_property
    def lanelet_graph(self) -> LaneletGraph:
        """What can be reached from where."""
        return LaneletGraph.of(self.network)

    @cached_property
    def driven_graph(self) -> LaneletGraph:
        """What SUMO's vehicles can reach from where: they keep their lanes inside junctions."""
        outside, graph = self.layout.lane_of, self.lanelet_graph
        beside = {k: tuple(n for n in near if k in outside and n in outside) for k, near in graph.neighbours.items()}
        return replace(graph, neighbours=beside)

    def graph_from_inside(self, start: int) -> LaneletGraph:
        """The same for a vehicle on a lanelet inside a junction, which may steer over to those beside it there."""
        outside, graph = self.layout.lane_of, self.lanelet_graph
        beside = {key: graph.neighbours[key] for key in graph.beside([start]) if key not in outside}
        return replace(graph, neighbours={**self.driven_graph.neighbours, **beside})

    @cached_property
    def straight_speeds_mps(self) -> dict[int, float]:
        """Speed of every drivable lanelet but for its bends: posted or usual, raised where somebody was faster."""
        fastest: dict[int, float] = {}
        for key, match in self.matches.items():
            track = self.tracks.get(key)
            for index, lanelet in zip(match.indices, match.lanelets, strict=True):
                speed = float(track.speeds_mps[index]) if track else 0.0
                fastest[lanelet] = max(fastest.get(lanelet, 0.0), speed)
        return straight_speeds(self.layout, fastest, posted_speeds(self.network))

    @cached_property
    def lane_speeds_mps(self) -> dict[int, float]:
        """The speed that the sharpest bend of every drivable lanelet takes, where that is less."""
        return lowered_by_curves(self.layout, self.straight_speeds_mps)

    @cached_property
    def slow_places(self) -> dict[str, SlowPlaces]:
        """SUMO's lanes whose lanelet is long: where they bend. A driven vehicle is slowed there, and not all along."""
        straight, lanes = self.straight_speeds_mps, self.layout.table.lanes
        return {
            f"{edge}_{index}": slow_places(lanes[key].center, straight[key], self._recorded_on(key))
            for key, (edge, index) in self.layout.lane_of.items()
            if lanes[key].length_m > LONG_LANELET_M and self.lane_speeds_mps[key] < straight[key]
        }

    def _recorded_on(self, lanelet_id: int) -> list[tuple[float, float]]:
        """Arc lengths in m on a lanelet and the speeds there of all who were recorded on it."""
        center = self.layout.table.lanes[lanelet_id].center
        return [
            (project(center, self.tracks[key].positions[index])[0], float(self.tracks[key].speeds_mps[index]))
            for key, match in self.matches.items()
            if key in self.tracks
            for index, lanelet in zip(match.indices, match.lanelets, strict=True)
            if lanelet == lanelet_id
        ]

    @cached_property
    def driven_speeds_mps(self) -> dict[int, float]:
        """Speed of every lane of SUMO's network: a long lanelet has that of its straights."""
        long = {key for lane in self.slow_places for key in self.layout.lanelets_of_lane[lane]}
        straight = self.straight_speeds_mps
        return {key: straight[key] if key in long else speed for key, speed in self.lane_speeds_mps.items()}

    @cached_property
    def signals(self) -> tuple[Signal, ...]:
        """The traffic lights."""
        return signals_of(self.network, self.step_s)

    @cached_property
    def sumo_net(self) -> str:
        """The text of SUMO's network over the lanelets."""
        return sumo_net(self.layout, self.driven_speeds_mps, self.signals)


def _ego(loaded: LoadedScenario, matcher: MapMatcher, problem_id: int | None) -> Ego | None:
    if problem_id is None and not loaded.planning_problems.planning_problem_dict:
        return None
    problem = loaded.problem(problem_id)
    state = problem.initial_state
    position, heading = np.asarray(center_of(state.position), dtype=float), middle_of(state.orientation)
    near = sorted(matcher.near(position, heading, 1.0), key=lambda found: (found[1], found[0]))
    return Ego(
        problem_id=int(problem.planning_problem_id),
        step=int(state.time_step),
        position=position,
        heading_rad=heading,
        speed_mps=middle_of(state.velocity),
        lanelets=tuple(key for key, _ in near),
    )


def _regions(loaded: LoadedScenario, matcher: MapMatcher) -> tuple[_Region, ...]:
    found = occupied_regions(loaded.scenario)
    matches = matcher.match_all({track.obstacle_id: track for tracks in found.values() for track in tracks})
    return tuple(
        _Region(key, track, matches.get(track.obstacle_id)) for key, tracks in found.items() for track in tracks
    )


def _standing(loaded: LoadedScenario, last_step: int) -> dict[int, Track]:
    found = {}
    for obstacle in sorted(loaded.scenario.static_obstacles, key=lambda obstacle: int(obstacle.obstacle_id)):
        state = obstacle.initial_state
        length, width = size_of(obstacle.obstacle_shape)
        count = last_step + 1
        found[int(obstacle.obstacle_id)] = Track(
            obstacle_id=int(obstacle.obstacle_id),
            kind=str(obstacle.obstacle_type.value),
            length_m=length,
            width_m=width,
            first_step=0,
            positions=np.repeat(np.asarray(center_of(state.position), dtype=float)[None], count, axis=0),
            headings_rad=np.full(count, middle_of(getattr(state, "orientation", 0.0))),
            speeds_mps=np.zeros(count),
        )
    return found
