"""What a scenario allows: which goals a car can reach, and where "25 m ahead" is, according to the file's lanelets.

This module does not use the editing code, so that it can judge that code's results.
"""

import heapq
import math
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...engine.geometry import Points, length_m, point_at, project

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork

    from ...engine.commonroad import Track

SHARES: Mapping[str, float] = {"beginning": 0.0, "quarter": 0.25, "middle": 0.5, "three_quarter": 0.75, "final": 1.0}
LARGEST_ACCELERATION_MPS2, LARGEST_SPEED_MPS = 11.5, 50.8
"""Limits of CommonRoad's vehicle 2 (BMW 320i)."""
HARD_BRAKING_MPS2, LATERAL_MPS2, CURVE_M = 8.0, 8.0, 5.0
"""Maximum deceleration before a curve, lateral acceleration in it, and the length for measuring a curve."""
LEAST_AHEAD_M, SHARE_IN_REACH = 1.0, 0.95
"""A goal drawn for a request is clearly ahead and within reach, so that rounding decides nothing."""


def speed_limit_mps(network: "LaneletNetwork", key: int) -> float:
    """Return the lowest speed in m/s that a lanelet's signs allow; infinite if there are none."""
    signs = (network.find_traffic_sign_by_id(sign) for sign in network.find_lanelet_by_id(key).traffic_signs or ())
    elements = [one for sign in signs for one in sign.traffic_sign_elements]
    limits = [float(one.additional_values[0]) for one in elements if one.traffic_sign_element_id.name == "MAX_SPEED"]
    return min(limits, default=math.inf)


def distances_m(
    network: "LaneletNetwork",
    position: Points,
    heading_rad: float,
    speed_mps: float = 0.0,
    among: Collection[int] | None = None,
    hardest_mps2: tuple[float, float] = (HARD_BRAKING_MPS2, LATERAL_MPS2),
) -> dict[int, float]:
    """Return the distance in m from a car to the start of every reachable lanelet, along successors and lane changes.

    Paths begin on all lanelets under its position (2,) that do not lead against its heading; the distance is negative
    if the lanelet's start is behind the car. No path continues beyond a lanelet with a curve that the car reaches too
    fast, even if it brakes.

    Args:
        speed_mps: its speed; at 0 it takes all curves.
        among: the lanelets to start from; None means all.
        hardest_mps2: its deceleration before curves and lateral acceleration in them.
    """

    def takes(pairs: Iterable[tuple[float, int]]) -> list[tuple[float, int]]:
        lanelets = ((away_m, network.find_lanelet_by_id(key)) for away_m, key in pairs)
        return [
            (away_m, one.lanelet_id) for away_m, one in lanelets if _takes_curves(one, away_m, speed_mps, *hardest_mps2)
        ]

    def onward(away_m: float, lanelet: "Lanelet") -> list[tuple[float, int]]:
        end_m = away_m + length_m(lanelet.center_vertices)
        return takes(
            [*((end_m, key) for key in lanelet.successor), *((away_m, key) for key in adjacent_lanelets(lanelet))]
        )

    begin = []
    for key in network.find_lanelet_by_position([position])[0]:
        line = network.find_lanelet_by_id(key).center_vertices
        station_m = project(line, position)[0]
        leads = math.cos(point_at(line, station_m)[1] - heading_rad) > 0.0
        begin += [(-station_m, int(key))] if leads and (among is None or key in among) else []
    return _cheapest(network, takes(begin), onward)


def lanelets_at_first(network: "LaneletNetwork", track: "Track") -> frozenset[int]:
    """Return the lanelets at a recording's start; if several overlap, those that it stays on longest."""
    under = [frozenset(map(int, found)) for found in network.find_lanelet_by_position(list(track.positions))]
    stays = {key: sum(key in found for found in under) for key in under[0]}
    return frozenset(key for key, count in stays.items() if count == max(stays.values()))


def _cheapest(
    network: "LaneletNetwork",
    begin: Iterable[tuple[float, int]],
    onward: Callable[[float, "Lanelet"], Iterable[tuple[float, int]]],
) -> dict[int, float]:
    """Return, by lanelet, the lowest cost of a path from the starts, which have costs of their own (Dijkstra 1959)."""
    best: dict[int, float] = {}
    queue = sorted(begin)
    while queue:
        cost, key = heapq.heappop(queue)
        if key not in best:
            best[key] = cost
            for pair in onward(cost, network.find_lanelet_by_id(key)):
                heapq.heappush(queue, pair)
    return best


def all_after(begin: Iterable[int], following: Callable[[int], Iterable[int]]) -> frozenset[int]:
    """Return the given lanelets and all lanelets that can be reached from them through successors."""
    known, queue = set(begin), list(begin)
    while queue:
        more = {int(key) for key in following(queue.pop())} - known
        known |= more
        queue += more
    return frozenset(known)


def ways_to_m(network: "LaneletNetwork", targets: frozenset[int]) -> dict[int, float]:
    """Return, by lanelet, the shortest distance in m from its start to that of any target, if there is a route."""
    return _costs_to(network, targets, lambda lanelet: length_m(lanelet.center_vertices), change_cost=0.0)


def changes_to(network: "LaneletNetwork", targets: frozenset[int]) -> dict[int, float]:
    """Return, by lanelet, the fewest lane changes on any route to any target, if there is a route."""
    return _costs_to(network, targets, lambda _: 0.0, change_cost=1.0)


def _costs_to(
    network: "LaneletNetwork", targets: frozenset[int], onward_cost: Callable[["Lanelet"], float], *, change_cost: float
) -> dict[int, float]:
    before: dict[int, list[tuple[float, int]]] = {}
    for lanelet in network.lanelets:
        cost = onward_cost(lanelet)
        steps = [
            *((cost, key) for key in lanelet.successor),
            *((change_cost, key) for key in adjacent_lanelets(lanelet)),
        ]
        for more, after in steps:
            before.setdefault(int(after), []).append((more, int(lanelet.lanelet_id)))

    def backward(cost: float, lanelet: "Lanelet") -> list[tuple[float, int]]:
        return [(cost + more, key) for more, key in before.get(int(lanelet.lanelet_id), ())]

    return _cheapest(network, ((0.0, key) for key in targets), backward)


def is_in_reach(problem: "PlanningProblem", step_s: float, distance_m: float, last_step: int) -> bool:
    """Return whether a car can cover ``distance_m`` before the goal's time ends, at a speed that the goal allows.

    If the goal has no time, it ends at the scenario's last step. A car that can also stop on its route, and regain the
    goal's minimum speed, can wait for the time to begin.
    """
    start, goal = problem.initial_state, next(iter(problem.goal.state_list), None)
    time, speeds = getattr(goal, "time_step", None), getattr(goal, "velocity", None)
    last = last_step if time is None else int(getattr(time, "end", time))
    seconds, speed = max(last - int(start.time_step), 0) * step_s, float(start.velocity)
    least_mps, most_mps = (0.0, LARGEST_SPEED_MPS) if speeds is None else _ends(speeds)
    gained_mps = LARGEST_ACCELERATION_MPS2 * seconds
    if not (least_mps <= speed + gained_mps and speed - gained_mps <= most_mps):
        return False
    farthest = _farthest_m(speed, min(most_mps, speed + gained_mps, LARGEST_SPEED_MPS), seconds)
    can_wait = speed**2 + least_mps**2 <= 2 * LARGEST_ACCELERATION_MPS2 * SHARE_IN_REACH * distance_m
    return LEAST_AHEAD_M <= distance_m <= SHARE_IN_REACH * farthest and can_wait


def places_on(network: "LaneletNetwork", lanelet_id: int, share: float, vehicle_length_m: float) -> list[Points]:
    """Return the point at a share of a lanelet's length, moved inwards by half a vehicle (rule 3 of the corpus)."""
    lanelet = network.find_lanelet_by_id(lanelet_id)
    total_m = length_m(lanelet.center_vertices)
    inside_m = min(vehicle_length_m, total_m) / 2
    return [point_at(lanelet.center_vertices, min(max(share * total_m, inside_m), total_m - inside_m))[0]]


def places_along(network: "LaneletNetwork", position: Points, offset_m: float) -> list[Points]:
    """Return all points ``offset_m`` ahead of a point (negative: behind), along its lanelets and their successors."""
    places: list[Points] = []
    for key in network.find_lanelet_by_position([position])[0]:
        station_m = project(network.find_lanelet_by_id(key).center_vertices, position)[0] + offset_m
        places += _at_station(network, int(key), station_m, set())
    return places


def nearest_m(point: Points, places: Iterable[Points]) -> float:
    """Return the distance in m to the nearest of the places; infinite if there are none."""
    return min((float(np.linalg.norm(point - place)) for place in places), default=math.inf)


def _ends(speeds_mps: Any) -> tuple[float, float]:
    """Return the lowest and highest speed of an interval or of an exact value; goals are never reached backwards."""
    return max(float(getattr(speeds_mps, "start", speeds_mps)), 0.0), float(getattr(speeds_mps, "end", speeds_mps))


def _farthest_m(speed_mps: float, final_mps: float, seconds: float) -> float:
    """Return the longest distance in m in a time between two speeds: full power, top speed, then full brakes."""
    doubled = 2 * LARGEST_ACCELERATION_MPS2
    top = min((speed_mps + final_mps + LARGEST_ACCELERATION_MPS2 * seconds) / 2, max(LARGEST_SPEED_MPS, speed_mps))
    at_top_s = seconds - (2 * top - speed_mps - final_mps) / LARGEST_ACCELERATION_MPS2
    return (2 * top**2 - speed_mps**2 - final_mps**2) / doubled + top * at_top_s


def _at_station(network: "LaneletNetwork", key: int, station_m: float, seen: set[int]) -> list[Points]:
    """Return the points at an arc length that may be before or beyond a lanelet, on every branch there."""
    lanelet = network.find_lanelet_by_id(key)
    total = length_m(lanelet.center_vertices)
    if 0.0 <= station_m <= total:
        return [point_at(lanelet.center_vertices, station_m)[0]]
    if key in seen:
        return []
    places: list[Points] = []
    for other in lanelet.successor if station_m > total else lanelet.predecessor:
        step = -total if station_m > total else length_m(network.find_lanelet_by_id(other).center_vertices)
        places += _at_station(network, int(other), station_m + step, seen | {key})
    return places


def _takes_curves(
    lanelet: "Lanelet", distance_m: float, speed_mps: float, braking_mps2: float, lateral_mps2: float
) -> bool:
    """Return whether a car that brakes from a speed to a lanelet's start is slow enough for all of its curves."""
    slowest = math.sqrt(max(speed_mps**2 - 2 * braking_mps2 * max(distance_m, 0.0), 0.0))
    if slowest == 0.0:
        return True
    steps = np.diff(lanelet.center_vertices, axis=0)
    lengths, along = np.linalg.norm(steps, axis=1), np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    middles = np.cumsum(lengths) - lengths / 2
    within = np.abs(middles[:, None] - middles[None, :]) <= CURVE_M
    within &= middles[:, None] >= -distance_m - CURVE_M
    sharpest = float((np.abs(along[:, None] - along[None, :]) * within).max()) / CURVE_M
    return slowest**2 * sharpest <= lateral_mps2


def adjacent_lanelets(lanelet: "Lanelet") -> list[Any]:
    """Return the adjacent lanelets of the same direction."""
    left = lanelet.adj_left if lanelet.adj_left_same_direction else None
    right = lanelet.adj_right if lanelet.adj_right_same_direction else None
    return [key for key in (left, right) if key is not None]
