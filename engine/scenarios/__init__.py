"""What is known about a scenario: facts with computed features, and the description in words.

``read_facts``: An operation: the facts of one CommonRoad file, for the catalogue.
``describe``: An operation: ego, vehicles and lanelets near the focus of a scenario.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .description import describe
    from .facts import read_facts

__getattr__, __dir__ = lazy_face(__name__, __file__)
