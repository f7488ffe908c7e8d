"""Whether the lanes under a car's way can be followed at its speed: what a planner with a reference path needs.

Maps have corners, and sideways jogs where netconvert joins lanes that do not face each other. Recorded cars cut them;
a planner that follows the lanes' centre lines may find no trajectory there.
"""

import itertools
from collections.abc import Sequence

import numpy as np

from plannerforge.engine.geometry.polyline import Points, arc_length, gaussian, project, resample, without_repeats
from plannerforge.engine.network.lanelet_lookup import LaneletLookup
from plannerforge.engine.network.road_network import RoadLanelet, RoadNetwork
from plannerforge.engine.traffic.motions import Participant

LARGEST_CURVATURE_PER_M = 0.2
"""Just below that of CommonRoad's vehicle 2 (BMW 320i) with its wheels turned fully."""

LARGEST_CURVATURE_RATE_PER_MS = 0.4
"""What the Frenetix core allows."""

SMOOTHING_M = 2.0
BEFORE_M, BEYOND_M = 2.0, 20.0
LOOKED_AT_EVERY = 5


def follows_smooth_lanes(car: Participant, last_step: int, network: RoadNetwork, lookup: LaneletLookup) -> bool:
    """Whether the centre lines under the car up to a step, and 20 m beyond, bend no more than it can steer."""
    steps = range(0, last_step + 1, LOOKED_AT_EVERY)
    under = [lookup.under(car.motion.positions[step], float(car.motion.headings_rad[step])) for step in steps]
    way = [lanelet for lanelet, _ in itertools.groupby(lanelet for lanelet in under if lanelet is not None)]
    return all(_is_smooth(line, car, last_step) for line in _lines(way, network))


def _lines(way: Sequence[RoadLanelet], network: RoadNetwork) -> list[Points]:
    """The centre lines joined where one lanelet follows on another, apart where the car changes the lane."""
    lines: list[list[Points]] = []
    for before, lanelet in itertools.pairwise([None, *way]):
        if lanelet is None:
            continue
        if before is None or lanelet.lanelet_id not in before.successors:
            lines.append([])
        lines[-1].append(lanelet.center)
    if way and len(way[-1].successors) == 1:
        lines[-1].append(network.lanelets[way[-1].successors[0]].center)
    return [without_repeats(np.concatenate(parts)) for parts in lines]


def _is_smooth(line: Points, car: Participant, last_step: int) -> bool:
    length = float(arc_length(line)[-1])
    if length < 4 * SMOOTHING_M:
        return True
    spacing = length / round(length)
    points = gaussian(resample(line, round(length) + 1), SMOOTHING_M / spacing)
    turns = np.diff(np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1])))
    curvature = turns / spacing
    stations = arc_length(points)[1:-1]
    first, last = (project(points, car.motion.positions[step])[0] for step in (0, last_step))
    watched = (stations > first - BEFORE_M) & (stations < last + BEYOND_M)
    speed = _speeds_along(points, stations, car, last_step)
    rate = np.abs(np.gradient(curvature, spacing)) * speed if len(curvature) > 1 else curvature
    too_tight = np.abs(curvature) > LARGEST_CURVATURE_PER_M
    return not bool(np.any(watched & (too_tight | (rate > LARGEST_CURVATURE_RATE_PER_MS))))


def _speeds_along(line: Points, stations: Points, car: Participant, last_step: int) -> Points:
    """The car's recorded speed at every station, that at either end beyond."""
    steps = np.arange(0, last_step + 1, LOOKED_AT_EVERY)
    there = np.array([project(line, car.motion.positions[step])[0] for step in steps])
    order = np.argsort(there, kind="stable")
    speeds: Points = np.interp(stations, there[order], car.motion.speeds_mps[steps][order])
    return speeds
