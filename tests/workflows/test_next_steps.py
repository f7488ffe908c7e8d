"""The next step of an answer is a call that works."""

import pytest

from plannerforge.engine.execution import Job
from plannerforge.engine.workspace import Recipe
from plannerforge.workflows.artifacts import _next_step
from plannerforge.workflows.runs import after_batch


@pytest.mark.parametrize(("config_ids", "compares"), [(["cfg_a"], False), (["cfg_a", "cfg_b"], True)])
def test_only_a_batch_of_several_configurations_is_to_be_compared(config_ids: list[str], compares: bool) -> None:
    assert ("compare_results" in after_batch("batch_1", config_ids)) is compares
    parents = ("ZAM_A-1_1_T-1", *config_ids)
    assert ("compare_results" in _next_step(_done("batch", "batch_1", parents))) is compares


@pytest.mark.parametrize(
    ("kind", "result", "tool"), [("study", "study_1", "optimize_planner"), ("trial", "run_1", "analyze_results")]
)
def test_the_result_of_a_study_and_of_a_trial_is_got_by_the_call_that_started_it(
    kind: str, result: str, tool: str
) -> None:
    assert tool in _next_step(_done(kind, result, ()))
    assert "compare_results" not in _next_step(_done(kind, "batch_1", ()))


def _done(kind: str, result: str, parents: tuple[str, ...]) -> Job:
    return Job(
        job_id="job_1",
        kind=kind,
        recipe=Recipe(tool="run_planner", parents=parents),
        state="done",
        share=1.0,
        message="",
        results=(result,),
        error="",
        started_at=0.0,
        updated_at=0.0,
    )
