"""Edits of a scenario, which are resolved, simulated in SUMO among the recorded traffic, checked and written.

``SCENARIO_FILE``: the name of an edited scenario's file.
``apply_edits``: applies all edits of a request in one re-simulation, or refuses the request; returns files and reports.
``Changes``: everything that a list of edits requests, before anything is simulated; immutable.
``EditableScenario``: a base scenario that can be edited in memory any number of times, with the values of its files.
``EditedScenario``: a scenario after edits, in memory.
``NeedsFile``: raised for edits that can only be applied with files.
``is_unchanged``: returns whether a road user still follows an earlier track.
``road_across``: returns the start and end of a crossing of the road at a point of a lanelet.
``select``: returns the ids of the vehicles that selectors match, ascending.
``scene_of``: returns the scene of a file with its lanes and SUMO network, cached for the next request.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .apply import SCENARIO_FILE, apply_edits
    from .changes import Changes
    from .ego_risk import is_unchanged
    from .in_memory import EditableScenario, EditedScenario, NeedsFile
    from .population import road_across
    from .references import select
    from .scene_cache import scene_of

__getattr__, __dir__ = lazy_face(__name__, __file__)
