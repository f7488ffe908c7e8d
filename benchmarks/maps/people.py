"""Checks pedestrians and bicycles on real extracts: their lanelets, their overlaps, and whether cars yield.

Each map gives one scenario with ten pedestrians and four bicycles if its site has paths for both. The judge reads only
the written XML, with lxml and shapely.

Keys:

- ``walkers_feasible``: share of the positions of pedestrians and cyclists on lanelets for them (type pavement, crossing
  or bicycle lane, or users that name them).
- ``walkers_overlaps``: pairs of a pedestrian or cyclist and another road user with overlapping rectangles at any time
  step.
- ``cars_yield_share``: of the encounters of a motor vehicle and a pedestrian on a crossing, the share in which the
  vehicle passes the conflict point ``GAP_S`` or more before or after the pedestrian, or stopped before it.
- ``walkers_encounters``: number of these; ``walkers_on_crossings``: pedestrians on a crossing in the recording, of
  ``walkers``.
- ``walkers_scenarios``: generated; ``walkers_refused``: refused for lack of a path or of space.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from plannerforge.engine.execution import silent
from plannerforge.engine.generation import generate_scenario
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.generation import GenerationRequest, ScenarioType, VehicleDemand

from ..harness import Figures
from .bench import MapsBench

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

TYPES: tuple[ScenarioType, ...] = ("signalised_intersection", "intersection", "roundabout", "urban", "rural")
"""Site types tried in turn until a map has one; each map begins with another type."""
PEDESTRIANS, BICYCLES, DURATION_S, SEED = 10, 4, 20.0, 18
GAP_S, ENCOUNTER_S, STANDS_MPS = 1.0, 4.0, 0.5
"""A larger time difference is no encounter; the other two values decide whether a vehicle gave way."""
EDGE_M = 0.02
_FOR_PEDESTRIANS = frozenset({"sidewalk", "crosswalk"})
_STEP_S = 0.1
_UNDRIVEN = frozenset({"pedestrian", "bicycle"})
_APPROACH_STEPS = 80


def measure(bench: MapsBench) -> Figures:
    """Make the scenarios and judge them."""
    folder = bench.folder("people")
    counts: Counter[str] = Counter()
    files = sorted(path for path in bench.maps.iterdir() if path.suffix == ".osm")[: bench.limit]
    for number, path in enumerate(files):
        own = folder / path.stem
        own.mkdir()
        if _make(path, own, number):
            counts["scenarios"] += 1
            counts.update(judge_file(own / "scenario.xml"))
        else:
            counts["refused"] += 1
    return {
        "walkers_feasible": _share(counts["on_ways"], counts["positions"]),
        "walkers_overlaps": counts["overlaps"],
        "cars_yield_share": _share(counts["yielded"], counts["encounters"]),
        "walkers_encounters": counts["encounters"],
        "walkers_on_crossings": counts["on_crossings"],
        "walkers": counts["pedestrians"],
        "walkers_scenarios": counts["scenarios"],
        "walkers_refused": counts["refused"],
    }


def _share(part: int, whole: int) -> float:
    return round(part / whole, 5) if whole else float("nan")


def _make(map_path: Path, folder: Path, number: int) -> bool:
    """Generate a map's scenario, of the first possible type; return True if there is one."""
    turn = number % len(TYPES)
    for kind in (*TYPES[turn:], *TYPES[:turn]):
        request = GenerationRequest(
            map_path=str(map_path),
            map_id=map_path.stem,
            place=map_path.stem,
            country="DEU",
            attribution="OpenStreetMap",
            scenario_type=kind,
            vehicles=(
                VehicleDemand(vehicle_class="pedestrian", least=PEDESTRIANS),
                VehicleDemand(vehicle_class="bicycle", least=BICYCLES),
            ),
            duration_s=DURATION_S,
            seed=SEED,
            most_sites=2,
            folder=str(folder),
        )
        try:
            generate_scenario(request, silent)
        except PlannerForgeError:
            continue
        return True
    return False


@dataclass(frozen=True)
class _User:
    """A road user as the file has it: type, length and width, x, y, heading and speed at each step."""

    kind: str
    size_m: tuple[float, float]
    states: NDArray[np.float64]

    def boxes(self) -> "NDArray[np.object_]":
        """Return the rectangle at every step."""
        from shapely import polygons

        x, y, heading, _ = self.states.T
        length, width = self.size_m
        corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (length / 2, width / 2)
        cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
        east = x[:, None] + corners[:, 0] * cos - corners[:, 1] * sin
        north = y[:, None] + corners[:, 0] * sin + corners[:, 1] * cos
        return np.asarray(polygons(np.stack([east, north], axis=2)))


def judge_file(path: Path) -> Counter[str]:
    """Return the counts of one file."""
    from shapely import union_all

    root = etree.parse(path).getroot()
    users = [_user(element) for element in root.iterfind("dynamicObstacle")]
    ways = {kind: union_all([area.buffer(EDGE_M) for area in _ways(root, kind)]) for kind in sorted(_UNDRIVEN)}
    crossings = [area for types, _, area in _lanelets(root) if "crosswalk" in types]
    boxes = [user.boxes() for user in users]
    counts: Counter[str] = Counter()
    for index, user in enumerate(users):
        if user.kind not in _UNDRIVEN:
            continue
        on_ways = _inside(ways[user.kind], user.states)
        counts["positions"] += len(on_ways)
        counts["on_ways"] += int(on_ways.sum())
        counts["overlaps"] += sum(
            _overlap(boxes[index], boxes[other])
            for other, beside in enumerate(users)
            if beside.kind not in _UNDRIVEN or other < index
        )
        if user.kind == "pedestrian":
            counts["pedestrians"] += 1
            counts["on_crossings"] += any(bool(_inside(area, user.states).any()) for area in crossings)
            for other, beside in enumerate(users):
                if beside.kind not in _UNDRIVEN:
                    counts.update(_encounters(user, boxes[index], beside, boxes[other], crossings))
    return counts


def _encounters(
    person: _User,
    person_boxes: "NDArray[np.object_]",
    vehicle: _User,
    vehicle_boxes: "NDArray[np.object_]",
    crossings: "list[BaseGeometry]",
) -> Iterator[str]:
    """Count ``encounters`` for each shared crossing, and ``yielded`` if the vehicle gave way or passed apart in
    time.
    """
    from shapely import intersects, union_all

    for area in crossings:
        walked = np.flatnonzero(_inside(area, person.states))
        over = np.flatnonzero(intersects(vehicle_boxes, area))
        if not len(walked) or not len(over):
            continue
        shared = union_all(person_boxes[walked]).intersection(union_all(vehicle_boxes[over]))
        if shared.is_empty:
            continue
        theirs = walked[intersects(person_boxes[walked], shared)]
        its = over[intersects(vehicle_boxes[over], shared)]
        if not len(theirs) or not len(its):
            continue
        apart_s = max(its[0] - theirs[-1], theirs[0] - its[-1]) * _STEP_S
        if apart_s > ENCOUNTER_S:
            continue
        yield "encounters"
        before = vehicle.states[max(its[0] - _APPROACH_STEPS, 0) : its[0] + 1, 3]
        if apart_s >= GAP_S or (apart_s > 0 and its[0] > theirs[-1] and bool((before < STANDS_MPS).any())):
            yield "yielded"


def _overlap(first: "NDArray[np.object_]", second: "NDArray[np.object_]") -> bool:
    """Return True if two road users overlap by an area at any step at which both exist."""
    from shapely import area, intersection

    both = min(len(first), len(second))
    return bool((area(intersection(first[:both], second[:both])) > 1e-4).any())


def _inside(shape: "BaseGeometry", states: NDArray[np.float64]) -> NDArray[np.bool_]:
    from shapely import contains_xy

    return np.asarray(contains_xy(shape, states[:, 0], states[:, 1]))


def _ways(root: etree._Element, kind: str) -> "list[BaseGeometry]":
    """Return the lanelets for pedestrians or for bicycles."""
    if kind == "pedestrian":
        return [area for types, _, area in _lanelets(root) if types & _FOR_PEDESTRIANS]
    return [
        area
        for types, users, area in _lanelets(root)
        if "bicycleLane" in types or "bicycle" in users or (not users and not types & _FOR_PEDESTRIANS)
    ]


def _lanelets(root: etree._Element) -> "Iterator[tuple[set[str], set[str], BaseGeometry]]":
    """Return types, users and area of each lanelet."""
    from shapely import Polygon, make_valid

    for lanelet in root.iterfind("lanelet"):
        left, right = (_points(lanelet.find(tag)) for tag in ("leftBound", "rightBound"))
        types = {word.text or "" for word in lanelet.iterfind("laneletType")}
        users = {word.text or "" for tag in ("userOneWay", "userBidirectional") for word in lanelet.iterfind(tag)}
        yield types, users, make_valid(Polygon([*right, *left[::-1]]))


def _points(bound: etree._Element | None) -> list[tuple[float, float]]:
    points = () if bound is None else bound.iterfind("point")
    return [(_value(point, "x"), _value(point, "y")) for point in points]


def _user(element: etree._Element) -> _User:
    states = [
        [
            _value(state, path)
            for path in ("position/point/x", "position/point/y", "orientation/exact", "velocity/exact")
        ]
        for state in (element.find("initialState"), *element.iterfind("trajectory/state"))
        if state is not None
    ]
    size = _value(element, "shape/rectangle/length"), _value(element, "shape/rectangle/width")
    return _User(element.findtext("type", ""), size, np.array(states))


def _value(element: etree._Element, path: str) -> float:
    return float(element.findtext(path, "nan"))
