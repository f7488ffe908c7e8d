"""The facets that are not about scenarios: maps, behaviours of drivers, planners with their presets."""

from plannerforge.engine.edits.behaviours import presets as behaviour_presets
from plannerforge.engine.maps.index import built_in_maps
from plannerforge.engine.planners.registry import PLANNERS
from plannerforge.engine.tuning.planner_tuning import tuning_of
from plannerforge.schemas.catalog import FacetCounts
from plannerforge.schemas.generation import MapFacts
from plannerforge.tools.call import ToolCall

MAPS_SHOWN = 12


def other_facets(wanted: str, call: ToolCall) -> list[FacetCounts]:
    """Facets ``maps``, ``behaviours`` and ``planners``, or the one that is wanted."""
    makers = {"maps": _maps, "behaviours": _behaviours, "planners": _planners}
    return [make(call) for name, make in makers.items() if wanted in ("all", name)]


def _maps(call: ToolCall) -> FacetCounts:
    """The built-in maps and those that were imported, with the number of sites that can be cut from each."""
    imported = [found.read(MapFacts) for found in call.workspace.newest(kind="map", limit=MAPS_SHOWN)]
    facts = [*(entry.facts for entry in built_in_maps()), *imported]
    counts = {one.place: sum(one.sites.values()) for one in facts[:MAPS_SHOWN]}
    return FacetCounts(facet="maps", counts=counts, note="with their sites")


def _behaviours(call: ToolCall) -> FacetCounts:
    del call
    names = dict.fromkeys(sorted(behaviour_presets()), 0)
    return FacetCounts(facet="behaviours", counts=names, note="set_behaviour presets")


def _planners(call: ToolCall) -> FacetCounts:
    del call
    presets = "; ".join(f"{name}: {', '.join(tuning_of(name).presets)}" for name in PLANNERS)
    return FacetCounts(facet="planners", counts=dict.fromkeys(PLANNERS, 0), note=f"PLANNER:PRESET with {presets}")
