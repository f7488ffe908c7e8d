"""Generates scenarios from maps: site, road network, traffic, ego and goal, file, checks.

``Hopeless``: Levels that fit no site of a map, judging from the refused rows of a coverage plan.
``Levels``: The level index for each factor of a coverage plan; None if the plan does not have that level.
``PlanCounts``: The numbers of rows of a coverage plan that are waiting, made, refused, or failed.
``PlanRow``: A scenario that a coverage plan makes or has tried to make.
``PlanRows``: The rows of a coverage plan in the workspace's database, with their results.
``RowState``: The state of a row of a coverage plan.
``TRIES``: The number of refused rows after which a combination counts as impossible.
``combinations_in``: Yields the combinations of levels that a row of a coverage plan contains.
``generate_scenario``: Generates one scenario in the request's folder; an operation for a worker.
``count_sites``: Counts the different sites of a map that fit a request; an operation for a worker.
``made_before``: Yields the distinct requests behind a workspace's scenarios, without place or seeds.
``plan_coverage``: Reports the progress of a coverage plan and its next rows; an operation for a worker.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .coverage import TRIES, combinations_in, plan_coverage
    from .generator import generate_scenario
    from .plan_rows import Hopeless, Levels, PlanCounts, PlanRow, PlanRows, RowState, made_before
    from .sites import count_sites

__getattr__, __dir__ = lazy_face(__name__, __file__)
