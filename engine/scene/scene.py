"""A scenario prepared for edits and simulation: lanes as a SUMO network, vehicles on their lanelets, the ego."""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from ..commonroad import LoadedScenario, MadeOnce, Track, center_of, last_recorded_step, middle_of, static_tracks
from ..geometry import Points, project
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
from ..vehicles import VehicleParameters, ego_class
from .edge_routes import EdgeGraph
from .map_matching import LaneMatch, MapMatcher
from .occupancies import occupied_regions
from .poses import lanelets_of_pose

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

_MOST_MADE = 4000
"""What scenes keep of single tracks (chosen): a scenario has up to some hundreds of tracks, each on a few lanelets."""
NOT_DRIVEN = ("pedestrian",)
"""Obstacle types that SUMO's vehicles cannot represent: they are replayed, never driven."""


@dataclass(frozen=True)
class Ego:
    """A planning problem's start; if it is uncertain, the middle of its range.

    It has the centre (2,) in m, heading in rad, speed, the lanelets at the start (best fit first), the class of
    vehicle, and the coefficient of friction of the road (None if the file does not state it).
    """

    problem_id: int
    step: int
    position: Points
    heading_rad: float
    speed_mps: float
    lanelets: tuple[int, ...]
    vehicle_class: str = "car"
    friction: float | None = None

    @property
    def vehicle(self) -> VehicleParameters:
        """The size and limits of the ego's class, on the road of the scenario."""
        return ego_class(self.vehicle_class).vehicle.on_road(self.friction)

    @property
    def size_m(self) -> tuple[float, float]:
        """The length and width in m."""
        return self.vehicle.size_m


@dataclass(frozen=True)
class _Region:
    """A bounding track of an obstacle given by occupancies, and its lanelets; None if it is not near any lanelet."""

    obstacle_id: int
    track: Track
    match: LaneMatch | None


@dataclass(frozen=True)
class Scene:
    """A recorded scenario ready to be edited and simulated; it does not change while edits are applied.

    :meth:`of` sets these attributes. ``loaded``: the file as commonroad-io reads it. ``layout``: its drivable lanelets
    as SUMO's edges, lanes and paths through junctions. ``matcher``: for queries by position. ``tracks``: recorded
    vehicles with a trajectory, by id. ``standing``: static obstacles as tracks of one pose. ``regions``: dynamic
    obstacles without a trajectory as bounding tracks, which block all other road users. ``matches``: the lanelets of
    each moving or standing track that is near any. ``last_step``: the recording's last step; without moving road users,
    the last step of the goal. ``ego``: the start of the planning problem, or None.

    Computed on first use and cached: the graphs (``lanelet_graph``, ``driven_graph``, ``edge_graph``), the speeds of
    lanes, which are posted or usual speeds raised to the recorded ones (``straight_speeds_mps``, ``lane_speeds_mps``,
    ``driven_speeds_mps``, ``slow_places``), the traffic lights (``signals``) and SUMO's network (``sumo_net``).
    ``made``: what is derived from the roads and from single tracks. Scenes after edits share it.
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
    made: MadeOnce = field(default_factory=lambda: MadeOnce(_MOST_MADE), repr=False, compare=False)

    @classmethod
    def of(cls, loaded: LoadedScenario, problem_id: int | None = None) -> "Scene":
        """Lay out the network and match every recorded vehicle.

        Args:
            loaded: the scenario, which is kept.
            problem_id: the planning problem of the ego; None for the first.
        """
        network = loaded.scenario.lanelet_network
        layout = NetLayout.of(network)
        matcher = MapMatcher.of(layout, network)
        tracks = loaded.tracks
        last = last_recorded_step(loaded.scenario) or _last_goal_step(loaded)
        standing = static_tracks(loaded.scenario, last)
        matches = matcher.match_all(tracks | standing)
        ego, regions = _ego(loaded, matcher, problem_id), _regions(loaded, matcher)
        return cls(loaded, layout, matcher, tracks, standing, matches, last, ego, regions)

    @property
    def step_s(self) -> float:
        """The duration of a time step in s."""
        return self.loaded.step_s

    @property
    def friction(self) -> float | None:
        """The coefficient of friction of the roads; None if the file does not state it."""
        return self.loaded.friction

    @property
    def network(self) -> "LaneletNetwork":
        """The lanelet network of the file."""
        return self.loaded.scenario.lanelet_network

    @cached_property
    def edge_graph(self) -> EdgeGraph:
        """The graph of SUMO's edges, for routes."""
        return self.made.get("edge graph", lambda: EdgeGraph(self.layout))

    @cached_property
    def lanelet_graph(self) -> LaneletGraph:
        """The graph of the lanelets, with successors and lane changes."""
        return self.made.get("lanelet graph", lambda: LaneletGraph.of(self.network))

    @cached_property
    def driven_graph(self) -> LaneletGraph:
        """The graph of the lanelets for SUMO's vehicles, which keep their lanes inside junctions."""
        return self.made.get("driven graph", self._driven_graph)

    def _driven_graph(self) -> LaneletGraph:
        outside, graph = self.layout.lane_of, self.lanelet_graph
        neighbours = {
            k: tuple(n for n in near if k in outside and n in outside) for k, near in graph.neighbours.items()
        }
        return replace(graph, neighbours=neighbours)

    def graph_from_inside(self, start: int) -> LaneletGraph:
        """Return ``driven_graph``, extended by lane changes for a vehicle that is inside a junction."""
        outside, graph = self.layout.lane_of, self.lanelet_graph
        inside = {key: graph.neighbours[key] for key in graph.parallel_lanes([start]) if key not in outside}
        return replace(graph, neighbours={**self.driven_graph.neighbours, **inside})

    @cached_property
    def straight_speeds_mps(self) -> dict[int, float]:
        """The speed in m/s of each drivable lanelet without curves: posted or usual, raised to the recorded speed."""
        fastest: dict[int, float] = {}
        for key, match in self.matches.items():
            track = self.tracks.get(key)
            for index, lanelet in zip(match.indices, match.lanelets, strict=True):
                speed = float(track.speeds_mps[index]) if track else 0.0
                fastest[lanelet] = max(fastest.get(lanelet, 0.0), speed)
        return straight_speeds(self.layout, fastest, posted_speeds(self.network))

    @cached_property
    def lane_speeds_mps(self) -> dict[int, float]:
        """The speed of every drivable lanelet, lowered to the speed of its sharpest curve if that is less."""
        unlimited = dict.fromkeys(self.layout.table.lanes, math.inf)
        in_curves = self.made.get("speeds in curves", lambda: lowered_by_curves(self.layout, unlimited, self.friction))
        return {key: min(speed, in_curves[key]) for key, speed in self.straight_speeds_mps.items()}

    @cached_property
    def slow_places(self) -> dict[str, SlowPlaces]:
        """The curves of SUMO's lanes of long lanelets, by lane id: driven vehicles are slowed only in these curves."""
        straight, lanes = self.straight_speeds_mps, self.layout.table.lanes
        return {
            f"{edge}_{index}": self._slow_places_on(key, straight[key], tuple(self._recorded_on(key)))
            for key, (edge, index) in self.layout.lane_of.items()
            if lanes[key].length_m > LONG_LANELET_M and self.lane_speeds_mps[key] < straight[key]
        }

    def _slow_places_on(
        self, lanelet_id: int, straight_mps: float, recorded: tuple[tuple[float, float], ...]
    ) -> SlowPlaces:
        return self.made.get(
            ("slow places", lanelet_id, straight_mps, recorded),
            lambda: slow_places(self.layout.table.lanes[lanelet_id].center, straight_mps, recorded, self.friction),
        )

    def _recorded_on(self, lanelet_id: int) -> list[tuple[float, float]]:
        """Return arc lengths in m on a lanelet, and the recorded speeds of vehicles at them."""
        found = []
        for key, match in self.matches.items():
            if key in self.tracks and lanelet_id in match.lanelets:
                track = self.tracks[key]
                known = ("speeds", lanelet_id, id(track), id(match))
                found += self.made.get(known, partial(self._speeds_on, lanelet_id, track, match), track, match)
        return found

    def _speeds_on(self, lanelet_id: int, track: Track, match: LaneMatch) -> list[tuple[float, float]]:
        center = self.layout.table.lanes[lanelet_id].center
        return [
            (project(center, track.positions[index])[0], float(track.speeds_mps[index]))
            for index, lanelet in zip(match.indices, match.lanelets, strict=True)
            if lanelet == lanelet_id
        ]

    @cached_property
    def driven_speeds_mps(self) -> dict[int, float]:
        """The speed of every lane of SUMO's network: a long lanelet has the speed of its straights."""
        long = {key for lane in self.slow_places for key in self.layout.lanelets_of_lane[lane]}
        straight = self.straight_speeds_mps
        return {key: straight[key] if key in long else speed for key, speed in self.lane_speeds_mps.items()}

    @cached_property
    def signals(self) -> tuple[Signal, ...]:
        """The traffic lights."""
        return signals_of(self.network, self.step_s)

    @cached_property
    def sumo_net(self) -> str:
        """The XML text of SUMO's network for the lanelets."""
        return sumo_net(self.layout, self.driven_speeds_mps, self.signals)


def _last_goal_step(loaded: LoadedScenario) -> int:
    """Return the last step of any goal, which is the end of a scenario without moving road users; 0 without a goal."""
    problems = loaded.planning_problems.planning_problem_dict.values()
    steps = [getattr(state, "time_step", 0) for problem in problems for state in problem.goal.state_list]
    return max((int(getattr(step, "end", step)) for step in steps), default=0)


def _ego(loaded: LoadedScenario, matcher: MapMatcher, problem_id: int | None) -> Ego | None:
    if problem_id is None and not loaded.planning_problems.planning_problem_dict:
        return None
    problem = loaded.problem(problem_id)
    state = problem.initial_state
    position, heading = np.asarray(center_of(state.position), dtype=float), middle_of(state.orientation)
    on = lanelets_of_pose(loaded.scenario.lanelet_network, position, heading)
    return Ego(
        problem_id=int(problem.planning_problem_id),
        step=int(state.time_step),
        position=position,
        heading_rad=heading,
        speed_mps=middle_of(state.velocity),
        lanelets=tuple(key for key in on if key in matcher.layout.table.lanes),
        vehicle_class=loaded.ego_class(int(problem.planning_problem_id)),
        friction=loaded.friction,
    )


def _regions(loaded: LoadedScenario, matcher: MapMatcher) -> tuple[_Region, ...]:
    regions = occupied_regions(loaded.scenario)
    matches = matcher.match_all({track.obstacle_id: track for tracks in regions.values() for track in tracks})
    return tuple(
        _Region(key, track, matches.get(track.obstacle_id)) for key, tracks in regions.items() for track in tracks
    )
