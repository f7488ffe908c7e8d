"""Whether a vehicle can still slow down enough for the bends of a new way."""

import math
from collections.abc import Collection, Iterator, Sequence

import numpy as np

from plannerforge.engine.edits.changes import DrivePlan
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.geometry.polyline import Points, arc_length, curvatures, interpolate, project
from plannerforge.schemas.errors import NotPossible

HARDEST_BRAKING_MPS2 = 8.0
HARDEST_LATERAL_MPS2 = 8.0
"""What tyres hold on a dry road; comfort is half of it."""

EASY_MPS2 = 4.0
"""Braking and lateral acceleration of a driver who is in no trouble."""

SMOOTHING_M = 4.0
LAST_M = 0.1
PIECE_M = 20.0
"""The bend of a lanelet counts from the beginning of the piece on where it is: a long one may bend at its far end."""


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
    speed_mps, here_m = max(speed_mps, 0.0), project(scene.layout.table.lanes[way[0]].center, position)[0]
    for key, ahead_m, curvature in _bends_ahead(scene, way, here_m):
        at_best = math.sqrt(max(speed_mps**2 - 2 * HARDEST_BRAKING_MPS2 * ahead_m, 0.0))
        highest = math.sqrt(HARDEST_LATERAL_MPS2 / curvature)
        if key not in known and at_best > highest:
            where = f"{ahead_m:.0f} m before" if ahead_m > 0.0 else "in"
            return (
                f"drives {speed_mps:.1f} m/s {where} a bend of lanelet {key} that takes at most {highest:.1f} m/s: "
                "it cannot brake enough"
            )
    return None


def highest_entry_speed(scene: Scene, way: tuple[int, ...], station_m: float) -> float:
    """Speed in m/s from which a driver at an arc length of a way's first lanelet brakes with ease for all bends ahead.

    Where the way ends, it is followed as long as it does not fork. Infinite where nothing bends.
    """
    successors, onwards = scene.layout.table.successors, list(way)
    while len(successors[onwards[-1]]) == 1 and successors[onwards[-1]][0] not in onwards:
        onwards.append(successors[onwards[-1]][0])
    bends = _bends_ahead(scene, onwards, station_m)
    return min((math.sqrt(EASY_MPS2 / bend + 2 * EASY_MPS2 * ahead_m) for _, ahead_m, bend in bends), default=math.inf)


def _bends_ahead(scene: Scene, way: Sequence[int], here_m: float) -> Iterator[tuple[int, float, float]]:
    """Every piece of 20 m of a way that bends: its lanelet, how far ahead it begins, and its largest curvature.

    ``here_m``: the arc length of the first lanelet from which on they count. Lanelets beside each other begin equally
    far ahead; a piece that has begun is 0 m ahead.
    """
    lanes, successors, ahead_m = scene.layout.table.lanes, scene.layout.table.successors, -here_m
    for before, key in zip((None, *way), way, strict=False):
        if before is not None and key in successors[before]:
            ahead_m += lanes[before].length_m
        line = lanes[key].center if before is not None else _from(lanes[key].center, here_m)
        for begin_m, curvature in _bends_of(line):
            away_m = begin_m + (0.0 if before is None else ahead_m)
            if away_m > -PIECE_M:
                yield key, max(away_m, 0.0), curvature


def _bends_of(line: Points) -> Iterator[tuple[float, float]]:
    """Where on a line each piece that bends begins, and its largest curvature."""
    stations, curvature = curvatures(line, SMOOTHING_M)
    if len(stations):
        begins = np.arange(0.0, float(stations[-1]), PIECE_M)
        largest = np.maximum.reduceat(curvature, np.searchsorted(stations, begins))
        yield from ((begin, bend) for begin, bend in zip(begins.tolist(), largest.tolist(), strict=True) if bend > 0.0)


def _from(line: Points, station_m: float) -> Points:
    """The part of a line beyond an arc length; the last 10 cm at least."""
    stations = arc_length(line)
    begin = min(station_m, float(stations[-1]) - LAST_M)
    return interpolate(line, stations, np.array([begin, *stations[stations > begin]]))
