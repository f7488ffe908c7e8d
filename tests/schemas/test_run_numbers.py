"""Numbers of runs and plans: archives and planner programs may state any, and nothing overflows from one."""

import pytest
from pydantic import ValidationError
from support.runs import record

from plannerforge.schemas.planning import CommandTrajectory
from plannerforge.schemas.runs import RunRecord, RunSteps

LINE = {"x_m": (0.0, 1.0), "y_m": (0.0, 0.0), "heading_rad": (0.0, 0.0), "speed_mps": (10.0, 10.0)}


@pytest.mark.parametrize(
    "changed", [{"step_s": -1e-300}, {"step_s": 0.0}, {"ego_length_m": 1e308}, {"ego_width_m": 0.0}]
)
def test_a_run_with_an_impossible_step_or_size_is_refused(changed: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        RunRecord.model_validate(record("ZAM_A-1_1_T-1").model_dump() | changed)


@pytest.mark.parametrize("name", [*LINE])
def test_motion_from_which_derivatives_overflow_is_refused(name: str) -> None:
    driven = {"first_step": 0, **LINE, "acceleration_mps2": (0.0, 0.0), "plan_steps": (0,), "costs": {}}
    for model, sound in ((RunSteps, driven), (CommandTrajectory, LINE)):
        assert model.model_validate(sound)
        with pytest.raises(ValidationError):
            model.model_validate(sound | {name: (0.0, 1e308)})
