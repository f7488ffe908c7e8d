"""How fast an added vehicle enters when the request leaves it open: with the traffic around it, able to brake."""

import math
from dataclasses import dataclass

from plannerforge.engine.edits.altered_scene import populated
from plannerforge.engine.edits.braking_reach import gets_onto, stopping_way_m
from plannerforge.engine.edits.changes import Changes
from plannerforge.engine.edits.placing import Place
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.turn_speed import highest_entry_speed
from plannerforge.engine.geometry.polyline import project
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.engine.traffic.vehicle_classes import VehicleClass
from plannerforge.schemas.errors import NotPossible

SHARE_OF_LANE_SPEED = 0.8
LOOK_M = 60.0


@dataclass(frozen=True)
class _Neighbour:
    """A vehicle in the lane: how far ahead of the place its centre is (behind negative), its speed, and its length.

    ``is_parked``: it never moves.
    """

    vehicle_id: int
    distance_m: float
    speed_mps: float
    length_m: float
    is_parked: bool = False

    def gap_m(self, vehicle_class: VehicleClass) -> float:
        """The room between the bumpers."""
        return max(abs(self.distance_m) - (self.length_m + vehicle_class.length_m) / 2, 0.0)


def entry_speed(
    scene: Scene, changes: Changes, vehicle_class: VehicleClass, place: Place, step: int, way: tuple[int, ...]
) -> float:
    """Speed in m/s: 80 % of the lane's, or that of the nearest vehicle in the lane; parked ones are no traffic.

    Never too fast for the leader, parked or not, nor for the bends of the way, which begins with the place's lanelet.

    Raises:
        NotPossible: the vehicle behind would run into it, even if it brakes as hard as it can.
    """
    fastest = min(vehicle_class.maximum_speed_mps, highest_entry_speed(scene, way, place.station_m))
    usual = min(SHARE_OF_LANE_SPEED * scene.driven_speeds_mps[place.lanelet_id], fastest)
    neighbours = _same_lane(scene, changes, place, step)
    traffic = [one for one in neighbours if not one.is_parked and abs(one.distance_m) < LOOK_M]
    nearest = min(traffic, key=lambda one: (abs(one.distance_m), one.distance_m), default=None)
    speed = usual if nearest is None else min(nearest.speed_mps, fastest)
    leaders = [one for one in neighbours if one.distance_m > 0]
    if leaders:
        leader = min(leaders, key=lambda one: one.distance_m)
        free = max(leader.gap_m(vehicle_class) - vehicle_class.minimum_gap_m, 0.0)
        speed = min(speed, math.sqrt(leader.speed_mps**2 + 2 * vehicle_class.deceleration_mps2 * free))
    followers = [one for one in neighbours if one.distance_m <= 0 and not one.is_parked]
    if followers:
        follower = max(followers, key=lambda one: one.distance_m)
        if _comes_along(follower, scene, changes, vehicle_class, place, step):
            _check_follower(follower, vehicle_class, place, speed)
    return speed


def _comes_along(
    follower: _Neighbour, scene: Scene, changes: Changes, vehicle_class: VehicleClass, place: Place, step: int
) -> bool:
    """Whether a vehicle behind comes over the place, and does not turn off before or brake; one that is driven may."""
    recorded = None if follower.vehicle_id in changes.driven else scene.tracks.get(follower.vehicle_id)
    if recorded is None:
        return True
    center, heading_rad = place.pose(scene)
    return gets_onto(recorded, step, center, heading_rad, (vehicle_class.length_m, vehicle_class.width_m))


def _check_follower(follower: _Neighbour, vehicle_class: VehicleClass, place: Place, speed_mps: float) -> None:
    gap = follower.gap_m(vehicle_class)
    needed = stopping_way_m(max(follower.speed_mps - speed_mps, 0.0))
    if needed > gap:
        raise NotPossible(
            f"a {vehicle_class.name} that enters lanelet {place.lanelet_id} at {place.station_m:.1f} m with "
            f"{speed_mps:.1f} m/s is hit by vehicle {follower.vehicle_id}, which comes {gap:.1f} m behind with "
            f"{follower.speed_mps:.1f} m/s and cannot brake enough",
            valid=[f"at least {needed:.0f} m before its front", "a speed, and the collision is reported"],
            next_step="choose a place farther ahead of it or behind it, or name a speed",
        )


def _same_lane(scene: Scene, changes: Changes, place: Place, step: int) -> list[_Neighbour]:
    """Vehicles in the lane, or in those right before and after it."""
    lanes = scene.layout.table.lanes
    starts = {place.lanelet_id: 0.0}
    for before in scene.lanelet_graph.predecessors.get(place.lanelet_id, ()):
        if before in lanes:
            starts[before] = -lanes[before].length_m
    for after in scene.layout.table.successors[place.lanelet_id]:
        starts[after] = lanes[place.lanelet_id].length_m
    there, found = populated(scene, changes), []
    for key, match in sorted(there.matches.items()):
        track: Track | None = there.tracks.get(key) or there.standing.get(key)
        index = track.index_at(step) if track else None
        if track is None or index is None or match.at(index) not in starts:
            continue
        lanelet = match.at(index)
        station, _ = project(lanes[lanelet].center, track.positions[index])
        distance = starts[lanelet] + station - place.station_m
        is_parked = key not in there.tracks
        found.append(_Neighbour(key, distance, float(track.speeds_mps[index]), track.length_m, is_parked))
    return found
