"""What the cost of a run is made of."""

from pathlib import Path

import pytest
from support.runs import record, source

from plannerforge.engine.analysis.run_set import RunSet, cost_shares, mean_terms, share_of


def test_a_share_of_no_cost_is_undefined() -> None:
    assert share_of({"prediction": 0.0}, ["prediction"]) is None
    assert share_of({}, ["prediction"]) is None
    assert share_of({"prediction": 1.0, "jerk": 3.0}, ["prediction", "unknown"]) == 0.25


def test_every_run_has_the_same_weight_and_the_largest_term_comes_first(tmp_path: Path) -> None:
    first = source(record("ZAM_A-1_1_T-1"), tmp_path, prediction=1.0, jerk=1.0, idle=0.0)
    second = source(record("ZAM_B-1_1_T-1"), tmp_path, prediction=5.0)
    shares = cost_shares(RunSet((first, second)))
    assert [(one.term, one.mean_weighted, one.runs) for one in shares] == [("prediction", 3.0, 2), ("jerk", 0.5, 2)]
    assert [one.share for one in shares] == pytest.approx([3.0 / 3.5, 0.5 / 3.5])


def test_costs_count_from_the_given_step_on(tmp_path: Path) -> None:
    runs = RunSet((source(record(), tmp_path, prediction=1.0),))
    (steps,) = runs.steps.values()
    rising = steps.model_copy(update={"costs": {"prediction": tuple(float(step) for step in steps.plan_steps)}})
    last = rising.plan_steps[-1]
    assert mean_terms(rising, since_step=last) == {"prediction": last}
    assert mean_terms(rising, since_step=last + 1) == {}
    assert mean_terms(rising)["prediction"] == pytest.approx(sum(rising.plan_steps) / len(rising.plan_steps))
