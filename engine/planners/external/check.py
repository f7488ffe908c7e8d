"""What a planner of others breaks on a scenario: it is driven in the loop, and asked again at what it saw there."""

import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

from ....schemas.errors import NotPossible, PlannerFailure
from ....schemas.planning import PlannerConfiguration, PlannerDeclaration, PlannerSettings
from ....schemas.runs import Outcome
from ...commonroad import read_recorded
from ...execution import silent
from ..interface import Observation, Plan, Planner, PlanningTask
from ..simulation import simulate
from .command import CommandDriver, ScenarioFile, command_driver
from .conformance import check_planner, same_plan
from .found import Found, OwnPlanner
from .guarded import guarded


@dataclass(frozen=True)
class PlannerCheck:
    """What a planner did on one scenario.

    ``breaches``: what it breaks of the contract, in words. ``idle``: weights that change no first plan from one end of
    their range to the other. ``raised``: the traceback of what its code raised; of a program what it wrote to standard
    error. ``took``: how long it took to plan, in words.
    """

    scenario_id: str
    breaches: tuple[str, ...]
    outcome: Outcome | None = None
    reason: str = ""
    idle: tuple[str, ...] = ()
    raised: str = ""
    took: str = ""


class _Recorder:
    """A planner that drives as another does and keeps what that was asked."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self.task: PlanningTask | None = None
        self.observations: list[Observation] = []

    def reset(self, task: PlanningTask) -> None:
        self.task, self.observations = task, []
        self._planner.reset(task)

    def plan(self, observation: Observation) -> Plan:
        self.observations.append(observation)
        return self._planner.plan(observation)


def check_on(name: str, planner: OwnPlanner | Found, path: Path) -> PlannerCheck:
    """Drive the first planning problem of a CommonRoad file with the preset Default, every plan held to the contract.

    A class is asked again at the first observation and at one in the middle, after a reset and in a new instance; a
    program at the first. A class is also asked with each weight at both ends of its range.

    Raises:
        UnsafeInput: the file cannot be read.
    """
    loaded = read_recorded(path).loaded
    scenario_id = str(loaded.scenario.scenario_id)
    try:
        planner = planner.own() if isinstance(planner, Found) and planner.command is None else planner
    except PlannerFailure as failure:
        return PlannerCheck(scenario_id, (failure.message,), raised=_raised(failure))
    declaration = planner.declaration
    configuration = _defaults(name, declaration)
    is_program = isinstance(planner, Found) and planner.command is not None
    make = _maker(name, planner, ScenarioFile(path, scenario_id))
    driver: Planner | None = None
    try:
        driver = make()
        recorder = _Recorder(driver)
        run = simulate(loaded.scenario, loaded.problem(None), configuration, recorder, "constant_velocity", silent)
    except PlannerFailure as failure:
        raised = driver.log if isinstance(driver, CommandDriver) else _raised(failure)
        return PlannerCheck(scenario_id, (failure.message,), raised=raised)
    except NotPossible as refusal:
        return PlannerCheck(scenario_id, (), reason=f"it refuses the problem: {refusal.message}")
    took = ""
    if run.plan_s:
        took = f"answered in {sum(run.plan_s):.1f} s" if is_program else f"{1000 * median(run.plan_s):.1f} ms a plan"
    breaches: list[str] = []
    idle: tuple[str, ...] = ()
    task, seen = recorder.task, recorder.observations
    if task is not None and seen:
        for observation in seen[:1] if is_program else {0: seen[0], 1: seen[len(seen) // 2]}.values():
            breaches += _asked_again(make, task, observation)
        idle = () if is_program else _idle(make, task, seen[0], declaration)
    return PlannerCheck(
        scenario_id, tuple(dict.fromkeys(breaches)), run.final.outcome, run.final.reason, idle, took=took
    )


def _maker(name: str, planner: OwnPlanner | Found, file: ScenarioFile) -> Callable[[], Planner]:
    if isinstance(planner, Found):
        if planner.command is not None:
            command = planner.command
            return lambda: command_driver(name, command, file)
        planner = planner.own()
    make = planner.make
    return lambda: guarded(name, make)


def _defaults(name: str, declaration: PlannerDeclaration) -> PlannerConfiguration:
    weights = {weight: declared.default for weight, declared in declaration.weights.items()}
    return PlannerConfiguration(
        config_id="cfg_check", planner=name, name=name, preset="Default", weights=weights, settings=PlannerSettings()
    )


def _asked_again(make: Callable[[], Planner], task: PlanningTask, observation: Observation) -> list[str]:
    try:
        return [f"at step {observation.ego.step} it {breach}" for breach in check_planner(make, task, observation)]
    except PlannerFailure as failure:
        return [failure.message]


def _idle(
    make: Callable[[], Planner], task: PlanningTask, observation: Observation, declaration: PlannerDeclaration
) -> tuple[str, ...]:
    """The weights that change nothing of the plan at an observation."""

    def planned(weight: str, value: float) -> Plan | None:
        weights = task.configuration.weights | {weight: value}
        configuration = task.configuration.model_copy(update={"weights": weights})
        planner = make()
        try:
            planner.reset(replace(task, configuration=configuration))
            return planner.plan(observation)
        except PlannerFailure:
            return None

    idle = []
    for name, weight in declaration.weights.items():
        low, high = planned(name, weight.lowest), planned(name, weight.highest)
        if low is not None and high is not None and same_plan(low, high):
            idle.append(name)
    return tuple(idle)


def _raised(failure: PlannerFailure) -> str:
    """The traceback of what a planner's own code raised, from its first file on; empty where it raised nothing."""
    cause = failure.__cause__
    if cause is None:
        return ""
    ours = Path(__file__).parent.parent
    frames = [frame for frame in traceback.extract_tb(cause.__traceback__) if ours not in Path(frame.filename).parents]
    return "".join([*traceback.format_list(frames), *traceback.format_exception_only(cause)])
