"""The facets that are not about scenarios: maps, behaviours of drivers, planners with their presets."""

from plannerforge.engine.edits.behaviours import presets as behaviour_presets
from plannerforge.engine.planners.registry import PLANNERS
from plannerforge.engine.tuning.presets import presets as weight_presets
from plannerforge.schemas.catalog import FacetCounts
from plannerforge.tools.call import ToolCall

MAPS_SHOWN = 12


def other_facets(wanted: str, call: ToolCall) -> list[FacetCounts]:
    """Facets ``maps``, ``behaviours`` and ``planners``, or the one that is wanted."""
    makers = {"maps": _maps, "behaviours": _behaviours, "planners": _planners}
    return [make(call) for name, make in makers.items() if wanted in ("all", name)]


def _maps(call: ToolCall) -> FacetCounts:
    """Maps of the library, the map folders and the imports, with the number of sites that can be cut from each."""
    found = call.workspace.newest(kind="map", limit=MAPS_SHOWN)
    counts = {f"{map_.name} ({map_.artifact_id})": sum(map_.record.get("sites", {}).values()) for map_ in found}
    return FacetCounts(facet="maps", counts=counts, note="imported maps, with their sites")


def _behaviours(call: ToolCall) -> FacetCounts:
    del call
    names = dict.fromkeys(sorted(behaviour_presets()), 0)
    return FacetCounts(facet="behaviours", counts=names, note="presets for modify_scenario set_behaviour")


def _planners(call: ToolCall) -> FacetCounts:
    del call
    names = [f"{planner}:{preset}" for planner in PLANNERS for preset in weight_presets()]
    return FacetCounts(facet="planners", counts=dict.fromkeys(names, 0), note="configurations for run_planner")
