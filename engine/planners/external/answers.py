"""What planners that are programs answer, read without trust: each kind of error is a failure with its own reason."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from pydantic import ValidationError

from ....schemas.base import Model, problem_of
from ....schemas.errors import PlannerFailure
from ....schemas.planning import CommandTrajectory
from ....schemas.text import cited, shown_name
from ...geometry import Values
from ..interface import EgoState, PlannedTrajectory
from .conformance import trajectory_breaches

Failed = Callable[[str, str], PlannerFailure]
"""Ends the program and makes the failure from a reason and a description of what the program does."""
_SHOWN = 80
"""How many characters of an answer that is not JSON an error repeats."""
_Message = TypeVar("_Message", bound=Model)


def read_message(model: type[_Message], answered: bytes, failed: Failed) -> _Message:
    """Return the message that an answer holds.

    Raises:
        PlannerFailure: it is empty, not JSON, in another form, or holds a number that is not finite.
    """
    if not answered.strip():
        raise failed("not_json", "writes no answer to standard output")
    try:
        return model.model_validate_json(answered)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        if first["type"] == "json_invalid":
            begins = cited(answered[: 4 * _SHOWN].decode("utf-8", "replace"), _SHOWN)
            raise failed("not_json", f"writes something that is not JSON and begins with {begins}") from error
        if first["type"] == "finite_number":
            where = shown_name(".".join(map(str, first["loc"])))
            raise failed("not_finite", f"answers a number that is not finite: {where}") from error
        problem = cited(problem_of(model, first)[0])
        raise failed("wrong_form", f"answers in another form: {problem}") from error


def read_trajectory(answered: CommandTrajectory, ego: EgoState, step_s: float, failed: Failed) -> PlannedTrajectory:
    """Return the trajectory with unwrapped headings and the accelerations that follow from its speeds.

    Raises:
        PlannerFailure: it breaks the contract of planners.
    """
    if len(answered.x_m) < 2:
        raise failed(
            "too_short",
            f"answers {len(answered.x_m)} state(s); it must answer the present state and at least one planned state",
        )
    trajectory = _trajectory(answered, ego, step_s)
    breaches = trajectory_breaches(trajectory, ego, step_s)
    if breaches:
        reason = "too_short" if breaches[0].startswith("plans only") else "contract_broken"
        raise failed(reason, f"answers a trajectory that breaks the contract: {'; '.join(breaches)}")
    return trajectory


def _trajectory(answered: CommandTrajectory, ego: EgoState, step_s: float) -> PlannedTrajectory:
    headings: Values = np.unwrap(np.array(answered.heading_rad))
    headings += 2 * np.pi * round((ego.heading_rad - float(headings[0])) / (2 * np.pi))
    speeds = np.array(answered.speed_mps)
    gained = np.concatenate([[ego.acceleration_mps2], np.diff(speeds) / step_s])
    return PlannedTrajectory(np.column_stack([answered.x_m, answered.y_m]), headings, speeds, gained)
