"""Explores how planners fare over logical scenarios: points, their evaluation in memory, boundaries and failures.

``concrete_edits``: returns the edits of a logical scenario for values of its parameters.
``Evaluator``: edits a base in memory and runs a planner until the encounter is resolved.
``open_space``: the operation that runs the planner in the unchanged base, and derives what it offers to a search.
``propose_points``: the operation that returns the next points of a search.
``evaluate_points``: the operation that returns how the planner fares at points.
``shrink_failure``: the operation that reduces a failure to what it needs.
``FailureSearch``: a search for failures in a stratified space.
``Stratum``: a part of such a space.
``Point``: a proposal of the search.
``Score``: the score of a proposal.
``Archive``: the failures of a search by cell.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .archive import Archive
    from .concrete import concrete_edits
    from .evaluation import Evaluator
    from .finding import evaluate_points, open_space, propose_points, shrink_failure
    from .search import FailureSearch, Point, Score, Stratum

__getattr__, __dir__ = lazy_face(__name__, __file__)
