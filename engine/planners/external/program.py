"""Creates program planners of either protocol, ends them, and reads their logs."""

from collections.abc import Iterator
from contextlib import contextmanager

from ....schemas.planning import CommandPlanner
from ..interface import Planner
from .command import CommandDriver, ScenarioFile, command_driver
from .found import OwnPlanner
from .guarded import guarded
from .stepwise import StepwiseDriver


def program_driver(name: str, declared: CommandPlanner, scenario: ScenarioFile) -> CommandDriver | StepwiseDriver:
    """Return a new planner that calls the program; a stepwise program gets no file, since it contains the future."""
    if declared.protocol == "stepwise":
        return StepwiseDriver(name, declared, scenario.scenario_id)
    return command_driver(name, declared, scenario)


@contextmanager
def ended_after(planner: Planner) -> Iterator[Planner]:
    """Yield the planner for a ``with`` block, and end its process afterwards."""
    try:
        yield planner
    finally:
        if isinstance(planner, StepwiseDriver):
            planner.close()


def log_of(planner: Planner | None) -> str:
    """Return the kept part of a program's standard error; empty for a planner that is a class."""
    return planner.log if isinstance(planner, CommandDriver | StepwiseDriver) else ""


@contextmanager
def planner_driver(name: str, planner: OwnPlanner | CommandPlanner, file: ScenarioFile) -> Iterator[Planner]:
    """Yield a user's new planner in the form that the loop drives, and end its process after the ``with`` block."""
    made = guarded(name, planner.make) if isinstance(planner, OwnPlanner) else program_driver(name, planner, file)
    with ended_after(made) as driver:
        yield driver
