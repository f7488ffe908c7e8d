"""Checks that generated traffic has the driver variety of the requested published calibration.

The bench fills a motorway of a real extract with usual drivers, with those of ``gb_motorway`` (few vehicles) and with
those of ``m25_gaps`` (many). It reads their behaviour from the written XML alone, with lxml and shapely.

Keys:

- ``free_speed_mean``, ``free_speed_deviation``: the highest speed over the limit that a car keeps on a free road for
  ``FREE_S``, one value per car, under ``gb_motorway``; ``usual_speed_…`` without a condition.
- ``time_gap_mean_s``, ``time_gap_deviation_s``: the gap from bumper to bumper, minus the ``STANDING_M`` kept at a
  standstill, over the speed, for vehicles that follow another at its speed within ``FOLLOWED_S``, one value per
  vehicle, under ``m25_gaps``; ``usual_gap_…`` without a condition.
- ``free_cars``, ``followers``: how many these are.
"""

import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from plannerforge.engine.execution import silent
from plannerforge.engine.generation import generate_scenario
from plannerforge.schemas.generation import GenerationRequest, TrafficConditions

from ..harness import Figures
from .bench import MapsBench

MAP = "o2s_arizona_highways"
"""An extract with straight motorways, because in curves no car drives at its desired speed."""
SEEDS = range(4)
FEW_PER_LANE_KM, MANY_PER_LANE_KM = 2.0, 24.0
FREE_S, FOLLOWED_S, STANDING_M = 6.0, 3.0, 2.5
_WINDOW = 10
"""Steps (1 s) before and after a time in which a vehicle must keep its speed."""
_HELD_MPS, _SAME_MPS, _STRAIGHT_RAD, _LATERAL_M, _SLOWEST_MPS, _FAST_MPS = 0.3, 0.5, 0.05, 1.75, 8.0, 25.0
_CARS = frozenset({"car", "taxi"})


def measure(bench: MapsBench) -> Figures:
    """Make the scenarios and judge them."""
    folder = bench.folder("demand")
    usual, brisk, following, spread = (
        _judged(bench, folder / f"{drivers}_{per_lane_km}", TrafficConditions(drivers=drivers, per_lane_km=per_lane_km))
        for drivers, per_lane_km in (
            ("", FEW_PER_LANE_KM),
            ("gb_motorway", FEW_PER_LANE_KM),
            ("", MANY_PER_LANE_KM),
            ("m25_gaps", MANY_PER_LANE_KM),
        )
    )
    figures: dict[str, float] = {}
    for key, values in (("free_speed", brisk.factors), ("usual_speed", usual.factors)):
        figures |= {f"{key}_mean": _mean(values), f"{key}_deviation": _deviation(values)}
    for key, values in (("time_gap", spread.gaps_s), ("usual_gap", following.gaps_s)):
        figures |= {f"{key}_mean_s": _mean(values), f"{key}_deviation_s": _deviation(values)}
    return figures | {"free_cars": len(brisk.factors), "followers": len(spread.gaps_s)}


@dataclass(frozen=True)
class Driving:
    """Free speeds over the limit, and time gaps behind others: one value for each vehicle that shows one."""

    factors: tuple[float, ...]
    gaps_s: tuple[float, ...]


def _judged(bench: MapsBench, folder: Path, conditions: TrafficConditions) -> Driving:
    made = []
    for seed in SEEDS[: bench.limit]:
        own = folder / str(seed)
        own.mkdir(parents=True)
        _make(bench.maps / f"{MAP}.osm", own, conditions, seed)
        made.append(judge_file(own / "scenario.xml"))
    return Driving(
        tuple(factor for one in made for factor in one.factors), tuple(gap_s for one in made for gap_s in one.gaps_s)
    )


def _make(map_path: Path, folder: Path, conditions: TrafficConditions, seed: int) -> None:
    """Make a scenario on the motorway."""
    request = GenerationRequest(
        map_path=str(map_path),
        map_id=map_path.stem,
        place=map_path.stem,
        country="USA",
        attribution="OpenStreetMap",
        scenario_type="highway",
        seed=seed,
        conditions=conditions,
        folder=str(folder),
    )
    generate_scenario(request, silent)


def _mean(values: Sequence[float]) -> float:
    return round(statistics.fmean(values), 3) if values else float("nan")


def _deviation(values: Sequence[float]) -> float:
    return round(statistics.stdev(values), 3) if len(values) > 1 else float("nan")


@dataclass(frozen=True)
class _Vehicle:
    """A vehicle as the file has it: type, length, and x, y, heading and speed at each step."""

    kind: str
    length_m: float
    states: NDArray[np.float64]


def judge_file(path: Path) -> Driving:
    """Judge the driving of a file's free cars, and of its followers."""
    root = etree.parse(path).getroot()
    vehicles = [_vehicle(element) for element in root.iterfind("dynamicObstacle")]
    roads = _Roads(root)
    factors, gaps_s = [], []
    for vehicle in vehicles:
        free, behind = [], []
        for step in range(_WINDOW, len(vehicle.states) - _WINDOW, _WINDOW):
            if not _is_steady(vehicle, step):
                continue
            ahead = _ahead(vehicle, vehicles, step)
            speed = vehicle.states[step, 3]
            if ahead is None or ahead[0] > FREE_S * speed:
                limits = roads.limits_mps(vehicle.states[step, :2])
                free += [speed / limit for limit in limits if limit > _FAST_MPS]
            elif ahead[0] < FOLLOWED_S * speed and _is_followed(vehicle, ahead[1], step):
                behind.append((ahead[0] - STANDING_M) / speed)
        factors += [float(max(free))] if free and vehicle.kind in _CARS else []
        gaps_s += [float(statistics.median(behind))] if behind else []
    return Driving(tuple(factors), tuple(gaps_s))


def _is_steady(vehicle: _Vehicle, step: int) -> bool:
    """Return True if a vehicle drives straight on at constant speed around a step."""
    around = vehicle.states[step - _WINDOW : step + _WINDOW + 1]
    turn = np.abs(np.unwrap(around[:, 2]) - around[_WINDOW, 2]).max()
    return bool(around[:, 3].min() > _SLOWEST_MPS and np.ptp(around[:, 3]) < _HELD_MPS and turn < _STRAIGHT_RAD)


def _ahead(vehicle: _Vehicle, others: Sequence[_Vehicle], step: int) -> tuple[float, _Vehicle] | None:
    """Return the gap in m to the nearest vehicle ahead on the same line, and that vehicle."""
    x, y, heading, _ = vehicle.states[step]
    gaps = []
    for other in others:
        if other is vehicle or step >= len(other.states):
            continue
        dx, dy = other.states[step, 0] - x, other.states[step, 1] - y
        along, beside = dx * np.cos(heading) + dy * np.sin(heading), dy * np.cos(heading) - dx * np.sin(heading)
        if along > 0 and abs(beside) < _LATERAL_M:
            gaps.append((float(along) - (vehicle.length_m + other.length_m) / 2, other))
    return min(gaps, key=lambda gap: gap[0], default=None)


def _is_followed(vehicle: _Vehicle, leader: _Vehicle, step: int) -> bool:
    """Return True if a vehicle keeps its leader's speed."""
    last = step + _WINDOW
    if last >= len(leader.states):
        return False
    speeds = vehicle.states[step - _WINDOW : last + 1, 3] - leader.states[step - _WINDOW : last + 1, 3]
    return bool(np.abs(speeds).max() < _SAME_MPS)


class _Roads:
    """The speed limits of the lanelets of a file, by the place."""

    def __init__(self, root: etree._Element) -> None:
        from shapely import Polygon, STRtree, make_valid

        signs = {
            sign.get("id", ""): float(element.findtext("additionalValue", "nan"))
            for sign in root.iterfind("trafficSign")
            for element in sign.iterfind("trafficSignElement")
            if element.findtext("trafficSignID") in ("274", "R2-1", "maxSpeed")
        }
        areas, self._limits = [], []
        for lanelet in root.iterfind("lanelet"):
            limits = [
                signs[ref] for sign in lanelet.iterfind("trafficSignRef") if (ref := sign.get("ref", "")) in signs
            ]
            if limits:
                left, right = (_points(lanelet.find(tag)) for tag in ("leftBound", "rightBound"))
                areas.append(make_valid(Polygon([*right, *left[::-1]])))
                self._limits.append(limits[0])
        self._tree = STRtree(areas)

    def limits_mps(self, place: NDArray[np.float64]) -> Iterator[float]:
        """Return the speed limit at a place if it is the same on all lanelets there, otherwise None."""
        from shapely import Point

        there = {self._limits[index] for index in self._tree.query(Point(place), predicate="within")}
        if len(there) == 1:
            yield there.pop()


def _points(bound: etree._Element | None) -> list[tuple[float, float]]:
    points = () if bound is None else bound.iterfind("point")
    return [(_value(point, "x"), _value(point, "y")) for point in points]


def _vehicle(element: etree._Element) -> _Vehicle:
    states = [
        [
            _value(state, path)
            for path in ("position/point/x", "position/point/y", "orientation/exact", "velocity/exact")
        ]
        for state in (element.find("initialState"), *element.iterfind("trajectory/state"))
        if state is not None
    ]
    return _Vehicle(element.findtext("type", ""), _value(element, "shape/rectangle/length"), np.array(states))


def _value(element: etree._Element, path: str) -> float:
    return float(element.findtext(path, "nan"))
