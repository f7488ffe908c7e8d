"""Keeps one process per program declaration for many runs, until the worker ends."""

import atexit
from functools import cache

from ....schemas.planning import CommandPlanner
from .process import PlannerProcess


@cache
def _kept() -> dict[str, PlannerProcess]:
    kept: dict[str, PlannerProcess] = {}

    def end() -> None:
        for process in kept.values():
            process.close()

    atexit.register(end)
    return kept


def standing_process(name: str, declared: CommandPlanner) -> PlannerProcess:
    """Return the process of a long-lived program, or a new one if it is not running.

    Raises:
        PlannerFailure: The program cannot be started.
    """
    kept, key = _kept(), declared.model_dump_json()
    process = kept.get(key)
    if process is not None and not process.alive:
        kept.pop(key).close()
        process = None
    if process is None:
        process = kept[key] = PlannerProcess(name, declared)
    return process


def forget_process(declared: CommandPlanner) -> None:
    """End a long-lived program after a failure, because its later answers are unreliable."""
    process = _kept().pop(declared.model_dump_json(), None)
    if process is not None:
        process.close()
