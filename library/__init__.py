"""The Python door: scenarios, runs and results as objects, on the workflows that the tools of MCP use too.

``Workspace``: A folder of scenarios, configurations, runs and results, and everything that can be done with them.
``Scenario``: A stored scenario.
``Run``: A stored run.
``Runs``: Runs with their figures as a table.
``Scenarios``: Scenarios in order, with all that was answered.
``Picture``: A picture that was drawn, shown in notebooks.
``Observation``, ``Plan``, ``PlannedTrajectory``, ``PlanningTask``: What a planner of one's own is given, and answers.
``RouteFollower``: Makes motions along a planner's route.
"""

from typing import TYPE_CHECKING

from ..engine import lazy_face

if TYPE_CHECKING:
    from ..engine.planners import Observation, Plan, PlannedTrajectory, PlanningTask, RouteFollower
    from .objects import Picture, Run, Runs, Scenario, Scenarios
    from .workspace import Workspace

__getattr__, __dir__ = lazy_face(__name__, __file__)
