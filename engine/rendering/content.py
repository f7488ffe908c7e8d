"""The drawable content of a scenario and its runs as plain arrays, read once and drawn for every frame.

``ScenarioContent`` is a scenario, ``DrivenPath`` a run over it, ``ScenarioView`` both at one step, ``Viewport`` the
visible part of a picture. Lengths are in m, in the coordinates of the scenario.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ...schemas.runs import RunRecord, RunSource
from ...schemas.worlds import REPORTED, Sighting
from ..analysis import driven_tracks, read_steps
from ..commonroad import Track, last_recorded_step, size_of
from ..geometry import Points, Values, length_m, oriented_rectangle, resample
from ..vehicles import ego_class
from .canvas import EGO_COLOUR, series_style

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.lanelet import Lanelet
    from commonroad.scenario.scenario import Scenario

    from ..commonroad import RecordedScenario


@dataclass(frozen=True)
class LaneletShape:
    """A lanelet's sides (n, 2), its centre line, and its neighbouring lanelets of either direction."""

    lanelet_id: int
    left: Points
    right: Points
    center: Points
    left_neighbour: int | None
    right_neighbour: int | None
    inside_intersection: bool

    @property
    def outline(self) -> Points:
        """The closed outline, shape (m, 2)."""
        return np.vstack([self.left, self.right[::-1]])


@dataclass(frozen=True)
class _TrafficSignal:
    """A traffic light: its position, and its colour at every step of its cycle ("inactive" if it has no cycle)."""

    signal_id: int
    position: Points
    cycle: tuple[str, ...]
    offset: int

    def state_at(self, step: int) -> str:
        """Return the colour at a time step."""
        return self.cycle[(step - self.offset) % len(self.cycle)] if self.cycle else "inactive"


@dataclass(frozen=True)
class VehicleShape:
    """A vehicle or standing obstacle at one time: corners (4, 2) counter-clockwise from the front left."""

    vehicle_id: int
    kind: str
    corners: Points
    center: Points


@dataclass(frozen=True)
class ScenarioContent:
    """All drawn content of one scenario; ``goals`` are polygons (n, 2), empty if any position counts.

    ``pavements`` and ``crossings`` (stripes) are polygons for paths that only pedestrians use.
    """

    scenario_id: str
    step_s: float
    last_step: int
    lanelets: tuple[LaneletShape, ...]
    stop_lines: tuple[Points, ...]
    signals: tuple[_TrafficSignal, ...]
    tracks: dict[int, Track]
    standing: tuple[VehicleShape, ...]
    ego_position: Points | None
    ego_heading_rad: float
    ego_speed_mps: float
    ego_step: int
    ego_class: str
    goals: tuple[Points, ...]
    pavements: tuple[Points, ...] = ()
    crossings: tuple[Points, ...] = ()

    @property
    def ego_size_m(self) -> tuple[float, float]:
        """The length and width in m of the ego's class."""
        return ego_class(self.ego_class).vehicle.size_m

    def positions_at(self, step: int) -> dict[int, Points]:
        """Return the positions of the moving vehicles at a step, by id; each a point (2,)."""
        tracks = self.tracks.items()
        return {key: track.positions[index] for key, track in tracks if (index := track.index_at(step)) is not None}

    def places_at(self, step: int) -> dict[int, Points]:
        """Return the positions (2,) of all road users but the ego at a step, and of standing obstacles, by id."""
        return {shape.vehicle_id: shape.center for shape in self.vehicles_at(step)}

    def vehicles_at(self, step: int) -> list[VehicleShape]:
        """Return all vehicles and standing obstacles that are present at a step, by id."""
        present = [(track, index) for track in self.tracks.values() if (index := track.index_at(step)) is not None]
        moving = [
            VehicleShape(track.obstacle_id, track.kind, track.corners_at(index), track.positions[index])
            for track, index in present
        ]
        return sorted([*moving, *self.standing], key=lambda vehicle: vehicle.vehicle_id)


def content_of(recorded: "RecordedScenario") -> ScenarioContent:
    """Return the drawable content of a scenario with its first planning problem, if it has one."""
    loaded = recorded.loaded
    scenario = loaded.scenario
    problem = loaded.problem() if loaded.planning_problems.planning_problem_dict else None
    ego = problem.initial_state if problem else None
    goal_states = problem.goal.state_list if problem else []
    last_goals = (int(getattr(state.time_step, "end", state.time_step)) for state in goal_states)
    return ScenarioContent(
        scenario_id=loaded.benchmark_id,
        step_s=loaded.step_s,
        last_step=max(last_recorded_step(scenario), *last_goals, 0),
        lanelets=_lanelets(scenario),
        stop_lines=_stop_lines(scenario),
        signals=_signals(scenario),
        tracks=recorded.tracks,
        standing=_standing(scenario),
        ego_position=np.asarray(ego.position, dtype=float) if ego else None,
        ego_heading_rad=float(ego.orientation) if ego else 0.0,
        ego_speed_mps=float(ego.velocity) if ego else 0.0,
        ego_step=int(ego.time_step) if ego else 0,
        ego_class=loaded.ego_class(int(problem.planning_problem_id)) if problem else "car",
        goals=_goals(problem, scenario) if problem else (),
        pavements=tuple(_outline(one) for one in loaded.footways if not _crosses(one)),
        crossings=tuple(stripe for one in loaded.footways if _crosses(one) for stripe in _stripes(one)),
    )


_STRIPE_M = 0.6
"""Width of a stripe of a crossing, and of the gap next to it (chosen)."""


def _crosses(footway: "Lanelet") -> bool:
    return any(kind.value == "crosswalk" for kind in footway.lanelet_type)


def _outline(footway: "Lanelet") -> Points:
    return np.concatenate([footway.right_vertices, footway.left_vertices[::-1]])


def _stripes(footway: "Lanelet") -> list[Points]:
    """Return the stripes of a crossing, along the road that it crosses."""
    count = 2 * max(round(length_m(np.asarray(footway.center_vertices)) / _STRIPE_M / 2), 1)
    left, right = (resample(np.asarray(side), count + 1) for side in (footway.left_vertices, footway.right_vertices))
    return [np.array([right[k], right[k + 1], left[k + 1], left[k]]) for k in range(0, count, 2)]


def _lanelets(scenario: "Scenario") -> tuple[LaneletShape, ...]:
    network = scenario.lanelet_network
    incomings = [incoming for intersection in network.intersections for incoming in intersection.incomings]
    turns = [(one.successors_left, one.successors_straight, one.successors_right) for one in incomings]
    inside = {key for groups in turns for group in groups for key in group or ()}
    return tuple(
        LaneletShape(
            lanelet_id=int(lanelet.lanelet_id),
            left=np.asarray(lanelet.left_vertices, dtype=float),
            right=np.asarray(lanelet.right_vertices, dtype=float),
            center=np.asarray(lanelet.center_vertices, dtype=float),
            left_neighbour=lanelet.adj_left,
            right_neighbour=lanelet.adj_right,
            inside_intersection=lanelet.lanelet_id in inside,
        )
        for lanelet in sorted(network.lanelets, key=lambda lanelet: lanelet.lanelet_id)
    )


def _stop_lines(scenario: "Scenario") -> tuple[Points, ...]:
    lines = []
    for lanelet in sorted(scenario.lanelet_network.lanelets, key=lambda lanelet: lanelet.lanelet_id):
        line = lanelet.stop_line
        if line is None:
            continue
        given = line.start is not None and line.end is not None
        ends = (line.start, line.end) if given else (lanelet.left_vertices[-1], lanelet.right_vertices[-1])
        lines.append(np.array(ends, dtype=float))
    return tuple(lines)


def _signals(scenario: "Scenario") -> tuple[_TrafficSignal, ...]:
    network = scenario.lanelet_network
    ends: dict[int, Points] = {}
    for lanelet in sorted(network.lanelets, key=lambda lanelet: lanelet.lanelet_id):
        for key in lanelet.traffic_lights:
            ends.setdefault(key, np.asarray(lanelet.right_vertices[-1], dtype=float))
    signals = []
    for light in sorted(network.traffic_lights, key=lambda light: light.traffic_light_id):
        position = light.position if light.position is not None else ends.get(light.traffic_light_id)
        if position is None:
            continue
        cycle = light.traffic_light_cycle
        elements = (cycle.cycle_elements or []) if cycle is not None else []
        colours = tuple(element.state.value for element in elements for _ in range(int(element.duration)))
        offset = int(cycle.time_offset or 0) if cycle is not None else 0
        signals.append(_TrafficSignal(int(light.traffic_light_id), np.asarray(position, dtype=float), colours, offset))
    return tuple(signals)


def _standing(scenario: "Scenario") -> tuple[VehicleShape, ...]:
    standing = []
    for obstacle in sorted(scenario.static_obstacles, key=lambda obstacle: obstacle.obstacle_id):
        state = obstacle.initial_state
        center = getattr(state.position, "center", state.position)
        heading = getattr(state.orientation, "start", state.orientation)
        corners = oriented_rectangle(np.asarray(center, dtype=float), float(heading), size_of(obstacle.obstacle_shape))
        kind = str(obstacle.obstacle_type.value)
        standing.append(VehicleShape(int(obstacle.obstacle_id), kind, corners, corners.mean(axis=0)))
    return tuple(standing)


def _goals(problem: "PlanningProblem", scenario: "Scenario") -> tuple[Points, ...]:
    polygons: list[Points] = []
    for index, state in enumerate(problem.goal.state_list):
        by_lanelet = (problem.goal.lanelets_of_goal_position or {}).get(index, [])
        if by_lanelet:
            lanelets = [scenario.lanelet_network.find_lanelet_by_id(key) for key in by_lanelet]
            polygons += [np.asarray(lanelet.polygon.vertices) for lanelet in lanelets if lanelet is not None]
        else:
            polygons += _polygons(getattr(state, "position", None))
    return tuple(polygons)


def _polygons(shape: Any) -> list[Points]:
    """Return the outlines of a CommonRoad shape; a circle gets 35 corners."""
    if shape is None:
        return []
    if hasattr(shape, "shapes"):
        return [polygon for part in shape.shapes for polygon in _polygons(part)]
    if hasattr(shape, "radius"):
        angles = np.linspace(0, 2 * np.pi, 36)
        return [np.asarray(shape.center) + shape.radius * np.column_stack([np.cos(angles), np.sin(angles)])]
    if hasattr(shape, "vertices"):
        return [np.asarray(shape.vertices, dtype=float)]
    return []


@dataclass(frozen=True)
class DrivenPath:
    """The ego's centres (n, 2), headings and speeds (n,), starting at ``first_step``.

    ``name``: the run's name in the picture; ``series``: number of its colour and dash pattern, the same for one
    configuration in all pictures of a request. ``others``: the motion of the obstacles that reacted to the ego, by id.
    ``sightings``: what the planner received about road users in an imperfect world.
    """

    record: RunRecord
    first_step: int
    positions: Points
    headings_rad: Values
    speeds_mps: Values
    name: str
    series: int = 0
    others: dict[int, Track] = field(default_factory=dict)
    sightings: tuple[Sighting, ...] = ()

    def unseen_at(self, step: int) -> frozenset[int]:
        """Return the ids of the road users within 80 m that the planner did not receive at a step."""
        codes = {one.obstacle_id: one.code for one in self.sightings if one.step <= step}
        return frozenset(key for key, code in codes.items() if code not in REPORTED)

    @property
    def last_step(self) -> int:
        """The last driven step."""
        return self.first_step + len(self.positions) - 1

    def index_at(self, step: int) -> int:
        """Return the index for a time step, clamped to the driven steps, so that the ego stays where its run ended."""
        return int(np.clip(step - self.first_step, 0, len(self.positions) - 1))

    def position_at(self, step: int) -> Points:
        """Return the ego's position at a time step, shape (2,)."""
        position: Points = self.positions[self.index_at(step)]
        return position

    def corners_at(self, step: int) -> Points:
        """Return the ego's corners at a time step, shape (4, 2)."""
        size = (self.record.ego_length_m, self.record.ego_width_m)
        return oriented_rectangle(self.position_at(step), float(self.headings_rad[self.index_at(step)]), size)

    @property
    def label(self) -> str:
        """The configuration and the outcome, as in a legend."""
        return f"{self.name}: {self.record.outcome.replace('_', ' ')}"


def driven_path(source: RunSource, name: str = "", series: int = 0) -> DrivenPath | None:
    """Return the path of a run, by default with its configuration's name; None if it has no steps."""
    steps = read_steps(source)
    if steps is None or not steps.x_m:
        return None
    return DrivenPath(
        record=source.record,
        first_step=steps.first_step,
        positions=np.column_stack([steps.x_m, steps.y_m]),
        headings_rad=np.asarray(steps.heading_rad, dtype=float),
        speeds_mps=np.asarray(steps.speed_mps, dtype=float),
        name=name or source.record.config_name,
        series=series,
        others=driven_tracks(steps),
        sightings=() if steps.perceived is None else steps.perceived.sightings,
    )


def short_names(runs: Sequence[RunRecord]) -> dict[str, str]:
    """Return names of configurations by id, without the planner if all runs have the same planner."""
    one_planner = len({run.planner for run in runs}) == 1
    return {run.config_id: run.config_name.removeprefix(f"{run.planner}:" if one_planner else "") for run in runs}


@dataclass(frozen=True)
class ScenarioView:
    """One scenario to draw: its content, the runs over it and the displayed step.

    ``focus_id``: the road user in the middle of the picture, which is present at the step; None means the ego.
    """

    content: ScenarioContent
    paths: tuple[DrivenPath, ...] = ()
    step: int = 0
    focus_id: int | None = None

    @property
    def unseen(self) -> frozenset[int]:
        """The road users that no planner received at the displayed step; empty without a run in an imperfect world."""
        each = [path.unseen_at(self.step) for path in self.paths]
        return frozenset.intersection(*each) if each else frozenset()

    @property
    def time_s(self) -> float:
        """The displayed time in seconds."""
        return self.step * self.content.step_s

    def ego_colour(self, number: int) -> str:
        """Return the colour of the n-th run's ego; if there are several runs, it is the colour of the run's path."""
        return EGO_COLOUR if len(self.paths) == 1 else series_style(self.paths[number].series)[0]

    @property
    def ego_name(self) -> str:
        """The name of the ego: ``ego``, with its class if that is not a car."""
        driven = {path.record.ego_class for path in self.paths} or {self.content.ego_class}
        return "ego" if driven == {"car"} or len(driven) > 1 else f"ego ({driven.pop()})"

    @property
    def ego_size_m(self) -> tuple[float, float]:
        """The length and width of the ego in m, from the first run if there is one."""
        records = [path.record for path in self.paths[:1]]
        return (records[0].ego_length_m, records[0].ego_width_m) if records else self.content.ego_size_m

    def focus(self) -> Points:
        """Return the point of interest: the chosen road user, else the first ego or start, else the map's middle."""
        if self.focus_id is not None:
            return self.content.places_at(self.step)[self.focus_id]
        if self.paths:
            return self.paths[0].position_at(self.step)
        if self.content.ego_position is not None:
            return self.content.ego_position
        centers = [lanelet.center.mean(axis=0) for lanelet in self.content.lanelets]
        return np.mean(centers, axis=0) if centers else np.zeros(2)


MARGIN_M = 14.0
"""Margin around the content of a picture: about three car lengths (chosen)."""
_SMALLEST_SPAN_M, _LARGEST_SPAN_M = 80.0, 260.0
"""Between these, a car is recognisable and its surroundings are in view (chosen)."""
_FLATTEST_RATIO, _STEEPEST_RATIO = 3.0, 1.1
"""Bounds of width by height, which keep pictures in a usable shape (chosen)."""
_GOAL_SHOWN_M = 30.0
"""Length of a goal shown beyond its point nearest to the ego or its path (chosen)."""
_NEIGHBOURS_M = 35.0
"""Radius around the ego within which vehicles are in view (chosen)."""
_LOOK_AHEAD_S = 2.5
"""Without a run, the ego's path over this time at its initial speed is in view (chosen)."""


@dataclass(frozen=True)
class Viewport:
    """A rectangle in scenario coordinates (metres)."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @property
    def width_m(self) -> float:
        """The extent along x in m."""
        return self.x_max - self.x_min

    @property
    def height_m(self) -> float:
        """The extent along y in m."""
        return self.y_max - self.y_min

    @property
    def middle(self) -> Points:
        """The viewport's middle, shape (2,)."""
        return np.array([self.x_min + self.x_max, self.y_min + self.y_max]) / 2

    @classmethod
    def of(cls, content: ScenarioContent, paths: Sequence[DrivenPath] = (), step: int | None = None) -> "Viewport":
        """Return the relevant part: ego, neighbours, paths and near end of the goal; else the traffic or the map.

        It is at least 80 m wide, at most 260 m in each direction, and no flatter than 3 to 1.
        """
        points = _points_of_interest(content, paths, step)
        center = _anchor(content, paths, step, points)
        low, high = _limited(points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M, center)
        width, height = high - low
        width, height = max(width, _SMALLEST_SPAN_M), max(height, _SMALLEST_SPAN_M / _FLATTEST_RATIO)
        height = max(height, width / _FLATTEST_RATIO)
        return cls.around((low + high) / 2, max(width, height * _STEEPEST_RATIO), height)

    @classmethod
    def near(cls, point: Points) -> "Viewport":
        """Return the surroundings of a point (2,), with the width of the smallest picture."""
        return cls.around(point, _SMALLEST_SPAN_M, _SMALLEST_SPAN_M / _STEEPEST_RATIO)

    @classmethod
    def around(cls, middle: Points, width_m: float, height_m: float) -> "Viewport":
        """Return the rectangle of a given size around a point (2,)."""
        x, y = middle
        return cls(x - width_m / 2, y - height_m / 2, x + width_m / 2, y + height_m / 2)

    def fitted(self, ratio: float) -> "Viewport":
        """Return the viewport widened to the shape of the axes (width by height), so that both scales are equal."""
        wider, higher = max(self.width_m, self.height_m * ratio), max(self.height_m, self.width_m / ratio)
        return Viewport.around(self.middle, wider, higher)

    def joined(self, other: "Viewport") -> "Viewport":
        """Return the smallest viewport that contains this one and another, for pictures that are compared."""
        low = min(self.x_min, other.x_min), min(self.y_min, other.y_min)
        return Viewport(*low, max(self.x_max, other.x_max), max(self.y_max, other.y_max))

    def contains(self, points: Points) -> bool:
        """Return True if any of the points (n, 2) is inside."""
        x, y = points[:, 0], points[:, 1]
        inside = (self.x_min <= x) & (x <= self.x_max) & (self.y_min <= y) & (y <= self.y_max)
        return bool(inside.any())


def _points_of_interest(content: ScenarioContent, paths: Sequence[DrivenPath], step: int | None) -> Points:
    shown = [path.positions for path in paths]
    at = content.ego_step if step is None else step
    traffic = np.array(list(content.positions_at(at).values())).reshape(-1, 2)
    if content.ego_position is not None:
        direction = np.array([np.cos(content.ego_heading_rad), np.sin(content.ego_heading_rad)])
        ahead = content.ego_position + direction * content.ego_speed_mps * _LOOK_AHEAD_S
        shown += [content.ego_position[None, :]] if paths else [np.stack([content.ego_position, ahead])]
        center = paths[0].position_at(at) if paths else content.ego_position
        shown.append(traffic[np.linalg.norm(traffic - center, axis=1) <= _NEIGHBOURS_M])
        if content.goals:
            goal, reference = np.vstack(content.goals), np.vstack(shown)
            distance = np.linalg.norm(goal[:, None, :] - reference[None, :, :], axis=2).min(axis=1)
            shown.append(goal[distance <= distance.min() + _GOAL_SHOWN_M])
    else:
        shown.append(traffic)
    if not any(len(points) for points in shown):
        shown = [lanelet.center for lanelet in content.lanelets] or [np.zeros((1, 2))]
    return np.vstack(shown)


def _anchor(content: ScenarioContent, paths: Sequence[DrivenPath], step: int | None, points: Points) -> Points:
    if paths and step is not None:
        return paths[0].position_at(step)
    if content.ego_position is not None:
        return content.ego_position
    middle: Points = (points.min(axis=0) + points.max(axis=0)) / 2
    return middle


def _limited(low: Points, high: Points, center: Points) -> tuple[Points, Points]:
    """Return an extent, cut if it is too large, with the centre of interest inside."""
    for axis in (0, 1):
        if high[axis] - low[axis] > _LARGEST_SPAN_M:
            start = np.clip(center[axis] - _LARGEST_SPAN_M / 2, low[axis], high[axis] - _LARGEST_SPAN_M)
            low[axis], high[axis] = start, start + _LARGEST_SPAN_M
    return low, high
