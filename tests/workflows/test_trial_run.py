"""What a trial run says of a scenario that was just made."""

from typing import Any

import pytest

from plannerforge.schemas.generation import ScenarioSummary
from plannerforge.schemas.runs import Outcome, RunRecord
from plannerforge.workflows.generation import making as trial_run
from plannerforge.workflows.runs import CellResult

SUMMARY = ScenarioSummary.model_construct(scenario_id="ZAM_A-1_1_T-1", checks_passed=[], checks_failed=[], notes=[])


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("outcome", "can_run"), [("collision", True), ("goal_missed", True), ("infeasible", False), ("invalid", False)]
)
async def test_only_an_outcome_without_a_trajectory_fails_the_check(
    monkeypatch: pytest.MonkeyPatch, outcome: Outcome, can_run: bool
) -> None:
    async def one_run(*_: Any) -> list[CellResult]:
        return [CellResult(RunRecord.model_construct(run_id="run_1", outcome=outcome, reason="so it ended"))]

    monkeypatch.setattr(trial_run, "run_grid", one_run)
    monkeypatch.setattr(trial_run, "resolve_configuration", lambda *_: None)
    monkeypatch.setattr(trial_run, "store_configuration", lambda *_: None)
    call: Any = None
    told = await trial_run.with_trial_run(call, SUMMARY)
    assert (trial_run.CHECK in told.checks_passed, trial_run.CHECK in told.checks_failed) == (can_run, not can_run)
    assert bool(told.notes) is not can_run
    assert outcome.replace("_", " ") in told.trial_run
