"""Python access to PlannerForge: scenarios, runs and results as objects, based on the same workflows as the MCP tools.

``Workspace``: A folder of scenarios, configurations, runs and results, with every operation on them.
``Scenario``: A stored scenario.
``Run``: A stored run.
``Runs``: Runs, with metrics that convert to a table.
``Scenarios``: An ordered collection of scenarios, with the answer that returned them.
``Picture``: A drawn picture that notebooks display.
``Observation``, ``Plan``, ``PlannedTrajectory``, ``PlanningTask``: The input and output of your own planner.
``RouteFollower``: Generates motions along a planner's route.
"""

from typing import TYPE_CHECKING

from ..engine import lazy_face

if TYPE_CHECKING:
    from ..engine.planners import Observation, Plan, PlannedTrajectory, PlanningTask, RouteFollower
    from .objects import Picture, Run, Runs, Scenario, Scenarios
    from .workspace import Workspace

__getattr__, __dir__ = lazy_face(__name__, __file__)
