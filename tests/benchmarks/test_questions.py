"""The judge of questions about results: every line is asked, and an answer without the figure is told."""

import json
from pathlib import Path

import pytest
from support.runs import DEFAULT, SAFE, metrics, record

from benchmarks.analysis.public_runs import RawRuns
from benchmarks.analysis.questions import Question, Situations, questions
from plannerforge.schemas.runs import BatchRecord


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


def test_every_turn_about_results_is_asked(shared_data: Path) -> None:
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


@pytest.mark.parametrize(
    ("ask", "answer", "lacking"),
    [
        ("criticality", "reached the goal at 5.0 s. Risk score (0 a collision, 5 negligible) 2 of 5", "3 of 5"),
        ("min_distance", "reached the goal at 5.0 s. Closest: 2.5 m to car 7", "Closest: 2.6 m"),
        ("duration", "reached the goal at 5.0 s (step 50)", "at 5.2 s"),
        ("recommendation", "Suggest: raise velocity (untried)", "Findings:"),
    ],
)
def test_an_answer_with_another_figure_is_none(raw: RawRuns, ask: str, answer: str, lacking: str) -> None:
    situation = Situations(raw).of(Question("x", "?", "goal_reached", (ask,)))[0]
    assert situation.holds(ask, answer)
    assert not situation.holds(ask, f"reached the goal at 9.0 s, {lacking}")


def test_a_question_about_one_run_is_asked_of_each_way_to_end(raw: RawRuns) -> None:
    asked = Situations(raw).of(Question("x", "?", "run", ("outcome",)))
    assert len(asked) == 2
    assert asked[0].holds("outcome", "collision: hit from behind by car 7 at 4.0 s")
    assert not asked[0].holds("outcome", "reached the goal at 4.0 s")


def test_rates_and_rankings_of_a_batch_are_recounted(raw: RawRuns) -> None:
    situation = Situations(raw).of(Question("x", "?", "batch", ("success_rate",)))[0]
    assert situation.holds("success_rate", "goal 1/2 = 50 %")
    assert not situation.holds("success_rate", "goal 2/2 = 100 %")
    hit, reached = "- run_a ZAM_T-1_1_T-1 Default: collision", "- run_b ZAM_T-2_1_T-1 Default: reached"
    assert situation.holds("ranking", f"The hardest first:\n{hit}\n{reached}")
    assert not situation.holds("ranking", f"The hardest first:\n{reached}\n{hit}")
