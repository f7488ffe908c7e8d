"""The score of an attempt at a request of any corpus."""

from collections.abc import Callable, Mapping
from pathlib import Path

from ..attempts import Attempt, EvalRequest, Score, Task
from .common import refused, score_question
from .conversation import score_conversation
from .generation import score_generation
from .modification import score_modification
from .routing import score_routing
from .selection import score_selection
from .tuning import score_tuning

_SCORERS: Mapping[Task, Callable[[EvalRequest, Attempt, Path], Score]] = {
    "generation": score_generation,
    "selection": score_selection,
    "modification": score_modification,
    "routing": score_routing,
    "tuning": score_tuning,
    "e2e": score_conversation,
}


def score_attempt(request: EvalRequest, attempt: Attempt, workspace: Path) -> Score:
    """Score an attempt in the columns of its task's table; ``workspace`` is the workspace of the server used."""
    if request.expect == "clarify" and request.task != "routing":
        return score_question(request, attempt)
    if request.task == "selection" and request.expect == "refuse":
        return refused(request, attempt, "find_scenarios")
    return _SCORERS[request.task](request, attempt, workspace)
