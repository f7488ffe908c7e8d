"""The facets that are not about scenarios: maps, behaviours of drivers, planners with their presets."""

from plannerforge.engine.edits.behaviours import presets as behaviour_presets
from plannerforge.engine.planners.registry import PLANNERS
from plannerforge.engine.tuning.planner_tuning import tuning_of
from plannerforge.schemas.catalog import FacetCounts
from plannerforge.tools.call import ToolCall
from plannerforge.tools.maps import maps_seen

MAPS_SHOWN = 12


def other_facets(wanted: str, call: ToolCall) -> list[FacetCounts]:
    """Facets ``maps``, ``behaviours`` and ``planners``, or the one that is wanted."""
    makers = {"maps": _maps, "behaviours": _behaviours, "planners": _planners}
    return [make(call) for name, make in makers.items() if wanted in ("all", name)]


def _maps(call: ToolCall) -> FacetCounts:
    """The built-in maps and those that were imported, with the number of sites that can be cut from each."""
    seen = maps_seen(call)
    counts: dict[str, int] = {}
    for facts in (entry.facts for entry in seen.entries[:MAPS_SHOWN]):
        name = facts.place if facts.place not in counts else f"{facts.place} ({facts.map_id})"
        counts[name] = sum(facts.sites.values())
    more = len(seen.entries) - MAPS_SHOWN
    notes = ["with their sites", *([f"{more} more maps"] if more > 0 else []), *seen.notes]
    return FacetCounts(facet="maps", counts=counts, note="; ".join(notes))


def _behaviours(call: ToolCall) -> FacetCounts:
    del call
    names = dict.fromkeys(sorted(behaviour_presets()), 0)
    return FacetCounts(facet="behaviours", counts=names, note="set_behaviour presets")


def _planners(call: ToolCall) -> FacetCounts:
    del call
    presets = "; ".join(f"{name}: {', '.join(tuning_of(name).presets)}" for name in PLANNERS)
    return FacetCounts(facet="planners", counts=dict.fromkeys(PLANNERS, 0), note=f"PLANNER:PRESET with {presets}")
