"""What runs have in common, in words with the runs behind them: findings, in the order in which they are told.

Adding one: a function ``(evidence) -> list of findings`` here, its name in ``FINDINGS``, one test.
"""

from collections.abc import Callable

from plannerforge.engine.analysis.evidence import Evidence
from plannerforge.engine.analysis.findings.dominating_cost import dominating_cost
from plannerforge.engine.analysis.findings.hard_scenarios import hard_scenarios
from plannerforge.engine.analysis.findings.held_back import held_back
from plannerforge.engine.analysis.findings.idle_weights import idle_weights
from plannerforge.engine.analysis.findings.main_failure import main_failure
from plannerforge.engine.analysis.findings.near_misses import near_misses
from plannerforge.engine.analysis.findings.rejecting_constraint import rejecting_constraint
from plannerforge.engine.analysis.findings.uncomfortable_turns import uncomfortable_turns
from plannerforge.engine.analysis.findings.weak_obstacle_cost import weak_obstacle_cost
from plannerforge.schemas.results import Finding

FINDINGS: tuple[Callable[[Evidence], list[Finding]], ...] = (
    main_failure,
    weak_obstacle_cost,
    held_back,
    rejecting_constraint,
    near_misses,
    uncomfortable_turns,
    dominating_cost,
    idle_weights,
    hard_scenarios,
)


def find_all(evidence: Evidence) -> tuple[Finding, ...]:
    """What every finding has to say about these runs."""
    return tuple(finding for find in FINDINGS for finding in find(evidence))
