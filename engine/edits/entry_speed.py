"""How fast an added vehicle enters when the request leaves it open: with the traffic around it, and able to stop."""

import math

from plannerforge.engine.edits.changes import Changes
from plannerforge.engine.edits.placing import Place
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.geometry.polyline import project
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.engine.traffic.vehicle_classes import VehicleClass

SHARE_OF_LANE_SPEED = 0.8
LOOK_M = 60.0


def entry_speed(scene: Scene, changes: Changes, vehicle_class: VehicleClass, place: Place, step: int) -> float:
    """Speed in m/s: 80 % of the lane's, or that of the nearest vehicle in the lane, never too fast for the leader."""
    limit = min(SHARE_OF_LANE_SPEED * scene.lane_speeds_mps[place.lanelet_id], vehicle_class.maximum_speed_mps)
    neighbours = _same_lane(scene, changes, place, step)
    if not neighbours:
        return limit
    nearest = min(neighbours, key=lambda found: (abs(found[0]), found[0]))
    speed = min(nearest[1], limit) if abs(nearest[0]) < LOOK_M else limit
    leaders = [found for found in neighbours if found[0] > 0]
    if leaders:
        gap, leader_speed, leader_length = min(leaders)
        free = max(gap - (leader_length + vehicle_class.length_m) / 2 - vehicle_class.minimum_gap_m, 0.0)
        speed = min(speed, math.sqrt(leader_speed**2 + 2 * vehicle_class.deceleration_mps2 * free))
    return speed


def _same_lane(scene: Scene, changes: Changes, place: Place, step: int) -> list[tuple[float, float, float]]:
    """Vehicles in the lane or right after it: distance along the lane (ahead positive), speed, length."""
    lanes = scene.layout.table.lanes
    starts = {place.lanelet_id: 0.0}
    for after in scene.layout.table.successors[place.lanelet_id]:
        starts[after] = lanes[place.lanelet_id].length_m
    found = []
    for key, match in sorted(scene.matches.items()):
        track: Track | None = scene.tracks.get(key) or scene.standing.get(key)
        index = track.index_at(step) if track else None
        if track is None or index is None or key in changes.removed or match.at(index) not in starts:
            continue
        lanelet = match.at(index)
        station, _ = project(lanes[lanelet].center, track.positions[index])
        distance = starts[lanelet] + station - place.station_m
        found.append((distance, float(track.speeds_mps[index]), track.length_m))
    return found
