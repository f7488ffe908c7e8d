"""Tests findings on batches with one planted cause of failure, and on batches without one.

A batch has 24 scenarios of a straight road with one run each; one run in ten fails for no reason. Each of five causes
is planted in six batches:

- a weight of zero: a third of the runs fail accordingly,
- a blind predictor: others turn into the ego's path within a second,
- a harder class of scenarios: those with a truck fail three times out of four,
- a slower leader in a third of the scenarios,
- a goal that is too far for its time in a third.

The drives follow closed forms, and the product sees records, steps and CommonRoad files as of any run.

Keys:

- ``planted_found``: share of batches with a cause in which a finding names it (its weight, its class).
- ``planted_misnamed``: share in which a finding names another of the five causes.
- ``planted_quiet``: share of as many batches without a cause in which no finding names any of them.
- ``planted_batches``: number of batches with a cause.
"""

import json
import math
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from plannerforge.engine.analysis import analyse
from plannerforge.engine.execution import silent
from plannerforge.schemas.measures import RunMetrics
from plannerforge.schemas.results import AnalyseRequest, ConfigWeights, Finding
from plannerforge.schemas.runs import (
    CollisionRecord,
    DrivenObstacle,
    Outcome,
    RunRecord,
    RunSource,
    RunSteps,
    ScenarioSource,
)

from ..harness import Figures, SeededBench, share

EACH, SCENARIOS = 6, 24
_STEP_S, _LENGTH_M, _WIDTH_M = 0.1, 4.508, 1.61
_STEPS = 61
_WEIGHTS = {"prediction": 0.2, "velocity_offset": 1.0, "distance_to_reference_path": 0.5, "lateral_jerk": 0.2}
_GUARDED: Mapping[str, Outcome] = {"prediction": "collision", "velocity_offset": "timeout"}
_ROAD_M = 1200.0
Cause = str
"""``weight NAME``, ``blind``, ``class truck``, ``slower``, ``late``, or empty."""


@dataclass
class _Run:
    """A run to write: how the ego and one other drove, how it ended, and its scenario."""

    outcome: Outcome = "goal_reached"
    speed_mps: float = 10.0
    other: Callable[[float], tuple[float, float, float, float]] | None = None
    """Time in s to x, y, heading and speed of the other."""
    touch_s: float | None = None
    classes: dict[str, int] = field(default_factory=lambda: {"car": 4})
    goal_m: float = 55.0
    goal_s: float = 6.0


def _drawn(cause: Cause, choice: random.Random) -> Iterator[_Run]:
    """Yield the runs of a batch."""
    for number in range(SCENARIOS):
        run = _Run(speed_mps=choice.uniform(8, 13), classes={"car": choice.randint(1, 12)})
        if choice.random() < 0.35:
            run.classes["truck"] = choice.randint(1, 3)
        if choice.random() < 0.3:
            run.classes["bicycle"] = 1
        if choice.random() < 0.1:
            run.outcome = choice.choice(("timeout", "goal_missed"))
        _plant(run, cause, number, choice)
        yield run


def _plant(run: _Run, cause: Cause, number: int, choice: random.Random) -> None:
    kind, _, name = cause.partition(" ")
    if kind == "class":
        if name in run.classes and choice.random() < 0.75:
            run.outcome = choice.choice(("timeout", "goal_missed"))
    elif number % 3:
        return
    elif kind == "weight":
        run.outcome = _GUARDED[name]
        if run.outcome == "collision":
            _into_a_slower_one(run, choice)
    elif kind == "blind":
        _hit_by_one_that_turns(run, choice)
    elif kind == "slower":
        run.outcome, slow = "timeout", run.speed_mps * choice.uniform(0.5, 0.75)
        gap = choice.uniform(14, 20)
        run.speed_mps, run.other = run.speed_mps, lambda t: (gap + slow * t, 0.0, 0.0, slow)
    elif kind == "late":
        run.outcome, run.goal_m = "timeout", choice.uniform(250, 500)


def _into_a_slower_one(run: _Run, choice: random.Random) -> None:
    """Return a drive into a slower leader that the ego sees all the time."""
    slow, touch = run.speed_mps * choice.uniform(0.2, 0.4), choice.uniform(3.0, 5.0)
    ahead = (run.speed_mps - slow) * touch + _LENGTH_M
    run.outcome, run.touch_s = "collision", _next_step_s(touch)
    run.other = lambda t: (ahead + slow * t, 0.0, 0.0, slow)


def _hit_by_one_that_turns(run: _Run, choice: random.Random) -> None:
    """Return a road user that drives next to and ahead of the ego and turns into its path within the last second."""
    touch, aside, speed = choice.uniform(3.0, 5.0), choice.uniform(3.4, 3.8), run.speed_mps
    across = aside / 0.9

    def other(t: float) -> tuple[float, float, float, float]:
        since = min(max(t - (touch - 0.9), 0.0), 0.9)
        ahead = speed * touch + _LENGTH_M / 2 + 1.0 - speed * 0.7 * (touch - t)
        heading = -math.atan2(across, speed * 0.7) if since > 0 else 0.0
        return ahead, aside - across * since, heading, speed * 0.7

    run.outcome, run.touch_s, run.other = "collision", _next_step_s(touch), other


def _next_step_s(time_s: float) -> float:
    """Return the time of the first step from a time on: runs end at a step at which the two overlap."""
    return math.ceil(time_s / _STEP_S) * _STEP_S


def _steps_of(run: _Run, weights: Mapping[str, float], choice: random.Random) -> RunSteps:
    """Return the driven steps (the ego at constant speed, or with a gap to its slower leader) and the plans' costs."""
    last = round(run.touch_s / _STEP_S) if run.touch_s is not None else _STEPS - 1
    times = np.arange(_STEPS) * _STEP_S
    other = [run.other(float(t)) for t in times] if run.other else []
    x = run.speed_mps * times
    if run.other and run.touch_s is None:
        x = np.minimum(x, np.array([place[0] for place in other]) - _LENGTH_M - 4.0)
    speeds = np.gradient(x, _STEP_S) if run.touch_s is None else np.full(_STEPS, run.speed_mps)
    speeds[0] = run.speed_mps
    planned = tuple(range(0, last + 1, 3))
    costs = {name: tuple(weight * choice.uniform(0.5, 1.5) for _ in planned) for name, weight in weights.items()}
    others: tuple[DrivenObstacle, ...] = ()
    if other:
        others = (
            DrivenObstacle(
                obstacle_id=7,
                kind="car",
                length_m=_LENGTH_M,
                width_m=_WIDTH_M,
                first_step=0,
                x_m=tuple(place[0] for place in other),
                y_m=tuple(place[1] for place in other),
                heading_rad=tuple(place[2] for place in other),
                speed_mps=tuple(place[3] for place in other),
            ),
        )
    count = last + 1
    return RunSteps(
        first_step=0,
        x_m=tuple(x[:count].tolist()),
        y_m=(0.0,) * count,
        heading_rad=(0.0,) * count,
        speed_mps=tuple(speeds[:count].tolist()),
        acceleration_mps2=(0.0,) * count,
        plan_steps=planned,
        costs=costs,
        others=others,
    )


def _write_scenario(path: Path, scenario_id: str, run: _Run) -> None:
    """Write a straight road with the ego's planning problem, by commonroad-io."""
    from commonroad.common.file_writer import CommonRoadFileWriter, OverwriteExistingFile
    from commonroad.common.util import Interval
    from commonroad.geometry.shape import Rectangle
    from commonroad.planning.goal import GoalRegion
    from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork, LaneletType
    from commonroad.scenario.scenario import Location, Scenario, ScenarioID
    from commonroad.scenario.state import CustomState, InitialState

    stations = np.linspace(-50.0, _ROAD_M, 30)
    left, middle, right = (np.column_stack([stations, np.full(30, y)]) for y in (1.75, 0.0, -1.75))
    network = LaneletNetwork.create_from_lanelet_list(
        [Lanelet(left, middle, right, 1, lanelet_type={LaneletType.URBAN})]
    )
    scenario = Scenario(_STEP_S, ScenarioID.from_benchmark_id(scenario_id, "2020a"))
    scenario.add_objects(network)
    start = InitialState(
        time_step=0, position=np.zeros(2), orientation=0.0, velocity=run.speed_mps, acceleration=0.0, yaw_rate=0.0,
        slip_angle=0.0,
    )  # fmt: skip
    goal = CustomState(
        time_step=Interval(0, round(run.goal_s / _STEP_S)), position=Rectangle(20.0, 3.5, np.array([run.goal_m, 0.0]))
    )
    problems = PlanningProblemSet([PlanningProblem(1, start, GoalRegion([goal]))])
    writer = CommonRoadFileWriter(scenario, problems, "bench", "bench", "bench", set(), Location())
    writer.write_to_file(str(path), OverwriteExistingFile.ALWAYS)


def _record(scenario_id: str, run: _Run) -> RunRecord:
    touch = run.touch_s
    collision = None
    if touch is not None:
        step = round(touch / _STEP_S)
        collision = CollisionRecord(obstacle_id=7, kind="car", step=step, time_s=round(step * _STEP_S, 9))
    return RunRecord(
        run_id=f"run_{scenario_id}",
        scenario_id=scenario_id,
        problem_id=1,
        config_id="cfg_planted",
        config_name="planted",
        planner="frenetix",
        prediction="constant_velocity",
        traffic="recorded",
        seed=0,
        step_s=_STEP_S,
        outcome=run.outcome,
        reason="planted",
        collision=collision,
        rejected_candidates={},
        metrics=RunMetrics(
            duration_s=touch or 6.0,
            distance_m=50.0,
            mean_speed_mps=run.speed_mps,
            minimum_distance_m=0.0 if collision else 8.0,
            minimum_time_to_collision_s=0.0 if collision else None,
            maximum_jerk_mps3=1.0,
            mean_squared_jerk=0.5,
            maximum_lateral_acceleration_mps2=0.5,
            mean_total_cost=1.0,
        ),
        ego_length_m=_LENGTH_M,
        ego_width_m=_WIDTH_M,
    )


def findings_of(cause: Cause, choice: random.Random, folder: Path) -> Sequence[Finding]:
    """Return the product's findings in a batch with a cause."""
    kind, _, name = cause.partition(" ")
    weights = _WEIGHTS | ({name: 0.0} if kind == "weight" else {})
    runs, scenarios = [], []
    for number, run in enumerate(_drawn(cause, choice)):
        scenario_id = f"ZAM_Planted-{number + 1}_1_T-1"
        path, steps = folder / f"{scenario_id}.xml", folder / f"{scenario_id}.json"
        _write_scenario(path, scenario_id, run)
        steps.write_text(_steps_of(run, weights, choice).model_dump_json(), encoding="utf-8")
        runs.append(RunSource(record=_record(scenario_id, run), steps_path=str(steps)))
        scenarios.append(
            ScenarioSource(scenario_id=scenario_id, path=str(path), obstacles=run.classes, road="urban", limit_kmh=50.0)
        )
    config = ConfigWeights(
        config_id="cfg_planted", name="planted", planner="frenetix", weights=weights, default_weights=_WEIGHTS
    )
    request = AnalyseRequest(
        results=("planted",), runs=tuple(runs), configs=(config,), scenarios=tuple(scenarios), detail="findings"
    )
    return analyse(request, silent).findings


def names(cause: Cause, findings: Sequence[Finding]) -> bool:
    """Return True if a finding names the cause."""
    kind, _, word = cause.partition(" ")
    return any(one.name == _NAMES[kind] and word in one.statement for one in findings)


_NAMES = {
    "weight": "weight_off",
    "blind": "unforeseen",
    "class": "harder_group",
    "slower": "held_up",
    "late": "goal_out_of_reach",
}
_NAMED = frozenset(_NAMES.values())
_CAUSES = ("weight prediction", "weight velocity_offset", "blind", "class truck", "slower", "late")


def measure(bench: SeededBench) -> Figures:
    """Measure the keys above on six batches of each cause, or the bench's limit."""
    choice = random.Random(bench.seed)  # noqa: S311 - reproducible, not secret
    each = bench.limit or EACH
    causes = [cause for cause in ("weight", *_CAUSES[2:]) for _ in range(each)]
    found: dict[str, list[bool]] = {}
    misnamed: list[bool] = []
    quiet: list[bool] = []
    for number, word in enumerate(causes):
        cause = _CAUSES[number % 2] if word == "weight" else word
        folder = bench.folder(f"planted_{number}")
        findings = findings_of(cause, choice, folder)
        found.setdefault(word, []).append(names(cause, findings))
        misnamed.append(any(one.name in _NAMED - {_NAMES[word.partition(" ")[0]]} for one in findings))
        without = findings_of("", choice, bench.folder(f"plain_{number}"))
        quiet.append(not any(one.name in _NAMED for one in without))
    everything = [verdict for verdicts in found.values() for verdict in verdicts]
    by_cause = {word: f"{sum(verdicts)} of {len(verdicts)}" for word, verdicts in found.items()}
    return {
        "planted_found": share(everything),
        "planted_misnamed": share(misnamed),
        "planted_quiet": share(quiet),
        "planted_batches": len(everything),
        "planted_by_cause": json.dumps(by_cause),
    }
