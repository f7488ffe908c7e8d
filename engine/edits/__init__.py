"""Edits of a scenario: resolved, simulated in SUMO among the recorded traffic, checked, written.

``NET_FILE``: TODO.
``SCENARIO_FILE``: TODO.
``apply_edits``: Carry out all edits, or none, in one re-simulation from the base scenario.
``scene_of``: The scene of a file with its lanes and SUMO network.
``Changes``: Everything that the edits so far ask for.
``reachable_lanelets``: Lanelets outside junctions that can be reached, the fewest lanelets away first, without the
    starts.
``select``: Ids of the vehicles that the selectors mean together, ascending.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .apply import NET_FILE as NET_FILE
    from .apply import SCENARIO_FILE as SCENARIO_FILE
    from .apply import apply_edits as apply_edits
    from .apply import scene_of as scene_of
    from .changes import Changes as Changes
    from .references import reachable_lanelets as reachable_lanelets
    from .references import select as select

__getattr__, __dir__ = lazy_face(__name__, __file__)
