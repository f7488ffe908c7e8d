"""Edit P: people on foot, along a footpath or across a road.

SUMO's vehicles do not walk: a walker moves at one speed along a given line. The vehicles that SUMO drives see him where
he is on their lane, or about to be.
"""

import math
from dataclasses import replace

import numpy as np

from plannerforge.engine.edits.changes import Changes, EditStep, Replay
from plannerforge.engine.edits.occupancy import occupant_at
from plannerforge.engine.edits.placing import Place, first_place
from plannerforge.engine.edits.road_users import check_allowed, is_footpath
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.geometry.polyline import Points, length_m, point_at, project, without_repeats
from plannerforge.engine.network.positions import station_m
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.grammar import parse_quantity
from plannerforge.schemas.modification import Edit

WALKING_MPS, RUNNING_MPS = 1.4, 4.0
SIZE_M = (0.5, 0.6)
"""Length and width of a person."""

KERB_M = 0.6


def add_walker(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Add a pedestrian: along a footpath or crossing from the place on, or across a road from right to left there.

    Raises:
        InvalidRequest: an argument that walkers have not, an impossible speed or departure.
        NotPossible: a motorway, or a place that is taken.
    """
    foreign = [name for name in ("to", "preset", "params", "count", "spacing_m") if name in edit.given]
    if foreign:
        raise InvalidRequest(
            f"{', '.join(foreign)} is for vehicles; a pedestrian walks straight on",
            valid=["at", "position", "lane", "offset_m", "speed", "time_s"],
            next_step="leave it out",
        )
    speed = WALKING_MPS if edit.speed is None else parse_quantity(edit.speed, "m/s")
    if not 0.0 <= speed <= RUNNING_MPS:
        raise InvalidRequest(
            f"a pedestrian does not walk {edit.speed}",
            valid=[f"0 … {RUNNING_MPS:g} m/s"],
            next_step="choose a slower speed",
        )
    first = round((edit.time_s or 0.0) / scene.step_s)
    if not 0 <= first < scene.last_step:
        raise InvalidRequest(
            f"departure at {edit.time_s} s is not within the scenario",
            valid=[f"0 … {(scene.last_step - 1) * scene.step_s:.1f} s"],
            next_step="choose another time_s",
        )
    line, where = _line(edit, scene, changes, stands=speed == 0.0)
    track = _walk(changes.next_id, line, speed, first, scene)
    who = occupant_at(scene, changes, track.positions[0], float(track.headings_rad[0]), SIZE_M, first)
    if who:
        raise NotPossible(f"the place is taken by {who}", next_step="choose another position or departure")
    changes = replace(changes.with_replay(Replay(track, None)), next_id=changes.next_id + 1)
    what = f"pedestrian {track.obstacle_id} {where}, {speed:.1f} m/s, from {first * scene.step_s:.1f} s on"
    return EditStep(changes, (track.obstacle_id,), what, added=(track.obstacle_id,))


def _line(edit: Edit, scene: Scene, changes: Changes, *, stands: bool) -> tuple[Points, str]:
    """The line walked along, and in words."""
    footpath = _footpath(edit, scene)
    if footpath is not None:
        return _along(edit, footpath, scene, stands=stands)
    place = first_place(edit, scene, changes, SIZE_M[0])
    check_allowed("pedestrian", place.lanelet_id, scene)
    if stands:
        (x, y), heading = place.pose(scene)
        line = np.array([(x, y), (x + np.cos(heading), y + np.sin(heading))])
        return line, _stands_on(place.lanelet_id, place.station_m)
    line = _across(scene, place)
    where = f"crosses lanelet {place.lanelet_id} at {place.station_m:.1f} m from its right"
    return line, where


def _along(edit: Edit, footpath: int, scene: Scene, *, stands: bool) -> tuple[Points, str]:
    """The line along a footpath or crossing, and in words."""
    if edit.lane not in (None, "same"):
        raise InvalidRequest(
            f"lane is relative to the ego or a vehicle; '{edit.at}' is a lanelet",
            valid=["position", "offset_m"],
            next_step="leave lane out",
        )
    center = without_repeats(np.asarray(scene.network.find_lanelet_by_id(footpath).center_vertices, dtype=float))
    last_m = length_m(center) - SIZE_M[0]
    station = station_m(edit.position or "beginning", footpath, length_m(center)) + (edit.offset_m or 0.0)
    if not 0.0 <= station <= last_m:
        raise InvalidRequest(
            f"lanelet {footpath} has no room for a pedestrian at {station:.1f} m",
            valid=[f"position='0m' … position='{math.floor(last_m * 10) / 10:g}m'"],
            next_step="choose another position",
        )
    onward = [vertex for vertex in center if project(center, vertex)[0] > station + 1e-6]
    line = np.array([point_at(center, station)[0], *onward])
    return line, _stands_on(footpath, station) if stands else f"walks along lanelet {footpath} from {station:.1f} m on"


def _stands_on(lanelet_id: int, station: float) -> str:
    return f"stands on lanelet {lanelet_id} at {station:.1f} m"


def _footpath(edit: Edit, scene: Scene) -> int | None:
    known = {int(lanelet.lanelet_id) for lanelet in scene.network.lanelets}
    text = (edit.at or "").strip()
    return int(text) if text.isdigit() and int(text) in known and is_footpath(scene, int(text)) else None


def _across(scene: Scene, place: Place) -> Points:
    """From the right edge of the road to its left edge (2, 2), past all lanes beside, kerbs included."""
    point, heading = place.pose(scene)
    left = np.array([-np.sin(heading), np.cos(heading)])
    offsets = [offset for key in _side_by_side(scene, place.lanelet_id) for offset in _bounds(scene, key, point, left)]
    return np.array([point + left * (min(offsets) - KERB_M), point + left * (max(offsets) + KERB_M)])


def _side_by_side(scene: Scene, lanelet_id: int) -> list[int]:
    """The lanelets of a road at a place, oncoming ones included."""
    found = [lanelet_id]
    for key in found:
        lanelet = scene.network.find_lanelet_by_id(key)
        found += [int(one) for one in (lanelet.adj_left, lanelet.adj_right) if one is not None and one not in found]
    return found


def _bounds(scene: Scene, lanelet_id: int, point: Points, left: Points) -> list[float]:
    """How far the bounds of a lanelet lie to the left of a point (negative: to its right)."""
    lanelet = scene.network.find_lanelet_by_id(lanelet_id)
    lines = [
        without_repeats(np.asarray(bound, dtype=float)) for bound in (lanelet.left_vertices, lanelet.right_vertices)
    ]
    return [float((point_at(line, project(line, point)[0])[0] - point) @ left) for line in lines]


def _walk(key: int, line: Points, speed_mps: float, first: int, scene: Scene) -> Track:
    """The walk until the line or the scenario ends; at no speed, standing where the line begins."""
    stations = np.arange(scene.last_step - first + 1) * scene.step_s * speed_mps
    poses = [point_at(line, float(station)) for station in stations if station <= length_m(line)]
    return Track(
        obstacle_id=key,
        kind="pedestrian",
        length_m=SIZE_M[0],
        width_m=SIZE_M[1],
        first_step=first,
        positions=np.array([point for point, _ in poses]),
        headings_rad=np.array([heading for _, heading in poses]),
        speeds_mps=np.full(len(poses), speed_mps),
    )
