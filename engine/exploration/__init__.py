"""Explores how planners fare over logical scenarios: points, their evaluation in memory, and boundaries.

``concrete_edits``: returns the edits of a logical scenario for values of its parameters.
``BoundarySearch``: searches for the edges between labels over two parameters.
``area_of``: returns the share of a map with a label, with its bounds.
``label_at``: returns the label at a place of a map.
``labels_on``: returns the labels of a map on a raster.
``Evaluator``: edits a base in memory and runs a planner until the encounter is resolved.
``draw_road``: the operation that writes the file of a road.
``evaluate_points``: the operation that evaluates a batch of points.
``read_logical_scenario``: the operation that returns a logical scenario by name or from a file.
``ROADS``: the names of the roads that logical scenarios may stand on.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .boundary import BoundarySearch, area_of, label_at, labels_on
    from .concrete import concrete_edits
    from .evaluation import Evaluator
    from .points import draw_road, evaluate_points, read_logical_scenario
    from .roads import ROADS

__getattr__, __dir__ = lazy_face(__name__, __file__)
