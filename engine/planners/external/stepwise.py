"""A program as a planner that is called at every planning step, by the stepwise protocol of ``schemas/stepwise.py``."""

from collections.abc import Sequence
from time import monotonic

import numpy as np

from ....schemas.base import Model
from ....schemas.errors import PlannerFailure
from ....schemas.planning import CommandPlanner
from ....schemas.stepwise import PROTOCOL, DebugMessage, PlanMessage, ReadyMessage
from ...geometry import Points
from ..interface import DebugValues, Observation, Plan, PlanningTask, evenly_chosen
from .answers import read_message, read_trajectory
from .guarded import drivable
from .kept import forget_process, standing_process
from .messages import StepMessages, start_message
from .process import PlannerProcess


class StepwiseDriver:
    """A planner that calls a program at every step; see :class:`plannerforge.engine.planners.interface.Planner`.

    ``log``: the start and the end of the program's standard error during the run.
    """

    def __init__(self, name: str, declared: CommandPlanner, scenario_id: str) -> None:
        self._name, self._declared, self._scenario_id = name, declared, scenario_id
        self._process: PlannerProcess | None = None
        self._log = ""
        self._shown: Sequence[Points] = ()

    @property
    def log(self) -> str:
        """The kept part of the program's standard error."""
        return self._log if self._process is None else self._process.log

    def reset(self, task: PlanningTask) -> None:
        """Start the program if it is not running, send it the task, and wait until it is ready.

        Raises:
            PlannerFailure: The program cannot be started, broke a limit, or is not ready for this protocol.
        """
        self._task, self._messages = task, StepMessages(task)
        self._left_s = self._declared.time_s
        if self._process is None:
            stays = self._declared.stays
            self._process = (standing_process if stays else PlannerProcess)(self._name, self._declared)
            self._process.begin_run()
        message = start_message(task, self._name, self._scenario_id)
        ready = read_message(ReadyMessage, self._exchange(message, self._declared.start_time_s), self._failure)
        if ready.protocol != PROTOCOL:
            raise self._failure("wrong_protocol", f"speaks protocol {ready.protocol}, not {PROTOCOL}")

    def plan(self, observation: Observation) -> Plan:
        """Return the program's plan for this step.

        Raises:
            PlannerFailure: The program broke a limit, or its answer is not a plan for this step.
        """
        ego, task = observation.ego, self._task
        answered = self._exchange(self._messages.at(observation), self._declared.step_time_s)
        answer = read_message(PlanMessage, answered, self._failure)
        if answer.step != ego.step:
            raise self._failure("wrong_step", f"answered for step {answer.step} instead of step {ego.step}")
        self._shown = [np.column_stack([one.x_m, one.y_m]) for one in answer.shown]
        debug = _debug_values(answer.debug)
        if answer.trajectory is None:
            rejected = answer.rejected or {"no_trajectory": 1}
            return Plan(None, rejected=rejected, candidates=answer.candidates, debug=debug)
        trajectory = read_trajectory(answer.trajectory, ego, task.step_s, self._failure)
        plan = Plan(trajectory, answer.costs, answer.rejected, answer.candidates, debug=debug)
        return drivable(plan, task)

    def shown_candidates(self, most: int) -> Sequence[Points]:
        """Return up to ``most`` of the candidates that the program showed at the last step, as points (n, 2)."""
        return [self._shown[place] for place in evenly_chosen(len(self._shown), most)]

    def close(self) -> None:
        """End the program, unless it stays for other runs."""
        if self._process is not None:
            if not self._declared.stays:
                self._process.finish()
            self._log, self._process = self._process.log, None

    def _exchange(self, message: Model, limit_s: float) -> bytes:
        """Return the answer to a message, within its own time limit and the remaining time of the run."""
        if self._process is None:
            raise PlannerFailure(f"planner {self._name} has already been stopped", reason="died")
        began = monotonic()
        try:
            answered = self._process.exchange(message.model_dump_json().encode(), min(limit_s, self._left_s))
        except PlannerFailure:
            self._end()
            raise
        self._left_s -= monotonic() - began
        if self._left_s <= 0:
            raise self._failure("timed_out", f"took more than {self._declared.time_s:g} s for the run and was stopped")
        return answered

    def _failure(self, reason: str, what: str) -> PlannerFailure:
        self._end()
        return PlannerFailure(f"planner {self._name} {what}", reason=reason)

    def _end(self) -> None:
        """End the program after a violation; a long-lived program starts again for the next run."""
        if self._process is not None:
            self._log = self._process.log
            self._process.close()
            self._process = None
        forget_process(self._declared)


def _debug_values(message: DebugMessage) -> DebugValues:
    outlines = {name: np.column_stack([one.x_m, one.y_m]) for name, one in message.polygons.items()}
    return DebugValues(message.numbers, message.texts, outlines)
