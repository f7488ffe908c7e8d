"""A planner for experiments: it keeps its place beside the reference path and brakes to a stand."""

import numpy as np

from plannerforge.engine.geometry.polyline import arc_length, interpolate, point_at, project
from plannerforge.engine.planners.interface import Observation, Plan, PlannedTrajectory, Planner, PlanningTask

BRAKING_MPS2 = 6.0
HORIZON_S = 3.0


class BrakingPlanner:
    """Brakes at once with 6 m/s² and stays where it stands."""

    def __init__(self, braking_mps2: float = BRAKING_MPS2) -> None:
        self._braking_mps2 = braking_mps2
        self._task: PlanningTask | None = None

    def reset(self, task: PlanningTask) -> None:
        """Keep the task of the run."""
        self._task = task

    def plan(self, observation: Observation) -> Plan:
        """The way to the stand along the reference path, at the present distance beside it."""
        if self._task is None:
            raise RuntimeError("reset the planner before it plans")
        ego, step_s = observation.ego, self._task.step_s
        times = np.arange(round(HORIZON_S / step_s) + 1) * step_s
        until_stand_s = ego.speed_mps / self._braking_mps2
        braked = np.minimum(times, until_stand_s)
        moved = ego.speed_mps * braked - self._braking_mps2 * braked**2 / 2
        points = self._task.reference.points
        stations = project(points, ego.position)[0] + moved
        path = interpolate(points, arc_length(points), stations)
        directions = np.unwrap([point_at(points, station)[1] for station in stations])
        return Plan(
            PlannedTrajectory(
                positions=path - path[0] + ego.position,
                headings_rad=ego.heading_rad + directions - directions[0],
                speeds_mps=np.maximum(ego.speed_mps - self._braking_mps2 * times, 0.0),
                accelerations_mps2=np.where(times < until_stand_s, -self._braking_mps2, 0.0),
            ),
            candidates=1,
        )


class BrakingFrom:
    """Drives as another planner does, and brakes to a stand from a time on; ``brake_step`` is that time's step.

    Args:
        planner: who drives first.
        after_s: time from the start of the run at which the ego begins to brake.
    """

    def __init__(self, planner: Planner, after_s: float) -> None:
        self.brake_step = 0
        self._planner, self._after_s, self._braking = planner, after_s, BrakingPlanner()

    def reset(self, task: PlanningTask) -> None:
        """Prepare both planners."""
        self.brake_step = int(task.problem.initial_state.time_step) + round(self._after_s / task.step_s)
        self._planner.reset(task)
        self._braking.reset(task)

    def plan(self, observation: Observation) -> Plan:
        """The plan of the planner whose time it is."""
        planner = self._planner if observation.ego.step < self.brake_step else self._braking
        return planner.plan(observation)
