"""Whether a place is free for a vehicle at a time step, and where the nearest free one is."""

from collections.abc import Iterable, Iterator

import numpy as np

from plannerforge.engine.edits.altered_scene import populated
from plannerforge.engine.edits.changes import Changes
from plannerforge.engine.edits.placing import Place
from plannerforge.engine.edits.scene import EGO_SIZE_M, Scene
from plannerforge.engine.geometry.polyline import Points, oriented_rectangle, rectangles_overlap

CLEARANCE_M = 0.3
SEARCH_STEP_M = 1.0
FREE_PLACES_NAMED = 3
NEAR_M = 40.0
"""Vehicles whose centres are farther apart do not touch."""

Body = tuple[str, Points, Points]
"""Name, centre (2,) and corners (4, 2)."""


def occupant(scene: Scene, changes: Changes, place: Place, size_m: tuple[float, float], step: int) -> str:
    """Who stands where a vehicle (length, width) would be put at a step; empty if the place is free."""
    center, heading = place.pose(scene)
    return occupant_at(scene, changes, center, heading, size_m, step)


def occupant_at(
    scene: Scene, changes: Changes, center: Points, heading: float, size_m: tuple[float, float], step: int
) -> str:
    """The same for a centre (2,) in m and a heading in rad."""
    return _in_the_way(center, heading, size_m, _bodies(scene, changes, step))


def free_places(scene: Scene, changes: Changes, place: Place, size_m: tuple[float, float], step: int) -> list[str]:
    """The nearest free places, as ``at`` and ``position``, nearest first: in the lane, else in those next to it."""
    lane, table = scene.layout.table.lanes[place.lanelet_id], scene.layout.table
    beside = [key for key in (lane.left, lane.right) if key is not None and key in table.lanes]
    next_to_it = [*table.successors[place.lanelet_id], *table.predecessors[place.lanelet_id], *beside]
    for lanelets in ([place.lanelet_id], next_to_it):
        found = _free_on(lanelets, scene, changes, place, size_m, step)
        if found:
            return found
    return []


def _free_on(
    lanelets: list[int], scene: Scene, changes: Changes, place: Place, size_m: tuple[float, float], step: int
) -> list[str]:
    """Up to three free places on lanelets, the nearest to a place (as the crow flies) first."""
    wanted, lanes = place.pose(scene)[0], scene.layout.table.lanes
    tried = []
    for key in lanelets:
        for station in np.arange(size_m[0] / 2, lanes[key].length_m - size_m[0] / 2 + 1e-6, SEARCH_STEP_M).tolist():
            other = Place(key, station)
            tried.append((float(np.linalg.norm(other.pose(scene)[0] - wanted)), key, station))
    found: list[str] = []
    there = tuple(_bodies(scene, changes, step))
    for _, key, station in sorted(tried):
        if not _in_the_way(*Place(key, station).pose(scene), size_m, there):
            found.append(f"at={key} position='{station:.1f}m'")
        if len(found) == FREE_PLACES_NAMED:
            break
    return found


def _in_the_way(center: Points, heading: float, size_m: tuple[float, float], bodies: Iterable[Body]) -> str:
    """The first body that is where a vehicle would be put; empty if the place is free."""
    mine = oriented_rectangle(center, heading, (size_m[0] + 2 * CLEARANCE_M, size_m[1] + CLEARANCE_M))
    for name, position, corners in bodies:
        if float(np.abs(position - center).max()) < NEAR_M and rectangles_overlap(mine, corners):
            return name
    return ""


def _bodies(scene: Scene, changes: Changes, step: int) -> Iterator[Body]:
    """Everybody who is known to be there at a step: name, centre (2,) and corners (4, 2).

    Where those are whom edits drive by then, only the simulation shows.
    """
    there = populated(scene, changes)
    driven = {key for key, plan in changes.driven.items() if plan.from_step < step}
    for key, track in (there.tracks | there.standing).items():
        index = track.index_at(step)
        if index is None or key in driven:
            continue
        size = (track.length_m, track.width_m)
        position = track.positions[index]
        yield f"vehicle {key}", position, oriented_rectangle(position, float(track.headings_rad[index]), size)
    for region in scene.regions:
        index = region.track.index_at(step)
        if index is not None and region.obstacle_id not in changes.removed:
            box, position = region.track, region.track.positions[index]
            corners = oriented_rectangle(position, float(box.headings_rad[index]), (box.length_m, box.width_m))
            yield f"obstacle {region.obstacle_id}", position, corners
    if scene.ego is not None and scene.ego.step == step:
        corners = oriented_rectangle(scene.ego.position, scene.ego.heading_rad, EGO_SIZE_M)
        yield "the ego", scene.ego.position, corners
