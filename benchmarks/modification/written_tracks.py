"""Reads a written CommonRoad file for the judge of ``make bench-edits``, with lxml and numpy alone.

It reads only what the judge needs: lanelets with their lights, road users with their states, the first planning
problem. It understands files of 2020a (``dynamicObstacle``) and 2018b (``obstacle`` with a role).
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RoadUser:
    """A road user's states: ``first`` is the time step of the first one; places in m, headings in rad, speeds m/s."""

    key: int
    kind: str
    length_m: float
    width_m: float
    first: int
    places: Array
    headings: Array
    speeds: Array
    is_static: bool = False

    @property
    def last(self) -> int:
        """The time step of the last state."""
        return self.first + len(self.places) - 1

    @cached_property
    def forward(self) -> Array:
        """Unit vectors (n, 2) along the headings."""
        return np.column_stack([np.cos(self.headings), np.sin(self.headings)])

    @cached_property
    def fronts(self) -> Array:
        """The middle of the front bumper at every state, (n, 2) in m."""
        return np.asarray(self.places + self.forward * self.length_m / 2)

    def at(self, step: int) -> int | None:
        """Return the index of the state at a time step; None if the road user is not there."""
        return step - self.first if self.first <= step <= self.last else None


@dataclass(frozen=True)
class Light:
    """A traffic light: its phases as (steps, colour) from ``offset`` on, and the direction that it holds for."""

    key: int
    phases: tuple[tuple[int, str], ...]
    offset: int
    direction: str
    active: bool

    def colour(self, step: int) -> str:
        """Return the colour at a time step; empty for a light without states."""
        total = sum(duration for duration, _ in self.phases)
        if not self.active or total <= 0:
            return ""
        left = (step - self.offset) % total
        for duration, colour in self.phases:
            if left < duration:
                return colour
            left -= duration
        return ""


@dataclass(frozen=True)
class Lane:
    """A lanelet: bounds (n, 2) in m, its successors and neighbours, and the ids of its lights."""

    key: int
    left: Array
    right: Array
    successors: tuple[int, ...]
    predecessors: tuple[int, ...]
    beside: dict[str, tuple[int, str]]
    lights: tuple[int, ...]
    kinds: frozenset[str]

    @cached_property
    def center(self) -> Array:
        """The centre line (n, 2) in m."""
        return np.asarray((self.left + self.right) / 2)

    @cached_property
    def stations(self) -> Array:
        """Arc lengths of the centre line's points."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.center, axis=0), axis=1))])

    @property
    def length_m(self) -> float:
        """Length of the centre line."""
        return float(self.stations[-1])

    @cached_property
    def width_m(self) -> float:
        """Mean width."""
        return float(np.linalg.norm(self.left - self.right, axis=1).mean())

    def along(self, points: Array) -> tuple[Array, Array, Array]:
        """Return arc length, offset (left positive) and direction in rad of the lane at each of some points (n, 2).

        Before its beginning and after its end the lane continues straight.
        """
        center = self.center
        steps = np.diff(center, axis=0)
        lengths = np.maximum(np.linalg.norm(steps, axis=1), 1e-9)
        units = steps / lengths[:, None]
        away = points[:, None, :] - center[None, :-1, :]
        along = (away * units[None]).sum(axis=2)
        low = np.where(np.arange(len(lengths)) == 0, -np.inf, 0.0)
        high = np.where(np.arange(len(lengths)) == len(lengths) - 1, np.inf, lengths)
        clipped = np.clip(along, low[None], high[None])
        gaps = np.linalg.norm(away - clipped[:, :, None] * units[None], axis=2)
        best = gaps.argmin(axis=1)
        rows = np.arange(len(points))
        cross = units[best, 0] * away[rows, best, 1] - units[best, 1] * away[rows, best, 0]
        direction = np.arctan2(units[best, 1], units[best, 0])
        return self.stations[best] + clipped[rows, best], cross, direction


@dataclass(frozen=True)
class WrittenFile:
    """A scenario file: lanes, lights and road users by id; ``step_s``: duration of a time step; the ego's start."""

    step_s: float
    lanes: dict[int, Lane]
    lights: dict[int, Light]
    users: dict[int, RoadUser]
    ego: "EgoStart | None" = None
    elements: dict[str, bytes] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path) -> "WrittenFile":
        """Read a file."""
        root = etree.parse(path, etree.XMLParser(resolve_entities=False, huge_tree=True)).getroot()
        lanes = {lane.key: lane for lane in map(_lane, root.findall("lanelet"))}
        lights = {light.key: light for light in map(_light, root.findall("trafficLight"))}
        users = {}
        for element in root:
            if element.tag in ("dynamicObstacle", "staticObstacle", "obstacle"):
                user = _user(element)
                if user is not None:
                    users[user.key] = user
        elements = {
            str(one.get("id") or one.tag): etree.tostring(one, with_tail=False)
            for one in root
            if isinstance(one.tag, str)
        }
        return cls(float(root.get("timeStepSize") or 0.1), lanes, lights, users, _ego(root), elements)

    @property
    def last_step(self) -> int:
        """The last time step of any moving road user."""
        return max((user.last for user in self.users.values() if not user.is_static), default=0)

    def lane_of(self, place: Array, heading: float) -> int | None:
        """Return the lanelet at a place (2,) with a heading; the best aligned of several."""
        best, key = math.radians(60.0), None
        for lane in self.lanes.values():
            station, offset, direction = (value[0] for value in lane.along(place[None]))
            if not -0.5 <= station <= lane.length_m + 0.5 or abs(offset) > lane.width_m / 2 + 0.2:
                continue
            off = abs(math.remainder(float(direction) - heading, math.tau))
            if off < best - 1e-9:
                best, key = off, lane.key
        return key


@dataclass(frozen=True)
class EgoStart:
    """The first planning problem's start: place (2,) in m, heading in rad, speed in m/s, time step."""

    place: Array
    heading: float
    speed: float
    step: int
    length_m: float = 4.508
    width_m: float = 1.61


def _points(bound: etree._Element | None) -> Array:
    if bound is None:
        return np.zeros((0, 2))
    return np.array(
        [[float(point.findtext("x", "nan")), float(point.findtext("y", "nan"))] for point in bound.findall("point")]
    )


def _lane(element: etree._Element) -> Lane:
    beside = {}
    for tag, side in (("adjacentLeft", "left"), ("adjacentRight", "right")):
        found = element.find(tag)
        if found is not None:
            beside[side] = int(found.get("ref") or 0), str(found.get("drivingDir"))
    return Lane(
        key=int(element.get("id") or 0),
        left=_points(element.find("leftBound")),
        right=_points(element.find("rightBound")),
        successors=tuple(int(one.get("ref") or 0) for one in element.findall("successor")),
        predecessors=tuple(int(one.get("ref") or 0) for one in element.findall("predecessor")),
        beside=beside,
        lights=tuple(int(one.get("ref") or 0) for one in element.findall("trafficLightRef")),
        kinds=frozenset(str(one.text) for one in element.findall("laneletType")),
    )


def _light(element: etree._Element) -> Light:
    cycle = element.find("cycle")
    parts = [] if cycle is None else cycle.findall("cycleElement")
    return Light(
        key=int(element.get("id") or 0),
        phases=tuple((int(one.findtext("duration", "0")), one.findtext("color", "")) for one in parts),
        offset=int((None if cycle is None else cycle.findtext("timeOffset")) or 0),
        direction=element.findtext("direction") or "all",
        active=(element.findtext("active") or "true").strip() == "true",
    )


def _number(element: etree._Element | None) -> float:
    if element is None:
        return 0.0
    exact = element.findtext("exact")
    if exact is not None:
        return float(exact)
    low, high = element.findtext("intervalStart"), element.findtext("intervalEnd")
    return 0.0 if low is None or high is None else (float(low) + float(high)) / 2


def _state(element: etree._Element) -> tuple[int, float, float, float, float] | None:
    point = element.find("position/point")
    if point is None:
        return None
    x, y = float(point.findtext("x", "nan")), float(point.findtext("y", "nan"))
    heading, speed = _number(element.find("orientation")), _number(element.find("velocity"))
    return round(_number(element.find("time"))), x, y, heading, speed


def _user(element: etree._Element) -> RoadUser | None:
    initial, rectangle = element.find("initialState"), element.find("shape/rectangle")
    if initial is None:
        return None
    is_static = element.tag == "staticObstacle" or element.findtext("role") == "static"
    states = [_state(initial), *map(_state, element.findall("trajectory/state"))]
    rows = [state for state in states if state is not None]
    if not rows or len(rows) != len(states):
        return None
    radius = float(element.findtext("shape/circle/radius") or 0.5)
    length, width = 2 * radius, 2 * radius
    if rectangle is not None:
        length, width = float(rectangle.findtext("length", "0")), float(rectangle.findtext("width", "0"))
    table = np.array(rows)
    return RoadUser(
        key=int(element.get("id") or 0),
        kind=element.findtext("type") or "",
        length_m=length,
        width_m=width,
        first=round(table[0, 0]),
        places=table[:, 1:3],
        headings=table[:, 3],
        speeds=table[:, 4],
        is_static=is_static,
    )


def _ego(root: etree._Element) -> EgoStart | None:
    state = root.find("planningProblem/initialState")
    found = None if state is None else _state(state)
    return None if found is None else EgoStart(np.array(found[1:3]), found[3], found[4], found[0])
