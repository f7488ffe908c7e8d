"""Explores how planners fare over logical scenarios: points, their evaluation in memory, boundaries and failures.

``concrete_edits``: returns the edits of a logical scenario for values of its parameters.
``Evaluator``: edits a base in memory and runs a planner until the encounter is resolved.
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
    from .search import FailureSearch, Point, Score, Stratum

__getattr__, __dir__ = lazy_face(__name__, __file__)
