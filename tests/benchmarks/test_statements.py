"""The judges of statements and of goals that ask for no driving: figures that are right and wrong are told apart."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from commonroad.common.util import Interval
from commonroad.geometry.shape import Rectangle
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.state import CustomState, InitialState
from support.runs import DEFAULT, SAFE, metrics, record, source

from benchmarks.analysis.expected import Expected, Tally
from benchmarks.analysis.public_runs import RawRuns
from benchmarks.analysis.recomputed import late_because
from benchmarks.analysis.statements import GivenAnswer, OnRuns, in_texts, judged
from benchmarks.analysis.trivial import truth
from benchmarks.stated_figures import agrees, unknown_in_fields, unknown_in_text
from plannerforge.engine.analysis import analyse, compare
from plannerforge.engine.execution import silent
from plannerforge.schemas.analysis.comparison import CompareRequest, Side
from plannerforge.schemas.results import AnalyseRequest
from plannerforge.schemas.runs import BatchRecord, RunSource, RunSteps

WEIGHTS = {one.config_id: one.weights for one in (DEFAULT, SAFE)} | {"default": DEFAULT.weights}


@pytest.fixture
def sources(tmp_path: Path) -> list[RunSource]:
    """Ten scenarios under two configurations, which differ in success, gaps, durations and turns."""
    made = []
    for number in range(10):
        for config, slower in ((DEFAULT, 0.0), (SAFE, 0.4)):
            late = number % (3 if config is DEFAULT else 5) == 0
            figures = metrics(
                duration_s=5.0 + slower + number / 7,
                minimum_distance_m=2.0 + slower + number / 9,
                maximum_lateral_acceleration_mps2=2.0 + number / 4,
            )
            run = record(f"ZAM_Town-{number + 1}_1_T-1", "timeout" if late else "goal_reached", config, figures=figures)
            made.append(source(run, tmp_path, prediction=1.0 + number, lateral_jerk=9.0 - slower))
    return made


def raw_of(sources: list[RunSource]) -> RawRuns:
    records = tuple(one.record for one in sources)
    return RawRuns(
        batch=BatchRecord(
            batch_id="batch_a",
            scenarios=tuple(dict.fromkeys(one.scenario_id for one in records)),
            configs=(DEFAULT.config_id, SAFE.config_id),
            prediction="constant_velocity",
            traffic="recorded",
            runs=tuple(one.run_id for one in records),
            lost=(),
        ),
        records=records,
        steps={
            one.record.run_id: RunSteps.model_validate_json(Path(one.steps_path or "").read_bytes()) for one in sources
        },
        facts={},
        files={},
    )


def answers(sources: list[RunSource]) -> tuple[GivenAnswer, ...]:
    """The answers on the runs, and their comparison."""
    runs, configs = tuple(sources), (DEFAULT, SAFE)
    request = AnalyseRequest(results=("batch_a",), runs=runs, configs=configs, breakdown="config")
    details = [request, *(request.model_copy(update={"detail": detail}) for detail in ("findings", "costs", "rows"))]
    sides = tuple(
        Side(
            label=config.name,
            config_id=config.config_id,
            config_name=config.name,
            run_ids=tuple(one.record.run_id for one in sources if one.record.config_id == config.config_id),
        )
        for config in configs
    )
    made = [("analyze_results", analyse(one, silent)) for one in details]
    made.append(("compare_results", compare(CompareRequest(sides=sides, runs=runs, configs=configs), silent)))
    return tuple(GivenAnswer(tool, {}, one.to_text(), one.model_dump(mode="json")) for tool, one in made)


def told_of(sources: list[RunSource], made: tuple[GivenAnswer, ...]) -> OnRuns:
    return OnRuns(raw_of(sources), WEIGHTS, {}, {}, made)


def spoiled(content: Any, changed: int, seen: list[int]) -> Any:
    """Structured content with its n-th number another one; ``seen`` counts them."""
    if isinstance(content, Mapping):
        return {key: spoiled(part, changed, seen) for key, part in content.items()}
    if isinstance(content, list):
        return [spoiled(part, changed, seen) for part in content]
    if isinstance(content, bool) or not isinstance(content, int | float):
        return content
    seen.append(1)
    return content + 1 if len(seen) == changed + 1 else content


def test_every_figure_of_an_answer_is_recomputed_from_its_rows(sources: list[RunSource]) -> None:
    made = answers(sources)
    tally = judged([told_of(sources, made)])
    assert (tally.wrong, tally.unread) == ([], [])
    assert tally.agreeing > 300
    in_text, unknown = in_texts([told_of(sources, made)])
    assert unknown == []
    assert in_text > 150


def test_figures_of_other_rows_are_found_to_be_wrong(sources: list[RunSource]) -> None:
    made = answers(sources)
    changed = [
        one.model_copy(
            update={
                "record": one.record.model_copy(
                    update={"metrics": metrics(duration_s=9.0), "outcome": "timeout", "reason": "another"}
                )
            }
        )
        if place < 6
        else one
        for place, one in enumerate(sources)
    ]
    assert len(judged([told_of(changed, made)]).wrong) > 40


def test_each_field_with_a_false_figure_is_found(sources: list[RunSource]) -> None:
    comparison = next(one for one in answers(sources) if one.tool == "compare_results")
    count = judged([told_of(sources, (comparison,))]).figures
    false = [replace(comparison, fields=spoiled(comparison.fields, place, [])) for place in range(count)]
    found = [judged([told_of(sources, (one,))]).wrong for one in false]
    assert all(len(faults) == 1 for faults in found)


def test_a_figure_of_a_text_that_is_in_no_field_is_unknown(sources: list[RunSource]) -> None:
    comparison = next(one for one in answers(sources) if one.tool == "compare_results")
    lines = comparison.text.splitlines()
    assert unknown_in_text("\n".join([*lines, "The moon is 384,400 km away."]), comparison.fields) != []
    assert unknown_in_text(comparison.text.replace("10 pairs", "11 pairs"), comparison.fields) != []


def test_a_figure_of_a_finding_must_be_in_the_finding_itself() -> None:
    finding = {"statement": "The third of 17 runs is late by 2.5 s.", "figures": {"runs": 17.0, "late_s": 2.51}}
    assert unknown_in_fields({"findings": [finding]}) == []
    elsewhere = {"findings": [finding | {"figures": {"runs": 17.0}}], "late_s": 2.51}
    assert [fault.split()[0] for fault in unknown_in_fields(elsewhere)] == ["2.5"]


@pytest.mark.parametrize(
    ("text", "known"),
    [
        ("12.3 % of 81 runs (0.123)", True),
        ("run_12 at 7.0 s", True),
        ("-7 m and −7 m", True),
        ("run_12 +80", True),
        ("… 78 more", True),
        ("12.4 % of the runs", False),
        ("run_12 +79", False),
        ("in 1,300 runs", False),
        ("ISO 15622 asks for 4", False),
    ],
)
def test_figures_are_known_in_any_form_and_names_are_not_figures(text: str, known: bool) -> None:
    fields = {"run_id": "run_12", "share": 0.12344, "runs": 81, "time_s": 7.0, "source": "ISO 15622"}
    listed = "- one\n- two\n- three\n" if text.startswith("…") else ""
    assert (unknown_in_text(listed + text, fields) == []) is known


@pytest.mark.parametrize(
    ("shown", "value", "right"),
    [
        ("0.36", 0.364, True),
        ("0.36", 0.366, False),
        ("1,234", 1233.6, True),
        ("1.2e-05", 1.24e-5, True),
        ("5", None, False),
    ],
)
def test_a_figure_agrees_if_it_rounds_to_the_field(shown: str, value: float | None, right: bool) -> None:
    assert agrees(shown, value) is right


def problem(*, speed: float, place: float | None, last: int = 40) -> PlanningProblem:
    start = InitialState(
        time_step=0,
        position=np.zeros(2),
        orientation=0.0,
        velocity=speed,
        acceleration=0.0,
        yaw_rate=0.0,
        slip_angle=0.0,
    )
    state = CustomState(time_step=Interval(20, last))
    if place is not None:
        state = CustomState(time_step=Interval(20, last), position=Rectangle(10.0, 4.0, center=np.array([place, 0.0])))
    return PlanningProblem(1, start, GoalRegion([state]))


def driven(speed: float, count: int = 31) -> RunSteps:
    return RunSteps(
        first_step=0,
        x_m=tuple(0.1 * speed * step for step in range(count)),
        y_m=(0.0,) * count,
        heading_rad=(0.0,) * count,
        speed_mps=(speed,) * count,
        acceleration_mps2=(0.0,) * count,
        plan_steps=(),
        costs={},
    )


@pytest.mark.parametrize(
    ("asked", "steps", "kind"),
    [
        (problem(speed=10.0, place=30.0), driven(10.0), None),
        (problem(speed=10.0, place=None), driven(10.0), "by_time_alone"),
        (problem(speed=10.0, place=0.0), driven(10.0, 2), "at_the_start"),
        (problem(speed=0.0, place=0.0), driven(0.0), "standing"),
        (problem(speed=0.0, place=0.0), driven(1.0), "standing"),
    ],
    ids=["driving", "time", "start", "stood", "would be met by standing"],
)
def test_goals_that_ask_for_no_driving_are_known(asked: PlanningProblem, steps: RunSteps, kind: str | None) -> None:
    assert truth(asked, steps) == kind


def test_attributed_causes_are_counted_apart_from_collisions(tmp_path: Path) -> None:
    hits = [source(record(f"ZAM_Town-{number}_1_T-1", "collision", obstacle_id=7), tmp_path) for number in range(1, 4)]
    prevention = {"by_braking_until_s": 1.0, "by_careful_driver": True, "by_rss": True, "by_fuzzy_driver": True}
    contacts = [
        {"kind": kind, "prevention": prevention, "predicted_gap_m": gap}
        for kind, gap in (("rear_end_by_other", None), ("crossing", 2.0), ("crossing", 0.0))
    ]
    reviews = {one.record.run_id: {"contact": contact} for one, contact in zip(hits, contacts, strict=True)}
    expected = Expected(raw_of(hits), WEIGHTS, reviews, {}).apart[DEFAULT.config_id]
    told = {"causes": {"kinds": {"crossing": 2}, "laid_to": {"recording": 1, "prediction": 1, "planning": 1}}}
    right, wrong = Tally(), Tally()
    right.hold(told, expected._causes_and_goals(told))
    assert (right.agreeing, right.wrong, right.unread) == (4, [], [])
    wrong.hold({"causes": {"laid_to": {"recording": 2, "prediction": 1}}}, expected._causes_and_goals(told))
    assert len(wrong.wrong) == 1
    assert expected._unforeseen("")["median_gap_m"] == 2.0


@pytest.mark.parametrize(
    ("away_m", "limit_kmh", "out_of_reach"), [(64.2, 50.0, False), (64.7, 50.0, True), (84.0, None, False)]
)
def test_goals_out_of_reach_are_missed_by_the_hardest_acceleration_too(
    away_m: float, limit_kmh: float | None, out_of_reach: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From 10 m/s an ego comes 54.9 m in 4 s if it accelerates by 11.5 m/s² to 50 km/h; the goal begins 5 m nearer."""
    asked = problem(speed=10.0, place=away_m)
    late = record(outcome="timeout")
    problems = SimpleNamespace(planning_problem_dict={late.problem_id: asked})
    monkeypatch.setattr(
        "benchmarks.analysis.recomputed.CommonRoadFileReader", lambda _: SimpleNamespace(open=lambda: (None, problems))
    )
    limits = () if limit_kmh is None else (limit_kmh,)
    facts: Any = SimpleNamespace(roads=SimpleNamespace(limits_ego_kmh=limits))
    batch: Any = None
    raw = RawRuns(
        batch=batch,
        records=(late,),
        steps={late.run_id: driven(10.0)},
        facts={late.scenario_id: facts},
        files={late.scenario_id: tmp_path},
    )
    assert (late_because(raw, late, ()) == "goal_out_of_reach") is out_of_reach
