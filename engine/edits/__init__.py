"""Edits of a scenario: resolved, simulated in SUMO among the recorded traffic, checked, written.

``NET_FILE``: the name of the SUMO network beside an edited scenario.
``SCENARIO_FILE``: the name of an edited scenario's file.
``apply_edits``: carries out all edits of a request, or none, in one re-simulation; returns files and reports.
``Changes``: all that a list of edits asks for, before anything is simulated; immutable.
``HIT_ON_ENTRY``: the reason of refusals of an entry that another road user would run into.
``PLACE_TAKEN``: the reason of refusals of an entry onto another road user.
``reachable_lanelets``: lanelets outside junctions that can be reached from some, the fewest lanelets away first.
``select``: the ids of the vehicles that selectors mean together, ascending.
``scene_of``: the scene of a file with its lanes and SUMO network, kept for the next request.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .apply import NET_FILE, SCENARIO_FILE, apply_edits
    from .changes import Changes
    from .entries import HIT_ON_ENTRY, PLACE_TAKEN
    from .references import reachable_lanelets, select
    from .scene_cache import scene_of

__getattr__, __dir__ = lazy_face(__name__, __file__)
