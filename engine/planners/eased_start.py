"""A reference path that begins as the ego stands, for starts from which no candidate gets onto the route's centre line.

An ego may begin askew of its lane, or so fast before a tight turn that steering takes too long: then every candidate
of a planner that follows the centre line breaks a limit in its first second.
"""

from dataclasses import replace

import numpy as np

from plannerforge.engine.geometry.polyline import Points, arc_length, interpolate, point_at, project
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.reference_path import BEFORE_M, ReferencePath, cubic, evenly, straight_on_from
from plannerforge.engine.planners.road import Road
from plannerforge.engine.planners.vehicle import VehicleParameters, rear_axle

EASED_OVER_M = (10.0, 15.0, 22.0, 33.0, 50.0)
"""Lengths to try in turn: the shortest that can be driven stays closest to the route."""


def eased_start(reference: ReferencePath, ego: EgoState, vehicle: VehicleParameters, over_m: float) -> ReferencePath:
    """The path from the ego's rear axle, in its heading, onto the reference path within ``over_m`` metres of it.

    Behind the ego it goes straight back. Where the reference path is shorter than that, it is joined at its end.
    """
    stations = arc_length(reference.points)
    start = rear_axle(ego.position, ego.heading_rad, vehicle)
    joined_m = min(project(reference.points, start)[0] + over_m, float(stations[-1]) - 1.0)
    end, end_heading_rad = point_at(reference.points, joined_m)
    forward = _direction(ego.heading_rad)
    rest = interpolate(reference.points, stations, np.array([joined_m, *stations[stations > joined_m]]))
    behind = straight_on_from(start + forward, start, BEFORE_M)[::-1]
    curve = cubic(start, forward, end, _direction(end_heading_rad))
    points = evenly(np.concatenate([behind, start[None], curve, rest]))
    straight_m = float(stations[-1]) - reference.network_end_m
    return replace(reference, points=points, network_end_m=float(arc_length(points)[-1]) - straight_m)


def stays_on(road: Road, eased: ReferencePath, ego: EgoState, over_m: float) -> bool:
    """Whether the curve of an eased path does not cut a corner across the edge of the road."""
    begin = project(eased.points, ego.position)[0]
    stations = arc_length(eased.points)
    curve = eased.points[(stations >= begin) & (stations <= begin + over_m)]
    return all(road.holds(point) for point in curve)


def _direction(heading_rad: float) -> Points:
    return np.array([np.cos(heading_rad), np.sin(heading_rad)])
