"""Explores how planners fare over logical scenarios: points, their evaluation in memory, and boundaries.

``concrete_edits``: returns the edits of a logical scenario for values of its parameters.
``Evaluator``: edits a base in memory and runs a planner until the encounter is resolved.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .concrete import concrete_edits
    from .evaluation import Evaluator

__getattr__, __dir__ = lazy_face(__name__, __file__)
