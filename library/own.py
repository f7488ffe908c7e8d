"""What a planner of one's own is made of, so that ``import plannerforge as pf`` is all that it needs."""

from ..engine.planners import Observation, Plan, PlannedTrajectory, PlanningTask, RouteFollower

__all__ = ["Observation", "Plan", "PlannedTrajectory", "PlanningTask", "RouteFollower"]
