"""The judge of questions about results: every line is asked, and an answer without the figure is told."""

import json
from pathlib import Path
from typing import Any

import pytest
from support.runs import DEFAULT, SAFE, metrics, record

from benchmarks.analysis.public_runs import RawRuns
from benchmarks.analysis.questions import GivenAnswer, Question, Situations, questions
from plannerforge.schemas.runs import BatchRecord, RunRecord


@pytest.fixture
def raw() -> RawRuns:
    """One scenario that collides under both configurations, one that reaches its goal under both."""
    records = tuple(
        record(f"ZAM_T-{number}_1_T-1", outcome, config, figures=metrics(risk_score=number, minimum_distance_m=2.5))
        for config in (DEFAULT, SAFE)
        for number, outcome in ((1, "collision"), (2, "goal_reached"))
    )
    batch = BatchRecord(
        batch_id="batch_x",
        scenarios=tuple(sorted({one.scenario_id for one in records})),
        configs=(DEFAULT.config_id, SAFE.config_id),
        prediction="constant_velocity",
        traffic="recorded",
        lost=(),
        runs=tuple(one.run_id for one in records),
    )
    return RawRuns(batch, records, {}, {}, {})


def test_every_turn_about_results_is_a_question(shared_data: Path) -> None:
    corpora = shared_data / "corpora" / "dev"
    asked = {one.line_id.rsplit("-", 1)[0] for one in questions(corpora) if one.line_id.startswith("e2e")}
    lines = [json.loads(line) for line in (corpora / "e2e.jsonl").read_text(encoding="utf-8").splitlines()]
    about = {
        line["id"]
        for line in lines
        for turn in line["turns"]
        if turn["action"] in ("analyse", "compare", "test+compare")
    }
    assert asked == about


def of_run(one: RunRecord, **fields: Any) -> dict[str, Any]:
    row = {"run_id": one.run_id, "outcome": one.outcome, "duration_s": one.metrics.duration_s, "reason": "it ended"}
    return {"rows": [row], "review": None, "metrics": [], **fields}


@pytest.mark.parametrize(
    ("ask", "name", "value"), [("criticality", "risk_score", 2.0), ("min_distance", "minimum_distance_m", 2.5)]
)
def test_an_answer_with_another_figure_does_not_count(raw: RawRuns, ask: str, name: str, value: float) -> None:
    run = next(one for one in raw.records if one.outcome == "goal_reached")
    situation = Situations(raw).of(Question("x", "?", "goal_reached", (ask,)))[0]
    fields = of_run(run, metrics=[{"name": name, "median": value}])
    assert situation.holds(ask, GivenAnswer(fields, f"{run.run_id} came to {value}"))
    assert not situation.holds(ask, GivenAnswer(fields, f"{run.run_id} came to {value + 1}"))
    wrong = of_run(run, metrics=[{"name": name, "median": value + 1}])
    assert not situation.holds(ask, GivenAnswer(wrong, f"{run.run_id} came to {value} or {value + 1}"))


def test_a_question_about_one_run_covers_each_way_to_end(raw: RawRuns) -> None:
    asked = Situations(raw).of(Question("x", "?", "run", ("outcome",)))
    assert len(asked) == 2
    hit, reached = raw.records[:2]
    told = GivenAnswer(of_run(hit), f"{hit.run_id} after {hit.metrics.duration_s} s")
    assert asked[0].holds("outcome", told)
    assert not asked[0].holds("outcome", GivenAnswer(of_run(reached), told.text))
    assert not asked[0].holds("outcome", GivenAnswer(of_run(hit), f"{hit.run_id} after 99.9 s"))


def test_rates_and_rankings_of_a_batch_are_recounted(raw: RawRuns) -> None:
    situation = Situations(raw).of(Question("x", "?", "batch", ("success_rate",)))[0]
    assert situation.holds("success_rate", GivenAnswer({"success": {"count": 1, "of": 2}}, "1/2 reached it"))
    assert not situation.holds("success_rate", GivenAnswer({"success": {"count": 2, "of": 2}}, "2/2 reached it"))
    hit, reached = {"scenario_id": "ZAM_T-1_1_T-1"}, {"scenario_id": "ZAM_T-2_1_T-1"}
    assert situation.holds("ranking", GivenAnswer({"rows": [hit, reached]}, "ZAM_T-1_1_T-1 before ZAM_T-2_1_T-1"))
    assert not situation.holds("ranking", GivenAnswer({"rows": [reached, hit]}, "ZAM_T-2_1_T-1 before ZAM_T-1_1_T-1"))
    assert not situation.holds("ranking", GivenAnswer({"rows": [hit, reached]}, "ZAM_T-2_1_T-1 before ZAM_T-1_1_T-1"))
