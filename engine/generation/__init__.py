"""Scenarios made from maps: site, network, traffic, ego and goal, file, checks.

``Hopeless``: Levels that sites of a map do not suit, as the rows of a coverage plan have shown.
``Levels``: By factor of a coverage plan, the index of its level; None for one that the plan does not have.
``PlanCounts``: How many rows of a coverage plan wait, were made, were refused, and failed.
``PlanRow``: A scenario that a coverage plan makes, or has tried to make.
``PlanRows``: The rows of a coverage plan in the workspace's database: what is to be made, and what became of it.
``RowState``: What became of a row of a coverage plan.
``TRIES``: Rows with a combination that are refused before it is said not to be possible.
``combinations_in``: The combinations of levels that a row of a coverage plan holds.
``generate_scenario``: Make one scenario in the request's folder; an operation for a worker.
``count_sites``: The number of different sites of a map that fit a request; an operation for a worker.
``made_before``: What was asked for the scenarios of a workspace, each once, without where and by which numbers.
``plan_coverage``: How far a coverage plan has come, and its next rows; an operation for a worker.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .coverage import TRIES, combinations_in, plan_coverage
    from .generator import generate_scenario
    from .plan_rows import Hopeless, Levels, PlanCounts, PlanRow, PlanRows, RowState, made_before
    from .sites import count_sites

__getattr__, __dir__ = lazy_face(__name__, __file__)
