"""Small CommonRoad scenarios made by hand, for tests that need no real file.

``town_road`` is a road of two lanes that forks, with an oncoming lane and a handful of vehicles:

    lane 3  ◄──────────────────────────────────────────────────────  y = 7      oncoming, westbound, x 300 → 0
    lane 2  ─────────────────────────────►┬─ 21 ───────────────────►  y = 3.5    x 0 → 200 → 300
    lane 1  ─────────────────────────────►┬─ 11 ───────────────────►  y = 0
                                          └─ 12 (right turn) ─► 13    southbound to y = −100
"""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

Point = tuple[float, float]
LANE_WIDTH_M = 3.5


@dataclass(frozen=True)
class Lane:
    """A lanelet around a centre line; neighbours as (id, same direction)."""

    lanelet_id: int
    center: tuple[Point, ...]
    successors: tuple[int, ...] = ()
    predecessors: tuple[int, ...] = ()
    left: tuple[int, bool] | None = None
    right: tuple[int, bool] | None = None


@dataclass(frozen=True)
class Vehicle:
    """A recorded vehicle: (x, y, heading, speed) at every step from ``first_step`` on."""

    vehicle_id: int
    poses: tuple[tuple[float, float, float, float], ...]
    kind: str = "car"
    length_m: float = 4.5
    width_m: float = 1.8
    first_step: int = 0


@dataclass(frozen=True)
class Problem:
    """A planning problem: start (x, y, heading, speed), goal rectangle (x, y, length, width) and time steps."""

    problem_id: int = 100
    start: tuple[float, float, float, float] = (40.0, 0.0, 0.0, 10.0)
    goal: tuple[float, float, float, float] | None = (150.0, 0.0, 8.0, 3.0)
    steps: tuple[int, int] = (60, 150)
    start_step: int = 0


@dataclass(frozen=True)
class ScenarioBuilder:
    """The content of a scenario file; ``write`` produces the XML of either format."""

    lanes: tuple[Lane, ...]
    vehicles: tuple[Vehicle, ...] = ()
    parked: tuple[Vehicle, ...] = ()
    problems: tuple[Problem, ...] = (Problem(),)
    benchmark_id: str = "ZAM_Builder-1_1_T-1"
    version: str = "2020a"
    step_s: float = 0.1
    tags: tuple[str, ...] = field(default=("urban",))

    def with_vehicles(self, *vehicles: Vehicle) -> "ScenarioBuilder":
        """Return the same scenario with other vehicles."""
        return replace(self, vehicles=vehicles)

    def cut(self, steps: int) -> "ScenarioBuilder":
        """Return the same scenario with fewer recorded steps, because reading takes most of a test's time."""
        return self.with_vehicles(*(replace(vehicle, poses=vehicle.poses[:steps]) for vehicle in self.vehicles))

    def write(self, path: Path) -> Path:
        """Write the file and return its path."""
        path.write_text(self.xml(), encoding="utf-8")
        return path

    def xml(self) -> str:
        """Return the file's text, indented by two blanks per level."""
        old = self.version == "2018b"
        tags = f' tags="{" ".join(self.tags)}"' if old else ""
        root = (
            f'<commonRoad timeStepSize="{self.step_s}" commonRoadVersion="{self.version}" author="nobody" '
            f'affiliation="none" source="by hand" benchmarkID="{self.benchmark_id}" date="2020-01-01"{tags}>'
        )
        lines = ["<?xml version='1.0' encoding='UTF-8'?>", root]
        if not old:
            lines.append("  <location><geoNameId>-999</geoNameId><gpsLatitude>999</gpsLatitude>")
            lines.append("  <gpsLongitude>999</gpsLongitude></location>")
            lines.append(f"  <scenarioTags>{''.join(f'<{tag}/>' for tag in self.tags)}</scenarioTags>")
        lines += [_lanelet(lane, old=old) for lane in self.lanes]
        lines += [_parked(vehicle, old=old) for vehicle in self.parked]
        lines += [_vehicle(vehicle, old=old) for vehicle in self.vehicles]
        lines += [_problem(problem) for problem in self.problems]
        return "\n".join([*lines, "</commonRoad>", ""])


def line(start: Point, end: Point, count: int = 21) -> tuple[Point, ...]:
    """Return evenly spaced points on a straight line."""
    shares = [index / (count - 1) for index in range(count)]
    return tuple((start[0] + (end[0] - start[0]) * share, start[1] + (end[1] - start[1]) * share) for share in shares)


def arc(center: Point, radius_m: float, begin_rad: float, end_rad: float, count: int = 21) -> tuple[Point, ...]:
    """Return evenly spaced points on a circle."""
    angles = [begin_rad + (end_rad - begin_rad) * index / (count - 1) for index in range(count)]
    return tuple((center[0] + radius_m * math.cos(a), center[1] + radius_m * math.sin(a)) for a in angles)


def driving(
    vehicle_id: int,
    start: Point,
    speed_mps: float,
    steps: int,
    *,
    heading_rad: float = 0.0,
    kind: str = "car",
    size_m: tuple[float, float] = (4.5, 1.8),
    first_step: int = 0,
) -> Vehicle:
    """Return a vehicle that drives straight at constant speed."""
    forward = math.cos(heading_rad) * speed_mps * 0.1, math.sin(heading_rad) * speed_mps * 0.1
    poses = tuple(
        (start[0] + forward[0] * step, start[1] + forward[1] * step, heading_rad, speed_mps) for step in range(steps)
    )
    return Vehicle(vehicle_id, poses, kind, *size_m, first_step)


def town_road() -> ScenarioBuilder:
    """Return the road of the drawing above with five vehicles and the ego (problem 100) in lane 1 at x = 40."""
    lanes = (
        Lane(1, line((0, 0), (200, 0)), successors=(11, 12), left=(2, True)),
        Lane(2, line((0, 3.5), (200, 3.5)), successors=(21,), left=(3, False), right=(1, True)),
        Lane(3, line((300, 7), (0, 7)), left=(2, False)),
        Lane(11, line((200, 0), (300, 0)), predecessors=(1,), left=(21, True)),
        Lane(12, arc((200, -20), 20, math.pi / 2, 0), predecessors=(1,), successors=(13,)),
        Lane(13, line((220, -20), (220, -100)), predecessors=(12,)),
        Lane(21, line((200, 3.5), (300, 3.5)), predecessors=(2,), right=(11, True)),
    )
    vehicles = (
        driving(31, (70, 0), 10.0, 151),
        driving(32, (15, 0), 10.0, 151),
        driving(33, (60, 3.5), 12.0, 151, kind="truck", size_m=(8.0, 2.5)),
        driving(34, (280, 7), 11.0, 151, heading_rad=math.pi, kind="motorcycle", size_m=(2.2, 0.9)),
        driving(35, (165, 0), 8.0, 151),
    )
    return ScenarioBuilder(lanes, vehicles)


def crossing() -> ScenarioBuilder:
    """Return two crossing one-way roads: 1 → 2 → 3 eastbound, 4 → 5 → 6 northbound."""
    return ScenarioBuilder(
        (
            Lane(1, line((-60, 0), (-10, 0)), successors=(2,)),
            Lane(2, line((-10, 0), (10, 0)), successors=(3,), predecessors=(1,)),
            Lane(3, line((10, 0), (60, 0)), predecessors=(2,)),
            Lane(4, line((0, -60), (0, -10)), successors=(5,)),
            Lane(5, line((0, -10), (0, 10)), successors=(6,), predecessors=(4,)),
            Lane(6, line((0, 10), (0, 60)), predecessors=(5,)),
        )
    )


def _lanelet(lane: Lane, *, old: bool) -> str:
    left, right = _bounds(lane.center)
    parts = [f'  <lanelet id="{lane.lanelet_id}">']
    for name, points in (("leftBound", left), ("rightBound", right)):
        parts.append(
            f"    <{name}>{''.join(f'<point><x>{x:.4f}</x><y>{y:.4f}</y></point>' for x, y in points)}</{name}>"
        )
    parts += [f'    <predecessor ref="{key}"/>' for key in lane.predecessors]
    parts += [f'    <successor ref="{key}"/>' for key in lane.successors]
    for name, beside in (("adjacentLeft", lane.left), ("adjacentRight", lane.right)):
        if beside is not None:
            parts.append(f'    <{name} ref="{beside[0]}" drivingDir="{"same" if beside[1] else "opposite"}"/>')
    if not old:
        parts.append("    <laneletType>urban</laneletType>")
    return "\n".join([*parts, "  </lanelet>"])


def _bounds(center: tuple[Point, ...]) -> tuple[list[Point], list[Point]]:
    left, right = [], []
    for index, (x, y) in enumerate(center):
        before, after = center[max(index - 1, 0)], center[min(index + 1, len(center) - 1)]
        angle = math.atan2(after[1] - before[1], after[0] - before[0])
        across = -math.sin(angle) * LANE_WIDTH_M / 2, math.cos(angle) * LANE_WIDTH_M / 2
        left.append((x + across[0], y + across[1]))
        right.append((x - across[0], y - across[1]))
    return left, right


def _vehicle(vehicle: Vehicle, *, old: bool) -> str:
    states = [_state(pose, vehicle.first_step + step) for step, pose in enumerate(vehicle.poses)]
    tag = "obstacle" if old else "dynamicObstacle"
    return "\n".join(
        [
            f'  <{tag} id="{vehicle.vehicle_id}">',
            *(["    <role>dynamic</role>"] if old else []),
            *_type_and_shape(vehicle),
            f"    <initialState>{states[0]}</initialState>",
            "    <trajectory>",
            *(f"      <state>{state}</state>" for state in states[1:]),
            "    </trajectory>",
            f"  </{tag}>",
        ]
    )


def _parked(vehicle: Vehicle, *, old: bool) -> str:
    tag = "obstacle" if old else "staticObstacle"
    x, y, heading, _ = vehicle.poses[0]
    state = f"{_point(x, y)}<orientation><exact>{heading}</exact></orientation><time><exact>0</exact></time>"
    lines = [f'  <{tag} id="{vehicle.vehicle_id}">', *(["    <role>static</role>"] if old else [])]
    return "\n".join([*lines, *_type_and_shape(vehicle), f"    <initialState>{state}</initialState>", f"  </{tag}>"])


def _type_and_shape(vehicle: Vehicle) -> list[str]:
    size = f"<length>{vehicle.length_m}</length><width>{vehicle.width_m}</width>"
    return [f"    <type>{vehicle.kind}</type>", f"    <shape><rectangle>{size}</rectangle></shape>"]


def _state(pose: tuple[float, float, float, float], step: int) -> str:
    x, y, heading, speed = pose
    return (
        f"{_point(x, y)}<orientation><exact>{heading:.6f}</exact></orientation><time><exact>{step}</exact></time>"
        f"<velocity><exact>{speed:.4f}</exact></velocity><acceleration><exact>0.0</exact></acceleration>"
    )


def _point(x: float, y: float) -> str:
    return f"<position><point><x>{x:.4f}</x><y>{y:.4f}</y></point></position>"


def _problem(problem: Problem) -> str:
    x, y, heading, speed = problem.start
    start = (
        f"{_point(x, y)}<velocity><exact>{speed}</exact></velocity><orientation><exact>{heading}</exact></orientation>"
        f"<yawRate><exact>0.0</exact></yawRate><slipAngle><exact>0.0</exact></slipAngle>"
        f"<time><exact>{problem.start_step}</exact></time>"
    )
    first, last = problem.steps
    goal = f"<time><intervalStart>{first}</intervalStart><intervalEnd>{last}</intervalEnd></time>"
    if problem.goal is not None:
        gx, gy, length, width = problem.goal
        goal = (
            f"<position><rectangle><length>{length}</length><width>{width}</width><orientation>0.0</orientation>"
            f"<center><x>{gx}</x><y>{gy}</y></center></rectangle></position>{goal}"
        )
    return "\n".join(
        [
            f'  <planningProblem id="{problem.problem_id}">',
            f"    <initialState>{start}</initialState>",
            f"    <goalState>{goal}</goalState>",
            "  </planningProblem>",
        ]
    )


def swinging_bus(vehicle_id: int, steps: int) -> Vehicle:
    """Return a bus in the turn of the town road (lane 12) with its front swung out of the lane, off all lanes."""
    poses = []
    for step in range(steps):
        along = math.pi / 4 - 0.02 * step
        out_rad = 0.5 * math.exp(-0.05 * step)
        poses.append((200 + 20 * math.cos(along), -20 + 20 * math.sin(along), along - math.pi / 2 + out_rad, 4.0))
    return Vehicle(vehicle_id, tuple(poses), "bus", 12.0, 2.5)
