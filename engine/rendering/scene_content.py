"""What a scenario shows, as plain arrays: read once, drawn as often as there are frames."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from plannerforge.engine.geometry.polyline import Points, oriented_rectangle
from plannerforge.engine.planners.vehicle_models import BMW_320I
from plannerforge.engine.scenarios.tracks import Track, last_recorded_step, recorded_tracks, size_of

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.scenario import Scenario

    from plannerforge.engine.scenarios.reader import LoadedScenario

EGO_SIZE_M = (BMW_320I.length_m, BMW_320I.width_m)


@dataclass(frozen=True)
class LaneletShape:
    """A lanelet's sides (n, 2), its centre line, and the lanelets beside it, in whichever direction they lead."""

    lanelet_id: int
    left: Points
    right: Points
    center: Points
    left_neighbour: int | None
    right_neighbour: int | None
    inside_intersection: bool

    @property
    def outline(self) -> Points:
        """Closed outline, shape (m, 2)."""
        return np.vstack([self.left, self.right[::-1]])


@dataclass(frozen=True)
class StandingObstacle:
    """A static obstacle: its corners (n, 2) and type."""

    obstacle_id: int
    kind: str
    corners: Points


@dataclass(frozen=True)
class TrafficSignal:
    """A traffic light: where it stands and the colour of every step of its cycle ("inactive" without one)."""

    signal_id: int
    position: Points
    cycle: tuple[str, ...]
    offset: int

    def state_at(self, step: int) -> str:
        """Colour at a time step."""
        return self.cycle[(step - self.offset) % len(self.cycle)] if self.cycle else "inactive"


@dataclass(frozen=True)
class GoalRegion:
    """A goal: its polygons (empty where any place counts) and the steps in which it counts."""

    polygons: tuple[Points, ...]
    first_step: int
    last_step: int


@dataclass(frozen=True)
class SceneContent:
    """Everything that is drawn of one scenario."""

    scenario_id: str
    step_s: float
    last_step: int
    lanelets: tuple[LaneletShape, ...]
    stop_lines: tuple[Points, ...]
    signals: tuple[TrafficSignal, ...]
    tracks: dict[int, Track]
    standing: tuple[StandingObstacle, ...]
    ego_position: Points | None
    ego_heading_rad: float
    ego_speed_mps: float
    ego_step: int
    goals: tuple[GoalRegion, ...]

    def goal_points(self) -> Points:
        """All corners of all goal polygons, shape (n, 2)."""
        polygons = [polygon for goal in self.goals for polygon in goal.polygons]
        return np.vstack(polygons) if polygons else np.empty((0, 2))


def read_content(loaded: "LoadedScenario") -> SceneContent:
    """The drawable content of a scenario with its first planning problem, if it has one."""
    scenario = loaded.scenario
    problem = loaded.problem() if loaded.planning_problems.planning_problem_dict else None
    ego = problem.initial_state if problem else None
    goals = _goals(problem, scenario) if problem else ()
    last = max(last_recorded_step(scenario), *(goal.last_step for goal in goals), 0)
    return SceneContent(
        scenario_id=loaded.benchmark_id,
        step_s=loaded.step_s,
        last_step=last,
        lanelets=_lanelets(scenario),
        stop_lines=_stop_lines(scenario),
        signals=_signals(scenario),
        tracks=recorded_tracks(scenario),
        standing=_standing(scenario),
        ego_position=np.asarray(ego.position, dtype=float) if ego else None,
        ego_heading_rad=float(ego.orientation) if ego else 0.0,
        ego_speed_mps=float(ego.velocity) if ego else 0.0,
        ego_step=int(ego.time_step) if ego else 0,
        goals=goals,
    )


def _lanelets(scenario: "Scenario") -> tuple[LaneletShape, ...]:
    network = scenario.lanelet_network
    inside = {
        key
        for intersection in network.intersections
        for incoming in intersection.incomings
        for group in (incoming.successors_left, incoming.successors_straight, incoming.successors_right)
        for key in group or ()
    }
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
    found = []
    for lanelet in sorted(scenario.lanelet_network.lanelets, key=lambda lanelet: lanelet.lanelet_id):
        line = lanelet.stop_line
        if line is None:
            continue
        given = line.start is not None and line.end is not None
        ends = (line.start, line.end) if given else (lanelet.left_vertices[-1], lanelet.right_vertices[-1])
        found.append(np.array(ends, dtype=float))
    return tuple(found)


def _signals(scenario: "Scenario") -> tuple[TrafficSignal, ...]:
    network = scenario.lanelet_network
    ends: dict[int, Points] = {}
    for lanelet in sorted(network.lanelets, key=lambda lanelet: lanelet.lanelet_id):
        for key in lanelet.traffic_lights:
            ends.setdefault(key, np.asarray(lanelet.right_vertices[-1], dtype=float))
    found = []
    for light in sorted(network.traffic_lights, key=lambda light: light.traffic_light_id):
        position = light.position if light.position is not None else ends.get(light.traffic_light_id)
        if position is None:
            continue
        cycle = light.traffic_light_cycle
        elements = (cycle.cycle_elements or []) if cycle is not None else []
        colours = tuple(element.state.value for element in elements for _ in range(int(element.duration)))
        offset = int(cycle.time_offset or 0) if cycle is not None else 0
        found.append(TrafficSignal(int(light.traffic_light_id), np.asarray(position, dtype=float), colours, offset))
    return tuple(found)


def _standing(scenario: "Scenario") -> tuple[StandingObstacle, ...]:
    found = []
    for obstacle in sorted(scenario.static_obstacles, key=lambda obstacle: obstacle.obstacle_id):
        state = obstacle.initial_state
        center = getattr(state.position, "center", state.position)
        heading = getattr(state.orientation, "start", state.orientation)
        corners = oriented_rectangle(np.asarray(center, dtype=float), float(heading), size_of(obstacle.obstacle_shape))
        found.append(StandingObstacle(int(obstacle.obstacle_id), str(obstacle.obstacle_type.value), corners))
    return tuple(found)


def _goals(problem: "PlanningProblem", scenario: "Scenario") -> tuple[GoalRegion, ...]:
    found = []
    for index, state in enumerate(problem.goal.state_list):
        by_lanelet = (problem.goal.lanelets_of_goal_position or {}).get(index, [])
        if by_lanelet:
            lanelets = [scenario.lanelet_network.find_lanelet_by_id(key) for key in by_lanelet]
            polygons = [np.asarray(lanelet.polygon.vertices) for lanelet in lanelets if lanelet is not None]
        else:
            polygons = _polygons(getattr(state, "position", None))
        time = state.time_step
        first, last = (time.start, time.end) if hasattr(time, "start") else (time, time)
        found.append(GoalRegion(tuple(polygons), int(first), int(last)))
    return tuple(found)


def _polygons(shape: Any) -> list[Points]:
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
