"""Limits on what runs show: what a text says, and when it holds."""

from collections.abc import Mapping

import pytest
from support.runs import metrics, record

from plannerforge.engine.analysis import Judged, parse_limit
from plannerforge.schemas.analysis.comparison import SuccessTest
from plannerforge.schemas.errors import InvalidRequest, UnknownName
from plannerforge.schemas.runs import Outcome, RunRecord


def named(run_id: str, run: RunRecord) -> RunRecord:
    return run.model_copy(update={"run_id": run_id, "scenario_id": f"ZAM_{run_id}-1_1_T-1"})


def judged(outcomes: str, against: Mapping[str, tuple[SuccessTest, tuple[str, ...]]] | None = None) -> Judged:
    """Runs by a letter each: g(oal), c(ollision), u(npreventable collision), t(imeout), i(nvalid)."""
    words: dict[str, Outcome] = {
        "g": "goal_reached",
        "c": "collision",
        "u": "collision",
        "t": "timeout",
        "i": "invalid",
    }
    records = [named(f"run_{index}", record(outcome=words[letter])) for index, letter in enumerate(outcomes)]
    unpreventable = frozenset(f"run_{index}" for index, letter in enumerate(outcomes) if letter == "u")
    return Judged("Default", records, 1, unpreventable, against or {})


def paired(only_before: int, only_after: int, p: float, low: float, difference: float) -> SuccessTest:
    return SuccessTest(
        pairs=20,
        both=10,
        only_before=only_before,
        only_after=only_after,
        neither=10 - only_before - only_after,
        difference=difference,
        low=low,
        high=0.1,
        p=p,
        p_holm=None,
    )


@pytest.mark.parametrize(
    ("text", "outcomes", "holds"),
    [
        ("success >= 0.75", "gggci", True),
        ("success > 75%", "gggc", False),
        ("success >= 0.5 with confidence", "gggc", False),
        ("success >= 0.2 with confidence", "gggc", True),
        ("collision <= 0.25", "gggc", True),
        ("collision <= 0.3 with confidence", "gggc", False),
        ("timeout == 0", "gggc", True),
        ("success_without_unpreventable >= 100%", "ggu", True),
        ("success_without_unpreventable >= 100%", "gguc", False),
        ("preventable_collisions == 0", "gguu", True),
        ("preventable_collisions == 0", "gguc", False),
        ("collisions < 2", "gguc", False),
        ("failures <= 2", "ggct", True),
        ("invalid == 0", "ggi", False),
        ("lost == 0", "gg", False),
        ("success >= 0", "ii", False),
    ],
)
def test_a_limit_on_shares_and_counts_is_judged_by_its_figure(text: str, outcomes: str, holds: bool) -> None:
    assert parse_limit(text).judge(judged(outcomes)).holds is holds


def test_a_limit_on_a_metric_is_judged_in_every_run_in_a_share_or_by_a_statistic() -> None:
    values = [0.4, 0.6, 0.8, 1.0]
    records = [named(f"run_{i}", record(figures=metrics(minimum_distance_m=value))) for i, value in enumerate(values)]
    alone = metrics(minimum_distance_m=None, minimum_time_headway_s=None)
    records = [*records, named("run_alone", record(figures=alone))]
    runs = Judged("Default", records, 0, frozenset(), {})
    every = parse_limit("minimum_distance_m >= 0.5").judge(runs)
    assert (every.holds, every.run_ids) == (False, ("run_0",))
    assert every.observed == "within in 3 of 4 runs (0.4 to 1 m): run_0"
    assert parse_limit("minimum_distance_m >= 0.5 in 75% of runs").judge(runs).holds
    assert not parse_limit("minimum_distance_m >= 0.5 in 0.8 of runs").judge(runs).holds
    assert parse_limit("median minimum_distance_m >= 0.7").judge(runs).holds
    assert not parse_limit("lowest minimum_distance_m >= 0.5").judge(runs).holds
    assert parse_limit("highest minimum_distance_m < 1.1").judge(runs).holds
    only_alone = Judged("Default", records[-1:], 0, frozenset(), {})
    assert parse_limit("minimum_time_headway_s >= 99").judge(only_alone).observed == "no run has it"


def test_a_baseline_is_judged_by_the_test_by_a_margin_or_by_every_scenario() -> None:
    lost = ("run_3 on A",)
    worse = judged("gg", {"base.json": (paired(7, 0, 0.016, -0.55, -0.35), lost)})
    unclear = judged("gg", {"base.json": (paired(2, 1, 1.0, -0.21, -0.05), lost)})
    assert not parse_limit("not worse than base.json").judge(worse).holds
    assert parse_limit("not worse than base.json").judge(unclear).holds
    assert not parse_limit("not worse than base.json by 0.2").judge(unclear).holds
    assert parse_limit("not worse than base.json by 25%").judge(unclear).holds
    verdict = parse_limit("nothing lost against base.json").judge(unclear)
    assert not verdict.holds
    assert "1 gained, 2 lost of 20 pairs: run_3 on A" in verdict.observed


def test_a_limit_s_end_decides_its_quantity() -> None:
    assert parse_limit("success >= 0.9 for the careful one").only == "the careful one"
    assert parse_limit("not  worse than a/b.json by 5% for careful").baseline == "a/b.json"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("success is good", "not a limit"),
        ("succes >= 0.9", "success"),
        ("success >= 90", "between 0 and 1"),
        ("collisions <= 5%", "not a share"),
        ("median success >= 0.5", "single figure"),
        ("success >= 0.5 in 0.9 of runs", "single figure"),
        ("median duration_s <= 5 in 0.9 of runs", "cannot have a share"),
        ("duration_s <= 5 with confidence", "only shares"),
        ("nothing lost against b.json by 5%", "margin"),
        ("success >= nan", "not a limit"),
        ("", "not a limit"),
    ],
)
def test_a_limit_without_meaning_is_refused_with_the_intended_one(text: str, said: str) -> None:
    with pytest.raises((InvalidRequest, UnknownName)) as refusal:
        parse_limit(text)
    assert said in refusal.value.text
