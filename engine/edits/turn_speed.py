"""Whether a vehicle can still slow down enough for the bends of a new way."""

import math
from collections.abc import Collection

import numpy as np

from plannerforge.engine.edits.changes import DrivePlan
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.geometry.polyline import Points, arc_length, interpolate, maximum_curvature, project
from plannerforge.schemas.errors import NotPossible

HARDEST_BRAKING_MPS2 = 8.0
HARDEST_LATERAL_MPS2 = 8.0
"""What tyres hold on a dry road; comfort is half of it."""

EASY_MPS2 = 4.0
"""Braking and lateral acceleration of a driver who is in no trouble."""

SMOOTHING_M = 4.0
LAST_M = 0.1


def check_bends(scene: Scene, plan: DrivePlan, way: tuple[int, ...], who: str) -> None:
    """Refuse a way with a bend that the vehicle comes to too fast, even if it brakes as hard as it can.

    Lanelets of the recorded way are left out: the vehicle was recorded in their bends.

    Raises:
        NotPossible: naming the lanelet, the speed there at best and the highest that its bend takes.
    """
    index = plan.from_step - plan.start.first_step
    recorded = scene.matches.get(plan.start.obstacle_id)
    known = set(recorded.sequence) if recorded is not None and plan.cause != "added" else set()
    found = first_bend_too_tight(scene, way, plan.start.positions[index], float(plan.start.speeds_mps[index]), known)
    if found is not None:
        raise NotPossible(
            f"{who} {found}",
            next_step="choose a target straight ahead, or remove the vehicle and add one that starts slower",
        )


def first_bend_too_tight(
    scene: Scene, way: tuple[int, ...], position: Points, speed_mps: float, known: Collection[int] = ()
) -> str | None:
    """What is wrong with the first bend of a way that somebody at a position (2,) cannot brake enough for; else None.

    ``known``: lanelets whose bends are not asked about.
    """
    lanes, speed_mps = scene.layout.table.lanes, max(speed_mps, 0.0)
    here_m = project(lanes[way[0]].center, position)[0]
    ahead_m = -here_m
    for before, key in zip((None, *way), way, strict=False):
        if before is not None and key in scene.layout.table.successors[before]:
            ahead_m += lanes[before].length_m
        line = lanes[key].center if before is not None else _from(lanes[key].center, here_m)
        curvature = 0.0 if key in known else maximum_curvature(line, SMOOTHING_M)
        if curvature <= 0.0:
            continue
        at_best = math.sqrt(max(speed_mps**2 - 2 * HARDEST_BRAKING_MPS2 * max(ahead_m, 0.0), 0.0))
        highest = math.sqrt(HARDEST_LATERAL_MPS2 / curvature)
        if at_best > highest:
            where = f"{ahead_m:.0f} m before" if ahead_m > 0.0 else "on"
            return (
                f"drives {speed_mps:.1f} m/s {where} lanelet {key}, whose bend takes at most {highest:.1f} m/s: "
                "it cannot brake enough"
            )
    return None


def highest_entry_speed(scene: Scene, way: tuple[int, ...], station_m: float) -> float:
    """Speed in m/s from which a driver at an arc length of a way's first lanelet brakes with ease for all bends ahead.

    Where the way ends, it is followed as long as it does not fork. Infinite where nothing bends.
    """
    lanes, successors = scene.layout.table.lanes, scene.layout.table.successors
    onwards = list(way)
    while len(successors[onwards[-1]]) == 1 and successors[onwards[-1]][0] not in onwards:
        onwards.append(successors[onwards[-1]][0])
    highest, ahead_m = math.inf, 0.0
    for index, key in enumerate(onwards):
        line = lanes[key].center if index else _from(lanes[key].center, station_m)
        curvature = maximum_curvature(line, SMOOTHING_M)
        if curvature > 0.0:
            highest = min(highest, math.sqrt(EASY_MPS2 / curvature + 2 * EASY_MPS2 * ahead_m))
        is_followed = not set(onwards[index + 1 : index + 2]).isdisjoint(successors[key])
        ahead_m += float(arc_length(line)[-1]) if is_followed else 0.0
    return highest


def _from(line: Points, station_m: float) -> Points:
    """The part of a line beyond an arc length; the last 10 cm at least."""
    stations = arc_length(line)
    begin = min(station_m, float(stations[-1]) - LAST_M)
    return interpolate(line, stations, np.array([begin, *stations[stations > begin]]))
