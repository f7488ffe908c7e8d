"""Who takes part in reactive traffic: whom SUMO drives, whom it only sees, and how the ego looks to it."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np

from plannerforge.engine.edits.changes import not_drivable, recorded_plan
from plannerforge.engine.edits.lane_matching import LaneMatcher
from plannerforge.engine.edits.participants import Hint, Participant, participants
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.geometry.polyline import Points, point_at, project
from plannerforge.engine.network.sumo_net_layout import NetLayout
from plannerforge.engine.network.sumo_net_writer import write_sumo_net
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.route import find_route
from plannerforge.engine.planners.traffic import RecordedTraffic
from plannerforge.engine.planners.vehicle import VehicleParameters
from plannerforge.engine.scenarios.reader import LoadedScenario
from plannerforge.engine.scenarios.tracks import recorded_tracks
from plannerforge.schemas.errors import NotPossible

if TYPE_CHECKING:
    from commonroad.planning.goal import GoalRegion

EGO = "ego"
REAR_M = 15.0
AHEAD_M = 150.0
EGO_DECELERATION_MPS2 = 8.0
MERGING_COST = 0.5
"""Lanelets under the ego whose matching costs differ by less lie on one another: they merge."""


@dataclass(frozen=True)
class Cast:
    """The road users of a reactive run by how they move; none is in two groups.

    ``driven``: SUMO drives them from their first state, or from the ego's first step if that is later.
    ``shown``: replayed as recorded and seen by the driven ones. ``replayed``: all that SUMO does not drive, shown or
    not (an obstacle off the lanes is not).
    """

    scene: Scene
    driven: tuple[Participant, ...]
    shown: tuple[Participant, ...]
    replayed: RecordedTraffic

    @classmethod
    def of(cls, loaded: LoadedScenario, first_step: int) -> "Cast":
        """Match everybody with the lanes and decide who is driven."""
        everybody = RecordedTraffic(loaded.scenario)
        scene = _scene(loaded, everybody)
        trajectories = recorded_tracks(loaded.scenario)
        keys = [
            key for key, track in trajectories.items() if track.last_step > first_step and not not_drivable(scene, key)
        ]
        begin = {key: max(first_step, scene.tracks[key].first_step) for key in keys}
        plans = {key: recorded_plan(scene, key, "edited", begin[key]) for key in keys}
        cast = participants(scene, plans)
        return cls(
            scene,
            driven=tuple(one for one in cast if one.drive_from is not None),
            shown=tuple(one for one in cast if one.drive_from is None),
            replayed=RecordedTraffic(loaded.scenario, without=frozenset(keys)),
        )

    def write_net(self, path: Path) -> None:
        """Write SUMO's network, fast enough for the recorded speeds."""
        write_sumo_net(self.scene.layout, self.scene.lane_speeds_mps, path)

    def keeping_to_route(self, keys: frozenset[str]) -> "Cast":
        """The cast with some driven vehicles put onto their route's lanes when they begin."""
        kept = tuple(replace(one, keep_to_route=True) if one.key in keys else one for one in self.driven)
        return replace(self, driven=kept)

    def ego_edges(self, goal: "GoalRegion", ego: EgoState) -> tuple[str, ...]:
        """The edges of the ego's route with those before and after it.

        SUMO finds by its route which lanes a vehicle's rear still stands on; followers overlook it there otherwise.
        """
        network, graph = self.scene.network, self.scene.edge_graph
        try:
            lanelets = find_route(network, goal, ego.position, ego.heading_rad, ahead_m=AHEAD_M).lanelets
        except NotPossible:
            lanelets = ()
        lanelets = tuple(key for key in lanelets if key in self.scene.layout.table.lanes)
        edges = graph.route(self._with_lanelets_before(lanelets, ego)) if lanelets else None
        if edges is None:
            return (next(iter(self.scene.layout.edges)),)
        return graph.extended(edges, lanelets[-1])

    def _with_lanelets_before(self, lanelets: tuple[int, ...], ego: EgoState) -> tuple[int, ...]:
        table, found, length_m = self.scene.layout.table, list(lanelets), 0.0
        under_ego = dict(self.scene.matcher.near(ego.position, ego.heading_rad, ego.speed_mps))
        best = min(under_ego, key=lambda key: (under_ego[key], key), default=found[0])
        if len(found) > 1 and found[1] in table.successors[best]:
            found[0] = best
        while length_m < REAR_M and (before := [k for k in table.predecessors[found[0]] if k not in found]):
            found.insert(0, self._most_likely_before(before, under_ego, ego))
            length_m += table.lanes[found[0]].length_m
        return tuple(found)

    def _most_likely_before(self, lanelets: list[int], under_ego: dict[int, float], ego: EgoState) -> int:
        """The one that the ego fits best; of several that merge and fit as well, the one with the nearest vehicle.

        A follower on a lane that the ego's rear does not stand on sees the ego as crossing traffic, and far too late.
        """
        costs = {key: under_ego.get(key, math.inf) for key in lanelets}
        fitting = [key for key in lanelets if costs[key] <= min(costs.values()) + MERGING_COST]
        return min(fitting, key=lambda key: (self._nearest_driven_m(key, ego), costs[key], key))

    def _nearest_driven_m(self, lanelet: int, ego: EgoState) -> float:
        gaps = [math.inf]
        for one in self.driven:
            index = one.track.index_at(ego.step)
            if index is not None and self.scene.matches[one.track.obstacle_id].at(index) == lanelet:
                gaps.append(float(np.linalg.norm(one.track.positions[index] - ego.position)))
        return min(gaps)

    def ego_lane(self, position: Points, heading_rad: float, speed_mps: float) -> tuple[Hint, float]:
        """SUMO's edge and lane at a pose of the ego, ("", -1) off the lanes, and the lane's direction in rad."""
        near = self.scene.matcher.near(position, heading_rad, speed_mps)
        if not near:
            return ("", -1), heading_rad
        lanelet = min(near, key=lambda found: (found[1], found[0]))[0]
        center = self.scene.layout.table.lanes[lanelet].center
        direction = point_at(center, project(center, position)[0])[1]
        if lanelet in self.scene.layout.lane_of:
            return self.scene.layout.lane_of[lanelet], direction
        way = self.scene.edge_graph.path_for(lanelet, ())
        return ("", -1) if way is None else (self.scene.layout.internal_edge_of_path[way], 0), direction


def first_index(one: Participant) -> int:
    """Index of the state from which a driven vehicle is driven on."""
    return (one.drive_from or 0) - one.track.first_step


def ego_type(vehicle: VehicleParameters) -> str:
    """The ego's ``vType`` element; its apparent braking tells followers how much distance to keep."""
    attributes = {
        "id": f"t{EGO}",
        "length": f"{vehicle.length_m:.3f}",
        "width": f"{vehicle.width_m:.3f}",
        "maxSpeed": "70",
        "decel": f"{EGO_DECELERATION_MPS2:g}",
        "emergencyDecel": f"{EGO_DECELERATION_MPS2:g}",
        "apparentDecel": f"{EGO_DECELERATION_MPS2:g}",
    }
    return f"<vType {' '.join(f'{name}={quoteattr(value)}' for name, value in attributes.items())}/>"


def _scene(loaded: LoadedScenario, everybody: RecordedTraffic) -> Scene:
    """The scenario's lanes and all its obstacles, occupancy sets as tracks of their centres."""
    network = loaded.scenario.lanelet_network
    layout = NetLayout.of(network)
    matcher = LaneMatcher.of(layout, network)
    tracks = {track.obstacle_id: track for track in everybody.moving}
    standing = {track.obstacle_id: track for track in everybody.standing}
    usable = {key: track for key, track in (tracks | standing).items() if np.isfinite(track.headings_rad).all()}
    matches = {key: matcher.match(track) for key, track in sorted(usable.items())}
    last = max((track.last_step for track in tracks.values()), default=0)
    found = {key: match for key, match in matches.items() if match is not None}
    return Scene(loaded, layout, matcher, tracks, standing, found, last, None)
