"""PlannerForge MCP: scenario-based testing of motion planners behind one MCP server.

The checkout itself is the package: its folders import each other by relative paths, which editors, linters and import
graphs follow from file to file. The folder ``plannerforge/`` holds links to them and to this file and gives the package
its name for whoever imports it. Importing this package loads nothing else; the names of the Python door
(``plannerforge.Workspace``, see ``library/``) are imported when they are first used.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .library import (
        Observation,
        Picture,
        Plan,
        PlannedTrajectory,
        PlanningTask,
        RouteFollower,
        Run,
        Runs,
        Scenario,
        Scenarios,
        Workspace,
    )

__all__ = [
    "Observation",
    "Picture",
    "Plan",
    "PlannedTrajectory",
    "PlanningTask",
    "RouteFollower",
    "Run",
    "Runs",
    "Scenario",
    "Scenarios",
    "Workspace",
    "__version__",
]

__version__ = "0.1.0"


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"plannerforge has no {name!r}; it has {', '.join(__all__)}")
    from . import library

    return getattr(library, name)
