"""All findings by their entry point, in the order in which they are told.

Adding one: its file with a function ``(evidence) -> list of findings``, one line here, one test.
"""

import importlib
from collections.abc import Callable

from plannerforge.engine.analysis.evidence import Evidence
from plannerforge.schemas.results import Finding

FINDINGS: tuple[str, ...] = (
    "main_failure:main_failure",
    "weak_obstacle_cost:weak_obstacle_cost",
    "held_back:held_back",
    "rejecting_constraint:rejecting_constraint",
    "near_misses:near_misses",
    "uncomfortable_turns:uncomfortable_turns",
    "dominating_cost:dominating_cost",
    "idle_weights:idle_weights",
    "hard_scenarios:hard_scenarios",
)


def find_all(evidence: Evidence) -> tuple[Finding, ...]:
    """What every finding has to say about these runs."""
    return tuple(finding for entry_point in FINDINGS for finding in _load(entry_point)(evidence))


def _load(entry_point: str) -> Callable[[Evidence], list[Finding]]:
    module, name = entry_point.split(":")
    found: Callable[[Evidence], list[Finding]] = getattr(importlib.import_module(f"{__package__}.{module}"), name)
    return found
