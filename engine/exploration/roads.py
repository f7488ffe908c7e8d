"""Roads for logical scenarios: CommonRoad files with a road and an ego, but without other road users.

The roads are computed from constants in this module, so that a file has the same bytes on every machine. The lanes are
as wide as German guidelines require: 3.5 m on rural roads and on the main carriageways of motorways with reduced
cross-section (RAL 2012, RQ 11; RAA 2008, RQ 28), which also fits towns. The x axis points east and the y axis north.
Lengths are in m.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ...schemas.errors import UnknownName, closest

LANE_M = 3.5
_POINT_EVERY_M = 25.0
"""Distance between points of straight lanelets (chosen); curves have one per metre."""
_STEP_S = 0.1
_LAST_STEP = 200
"""A road's scenario lasts 20 s, longer than any horizon of the catalogue."""
_LONG_STEP, _LONG_M = 600, 3000.0
"""The duration of a long road's scenario (60 s, the longest horizon), and the road's length (chosen)."""
_Point = tuple[float, float]


@dataclass(frozen=True)
class _Lane:
    """A lanelet along a centre line. ``left`` and ``right``: the neighbour's id, and whether it leads the same way."""

    key: int
    center: tuple[_Point, ...]
    successors: tuple[int, ...] = ()
    predecessors: tuple[int, ...] = ()
    left: tuple[int, bool] | None = None
    right: tuple[int, bool] | None = None
    light: int | None = None
    sign: int | None = None


@dataclass(frozen=True)
class _Goal:
    """A goal region (centre, length, width, heading) and its time steps."""

    center: _Point
    size: tuple[float, float]
    heading_rad: float
    steps: tuple[int, int]


@dataclass(frozen=True)
class _Road:
    """A road with an ego (x, y, heading, speed). Without a goal region, the ego drives on until the scenario ends.

    ``stops``: the stop signs, each at the end of the lanelets that refer to it. ``last_step``: the end of its scenario.
    """

    name: str
    summary: str
    lanes: tuple[_Lane, ...]
    ego: tuple[float, float, float, float]
    goal: _Goal | None = None
    lights: Mapping[int, str] = field(default_factory=dict)
    stops: tuple[int, ...] = ()
    last_step: int = _LAST_STEP

    def xml(self) -> str:
        """Return the file's text (format 2020a)."""
        name = "".join(word.capitalize() for word in self.name.split("_"))
        lines = [
            "<?xml version='1.0' encoding='UTF-8'?>",
            f'<commonRoad timeStepSize="{_STEP_S}" commonRoadVersion="2020a" benchmarkID="ZAM_{name}-1_1_T-1"',
            '  author="PlannerForge" affiliation="" source="drawn" date="2026-01-01">',
            "  <location><geoNameId>-999</geoNameId><gpsLatitude>999</gpsLatitude>",
            "  <gpsLongitude>999</gpsLongitude></location>",
            "  <scenarioTags><simulated/></scenarioTags>",
            *(_lanelet(lane) for lane in self.lanes),
            *(_stop(key, next(lane.center[-1] for lane in self.lanes if lane.sign == key)) for key in self.stops),
            *(_light(key, colour, self._end_before(key)) for key, colour in self.lights.items()),
            self._problem(),
            "</commonRoad>",
            "",
        ]
        return "\n".join(lines)

    def _end_before(self, light: int) -> _Point:
        return next(lane.center[-1] for lane in self.lanes if lane.light == light)

    def _problem(self) -> str:
        x, y, heading, speed = self.ego
        goal, steps = "", (self.last_step, self.last_step)
        if self.goal is not None:
            (gx, gy), (length, width), turned = self.goal.center, self.goal.size, self.goal.heading_rad
            steps = self.goal.steps
            goal = (
                f"<position><rectangle><length>{length:g}</length><width>{width:g}</width><orientation>{turned:.6f}"
                f"</orientation><center><x>{gx:g}</x><y>{gy:g}</y></center></rectangle></position>"
            )
        return (
            f'  <planningProblem id="900">\n    <initialState><position><point><x>{x:.4f}</x><y>{y:.4f}</y></point>'
            f"</position><orientation><exact>{heading:.6f}</exact></orientation><time><exact>0</exact></time>"
            f"<velocity><exact>{speed:g}</exact></velocity><acceleration><exact>0.0</exact></acceleration>"
            f"<yawRate><exact>0.0</exact></yawRate><slipAngle><exact>0.0</exact></slipAngle></initialState>\n"
            f"    <goalState>{goal}<time><intervalStart>{steps[0]}</intervalStart><intervalEnd>{steps[1]}</intervalEnd>"
            f"</time></goalState>\n  </planningProblem>"
        )


def _lanelet(lane: _Lane) -> str:
    sides = {"leftBound": 1.0, "rightBound": -1.0}
    parts = [f'  <lanelet id="{lane.key}">']
    for name, side in sides.items():
        points = "".join(f"<point><x>{x:.4f}</x><y>{y:.4f}</y></point>" for x, y in _aside(lane.center, side))
        parts.append(f"    <{name}>{points}</{name}>")
    parts += [f'    <predecessor ref="{key}"/>' for key in lane.predecessors]
    parts += [f'    <successor ref="{key}"/>' for key in lane.successors]
    for name, neighbour in (("adjacentLeft", lane.left), ("adjacentRight", lane.right)):
        if neighbour is not None:
            parts.append(f'    <{name} ref="{neighbour[0]}" drivingDir="{"same" if neighbour[1] else "opposite"}"/>')
    if lane.sign is not None:
        parts.append("    <stopLine><lineMarking>solid</lineMarking></stopLine>")
    parts.append("    <laneletType>urban</laneletType>")
    if lane.sign is not None:
        parts.append(f'    <trafficSignRef ref="{lane.sign}"/>')
    if lane.light is not None:
        parts.append(f'    <trafficLightRef ref="{lane.light}"/>')
    return "\n".join([*parts, "  </lanelet>"])


def _aside(center: tuple[_Point, ...], side: float) -> list[_Point]:
    """Return the points of a bound; ``side``: 1 for the left one, −1 for the right one."""
    found = []
    for index, (x, y) in enumerate(center):
        before, after = center[max(index - 1, 0)], center[min(index + 1, len(center) - 1)]
        angle = math.atan2(after[1] - before[1], after[0] - before[0])
        found.append((x - side * math.sin(angle) * LANE_M / 2, y + side * math.cos(angle) * LANE_M / 2))
    return found


def _stop(key: int, position: _Point) -> str:
    return (
        f'  <trafficSign id="{key}"><trafficSignElement><trafficSignID>206</trafficSignID></trafficSignElement>'
        f"<position><point><x>{position[0]:g}</x><y>{position[1]:g}</y></point></position><virtual>false</virtual>"
        f"</trafficSign>"
    )


def _light(key: int, colour: str, position: _Point) -> str:
    return (
        f'  <trafficLight id="{key}"><cycle><cycleElement><duration>{2 * _LAST_STEP}</duration><color>{colour}</color>'
        f"</cycleElement></cycle><position><point><x>{position[0]:g}</x><y>{position[1]:g}</y></point></position>"
        f"<active>true</active></trafficLight>"
    )


def _line(start: _Point, end: _Point) -> tuple[_Point, ...]:
    count = max(round(math.dist(start, end) / _POINT_EVERY_M), 2)
    shares = [index / count for index in range(count + 1)]
    return tuple((start[0] + (end[0] - start[0]) * share, start[1] + (end[1] - start[1]) * share) for share in shares)


def _curve(start: _Point, start_rad: float, end: _Point, end_rad: float) -> tuple[_Point, ...]:
    """Return a cubic curve that leaves a point and reaches another in given directions."""
    reach = math.dist(start, end) * 0.4
    one = start[0] + reach * math.cos(start_rad), start[1] + reach * math.sin(start_rad)
    two = end[0] - reach * math.cos(end_rad), end[1] - reach * math.sin(end_rad)
    count = max(round(math.dist(start, end)), 4)
    points = []
    for index in range(count + 1):
        t = index / count
        shares = (1 - t) ** 3, 3 * (1 - t) ** 2 * t, 3 * (1 - t) * t**2, t**3
        nodes = (start, one, two, end)
        points.append(
            (
                sum(share * node[0] for share, node in zip(shares, nodes, strict=True)),
                sum(share * node[1] for share, node in zip(shares, nodes, strict=True)),
            )
        )
    return tuple(points)


def _arc(radius_m: float, begin_deg: float, end_deg: float) -> tuple[_Point, ...]:
    """Return points on a circle around the origin."""
    count = max(round(radius_m * math.radians(abs(end_deg - begin_deg))), 4)
    angles = [math.radians(begin_deg + (end_deg - begin_deg) * index / count) for index in range(count + 1)]
    return tuple((radius_m * math.cos(angle), radius_m * math.sin(angle)) for angle in angles)


def _three_lanes(name: str = "three_lanes", length_m: float = 1300.0, last_step: int = _LAST_STEP) -> _Road:
    lanes = tuple(
        _Lane(
            key,
            _line((0.0, y), (length_m, y)),
            left=(key + 1, True) if key < 3 else None,
            right=(key - 1, True) if key > 1 else None,
        )
        for key, y in ((1, -LANE_M), (2, 0.0), (3, LANE_M))
    )
    summary = "a straight road of three lanes, with the ego in the middle one"
    return _Road(name, summary, lanes, (300, 0, 0, 25), last_step=last_step)


def _two_way(name: str = "two_way", length_m: float = 1200.0, last_step: int = _LAST_STEP) -> _Road:
    lanes = (
        _Lane(1, _line((0.0, 0.0), (length_m, 0.0)), left=(2, False)),
        _Lane(2, _line((length_m, LANE_M), (0.0, LANE_M)), left=(1, False)),
    )
    summary = "a straight road with one lane in each direction"
    return _Road(name, summary, lanes, (200, 0, 0, 13.9), last_step=last_step)


def _long_three_lanes() -> _Road:
    return _three_lanes("three_lanes_long", _LONG_M, _LONG_STEP)


def _long_two_way() -> _Road:
    return _two_way("two_way_long", _LONG_M, _LONG_STEP)


_CURVE_M = 60.0


def _curve_road() -> _Road:
    """Return a road that leads east, turns left through a right angle, and leads north."""
    bend = tuple((x + 150.0, y + _CURVE_M) for x, y in _arc(_CURVE_M, -90.0, 0.0))
    end = (150.0 + _CURVE_M, _CURVE_M)
    lanes = (
        _Lane(1, _line((0.0, 0.0), (150.0, 0.0)), successors=(2,)),
        _Lane(2, bend, successors=(3,), predecessors=(1,)),
        _Lane(3, _line(end, (end[0], end[1] + 800.0)), predecessors=(2,)),
    )
    return _Road("curve", "a road of one lane with a left curve of 60 m radius", lanes, (60, 0, 0, 10))


_HALF_M, _ARM_M = 12.0, 220.0
"""Half the size of a crossing, and where its arms end."""
_TURNS: Mapping[int, tuple[int, int]] = {51: (11, 32), 52: (21, 42), 53: (31, 12), 54: (41, 22), 55: (11, 42)}
"""The ways over a crossing: straight on for all, and the left turn from the south."""
_INTO_NORTH: Mapping[int, tuple[int, int]] = {56: (21, 32), 57: (41, 32)}
"""The turns into the northern arm: right from the east, and left from the west."""
_FROM_RIGHT_LANE: Mapping[int, tuple[int, int]] = {58: (13, 42)}
"""The left turn from a second lane of the southern arm, across the first one."""


def _crossing(
    name: str,
    summary: str,
    goal: _Goal,
    *,
    lights: Mapping[int, str] | None = None,
    stops: bool = False,
    more: Mapping[int, tuple[int, int]] | None = None,
) -> _Road:
    """Return a crossing: arm k (south, east, north, west) has the lanes 10k + 1 to the crossing and 10k + 2 from it.

    Args:
        name: the road's name.
        summary: what the road looks like.
        goal: the ego's goal.
        lights: the colours for the north-south road (101) and for the other one (102), if there are traffic lights.
        stops: whether the east-west road has stop signs.
        more: turns in addition to the usual ones. A turn from lane 13 adds this lane to the right of lane 11.
    """
    half, far, off = _HALF_M, _ARM_M, LANE_M / 2
    turns = {**_TURNS, **(more or {})}
    has_second = any(begin == 13 for begin, _ in turns.values())
    inward = {11: ((off, -far), (off, -half)), 21: ((far, off), (half, off))}
    inward |= {31: ((-off, far), (-off, half)), 41: ((-far, -off), (-half, -off))}
    if has_second:
        inward |= {13: ((off + LANE_M, -far), (off + LANE_M, -half))}
    outward = {12: ((-off, -half), (-off, -far)), 22: ((half, -off), (far, -off))}
    outward |= {32: ((off, half), (off, far)), 42: ((-half, off), (-far, off))}
    lit = {11: 101, 31: 101, 21: 102, 41: 102} if lights else {}
    signed = {21: 201, 41: 202} if stops else {}
    lanes = []
    for key, (start, end) in inward.items():
        following = tuple(turn for turn, (begin, _) in turns.items() if begin == key)
        left = (11, True) if key == 13 else (key + 1, False)
        right = (13, True) if key == 11 and has_second else None
        lanes.append(
            _Lane(key, _line(start, end), following, left=left, right=right, light=lit.get(key), sign=signed.get(key))
        )
    for key, (start, end) in outward.items():
        before = tuple(turn for turn, (_, last) in turns.items() if last == key)
        lanes.append(_Lane(key, _line(start, end), predecessors=before, left=(key - 1, False)))
    for turn, (begin, last) in turns.items():
        start, end = inward[begin][1], outward[last][0]
        heading_rad, after_rad = _heading(inward[begin]), _heading(outward[last])
        center = _line(start, end) if heading_rad == after_rad else _curve(start, heading_rad, end, after_rad)
        lanes.append(_Lane(turn, center, (last,), (begin,)))
    ego = (off, -72.0, math.pi / 2, 12.0)
    return _Road(name, summary, tuple(lanes), ego, goal, dict(lights or {}), tuple(signed.values()))


def _heading(way: tuple[_Point, _Point]) -> float:
    (x, y), (to_x, to_y) = way
    return math.atan2(to_y - y, to_x - x)


_NORTH = _Goal((LANE_M / 2, 170.0), (60.0, LANE_M), math.pi / 2, (150, 250))
_WEST = _Goal((-170.0, LANE_M / 2), (60.0, LANE_M), math.pi, (200, 300))


def _straight_over() -> _Road:
    return _crossing("crossing_straight", "a crossing, with the ego going straight on", _NORTH)


def _left_turn() -> _Road:
    return _crossing("crossing_left", "a crossing, with the ego turning left", _WEST)


def _with_lights() -> _Road:
    summary = "a crossing with traffic lights: green for the ego, which goes straight on, red for crossing traffic"
    return _crossing("crossing_lights", summary, _NORTH, lights={101: "green", 102: "red"})


def _left_turn_with_lights() -> _Road:
    summary = "a crossing with traffic lights: green for the ego, which turns left, and for oncoming traffic"
    return _crossing("crossing_left_lights", summary, _WEST, lights={101: "green", 102: "red"})


def _turns_with_lights() -> _Road:
    summary = "a crossing with traffic lights: green for the ego, which goes straight on, red for turns into its road"
    return _crossing("crossing_turns_lights", summary, _NORTH, lights={101: "green", 102: "red"}, more=_INTO_NORTH)


def _turns_with_stops() -> _Road:
    summary = "a crossing with stop signs for crossing traffic, with the ego going straight on"
    return _crossing("crossing_stop", summary, _NORTH, stops=True, more=_INTO_NORTH)


def _two_lanes_to_crossing() -> _Road:
    summary = "a crossing with the ego going straight on in the left of two lanes"
    return _crossing("crossing_two_lanes", summary, _NORTH, more=_FROM_RIGHT_LANE)


def _merge() -> _Road:
    y = -LANE_M
    lanes = (
        _Lane(1, _line((0.0, 0.0), (300.0, 0.0)), successors=(2,), left=(11, True)),
        _Lane(2, _line((300.0, 0.0), (600.0, 0.0)), (3,), (1,), left=(12, True), right=(21, True)),
        _Lane(3, _line((600.0, 0.0), (1300.0, 0.0)), predecessors=(2,), left=(13, True)),
        _Lane(11, _line((0.0, LANE_M), (300.0, LANE_M)), successors=(12,), right=(1, True)),
        _Lane(12, _line((300.0, LANE_M), (600.0, LANE_M)), (13,), (11,), right=(2, True)),
        _Lane(13, _line((600.0, LANE_M), (1300.0, LANE_M)), predecessors=(12,), right=(3, True)),
        _Lane(20, _curve((100.0, -30.0), 0.15, (300.0, y), 0.0), successors=(21,)),
        _Lane(21, _line((300.0, y), (600.0, y)), predecessors=(20,), left=(2, True)),
    )
    return _Road("merge", "a road of two lanes with an on-ramp, with the ego in the right lane", lanes, (220, 0, 0, 25))


_RING_M = 18.0


def _roundabout() -> _Road:
    off, far = LANE_M / 2, 150.0
    at = {"in_south": -68.0, "out_north": 68.0, "in_west": -158.0, "out_south": -112.0}
    node = {name: _on_ring(angle) for name, angle in at.items()}
    lanes = (
        _Lane(11, _line((off, -far), (off, -32.0)), successors=(51,)),
        _Lane(41, _line((-far, -off), (-32.0, -off)), successors=(54,)),
        _Lane(32, _line((off, 32.0), (off, far)), predecessors=(52,)),
        _Lane(12, _line((-off, -32.0), (-off, -far)), predecessors=(53,)),
        _Lane(51, _curve((off, -32.0), math.pi / 2, node["in_south"], _along_ring(at["in_south"])), (63,), (11,)),
        _Lane(54, _curve((-32.0, -off), 0.0, node["in_west"], _along_ring(at["in_west"])), (61,), (41,)),
        _Lane(52, _curve(node["out_north"], _along_ring(at["out_north"]), (off, 32.0), math.pi / 2), (32,), (63,)),
        _Lane(53, _curve(node["out_south"], _along_ring(at["out_south"]), (-off, -32.0), -math.pi / 2), (12,), (61,)),
        _Lane(61, _arc(_RING_M, at["in_west"], at["out_south"]), (62, 53), (54, 64)),
        _Lane(62, _arc(_RING_M, at["out_south"], at["in_south"]), (63,), (61,)),
        _Lane(63, _arc(_RING_M, at["in_south"], at["out_north"]), (52, 64), (62, 51)),
        _Lane(64, _arc(_RING_M, at["out_north"], 360.0 + at["in_west"]), (61,), (63,)),
    )
    goal = _Goal((off, 120.0), (40.0, LANE_M), math.pi / 2, (200, 300))
    return _Road(
        "roundabout", "a roundabout, with the ego going straight on", lanes, (off, -92.0, math.pi / 2, 8.0), goal
    )


def _on_ring(angle_deg: float) -> _Point:
    return _RING_M * math.cos(math.radians(angle_deg)), _RING_M * math.sin(math.radians(angle_deg))


def _along_ring(angle_deg: float) -> float:
    return math.radians(angle_deg) + math.pi / 2


_DRAWN: Mapping[str, Callable[[], _Road]] = {
    "three_lanes": _three_lanes,
    "two_way": _two_way,
    "three_lanes_long": _long_three_lanes,
    "two_way_long": _long_two_way,
    "crossing_straight": _straight_over,
    "crossing_left": _left_turn,
    "crossing_lights": _with_lights,
    "crossing_left_lights": _left_turn_with_lights,
    "crossing_turns_lights": _turns_with_lights,
    "crossing_stop": _turns_with_stops,
    "crossing_two_lanes": _two_lanes_to_crossing,
    "curve": _curve_road,
    "merge": _merge,
    "roundabout": _roundabout,
}
ROADS: tuple[str, ...] = tuple(_DRAWN)
"""The names of all roads."""


def write_road(name: str, path: Path) -> Path:
    """Write the CommonRoad file of a road, and return its path.

    Raises:
        UnknownName: there is no such road.
    """
    if name not in _DRAWN:
        raise UnknownName(f"there is no road '{name}'", valid=closest(name, ROADS) or list(ROADS))
    path.write_text(_DRAWN[name]().xml(), encoding="utf-8")
    return path
