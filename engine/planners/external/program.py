"""Planners that are programs, whichever protocol they speak: made, ended, and asked for their logs."""

from collections.abc import Iterator
from contextlib import contextmanager

from ....schemas.planning import CommandPlanner
from ..interface import Planner
from .command import CommandDriver, ScenarioFile, command_driver
from .found import OwnPlanner
from .guarded import guarded
from .stepwise import StepwiseDriver


def program_driver(name: str, declared: CommandPlanner, scenario: ScenarioFile) -> CommandDriver | StepwiseDriver:
    """Return a new planner that asks the program; a stepwise program does not get the file, which holds the future."""
    if declared.protocol == "stepwise":
        return StepwiseDriver(name, declared, scenario.scenario_id)
    return command_driver(name, declared, scenario)


@contextmanager
def ended_after(planner: Planner) -> Iterator[Planner]:
    """Yield the planner for a ``with`` block; afterwards no process of it is left."""
    try:
        yield planner
    finally:
        if isinstance(planner, StepwiseDriver):
            planner.close()


def log_of(planner: Planner | None) -> str:
    """Return what is kept of what a program wrote to standard error; empty for a planner that is a class."""
    return planner.log if isinstance(planner, CommandDriver | StepwiseDriver) else ""


@contextmanager
def planner_driver(name: str, planner: OwnPlanner | CommandPlanner, file: ScenarioFile) -> Iterator[Planner]:
    """Yield a user's new planner as the loop drives it, for a ``with`` block; afterwards no process of it is left."""
    made = guarded(name, planner.make) if isinstance(planner, OwnPlanner) else program_driver(name, planner, file)
    with ended_after(made) as driver:
        yield driver
