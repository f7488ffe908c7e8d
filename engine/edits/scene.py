"""A scenario made ready for edits: its lanes as a SUMO network, its vehicles on their lanelets, its ego."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.edits.edge_routes import EdgeGraph
from plannerforge.engine.edits.lane_matching import LaneMatch, LaneMatcher
from plannerforge.engine.edits.occupied_regions import occupied_regions
from plannerforge.engine.geometry.polyline import Points, project
from plannerforge.engine.network.lanelet_graph import LaneletGraph
from plannerforge.engine.network.sumo_net_layout import NetLayout
from plannerforge.engine.network.sumo_net_signals import Signal, signals_of
from plannerforge.engine.network.sumo_net_speeds import (
    LONG_M,
    SlowPlaces,
    lowered_by_bends,
    posted_speeds,
    slow_places,
    straight_speeds,
)
from plannerforge.engine.network.sumo_net_writer import sumo_net
from plannerforge.engine.scenarios.reader import LoadedScenario
from plannerforge.engine.scenarios.tracks import (
    Track,
    center_of,
    last_recorded_step,
    middle_of,
    recorded_tracks,
    size_of,
)

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

NOT_DRIVEN = ("pedestrian",)
"""Obstacle types that SUMO's vehicles cannot stand for: they are replayed, never driven."""

EGO_SIZE_M = (4.508, 1.61)
"""Length and width of CommonRoad's vehicle 2 (BMW 320i), which stands for the ego."""


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
class Region:
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
    matcher: LaneMatcher
    tracks: dict[int, Track]
    standing: dict[int, Track]
    matches: dict[int, LaneMatch]
    last_step: int
    ego: Ego | None
    regions: tuple[Region, ...] = ()

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
        matcher = LaneMatcher.of(layout, network)
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
        return lowered_by_bends(self.layout, self.straight_speeds_mps)

    @cached_property
    def slow_places(self) -> dict[str, SlowPlaces]:
        """SUMO's lanes whose lanelet is long: where they bend. A driven vehicle is slowed there, and not all along."""
        straight, lanes = self.straight_speeds_mps, self.layout.table.lanes
        return {
            f"{edge}_{index}": slow_places(lanes[key].center, straight[key], self._recorded_on(key))
            for key, (edge, index) in self.layout.lane_of.items()
            if lanes[key].length_m > LONG_M and self.lane_speeds_mps[key] < straight[key]
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


def _ego(loaded: LoadedScenario, matcher: LaneMatcher, problem_id: int | None) -> Ego | None:
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


def _regions(loaded: LoadedScenario, matcher: LaneMatcher) -> tuple[Region, ...]:
    found = occupied_regions(loaded.scenario)
    matches = matcher.match_all({track.obstacle_id: track for tracks in found.values() for track in tracks})
    return tuple(
        Region(key, track, matches.get(track.obstacle_id)) for key, tracks in found.items() for track in tracks
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
