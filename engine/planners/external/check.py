"""Checks a user's planner on a scenario: its breaches of the contract, and the outcome of its drive.

The planner drives in the loop among the recorded traffic, as in a run, and then plans again from the observations of
that drive.
"""

import traceback
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np

from ....schemas.errors import NotPossible, PlannerFailure
from ....schemas.planning import PlannerConfiguration, PlannerDeclaration, PlannerSettings
from ....schemas.runs import LimitExcess, Outcome
from ...commonroad import read_recorded
from ...execution import silent
from ..driving.drivability import excesses_of
from ..interface import Observation, Plan, PlannedTrajectory, Planner, PlanningTask
from ..simulation import DrivenRun, simulate
from ..traffic.recorded import RecordedTraffic
from .command import ScenarioFile
from .conformance import check_planner, same_plan
from .found import Found, OwnPlanner
from .guarded import guarded
from .program import ended_after, log_of, program_driver


@dataclass(frozen=True)
class PlannerCheck:
    """The result of checking a planner on one scenario.

    ``breaches``: its breaches of the contract, as text. ``outcome``, ``reason``: how the drive ended, among the
    recorded traffic or on an empty road. ``planned_again``: the number of observations at which a class also planned
    with each weight and parameter at the two ends of its range; ``unmoved``: the weights and parameters that changed no
    plan. ``raised``: the traceback of the planner's exception, or a program's standard error. ``took``: the planning
    time, as text. ``beyond_vehicle``: the vehicle limits that the driven motion exceeds.
    """

    scenario_id: str
    breaches: tuple[str, ...]
    outcome: Outcome | None = None
    reason: str = ""
    unmoved: tuple[str, ...] = ()
    planned_again: int = 0
    raised: str = ""
    took: str = ""
    beyond_vehicle: tuple[LimitExcess, ...] = ()


class _Recorder:
    """Wraps a planner, drives as it does, and records its task and observations."""

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


def check_on(name: str, planner: OwnPlanner | Found, path: Path, *, empty_road: bool = False) -> PlannerCheck:
    """Drive the first planning problem of a CommonRoad file with the preset Default, and check every plan.

    A class plans again at the first observation and at the middle one, after a reset and in a new instance; a
    program only at the first. A class also plans with each weight at the two ends of its range, at every observation of
    the drive until two plans differ.

    Args:
        name: The planner's name.
        planner: A class with its declaration, or a discovered planner.
        path: The CommonRoad file.
        empty_road: True to leave out the recorded road users.

    Raises:
        UnsafeInput: The file cannot be read.
    """
    from commonroad.scenario.scenario import Scenario

    loaded = read_recorded(path).loaded
    scenario_id = str(loaded.scenario.scenario_id)
    try:
        planner = planner.own() if isinstance(planner, Found) and planner.command is None else planner
    except PlannerFailure as failure:
        return PlannerCheck(scenario_id, (failure.message,), raised=_own_traceback(failure))
    declaration = planner.declaration
    configuration = _defaults(name, declaration)
    is_program = isinstance(planner, Found) and planner.command is not None
    make = _maker(name, planner, ScenarioFile(path, scenario_id))
    scenario, problem = loaded.scenario, loaded.problem(None)
    traffic = RecordedTraffic(Scenario(loaded.step_s)) if empty_road else RecordedTraffic.of(loaded)
    driver: Planner | None = None
    try:
        driver = make()
        recorder = _Recorder(driver)
        with ended_after(driver):
            run = simulate(scenario, problem, configuration, recorder, "constant_velocity", silent, traffic)
    except PlannerFailure as failure:
        return PlannerCheck(scenario_id, (failure.message,), raised=log_of(driver) or _own_traceback(failure))
    except NotPossible as refusal:
        return PlannerCheck(scenario_id, (), reason=f"it refused the problem: {refusal.message}")
    breaches: list[str] = []
    unmoved: tuple[str, ...] = ()
    task, seen = recorder.task, recorder.observations
    if task is not None and seen:
        for observation in seen[:1] if is_program else {0: seen[0], 1: seen[len(seen) // 2]}.values():
            breaches += _replan_breaches(make, task, observation)
        unmoved = () if is_program else _unmoved_weights(make, task, seen, declaration)
    return PlannerCheck(
        scenario_id,
        tuple(dict.fromkeys(breaches)),
        run.final.outcome,
        run.final.reason,
        unmoved,
        planned_again=0 if is_program else len(seen),
        took=_describe_duration(planner, run.plan_s),
        beyond_vehicle=() if task is None else _excesses(run, task),
    )


def _excesses(run: DrivenRun, task: PlanningTask) -> tuple[LimitExcess, ...]:
    """Return the vehicle limits that the driven motion exceeds."""
    states = run.states
    driven = PlannedTrajectory(
        np.array([state.position for state in states]),
        np.array([state.heading_rad for state in states]),
        np.array([state.speed_mps for state in states]),
        np.array([state.acceleration_mps2 for state in states]),
    )
    return excesses_of(driven, task.vehicle, task.step_s)


def _describe_duration(planner: OwnPlanner | Found, plan_s: list[float]) -> str:
    """Return the planning time as text; for a program that is called once, its response time."""
    if not plan_s:
        return ""
    plans_once = isinstance(planner, Found) and planner.command is not None and planner.command.protocol == "one_shot"
    return f"answered in {sum(plan_s):.1f} s" if plans_once else f"{1000 * median(plan_s):.1f} ms a plan"


def _maker(name: str, planner: OwnPlanner | Found, file: ScenarioFile) -> Callable[[], Planner]:
    if isinstance(planner, Found):
        if planner.command is not None:
            command = planner.command
            return lambda: program_driver(name, command, file)
        planner = planner.own()
    make = planner.make
    return lambda: guarded(name, make)


def _defaults(name: str, declaration: PlannerDeclaration) -> PlannerConfiguration:
    weights = {weight: declared.default for weight, declared in declaration.weights.items()}
    return PlannerConfiguration(
        config_id="cfg_check", planner=name, name=name, preset="Default", weights=weights, settings=PlannerSettings()
    )


def _replan_breaches(make: Callable[[], Planner], task: PlanningTask, observation: Observation) -> list[str]:
    with ExitStack() as ended:
        try:
            found = check_planner(lambda: ended.enter_context(ended_after(make())), task, observation)
        except PlannerFailure as failure:
            return [failure.message]
    return [f"at step {observation.ego.step} it {breach}" for breach in found]


def _unmoved_weights(
    make: Callable[[], Planner],
    task: PlanningTask,
    observations: Sequence[Observation],
    declaration: PlannerDeclaration,
) -> tuple[str, ...]:
    """Return the weights and parameters that change no plan at the observations of a drive."""
    return tuple(
        name
        for name, weight in declaration.weights.items()
        if not _moves(make, task, observations, name, (weight.lowest, weight.highest))
    )


def _moves(
    make: Callable[[], Planner],
    task: PlanningTask,
    observations: Sequence[Observation],
    name: str,
    ends: tuple[float, float],
) -> bool:
    """Return True if the plans at the two ends of a range differ, or if the planner fails at one of the ends."""

    def planned(value: float, observation: Observation) -> Plan:
        configuration = task.configuration.model_copy(update={"weights": task.configuration.weights | {name: value}})
        planner = make()
        planner.reset(replace(task, configuration=configuration))
        return planner.plan(observation)

    low, high = ends
    try:
        return not all(same_plan(planned(low, observation), planned(high, observation)) for observation in observations)
    except PlannerFailure:
        return True


def _own_traceback(failure: PlannerFailure) -> str:
    """Return the traceback of the planner's own exception, starting at its first file; empty if it raised nothing."""
    cause = failure.__cause__
    if cause is None:
        return ""
    ours = Path(__file__).parent.parent
    frames = [frame for frame in traceback.extract_tb(cause.__traceback__) if ours not in Path(frame.filename).parents]
    return "".join([*traceback.format_list(frames), *traceback.format_exception_only(cause)])
