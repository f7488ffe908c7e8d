"""A program as a planner: asked once a run, its trajectory is one plan for the whole of it, which the loop follows."""

import atexit
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from ....schemas.base import problem_of
from ....schemas.errors import PlannerFailure
from ....schemas.planning import CommandAnswer, CommandPlanner, CommandRequest, CommandTrajectory, EgoStart
from ....schemas.text import one_line, quoted
from ...geometry import Values
from ...vehicles import VehicleParameters
from ..goal import Goal
from ..interface import EgoState, Observation, Plan, PlannedTrajectory, PlanningTask
from .conformance import trajectory_breaches
from .guarded import drivable
from .process import PlannerProcess

_SHOWN = 80
"""Characters of an answer that is no JSON that an error repeats."""


@dataclass(frozen=True)
class ScenarioFile:
    """The CommonRoad file that a program plans on, and the scenario's id."""

    path: Path
    scenario_id: str


def command_driver(name: str, declared: CommandPlanner, scenario: ScenarioFile) -> "CommandDriver":
    """A new planner that asks the program."""
    return CommandDriver(name, declared, scenario)


@dataclass(frozen=True)
class _Asked:
    """What an answer was given to; a run that is tried on another reference path asks for nothing new."""

    problem_id: int
    config_id: str
    first_step: int


class CommandDriver:
    """The planner; see :class:`plannerforge.engine.planners.interface.Planner`.

    ``log``: the end of what the program wrote to standard error.
    """

    def __init__(self, name: str, declared: CommandPlanner, scenario: ScenarioFile) -> None:
        self._name, self._declared, self._scenario = name, declared, scenario
        self._asked: _Asked | None = None
        self.log = ""

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        self._task = task

    def plan(self, observation: Observation) -> Plan:
        """What is left of the trajectory; none where it has ended, or where the vehicle cannot drive its next steps.

        Raises:
            PlannerFailure: the program broke a limit, or its answer is none.
        """
        ego = observation.ego
        task = self._task
        asked = _Asked(
            int(task.problem.planning_problem_id),
            task.configuration.config_id,
            EgoState.of(task.problem.initial_state).step,
        )
        if asked != self._asked:
            self._answer = self._ask(ego)
            self._trajectory = self._checked(self._answer, ego)
            self._asked = asked
        rejected, candidates = self._answer.rejected, self._answer.candidates
        if self._trajectory is None:
            return Plan(None, rejected=rejected or {"no_trajectory": 1}, candidates=candidates)
        begin = ego.step - asked.first_step
        left = self._trajectory.since(begin)
        if len(left.positions) < 2:
            return Plan(None, rejected={"trajectory_ended": 1}, candidates=candidates)
        return drivable(Plan(left, self._answer.costs, rejected, candidates), task)

    def _ask(self, ego: EgoState) -> CommandAnswer:
        process = _standing(self._name, self._declared) if self._declared.stays else None
        if process is None:
            process = PlannerProcess(self._name, self._declared)
        try:
            request = self._request(ego, process.fresh_folder(self._scenario.path))
            answered = process.ask(request.model_dump_json().encode())
        except PlannerFailure:
            _forget(self._declared)
            raise
        finally:
            self.log = process.log
            if not self._declared.stays:
                process.close()
        return self._read(answered, request)

    def _request(self, ego: EgoState, folder: Path) -> CommandRequest:
        task = self._task
        stated = task.configuration.settings.model_dump(exclude_none=True)
        vehicle: VehicleParameters = task.vehicle
        return CommandRequest(
            scenario_id=self._scenario.scenario_id,
            scenario_file=str(folder / "scenario.xml"),
            problem_id=int(task.problem.planning_problem_id),
            folder=str(folder),
            planner=self._name,
            config_id=task.configuration.config_id,
            weights=task.configuration.weights,
            settings={name: float(value) for name, value in (stated | vars(vehicle)).items()},
            ego=EgoStart(
                x_m=float(ego.position[0]),
                y_m=float(ego.position[1]),
                heading_rad=ego.heading_rad,
                speed_mps=ego.speed_mps,
                acceleration_mps2=ego.acceleration_mps2,
            ),
            first_step=ego.step,
            last_step=Goal(task.problem.goal).last_step,
            step_s=task.step_s,
        )

    def _read(self, answered: bytes, request: CommandRequest) -> CommandAnswer:
        if not answered.strip():
            raise self._failure("not_json", "writes no answer to standard output")
        try:
            answer = CommandAnswer.model_validate_json(answered)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            if first["type"] == "json_invalid":
                begins = quoted(answered[: 4 * _SHOWN].decode("utf-8", "replace"), _SHOWN)
                raise self._failure("not_json", f"writes no JSON but what begins {begins}") from error
            if first["type"] == "finite_number":
                where = ".".join(map(str, first["loc"]))
                raise self._failure("not_finite", f"answers a number that is not finite: {where}") from error
            problem = one_line(problem_of(CommandAnswer, first)[0])
            raise self._failure("wrong_form", f"answers in another form: {problem}") from error
        if (answer.scenario_id, answer.problem_id) != (request.scenario_id, request.problem_id):
            told = f"{quoted(answer.scenario_id)} #{answer.problem_id}"
            raise self._failure(
                "wrong_scenario", f"answers for {told}; asked was {request.scenario_id} #{request.problem_id}"
            )
        return answer

    def _checked(self, answer: CommandAnswer, ego: EgoState) -> PlannedTrajectory | None:
        """The answer's trajectory with what follows from it."""
        if answer.trajectory is None:
            return None
        if len(answer.trajectory.x_m) < 2:
            raise self._failure("too_short", f"answers {len(answer.trajectory.x_m)} state(s); the first is the present")
        trajectory = _trajectory(answer.trajectory, ego, self._task.step_s)
        breaches = trajectory_breaches(trajectory, ego, self._task.step_s)
        if breaches:
            reason = "too_short" if breaches[0].startswith("plans only") else "contract_broken"
            raise self._failure(reason, f"answers a trajectory that breaks the contract: {'; '.join(breaches)}")
        return trajectory

    def _failure(self, reason: str, what: str) -> PlannerFailure:
        _forget(self._declared)
        return PlannerFailure(f"planner {self._name} {what}", reason=reason)


def _trajectory(answered: CommandTrajectory, ego: EgoState, step_s: float) -> PlannedTrajectory:
    headings: Values = np.unwrap(np.array(answered.heading_rad))
    headings += 2 * np.pi * round((ego.heading_rad - float(headings[0])) / (2 * np.pi))
    speeds = np.array(answered.speed_mps)
    gained = np.concatenate([[ego.acceleration_mps2], np.diff(speeds) / step_s])
    return PlannedTrajectory(np.column_stack([answered.x_m, answered.y_m]), headings, speeds, gained)


@cache
def _kept() -> dict[str, PlannerProcess]:
    """The programs that stay, by their declaration; they end with the worker."""
    kept: dict[str, PlannerProcess] = {}

    def end() -> None:
        for process in kept.values():
            process.close()

    atexit.register(end)
    return kept


def _standing(name: str, declared: CommandPlanner) -> PlannerProcess:
    kept, key = _kept(), declared.model_dump_json()
    process = kept.get(key)
    if process is not None and not process.alive:
        kept.pop(key).close()
        process = None
    if process is None:
        process = kept[key] = PlannerProcess(name, declared)
    return process


def _forget(declared: CommandPlanner) -> None:
    """End a program that stays after what it did wrong: nobody knows what else it will say."""
    process = _kept().pop(declared.model_dump_json(), None)
    if process is not None:
        process.close()
