"""Checks progress and distance to the goal on roundabouts, loops and roads that cross themselves.

The roads are synthetic. Their centre lines consist of straight lines and arcs that join smoothly, so every place has an
arc length without any projection. An ego drives a part of the route at a lateral offset and stands until its time is
over. The bench compares the product's statements about that drive with the arc lengths of the closed form:

- ``lap_error_m_max``: the largest error in metres over all cases, of the progress (the covered share of the distance to
  the goal's beginning, times that distance) and of the distance to the goal's end in the verdict "ran out of time".

A wrong lap shows as an error of tens of metres. Smaller errors come from the smoothing of the reference path.
"""

import math
import random
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from commonroad.common.util import Interval
from commonroad.geometry.shape import Rectangle
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.scenario import Scenario
from commonroad.scenario.state import CustomState, InitialState

from plannerforge.engine.execution import silent
from plannerforge.engine.planners import Observation, Plan, PlannedTrajectory, PlanningTask, progress_to_goal, simulate
from plannerforge.engine.vehicles import BMW_320I
from plannerforge.evals.scoring.common import built_in

from ..harness import Figures, SeededBench

CASES = 60
_STEP_S, _WIDTH_M, _SPACING_M = 0.1, 4.0, 0.5
_GOAL_LENGTH_M = 8.0
_BEFORE_GOAL_M = r"([\d.]+) m short of the goal region's end"


@dataclass(frozen=True)
class _Piece:
    """A straight line (``turn_rad`` 0) or an arc, left positive, of a length in m."""

    length_m: float
    turn_rad: float = 0.0


@dataclass(frozen=True)
class _Way:
    """A way of pieces, one lanelet each, from the origin to the east."""

    pieces: tuple[_Piece, ...]

    @property
    def length_m(self) -> float:
        """Its length in m."""
        return sum(piece.length_m for piece in self.pieces)

    def pose(self, station_m: float, offset_m: float = 0.0) -> tuple[float, float, float]:
        """Return the place (x, y) in m at an arc length and an offset to the left, and the heading there in rad."""
        x = y = heading = 0.0
        left_m = station_m
        for piece in self.pieces:
            along_m = min(left_m, piece.length_m) if piece is not self.pieces[-1] else left_m
            bend = piece.turn_rad / piece.length_m
            if bend:
                x += (math.sin(heading + bend * along_m) - math.sin(heading)) / bend
                y -= (math.cos(heading + bend * along_m) - math.cos(heading)) / bend
            else:
                x, y = x + along_m * math.cos(heading), y + along_m * math.sin(heading)
            heading += bend * along_m
            left_m -= along_m
            if left_m <= 0.0:
                break
        return x - offset_m * math.sin(heading), y + offset_m * math.cos(heading), heading

    def network(self) -> LaneletNetwork:
        """Return a lanelet for each piece, joined in their order."""
        lanelets, begin_m = [], 0.0
        for number, piece in enumerate(self.pieces):
            count = max(math.ceil(piece.length_m / _SPACING_M), 2) + 1
            at = np.linspace(begin_m, begin_m + piece.length_m, count)
            left, center, right = (
                np.array([self.pose(float(station), offset)[:2] for station in at])
                for offset in (_WIDTH_M / 2, 0.0, -_WIDTH_M / 2)
            )
            before, after = number, number + 2
            links = {
                "predecessor": [before] if number else [],
                "successor": [after] if number + 1 < len(self.pieces) else [],
            }
            lanelets.append(Lanelet(left, center, right, number + 1, **links))
            begin_m += piece.length_m
        return LaneletNetwork.create_from_lanelet_list(lanelets)


@dataclass(frozen=True)
class Case:
    """A route, the ego's start, end and offset on it, and the start of the goal, in m."""

    name: str
    way: _Way
    begin_m: float
    end_m: float
    goal_m: float
    offset_m: float

    def problem(self) -> PlanningProblem:
        """Return the planning problem: the goal region extends across the lane."""
        x, y, heading = self.way.pose(self.begin_m, self.offset_m)
        start = InitialState(
            time_step=0,
            position=np.array([x, y]),
            orientation=heading,
            velocity=8.0,
            acceleration=0.0,
            yaw_rate=0.0,
            slip_angle=0.0,
        )
        gx, gy, turned = self.way.pose(self.goal_m + _GOAL_LENGTH_M / 2)
        region = Rectangle(_GOAL_LENGTH_M, _WIDTH_M, np.array([gx, gy]), math.remainder(turned, math.tau))
        over = len(self.driven()) + 10  # its time is over after the ego has stopped
        return PlanningProblem(1, start, GoalRegion([CustomState(time_step=Interval(10, over), position=region)]))

    def passes_goal_before(self) -> bool:
        """Return True if the route passes the goal's region before the goal, so that this passage counts as the
        goal.
        """
        x, y, heading = self.way.pose(self.goal_m + _GOAL_LENGTH_M / 2)
        for station in np.arange(0.0, self.goal_m - 2.0, 0.25):
            dx, dy = (a - b for a, b in zip(self.way.pose(float(station))[:2], (x, y), strict=True))
            along = dx * math.cos(heading) + dy * math.sin(heading)
            across = dy * math.cos(heading) - dx * math.sin(heading)
            if abs(along) < _GOAL_LENGTH_M / 2 + 2.0 and abs(across) < _WIDTH_M / 2 + 2.0:
                return True
        return False

    def driven(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return the poses (n, 3) at every step of the drive, 8 m/s along the centre line."""
        count = max(round((self.end_m - self.begin_m) / 8.0 / _STEP_S), 1) + 1
        stations = np.linspace(self.begin_m, self.end_m, count)
        return np.array([self.way.pose(float(station), self.offset_m) for station in stations])


def cases(seed: int, count: int) -> list[Case]:
    """Return roundabouts, ring roads, loops that cross themselves and hairpins, drawn evenly."""
    draw = random.Random(f"{seed}: laps")  # noqa: S311 - a sample
    kinds = (_roundabout, _ring_road, _loop, _hairpin)
    found: list[Case] = []
    while len(found) < count:
        case = kinds[len(found) % len(kinds)](draw)
        if not case.passes_goal_before():
            found.append(case)
    return found


def _roundabout(draw: random.Random) -> Case:
    """Return a way onto a ring along a tangent, round it by up to nearly a whole turn, and off along another."""
    radius_m, turn = draw.uniform(13.0, 28.0), draw.uniform(math.radians(60), math.radians(340))
    parts = [turn * share for share in (0.3, 0.4, 0.3)]
    ring = [_Piece(radius_m * part, part) for part in parts]
    way = _Way((_Piece(60.0), *ring, _Piece(draw.uniform(60.0, 90.0)), _Piece(60.0)))
    return _drawn("roundabout", way, way.length_m - 75.0, draw)


def _ring_road(draw: random.Random) -> Case:
    """Return a way round a ring from one place to just behind it, with a road that goes on round the ring again."""
    radius_m = draw.uniform(14.0, 30.0)
    turn = math.tau / 4
    ring = [_Piece(radius_m * turn, turn) for _ in range(6)]
    return _drawn("ring road", _Way(tuple(ring)), math.tau * radius_m * 0.97, draw, ring=True)


def _loop(draw: random.Random) -> Case:
    """Return a road that turns by 270° and crosses itself: a loop ramp."""
    radius_m = draw.uniform(13.0, 25.0)
    turn = math.radians(270)
    ring = [_Piece(radius_m * turn / 3, turn / 3) for _ in range(3)]
    way = _Way((_Piece(70.0), *ring, _Piece(100.0), _Piece(60.0)))
    return _drawn("loop", way, way.length_m - 70.0, draw)


def _hairpin(draw: random.Random) -> Case:
    """Return a way there and back on a road with its two arms 20 to 32 m apart."""
    radius_m = draw.uniform(10.0, 16.0)
    way = _Way((_Piece(80.0), _Piece(math.pi * radius_m, math.pi), _Piece(80.0), _Piece(60.0)))
    return _drawn("hairpin", way, way.length_m - 70.0, draw)


def _drawn(name: str, way: _Way, farthest_m: float, draw: random.Random, *, ring: bool = False) -> Case:
    """Return a case with a goal that begins within ``farthest_m``, and an ego that stops before it."""
    begin_m = draw.uniform(2.0, 6.0) if ring else draw.uniform(5.0, 30.0)
    goal_m = draw.uniform(0.55, 1.0) * (farthest_m - _GOAL_LENGTH_M)
    end_m = begin_m + draw.choice((draw.uniform(0.2, 0.9), 0.95)) * (goal_m - 4.0 - begin_m)
    return Case(name, way, begin_m, end_m, goal_m, draw.uniform(-1.0, 1.0))


class _Follower:
    """A planner that drives given poses and then stands."""

    def __init__(self, poses: np.ndarray[Any, np.dtype[np.float64]]) -> None:
        self._poses = poses

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        self._horizon = round(task.configuration.settings.horizon_s / task.step_s) + 1

    def plan(self, observation: Observation) -> Plan:
        """Return the poses from the present step on."""
        at = np.minimum(observation.ego.step + np.arange(self._horizon), len(self._poses) - 1)
        poses = self._poses[at]
        speeds = np.append(np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1) / _STEP_S, 0.0)
        return Plan(PlannedTrajectory(poses[:, :2], poses[:, 2], speeds, np.zeros(len(at))))


def errors_m(case: Case) -> tuple[float, float]:
    """Return the errors of the progress and of the distance to the goal's end, in m; infinite if missing."""
    scenario, problem, poses = Scenario(dt=_STEP_S), case.problem(), case.driven()
    scenario.add_objects(case.way.network())
    progress = progress_to_goal(scenario, problem, BMW_320I, poses[:, :2])
    whole_m = case.goal_m - case.begin_m
    run = simulate(scenario, problem, built_in("idm:Default"), _Follower(poses), "constant_velocity", silent)
    told = re.search(_BEFORE_GOAL_M, run.final.reason)
    left_m = case.goal_m + _GOAL_LENGTH_M - case.end_m
    return (
        math.inf if progress is None else abs(progress * whole_m - (case.end_m - case.begin_m)),
        math.inf if told is None else abs(float(told.group(1)) - left_m),
    )


def measure(bench: SeededBench) -> Figures:
    """Compare the product's places with those of the closed form."""
    found = [(case, errors_m(case)) for case in cases(bench.seed, bench.limit or CASES)]
    figures: dict[str, float] = {"lap_error_m_max": round(max(max(errors) for _, errors in found), 3)}
    for name in sorted({case.name for case, _ in found}):
        of_kind = [errors for case, errors in found if case.name == name]
        key = name.replace(" ", "_")
        figures[f"{key}_progress_m_max"] = round(max(progress for progress, _ in of_kind), 3)
        figures[f"{key}_distance_m_max"] = round(max(distance for _, distance in of_kind), 3)
    return {**figures, "laps_cases": len(found)}
