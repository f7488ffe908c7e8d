"""The roles of road users in reactive traffic: which SUMO drives, which it only sees, and how the ego appears to it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ....schemas.errors import NotPossible
from ...commonroad import LoadedScenario
from ...cosimulation import Actor, Script, all_actors, lane_hint, not_drivable, recorded_plan
from ...geometry import Points, point_at, project
from ...network import NetLayout
from ...scene import MapMatcher, Scene, find_route
from ...traffic import NO_LANE, LaneHint, vehicle_type
from ...vehicles import VehicleParameters, vehicle_classes
from ..interface import EgoState
from .recorded import RecordedTraffic
from .scripted import scripts_of

if TYPE_CHECKING:
    from commonroad.planning.goal import GoalRegion

EGO = "ego"
"""SUMO's id of the ego."""
_REAR_M = 15.0
"""The ego's route starts at least this far behind its centre, enough for its longest body (chosen)."""
_AHEAD_M = 150.0
"""The ego's route extends this far behind its goal (chosen)."""
_MERGING_COST = 0.5
"""Lanelets under the ego with a smaller difference of matching costs overlap, so they merge (chosen)."""


@dataclass(frozen=True)
class TrafficRoles:
    """The road users of a reactive run by the way they move; no road user is in two groups.

    ``driven``: SUMO drives them from their first state, or from the ego's first step if that is later. Road users with
    an edited motion are not driven: they follow the edit, and the driven ones react to them. ``scripts``: those of road
    users with a motion that depends on the ego, by id. ``shown``: replayed as recorded, or scripted, and seen by the
    driven ones.
    ``replayed``: all that SUMO does not drive, whether shown or not (an obstacle off the lanes is not shown).
    """

    scene: Scene
    driven: tuple[Actor, ...]
    shown: tuple[Actor, ...]
    replayed: RecordedTraffic
    scripts: Mapping[int, Script]

    @classmethod
    def of(cls, loaded: LoadedScenario, first_step: int) -> "TrafficRoles":
        """Match all road users with the lanes and decide which are driven from the ego's first step."""
        scripts = scripts_of(loaded)
        scene = _scene(loaded, RecordedTraffic.of(loaded), scripts)
        trajectories, prescribed = loaded.tracks, loaded.prescribed_ids | scripts.keys()
        keys = [
            key
            for key, track in trajectories.items()
            if track.last_step > first_step and key not in prescribed and not not_drivable(scene, key)
        ]
        begin = {key: max(first_step, scene.tracks[key].first_step) for key in keys}
        plans = {key: recorded_plan(scene, key, "edited", begin[key]) for key in keys}
        actors = all_actors(scene, plans)
        return cls(
            scene,
            driven=tuple(actor for actor in actors if actor.drive_from is not None),
            shown=tuple(actor for actor in actors if actor.drive_from is None),
            replayed=RecordedTraffic.of(loaded, without=frozenset(keys) | scripts.keys()),
            scripts=scripts,
        )

    def keeping_to_route(self, keys: frozenset[str]) -> "TrafficRoles":
        """Return the roles with the given driven vehicles placed on their route's lanes at their start."""
        kept = tuple(replace(actor, keep_to_route=True) if actor.key in keys else actor for actor in self.driven)
        return replace(self, driven=kept)

    def vehicle_types(self, vehicle: VehicleParameters) -> list[str]:
        """Return the ``vType`` elements of all that SUMO drives or sees, including the ego's."""
        return [*(actor.vehicle_type() for actor in self.driven + self.shown), _ego_type(vehicle)]

    def ego_edges(self, goal: "GoalRegion", ego: EgoState) -> tuple[str, ...]:
        """Return the edges of the ego's route, with those before and after it.

        SUMO uses the route to find the lanes under a vehicle's rear; otherwise followers overlook it there.
        """
        network, graph = self.scene.network, self.scene.edge_graph
        try:
            lanelets = find_route(network, goal, ego.position, ego.heading_rad, ahead_m=_AHEAD_M).lanelets
        except NotPossible:
            lanelets = ()
        lanelets = tuple(key for key in lanelets if key in self.scene.layout.table.lanes)
        edges = graph.route(self._with_lanelets_before(lanelets, ego)) if lanelets else None
        if edges is None:
            return (next(iter(self.scene.layout.edges)),)
        return graph.extended(edges, lanelets[-1])

    def ego_lane(self, position: Points, heading_rad: float, speed_mps: float) -> tuple[LaneHint, float]:
        """Return SUMO's lane at a pose of the ego, ``NO_LANE`` off the lanes, and the lane's direction in rad."""
        near = self.scene.matcher.near(position, heading_rad, speed_mps)
        if not near:
            return NO_LANE, heading_rad
        lanelet = min(near, key=lambda candidate: (candidate[1], candidate[0]))[0]
        center = self.scene.layout.table.lanes[lanelet].center
        direction = point_at(center, project(center, position)[0])[1]
        return lane_hint(self.scene, lanelet), direction

    def _with_lanelets_before(self, lanelets: tuple[int, ...], ego: EgoState) -> tuple[int, ...]:
        table, route, length_m = self.scene.layout.table, list(lanelets), 0.0
        under_ego = dict(self.scene.matcher.near(ego.position, ego.heading_rad, ego.speed_mps))
        best = min(under_ego, key=lambda key: (under_ego[key], key), default=route[0])
        if len(route) > 1 and route[1] in table.successors[best]:
            route[0] = best
        while length_m < _REAR_M and (before := [k for k in table.predecessors[route[0]] if k not in route]):
            route.insert(0, self._most_likely_before(before, under_ego, ego))
            length_m += table.lanes[route[0]].length_m
        return tuple(route)

    def _most_likely_before(self, lanelets: list[int], under_ego: dict[int, float], ego: EgoState) -> int:
        """Return the best-fitting lanelet for the ego; if merging lanelets fit equally well, the one with the nearest
        vehicle.

        A follower on a lane without the ego's rear sees the ego as crossing traffic, and far too late.
        """
        costs = {key: under_ego.get(key, math.inf) for key in lanelets}
        fitting = [key for key in lanelets if costs[key] <= min(costs.values()) + _MERGING_COST]
        return min(fitting, key=lambda key: (self._nearest_driven_m(key, ego), costs[key], key))

    def _nearest_driven_m(self, lanelet: int, ego: EgoState) -> float:
        distances = [math.inf]
        for actor in self.driven:
            index = actor.track.index_at(ego.step)
            if index is not None and self.scene.matches[actor.track.obstacle_id].at(index) == lanelet:
                distances.append(float(np.linalg.norm(actor.track.positions[index] - ego.position)))
        return min(distances)


def _ego_type(vehicle: VehicleParameters) -> str:
    """Return the ego's ``vType`` element; its apparent braking determines the distance that followers keep."""
    braking = f"{min(vehicle.hardest_braking_mps2, vehicle.maximum_acceleration_mps2):g}"
    return vehicle_type(
        f"t{EGO}",
        vClass=vehicle_classes()[vehicle.vehicle_class].sumo_class,
        length=f"{vehicle.length_m:.3f}",
        width=f"{vehicle.width_m:.3f}",
        maxSpeed="70",
        decel=braking,
        emergencyDecel=braking,
        apparentDecel=braking,
    )


def _scene(loaded: LoadedScenario, recorded: RecordedTraffic, scripts: Mapping[int, Script]) -> Scene:
    """Return the scenario's lanes and obstacles, with occupancy sets as tracks of their centres.

    Scripted road users have their motion without the script.
    """
    network = loaded.scenario.lanelet_network
    layout = NetLayout.of(network)
    matcher = MapMatcher.of(layout, network)
    tracks = {track.obstacle_id: track for track in recorded.moving}
    tracks |= {key: script.base for key, script in scripts.items()}
    standing = {track.obstacle_id: track for track in recorded.standing}
    usable = {key: track for key, track in (tracks | standing).items() if np.isfinite(track.headings_rad).all()}
    last = max((track.last_step for track in tracks.values()), default=0)
    return Scene(loaded, layout, matcher, tracks, standing, matcher.match_all(dict(sorted(usable.items()))), last, None)
