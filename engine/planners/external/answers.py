"""Reads the untrusted answers of program planners; each kind of error is a failure with its own reason."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from pydantic import ValidationError

from ....schemas.base import Model, problem_of
from ....schemas.errors import PlannerFailure
from ....schemas.planning import CommandTrajectory
from ....schemas.text import cited, counted, shown_name
from ...geometry import Values
from ..interface import EgoState, PlannedTrajectory
from .conformance import trajectory_breaches

Failed = Callable[[str, str], PlannerFailure]
"""Ends the program and returns the failure for a reason and a description of the program's behaviour."""
_SHOWN = 80
"""Characters of a non-JSON answer that an error quotes."""
_Message = TypeVar("_Message", bound=Model)


def read_message(model: type[_Message], answered: bytes, failed: Failed) -> _Message:
    """Return the message in an answer.

    Raises:
        PlannerFailure: The answer is empty, not JSON, in a different form, or contains a number that is not finite.
    """
    if not answered.strip():
        raise failed("not_json", "wrote no answer to standard output")
    try:
        return model.model_validate_json(answered)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        if first["type"] == "json_invalid":
            begins = cited(answered[: 4 * _SHOWN].decode("utf-8", "replace"), _SHOWN)
            raise failed("not_json", f"wrote something that is not JSON, starting with {begins}") from error
        if first["type"] == "finite_number":
            where = shown_name(".".join(map(str, first["loc"])))
            raise failed("not_finite", f"returned a number that is not finite: {where}") from error
        problem = cited(problem_of(model, first)[0])
        raise failed("wrong_form", f"returned an answer in the wrong form: {problem}") from error


def read_trajectory(answered: CommandTrajectory, ego: EgoState, step_s: float, failed: Failed) -> PlannedTrajectory:
    """Return the trajectory with unwrapped headings, and with accelerations computed from its speeds.

    Raises:
        PlannerFailure: The trajectory breaks the contract of planners.
    """
    if len(answered.x_m) < 2:
        raise failed(
            "too_short",
            f"returned {counted(len(answered.x_m), 'state')}; it must return the present state and at least "
            "one planned state",
        )
    trajectory = _trajectory(answered, ego, step_s)
    breaches = trajectory_breaches(trajectory, ego, step_s)
    if breaches:
        reason = "too_short" if breaches[0].startswith("plans only") else "contract_broken"
        raise failed(reason, f"returned a trajectory that breaks the contract: {'; '.join(breaches)}")
    return trajectory


def _trajectory(answered: CommandTrajectory, ego: EgoState, step_s: float) -> PlannedTrajectory:
    headings: Values = np.unwrap(np.array(answered.heading_rad))
    headings += 2 * np.pi * round((ego.heading_rad - float(headings[0])) / (2 * np.pi))
    speeds = np.array(answered.speed_mps)
    gained = np.concatenate([[ego.acceleration_mps2], np.diff(speeds) / step_s])
    return PlannedTrajectory(np.column_stack([answered.x_m, answered.y_m]), headings, speeds, gained)
