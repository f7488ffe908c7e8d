"""The files and stored runs of a workspace, read independently, with the geometry for judging them.

CommonRoad XML of either format is read with lxml; runs, configurations, batches and recipes come from the workspace's
SQLite file and from ``steps.json``. This module uses nothing from the engine or the tools, so that the comparison is
independent. Units are metres, seconds, metres per second and radians unless a name states otherwise.
"""

import json
import math
import sqlite3
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from lxml import etree
from numpy.typing import NDArray

Line = NDArray[np.float64]
"""Points in metres, a row each."""
STANDING_MPS = 0.1
"""Standing means slower than this: the corpora's rule for ``standing``."""


@dataclass(frozen=True)
class State:
    """The position and speed of a body at a step."""

    step: int
    x: float
    y: float
    heading: float
    speed: float


@dataclass(frozen=True)
class Body:
    """A rectangle at a position, with its velocity along its heading."""

    x: float
    y: float
    heading: float
    speed: float
    length: float
    width: float

    @cached_property
    def corners(self) -> Line:
        """The four corners, counter-clockwise."""
        along, across = np.array([math.cos(self.heading), math.sin(self.heading)]), None
        across = np.array([-along[1], along[0]])
        half = [(0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)]
        middle = np.array([self.x, self.y])
        return np.array([middle + a * self.length * along + b * self.width * across for a, b in half])

    @cached_property
    def polygon(self) -> Any:
        """The rectangle as a shapely polygon."""
        return shapely.Polygon(self.corners)

    @property
    def velocity(self) -> Line:
        """The velocity along the heading, as a vector."""
        return self.speed * np.array([math.cos(self.heading), math.sin(self.heading)])

    def gap_to(self, other: "Body") -> float:
        """Return the distance between the two bodies in m; 0 if they touch or overlap."""
        return float(self.polygon.distance(other.polygon))

    def local(self, x: float, y: float) -> tuple[float, float]:
        """Return a point relative to this body: metres ahead, metres to the left."""
        dx, dy = x - self.x, y - self.y
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        return dx * cos + dy * sin, -dx * sin + dy * cos


@dataclass(frozen=True)
class RoadUser:
    """An obstacle of a file; ``states`` by step, in order. Circles and polygons are replaced by their bounding
    rectangles.
    """

    key: int
    kind: str
    is_static: bool
    length: float
    width: float
    states: Mapping[int, State]

    @property
    def first(self) -> State:
        """The road user's first state."""
        return self.states[min(self.states)]

    @property
    def last_step(self) -> int:
        """The step of its last state; for static obstacles, unlimited."""
        return 10**9 if self.is_static else max(self.states)

    def at(self, step: int) -> Body | None:
        """Return the body at a step, or None if it is not present."""
        state = self.first if self.is_static else self.states.get(step)
        if state is None:
            return None
        return Body(state.x, state.y, state.heading, state.speed, self.length, self.width)


@dataclass(frozen=True)
class Lanelet:
    """A lanelet with its successors and neighbours."""

    key: int
    left: Line
    right: Line
    successors: tuple[int, ...]
    predecessors: tuple[int, ...]
    adjacent_left: int | None
    adjacent_right: int | None
    left_is_same: bool
    right_is_same: bool
    types: frozenset[str]
    signs: tuple[int, ...]
    limit_mps: float | None

    @cached_property
    def polygon(self) -> Any:
        """The area between the bounds."""
        return shapely.Polygon(np.vstack([self.left, self.right[::-1]])).buffer(0)

    @cached_property
    def centre(self) -> Any:
        """The line midway between the bounds."""
        return shapely.LineString((self.left + self.right) / 2)

    @property
    def length(self) -> float:
        """The length of the centre line in m."""
        return float(self.centre.length)


@dataclass(frozen=True)
class Goal:
    """The conditions of a goal: a time in steps and, if given, an area, lanelets, a speed."""

    first_step: float
    last_step: float
    lanelets: tuple[int, ...]
    areas: tuple[Any, ...]
    speed: tuple[float, float] | None


@dataclass(frozen=True)
class Problem:
    """A planning problem: the ego's first state and its goals."""

    key: int
    start: State
    goals: tuple[Goal, ...]


@dataclass(frozen=True)
class SceneFile:
    """A CommonRoad file."""

    scenario_id: str
    step_s: float
    tags: frozenset[str]
    users: Mapping[int, RoadUser]
    lanelets: Mapping[int, Lanelet]
    problems: tuple[Problem, ...]
    sign_limits_mps: Mapping[int, tuple[float, ...]]
    texts: Mapping[int, bytes]

    @property
    def country(self) -> str:
        """The country in the benchmark id (ISO 3166-1 alpha-3)."""
        return self.scenario_id.removeprefix("C-")[:3]

    @property
    def place(self) -> str:
        """The place in the benchmark id."""
        return self.scenario_id.removeprefix("C-")[4:].partition("-")[0]

    @property
    def last_step(self) -> int:
        """The last step of any moving road user's track or any goal's time interval."""
        ends = [max(user.states) for user in self.users.values() if not user.is_static]
        ends += [int(goal.last_step) for problem in self.problems for goal in problem.goals]
        return max(ends, default=0)

    @property
    def counts(self) -> Counter[str]:
        """The number of road users by class, including static road users, excluding the ego of the planning problem."""
        egos = {problem.key for problem in self.problems}
        return Counter(user.kind for key, user in self.users.items() if key not in egos)

    def under(self, x: float, y: float, slack: float = 0.0) -> set[int]:
        """Return the lanelets within a distance of a point."""
        point = shapely.Point(x, y)
        return {key for key, lane in self.lanelets.items() if lane.polygon.distance(point) <= slack}

    def count_parallel_lanes(self, key: int) -> int:
        """Count the parallel lanelets of one direction, including the given lanelet."""
        return 1 + len(list(self._adjacent_lanelets(key, "left"))) + len(list(self._adjacent_lanelets(key, "right")))

    def _adjacent_lanelets(self, key: int, side: str) -> Iterator[int]:
        seen = {key}
        while True:
            lane = self.lanelets[key]
            other = lane.adjacent_left if side == "left" else lane.adjacent_right
            same = lane.left_is_same if side == "left" else lane.right_is_same
            if other is None or not same or other in seen or other not in self.lanelets:
                return
            yield other
            seen.add(other)
            key = other

    def present(self, step: int) -> dict[int, Body]:
        """Return the bodies present at a step, by road user."""
        there = {key: user.at(step) for key, user in self.users.items()}
        return {key: body for key, body in there.items() if body is not None}

    def collisions(self, first: int, last: int, keys: Sequence[int]) -> dict[frozenset[int], int]:
        """Return the pairs of vehicles with overlapping bodies, with the first step of each overlap."""
        found: dict[frozenset[int], int] = {}
        for step in range(first, last + 1):
            there = self.present(step)
            for key in keys:
                if key not in there:
                    continue
                mine = there[key]
                for other, body in there.items():
                    near = math.hypot(mine.x - body.x, mine.y - body.y) < (mine.length + body.length)
                    pair = frozenset((key, other))
                    if other != key and near and pair not in found and _overlap(mine, body):
                        found[pair] = step
        return found


def _overlap(one: Body, other: Body) -> bool:
    return bool(one.polygon.intersection(other.polygon).area > 1e-3)


def time_to_collision_s(one: Body, other: Body) -> float | None:
    """Return seconds until two bodies touch at constant speed and heading (Hayward 1972), or None if they never do."""
    relative = other.velocity - one.velocity
    earliest, latest = 0.0, math.inf
    for body in (one, other):
        for angle in (body.heading, body.heading + math.pi / 2):
            axis = np.array([math.cos(angle), math.sin(angle)])
            a, b = one.corners @ axis, other.corners @ axis
            speed = float(relative @ axis)
            if abs(speed) < 1e-12:
                if b.min() > a.max() or b.max() < a.min():
                    return None
                continue
            times = sorted(((a.min() - b.max()) / speed, (a.max() - b.min()) / speed))
            earliest, latest = max(earliest, times[0]), min(latest, times[1])
    return earliest if earliest <= latest else None


def read_scene(path: Path) -> SceneFile:
    """Read a file of the format 2018b or 2020a."""
    root = etree.parse(path).getroot()
    users, texts = {}, {}
    for element in root.iterfind("*"):
        if element.tag in ("obstacle", "staticObstacle", "dynamicObstacle"):
            user = _user(element)
            users[user.key] = user
            texts[user.key] = etree.tostring(element, method="c14n")
    signs = {int(sign.get("id", "0")): _limits(sign) for sign in root.iterfind("trafficSign")}
    return SceneFile(
        scenario_id=root.get("benchmarkID", ""),
        step_s=float(root.get("timeStepSize", "0.1")),
        tags=frozenset({str(tag.tag) for tag in root.iterfind("scenarioTags/*")} or root.get("tags", "").split()),
        users=users,
        lanelets={int(one.get("id", "0")): _lanelet(one) for one in root.iterfind("lanelet")},
        problems=tuple(_problem(one) for one in root.iterfind("planningProblem")),
        sign_limits_mps=signs,
        texts=texts,
    )


def _number(element: Any, path: str, default: float = 0.0) -> float:
    """Return an exact value, or the midpoint of an interval."""
    found = element.find(path)
    if found is None:
        return default
    exact = found.findtext("exact")
    if exact is not None:
        return float(exact)
    return (float(found.findtext("intervalStart")) + float(found.findtext("intervalEnd"))) / 2


def _state(element: Any) -> State:
    points = element.findall("position//point") or element.findall("position//center")
    places = [(float(point.findtext("x")), float(point.findtext("y"))) for point in points] or [(0.0, 0.0)]
    return State(
        step=round(_number(element, "time")),
        x=sum(place[0] for place in places) / len(places),
        y=sum(place[1] for place in places) / len(places),
        heading=_number(element, "orientation"),
        speed=_number(element, "velocity"),
    )


def _user(element: Any) -> RoadUser:
    states = [_state(one) for one in (*element.iterfind("initialState"), *element.iterfind("trajectory/state"))]
    length, width = _extents(element.find("shape"))
    return RoadUser(
        key=int(element.get("id")),
        kind=(element.findtext("type") or "").strip(),
        is_static=element.tag == "staticObstacle" or (element.findtext("role") or "").strip() == "static",
        length=length,
        width=width,
        states={state.step: state for state in states},
    )


def _extents(shape: Any) -> tuple[float, float]:
    if shape is None:
        return 0.0, 0.0
    if (radius := shape.findtext("circle/radius")) is not None:
        return 2 * float(radius), 2 * float(radius)
    if (length := shape.findtext("rectangle/length")) is not None:
        return float(length), float(shape.findtext("rectangle/width"))
    points = np.array([(float(p.findtext("x")), float(p.findtext("y"))) for p in shape.iterfind("polygon/point")])
    sides = np.ptp(points, axis=0) if len(points) else (0.0, 0.0)
    return float(sides[0]), float(sides[1])


def _lanelet(element: Any) -> Lanelet:
    def bound(name: str) -> Line:
        points = element.iterfind(f"{name}/point")
        return np.array([(float(point.findtext("x")), float(point.findtext("y"))) for point in points])

    def adjoining(name: str) -> tuple[int | None, bool]:
        found = element.find(name)
        return (None, False) if found is None else (int(found.get("ref")), found.get("drivingDir") == "same")

    left, right = adjoining("adjacentLeft"), adjoining("adjacentRight")
    limit = element.findtext("speedLimit")
    return Lanelet(
        key=int(element.get("id")),
        left=bound("leftBound"),
        right=bound("rightBound"),
        successors=tuple(int(one.get("ref")) for one in element.iterfind("successor")),
        predecessors=tuple(int(one.get("ref")) for one in element.iterfind("predecessor")),
        adjacent_left=left[0],
        adjacent_right=right[0],
        left_is_same=left[1],
        right_is_same=right[1],
        types=frozenset((one.text or "").strip() for one in element.iterfind("laneletType")),
        signs=tuple(int(one.get("ref")) for one in element.iterfind("trafficSignRef")),
        limit_mps=None if limit is None else float(limit),
    )


_LIMIT_SIGNS = ("274", "274.1", "R2-1", "r301", "C43", "B14", "R15", "c43", "b14", "r15")
"""Signs with a speed in ``additionalValue`` (selection corpus)."""


def _limits(sign: Any) -> tuple[float, ...]:
    return tuple(
        float(one.findtext("additionalValue"))
        for one in sign.iterfind("trafficSignElement")
        if (one.findtext("trafficSignID") or "").strip() in _LIMIT_SIGNS and one.findtext("additionalValue")
    )


def _problem(element: Any) -> Problem:
    goals = tuple(_goal(one) for one in element.iterfind("goalState"))
    return Problem(int(element.get("id")), _state(element.find("initialState")), goals)


def _goal(element: Any) -> Goal:
    time, speed = element.find("time"), element.find("velocity")
    exact = None if time is None else time.findtext("exact")
    begin, end = (exact, exact) if exact is not None else _interval(time)
    areas = [_area(one) for one in element.iterfind("position/*") if one.tag != "lanelet"]
    return Goal(
        first_step=float(begin or 0),
        last_step=float(end or 0),
        lanelets=tuple(int(one.get("ref")) for one in element.iterfind("position/lanelet")),
        areas=tuple(area for area in areas if area is not None),
        speed=None if speed is None else (float(_interval(speed)[0]), float(_interval(speed)[1])),
    )


def _interval(element: Any) -> tuple[str, str]:
    if element is None:
        return "0", "0"
    exact = element.findtext("exact")
    return (exact, exact) if exact is not None else (element.findtext("intervalStart"), element.findtext("intervalEnd"))


def _area(element: Any) -> Any:
    if element.tag == "polygon":
        return shapely.Polygon([(float(p.findtext("x")), float(p.findtext("y"))) for p in element.iterfind("point")])
    centre = float(element.findtext("center/x", "0")), float(element.findtext("center/y", "0"))
    if element.tag == "circle":
        return shapely.Point(centre).buffer(float(element.findtext("radius")))
    if element.tag == "rectangle":
        length, width = float(element.findtext("length")), float(element.findtext("width"))
        return Body(*centre, float(element.findtext("orientation", "0")), 0.0, length, width).polygon
    return None


@dataclass(frozen=True)
class StoredRun:
    """A stored run: its record, and the ego's motion step by step."""

    run_id: str
    scenario_id: str
    record: Mapping[str, Any]
    steps: Mapping[str, Any]

    @property
    def outcome(self) -> str:
        """The outcome, such as ``goal_reached`` or ``collision``."""
        return str(self.record["outcome"])

    @property
    def first_step(self) -> int:
        """The scenario's step of the first state."""
        return int(self.steps["first_step"])

    @property
    def last_step(self) -> int:
        """The scenario's step of the last state."""
        return self.first_step + len(self.steps["x_m"]) - 1

    @property
    def step_s(self) -> float:
        """The duration of a step in s."""
        return float(self.record["step_s"])

    def ego_at(self, step: int) -> Body | None:
        """Return the ego's body at a step of the scenario."""
        index = step - self.first_step
        if not 0 <= index < len(self.steps["x_m"]):
            return None
        x, y, heading, speed = (float(self.steps[name][index]) for name in ("x_m", "y_m", "heading_rad", "speed_mps"))
        return Body(x, y, heading, speed, float(self.record["ego_length_m"]), float(self.record["ego_width_m"]))

    def series(self, name: str) -> Line:
        """Return one of the values of ``steps.json`` over all steps."""
        return np.asarray(self.steps[name], dtype=float)


class World:
    """A workspace, read from its files."""

    def __init__(self, workspace: Path) -> None:
        self._workspace = workspace
        self._scenes: dict[str, SceneFile | None] = {}
        self._runs: dict[str, StoredRun | None] = {}

    def _rows(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        connection = sqlite3.connect(f"file:{self._workspace / 'workspace.sqlite'}?mode=ro", uri=True)
        try:
            return connection.execute(query, values).fetchall()
        finally:
            connection.close()

    def ids(self, kind: str) -> list[str]:
        """Return all artifacts of a kind, oldest first."""
        return [
            row[0] for row in self._rows("SELECT artifact_id FROM artifacts WHERE kind = ? ORDER BY sequence", kind)
        ]

    def kind_of(self, artifact_id: str) -> str | None:
        """Return the kind of an artifact, or None for an unknown id."""
        rows = self._rows("SELECT kind FROM artifacts WHERE artifact_id = ?", artifact_id)
        return rows[0][0] if rows else None

    def record(self, kind: str, artifact_id: str) -> Mapping[str, Any] | None:
        """Return the stored record of an artifact, or None for an unknown id."""
        query = "SELECT record FROM artifacts WHERE kind = ? AND artifact_id = ?"
        rows = self._rows(query, kind, artifact_id)
        return json.loads(rows[0][0]) if rows else None

    def recipe(self, artifact_id: str) -> Mapping[str, Any]:
        """Return the recipe of an artifact (tool, arguments, parents); empty for an unknown id."""
        rows = self._rows("SELECT recipe FROM artifacts WHERE artifact_id = ?", artifact_id)
        return json.loads(rows[0][0]) if rows else {}

    def scene(self, scenario_id: str) -> SceneFile | None:
        """Return the file of a scenario, or None for an unknown id."""
        if scenario_id not in self._scenes:
            path = self._workspace / "scenarios" / scenario_id / "scenario.xml"
            self._scenes[scenario_id] = read_scene(path) if path.is_file() else None
        return self._scenes[scenario_id]

    def scenes(self) -> dict[str, SceneFile]:
        """Return all scenarios of the workspace, by id."""
        found = {key: self.scene(key) for key in self.ids("scenario")}
        return {key: scene for key, scene in found.items() if scene is not None}

    def run(self, run_id: str) -> StoredRun | None:
        """Return a stored run, or None for an unknown id."""
        if run_id not in self._runs:
            record = self.record("run", run_id)
            path = self._workspace / "runs" / run_id / "steps.json"
            steps = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None
            known = record is not None and steps is not None
            self._runs[run_id] = StoredRun(run_id, record["scenario_id"], record, steps) if known else None  # type: ignore[index, arg-type]
        return self._runs[run_id]

    def others_of(self, run: StoredRun, step: int) -> dict[int, tuple[str, Body]]:
        """Return the class and body of each other road user at a step of a run; for reactive traffic, as simulated."""
        scene = self.scene(run.scenario_id)
        if scene is None:
            return {}
        kinds = {key: user.kind for key, user in scene.users.items()}
        found = {
            key: (kinds[key], body) for key, body in scene.present(step).items() if key != run.record["problem_id"]
        }
        for driven in run.steps.get("others", []):
            body = _driven_at(driven, step)
            key = int(driven["obstacle_id"]) if "obstacle_id" in driven else int(driven["key"])
            found.pop(key, None)
            if body is not None:
                found[key] = (kinds.get(key, "car"), body)
        return found


def _driven_at(driven: Mapping[str, Any], step: int) -> Body | None:
    index = step - int(driven.get("first_step", 0))
    if not 0 <= index < len(driven["x_m"]):
        return None
    x, y, heading, speed = (float(driven[name][index]) for name in ("x_m", "y_m", "heading_rad", "speed_mps"))
    return Body(x, y, heading, speed, float(driven["length_m"]), float(driven["width_m"]))
