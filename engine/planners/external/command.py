"""A program as a planner: it is called once per run, and its trajectory is the plan for the whole run."""

from dataclasses import dataclass
from pathlib import Path

from ....schemas.errors import PlannerFailure
from ....schemas.planning import CommandAnswer, CommandPlanner, CommandRequest, EgoStart
from ....schemas.text import shown_name
from ...vehicles import parameter_values
from ..goal import Goal
from ..interface import EgoState, Observation, Plan, PlannedTrajectory, PlanningTask
from .answers import read_message, read_trajectory
from .guarded import drivable
from .kept import forget_process, standing_process
from .messages import numbers_of
from .process import PlannerProcess


@dataclass(frozen=True)
class ScenarioFile:
    """The CommonRoad file that a program plans on, and the scenario's id."""

    path: Path
    scenario_id: str


def command_driver(name: str, declared: CommandPlanner, scenario: ScenarioFile) -> "CommandDriver":
    """Return a new planner that calls the program."""
    return CommandDriver(name, declared, scenario)


@dataclass(frozen=True)
class _AnswerKey:
    """Identifies the input of an answer; a run that is retried on another reference path reuses the answer."""

    problem_id: int
    config_id: str
    first_step: int


class CommandDriver:
    """A planner that calls a program once per run; see :class:`plannerforge.engine.planners.interface.Planner`.

    ``log``: the end of the program's standard error.
    """

    def __init__(self, name: str, declared: CommandPlanner, scenario: ScenarioFile) -> None:
        self._name, self._declared, self._scenario = name, declared, scenario
        self._answer_key: _AnswerKey | None = None
        self.log = ""

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        self._task = task

    def plan(self, observation: Observation) -> Plan:
        """Return a plan with the rest of the trajectory, or without one if it has ended or cannot be driven.

        Raises:
            PlannerFailure: The program broke a limit, or its answer is invalid.
        """
        ego = observation.ego
        task = self._task
        key = _AnswerKey(
            int(task.problem.planning_problem_id),
            task.configuration.config_id,
            EgoState.of(task.problem.initial_state).step,
        )
        if key != self._answer_key:
            self._answer = self._ask(ego)
            self._trajectory = self._checked(self._answer, ego)
            self._answer_key = key
        rejected, candidates = self._answer.rejected, self._answer.candidates
        if self._trajectory is None:
            return Plan(None, rejected=rejected or {"no_trajectory": 1}, candidates=candidates)
        begin = ego.step - key.first_step
        left = self._trajectory.since(begin)
        if len(left.positions) < 2:
            return Plan(None, rejected={"trajectory_ended": 1}, candidates=candidates)
        return drivable(Plan(left, self._answer.costs, rejected, candidates), task)

    def _ask(self, ego: EgoState) -> CommandAnswer:
        process = standing_process(self._name, self._declared) if self._declared.stays else None
        if process is None:
            process = PlannerProcess(self._name, self._declared)
        try:
            request = self._request(ego, process.fresh_folder(self._scenario.path))
            answered = process.ask(request.model_dump_json().encode())
        except PlannerFailure:
            forget_process(self._declared)
            raise
        finally:
            self.log = process.log
            if not self._declared.stays:
                process.close()
        return self._read(answered, request)

    def _request(self, ego: EgoState, folder: Path) -> CommandRequest:
        task = self._task
        return CommandRequest(
            scenario_id=self._scenario.scenario_id,
            scenario_file=str(folder / "scenario.xml"),
            problem_id=int(task.problem.planning_problem_id),
            folder=str(folder),
            planner=self._name,
            config_id=task.configuration.config_id,
            weights=task.configuration.weights,
            settings=numbers_of(task.configuration.settings.stated_values) | numbers_of(parameter_values(task.vehicle)),
            ego=EgoStart(
                x_m=float(ego.position[0]),
                y_m=float(ego.position[1]),
                heading_rad=ego.heading_rad,
                speed_mps=ego.speed_mps,
                acceleration_mps2=ego.acceleration_mps2,
            ),
            ego_class=task.vehicle.vehicle_class,
            first_step=ego.step,
            last_step=Goal(task.problem.goal).last_step,
            step_s=task.step_s,
        )

    def _read(self, answered: bytes, request: CommandRequest) -> CommandAnswer:
        answer = read_message(CommandAnswer, answered, self._failure)
        if (answer.scenario_id, answer.problem_id) != (request.scenario_id, request.problem_id):
            given = f"{shown_name(answer.scenario_id)} #{answer.problem_id}"
            raise self._failure(
                "wrong_scenario", f"answered for {given} instead of {request.scenario_id} #{request.problem_id}"
            )
        return answer

    def _checked(self, answer: CommandAnswer, ego: EgoState) -> PlannedTrajectory | None:
        """Return the answer's trajectory with the computed quantities."""
        if answer.trajectory is None:
            return None
        return read_trajectory(answer.trajectory, ego, self._task.step_s, self._failure)

    def _failure(self, reason: str, what: str) -> PlannerFailure:
        forget_process(self._declared)
        return PlannerFailure(f"planner {self._name} {what}", reason=reason)
