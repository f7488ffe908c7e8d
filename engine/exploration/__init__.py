"""Explores how planners fare over logical scenarios: points, their evaluation in memory, boundaries and failures.

``concrete_edits``: returns the edits of a logical scenario for values of its parameters.
``BoundarySearch``: searches for the edges between labels over two parameters.
``area_of``: returns the share of a map with a label, with its bounds.
``label_at``: returns the label at a place of a map.
``labels_on``: returns the labels of a map on a raster.
``Evaluator``: edits a base in memory and runs a planner until the encounter is resolved.
``open_space``: the operation that runs the planner in the unchanged base, and derives the search space.
``propose_points``: the operation that returns the next points of a search.
``evaluate_in_space``: the operation that returns how the planner fares at points of a search's space.
``shrink_failure``: the operation that removes everything that a failure does not need.
``FailureSearch``: a search for failures in a stratified space.
``Stratum``: a part of such a space.
``Point``: a proposal of the search.
``Score``: the score of a proposal.
``Archive``: the failures of a search by cell.
``draw_road``: the operation that writes the file of a road.
``evaluate_points``: the operation that evaluates a batch of points.
``catalogue``: returns the logical scenarios of the catalogue by name.
``pre_crash_type``: returns the type that a text such as ``nhtsa:26`` names.
``pre_crash_types``: returns the types of NHTSA's pre-crash typology, with the logical scenarios of each.
``read_logical_scenario``: the operation that returns a logical scenario by name or from a file.
``ROADS``: the names of the roads that logical scenarios may use.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .archive import Archive
    from .boundary import BoundarySearch, area_of, label_at, labels_on
    from .concrete import concrete_edits
    from .evaluation import Evaluator
    from .finding import evaluate_in_space, open_space, propose_points, shrink_failure
    from .logical import catalogue, pre_crash_type, pre_crash_types
    from .points import draw_road, evaluate_points, read_logical_scenario
    from .roads import ROADS
    from .search import FailureSearch, Point, Score, Stratum

__getattr__, __dir__ = lazy_face(__name__, __file__)
