"""The tools that look into the catalogue."""

import hashlib

from ..engine.catalog import Ranking, Search, description_of, open_catalogue, scenario_facets
from ..engine.cosimulation import presets as behaviour_presets
from ..engine.planners import PLANNERS
from ..engine.tuning import tuning_of
from ..engine.workspace import Recipe
from ..schemas.catalog import (
    DescribeCatalogArguments,
    DescribeCatalogResult,
    FacetCounts,
    FindScenariosArguments,
    FindScenariosResult,
    RankRequest,
    SearchRecord,
)
from ..schemas.scenarios import ScenarioFacts, ScenarioRecord
from .call import INDEX_FOLDER, ToolCall
from .maps import maps_seen
from .operations import RANK
from .scenarios import one_scenario, opened_search, searched_within

_MAPS_SHOWN = 12
"""Maps that the facet lists by name; chosen to keep the answer short."""


async def describe_catalog(arguments: DescribeCatalogArguments, call: ToolCall) -> DescribeCatalogResult:
    """Facets with counts."""
    open_catalogue(call.workspace, with_starter=call.services.with_starter)
    within = searched_within(arguments.within, call)
    connection = call.workspace.database.connection()
    count, facets = scenario_facets(connection, arguments.facet, frozenset(within) if within is not None else None)
    return DescribeCatalogResult(scenarios=count, facets=(*facets, *_other_facets(arguments.facet, call)))


def _other_facets(wanted: str, call: ToolCall) -> list[FacetCounts]:
    """The facets that are not about scenarios: ``maps``, ``behaviours``, ``planners``, or the wanted one of them."""
    makers = {"maps": lambda: _maps(call), "behaviours": _behaviours, "planners": _planners}
    return [make() for name, make in makers.items() if wanted in ("all", name)]


def _maps(call: ToolCall) -> FacetCounts:
    """The built-in maps and those that were imported, with the number of sites that can be cut from each."""
    seen = maps_seen(call)
    counts: dict[str, int] = {}
    for facts in (entry.facts for entry in seen.entries[:_MAPS_SHOWN]):
        name = facts.place if facts.place not in counts else f"{facts.place} ({facts.map_id})"
        counts[name] = sum(facts.sites.values())
    more = len(seen.entries) - _MAPS_SHOWN
    notes = ["with their sites", *([f"{more} more maps"] if more > 0 else []), *seen.notes]
    return FacetCounts(facet="maps", counts=counts, note="; ".join(notes))


def _behaviours() -> FacetCounts:
    names = dict.fromkeys(sorted(behaviour_presets()), 0)
    return FacetCounts(facet="behaviours", counts=names, note="set_behaviour presets")


def _planners() -> FacetCounts:
    presets = "; ".join(f"{name}: {', '.join(tuning_of(name).presets)}" for name in PLANNERS)
    return FacetCounts(facet="planners", counts=dict.fromkeys(PLANNERS, 0), note=f"PLANNER:PRESET with {presets}")


async def find_scenarios(arguments: FindScenariosArguments, call: ToolCall) -> FindScenariosResult:
    """Filter by slots, rank by text, store the search, answer with one page of it."""
    open_catalogue(call.workspace, with_starter=call.services.with_starter)
    arguments = _resolved(arguments, call)
    search = opened_search(arguments, call)
    ranking = await _ranking(search, call) if search.needs_ranking else None
    hits = search.find(ranking)
    stages = search.stage_counts()
    found = hashlib.sha256("\n".join(hits.matches).encode()).hexdigest()
    recipe = Recipe(
        tool="find_scenarios",
        arguments=arguments.model_dump(mode="json", exclude={"limit", "offset"})
        | {"found": found, "left": [stage.left for stage in stages]},
        parents=tuple(key.partition("#")[0] for key in (arguments.within, arguments.like) if key),
    )
    search_id = f"search_{recipe.digest}"
    total = hits.total if hits.total > len(hits.matches) else None
    record = SearchRecord(arguments=arguments, scenario_ids=hits.matches, stages=stages, total=total)
    call.workspace.put("search", search_id, recipe=recipe, record=record)
    call.made("search", search_id)
    return search.answer(search_id, hits, ranking)


def _resolved(arguments: FindScenariosArguments, call: ToolCall) -> FindScenariosArguments:
    """The arguments with ids in the place of ``latest``, and the id of the entry that others are to be like."""
    changes = {}
    if arguments.like is not None:
        changes["like"] = _example(arguments.like, call).scenario_id
    if arguments.within is not None:
        changes["within"] = call.artifact(arguments.within, "search").artifact_id
    return arguments.model_copy(update=changes)


def _example(word: str, call: ToolCall) -> ScenarioFacts:
    """The entry that others are to be like; it need not be listed, as a version that was superseded."""
    artifact, problem_id = one_scenario(word, call)
    facts = artifact.read(ScenarioRecord).facts
    return facts if problem_id is None else facts.seen_by(problem_id)


async def _ranking(search: Search, call: ToolCall) -> Ranking:
    arguments, candidates = search.arguments, search.candidates()
    text = arguments.text or ""
    if arguments.like is not None:
        text = f"{text} {description_of(_example(arguments.like, call))}".strip()
    request = RankRequest(
        database=call.workspace.database.path,
        index=call.workspace.root / INDEX_FOLDER,
        text=text,
        candidates=candidates,
        method="bm25" if arguments.method == "bm25" else "semantic",
        limit=max(len(candidates), 1),
        model=call.services.embedding_model,
    )
    return Ranking.of(await call.run(RANK, request))
