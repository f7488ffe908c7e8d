"""The content of the catalogue, and searches in it."""

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

from ..engine.catalog import (
    Ranking,
    Search,
    description_of,
    entries_of,
    is_place,
    known_places,
    listed_facts,
    odd_values,
    open_catalogue,
    scenario_facets,
)
from ..engine.cosimulation import presets as behaviour_presets
from ..engine.maps import countries_spelt_like, country_code, country_name, find_maps
from ..engine.planners import PLANNERS, planner_names
from ..engine.tuning import tuning_of
from ..engine.workspace import ArtifactKind, Recipe
from ..schemas.catalog import (
    CountryMaps,
    DescribeCatalogArguments,
    DescribeCatalogResult,
    FacetCounts,
    FindScenariosArguments,
    FindScenariosResult,
    RankRequest,
    SearchRecord,
)
from ..schemas.errors import InvalidRequest, UnknownName, closest, misspelt, misspelt_names, with_values
from ..schemas.generation import MapFacts
from ..schemas.odd import OddCoverage, OddEntry, OddRequest
from ..schemas.runs import RunRecord
from ..schemas.scenarios import ScenarioFacts, ScenarioRecord
from ..schemas.text import cited, counted, one_line, quoted
from .context import INDEX_FOLDER, WorkflowContext
from .maps import inventory_of_read_maps
from .operations import JUDGE_ODD, RANK
from .paging import check_offset
from .scenarios import one_scenario, opened_search, searched_within

_MAPS_PAGE = 40
"""How many maps one page of the list shows (chosen)."""
_MOST_RUNS = 20_000
"""How many runs the coverage of an ODD counts, the newest first (chosen)."""
_COUNTRIES_SHOWN = 8
"""How many countries of maps are counted if all facets are requested (chosen)."""


async def describe_catalog(arguments: DescribeCatalogArguments, context: WorkflowContext) -> DescribeCatalogResult:
    """Return facets with counts."""
    open_catalogue(context.workspace, with_starter=context.services.with_starter)
    within = None if arguments.within is None else _within(arguments.within, context)
    connection = context.workspace.database.connection()
    maps = _maps_within(arguments.within, context)
    if arguments.within is not None and not within and not maps and not _is_search(arguments.within):
        raise _unknown_place(arguments.within, context)
    if arguments.offset and arguments.facet != "maps":
        raise InvalidRequest(
            f"offset counts maps, and facet={arguments.facet} has no pages",
            valid=["facet=maps", "no offset"],
            remedies=[with_values(offset=None), with_values(facet="maps")],
        )
    if arguments.odd is not None:
        covered = await _odd_coverage(arguments.odd, within, context)
        count = covered.inside.scenarios + covered.outside.scenarios
        return DescribeCatalogResult(scenarios=count, facets=(), odd=covered)
    count, facets = scenario_facets(connection, arguments.facet, within)
    found = DescribeCatalogResult(scenarios=count, facets=(*facets, *_other_facets(arguments, maps, context)))
    return _with_maps(found, maps, arguments) if arguments.facet == "maps" else found


async def _odd_coverage(text: str, within: frozenset[str] | None, context: WorkflowContext) -> OddCoverage:
    """Return what the listed scenarios, and their runs that could be attempted, cover of an ODD.

    Raises:
        InvalidRequest: the file does not exist, or is not an ODD.
        NotPossible: no concept of the ODD is measured.
    """
    path = context.allowed_path(text)
    if not path.is_file():
        raise InvalidRequest(f"{quoted(text)} is not a file", next_step="give the path of an OpenODD file (.yaml)")
    values = {
        facts.scenario_id: odd_values(facts) for facts in listed_facts(context.workspace.database.connection(), within)
    }
    runs, failed = Counter[str](), Counter[str]()
    for artifact in context.workspace.newest(kind="run", limit=_MOST_RUNS):
        record = artifact.read(RunRecord)
        entry = f"{record.scenario_id}#{record.problem_id}"
        entry = entry if entry in values else record.scenario_id
        if record.outcome != "invalid":
            runs[entry] += 1
            failed[entry] += record.outcome != "goal_reached"
    entries = [
        OddEntry(scenario_id=key, values=found, runs=runs[key], failed=failed[key]) for key, found in values.items()
    ]
    return await context.run(JUDGE_ODD, OddRequest(path=path, entries=tuple(entries)))


def _within(word: str, context: WorkflowContext) -> frozenset[str]:
    """Return the scenarios of a search, a coverage plan, countries or places; the set may be empty.

    Raises:
        UnknownName: there is no such search or plan, or an excluded place has neither scenarios nor maps.
    """
    if _is_search(word):
        return frozenset(searched_within(word, context) or ())
    area = _Area.of(word)
    for place in area.parts if area.excludes and not area.codes else ():
        if not _within(place, context) and not _maps_within(place, context):
            raise _unknown_place(place, context)
    where = {"country": word} if area.codes else {"city": word}
    try:
        search = opened_search(FindScenariosArguments(**where), context)
    except UnknownName:
        if area.excludes:
            raise
        return frozenset()
    entries = entries_of(context.workspace.database.connection(), search.funnel.matches)
    return frozenset(entry.scenario_id for entry in entries)


@dataclass(frozen=True)
class _Area:
    """The countries or places of a text, between ``|``. ``codes``: their codes if all are countries, otherwise empty.

    ``excludes``: everywhere else is meant, because of a leading ``!``.
    """

    parts: tuple[str, ...]
    codes: tuple[str, ...]
    excludes: bool

    @classmethod
    def of(cls, word: str) -> "_Area":
        body = word.strip()
        parts = tuple(part.strip() for part in body.removeprefix("!").split("|"))
        codes = tuple(code for part in parts if (code := country_code(part)) is not None)
        return cls(parts, codes if len(codes) == len(parts) else (), body.startswith("!"))


def _other_facets(
    arguments: DescribeCatalogArguments, maps: Sequence[MapFacts], context: WorkflowContext
) -> list[FacetCounts]:
    """Return the facets other than scenarios: ``maps``, ``behaviours``, ``planners``, or the selected one of them."""
    makers = {"maps": lambda: _maps(maps, arguments, context), "behaviours": _behaviours, "planners": _planners}
    return [make() for name, make in makers.items() if arguments.facet in ("all", name)]


def _maps_within(word: str | None, context: WorkflowContext) -> tuple[MapFacts, ...]:
    """Return the maps of countries or places, or of a search's countries, by country; all maps if no word is given."""
    known = [entry.facts for entry in inventory_of_read_maps(context).entries]
    if word is None:
        found = known
    elif _is_search(word):
        ids = searched_within(word, context) or ()
        countries = {each.partition("_")[0] for each in ids}
        found = [facts for facts in known if facts.country in countries]
    else:
        area = _Area.of(word)
        if area.codes:
            shown = {f.map_id for f in known if not {f.country, *f.countries_near}.isdisjoint(area.codes)}
        else:
            shown = {facts.map_id for part in area.parts for facts in _showing(part, context)}
        found = [facts for facts in known if (facts.map_id in shown) is not area.excludes]
    return tuple(
        sorted(found, key=lambda facts: (facts.country is None, facts.country or "", facts.place, facts.map_id))
    )


def _showing(place: str, context: WorkflowContext) -> list[MapFacts]:
    try:
        return [match.entry.facts for match in find_maps(inventory_of_read_maps(context).entries, place=place)]
    except UnknownName:
        return []


def _is_search(word: str) -> bool:
    return word.startswith(("search", "plan_")) or word == "latest"


def _unknown_place(word: str, context: WorkflowContext) -> UnknownName:
    """Return the refusal of a place that has neither scenarios nor maps."""
    maps = [entry.facts for entry in inventory_of_read_maps(context).entries]
    stored = known_places(context.workspace.database.connection())
    places = {facts.place for facts in maps}
    places |= {place for place, country in stored.places if is_place(country, place)}
    near = closest(word, sorted(places))
    meant = misspelt_names(word, near)
    alike = [] if meant else countries_spelt_like(word.strip().removeprefix("!"))
    filled = {code for facts in maps for code in (facts.country, *facts.countries_near)} | {*stored.countries}
    countries = [country_name(code) for code in alike if code in filled]
    likely = "" if countries or not alike else f"; no scenario or map is in {country_name(alike[0])} either"
    known = country_code(word.strip())
    what = f"no scenario, map or search matches {quoted(word)}{likely}"
    return UnknownName(
        what if known is None else f"the catalogue has no scenario and no map of the country {known}",
        valid=[*map(cited, meant), *countries, *(cited(place) for place in near if place not in meant)],
        next_step="choose one of these",
        remedies=[*misspelt(word, meant, "within"), *(with_values(within=one) for one in countries)],
    ).also(with_values(within=None))


def _with_maps(
    found: DescribeCatalogResult, maps: Sequence[MapFacts], arguments: DescribeCatalogArguments
) -> DescribeCatalogResult:
    """Return the answer with one page of the maps, by country, and the call that shows the rest.

    Raises:
        InvalidRequest: the offset skips all of them.
    """
    check_offset(arguments.offset, len(maps), "maps", _MAPS_PAGE)
    page = maps[arguments.offset : arguments.offset + _MAPS_PAGE]
    countries = [
        CountryMaps(
            country=country,
            maps=sum(_country(facts) == country for facts in maps),
            sites=sum(sum(facts.sites.values()) for facts in maps if _country(facts) == country),
            listed=tuple(_map_line(facts) for facts in page if _country(facts) == country),
        )
        for country in dict.fromkeys(_country(facts) for facts in page)
    ]
    after = arguments.offset + len(page)
    shown = f"{arguments.offset + 1} to {after}" if page else "none"
    within = "" if arguments.within is None else f", within='{one_line(arguments.within)}'"
    following = f"; describe_catalog facet=maps{within}, offset={after} shows more" if after < len(maps) else ""
    cut = len(page) < len(maps)
    rest = f"Maps {shown} of {len(maps)}{following}." if cut else ""
    return found.model_copy(update={"maps": tuple(countries), "maps_rest": rest})


def _country(facts: MapFacts) -> str:
    return facts.country or (f"{'/'.join(facts.countries_near)}?" if facts.countries_near else "?")


def _map_line(facts: MapFacts) -> str:
    """Return a map with its number of sites by type."""
    sites = ", ".join(f"{kind} {count}" for kind, count in sorted(facts.sites.items()) if count) or "no sites"
    return f"{cited(facts.place)} ({facts.map_id}): {sites}"


def _maps(maps: Sequence[MapFacts], arguments: DescribeCatalogArguments, context: WorkflowContext) -> FacetCounts:
    """Return the number of maps per country, with notes on the map folders."""
    counted_maps = Counter(_country(facts) for facts in maps)
    countries = dict(sorted(counted_maps.items(), key=lambda item: (-item[1], item[0])))
    hidden = len(countries) - _COUNTRIES_SHOWN
    shown = dict(islice(countries.items(), _COUNTRIES_SHOWN))
    sites = sum(sum(facts.sites.values()) for facts in maps)
    notes = [
        f"by country; {counted(sites, 'site')}",
        *([f"{counted(hidden, 'more country')}"] if hidden > 0 else []),
        *(["all: facet=maps"] if arguments.facet == "all" else []),
        *inventory_of_read_maps(context).notes,
    ]
    return FacetCounts(facet="maps", counts=shown if arguments.facet == "all" else countries, note="; ".join(notes))


def _behaviours() -> FacetCounts:
    names = dict.fromkeys(sorted(behaviour_presets()), 0)
    return FacetCounts(facet="behaviours", counts=names, note="set_behaviour")


def _planners() -> FacetCounts:
    planners_of: dict[str, list[str]] = {}
    for name in PLANNERS:
        others = [preset for preset in tuning_of(name).presets if preset != "Default"]
        if others:
            planners_of.setdefault(", ".join(others), []).append(name)
    presets = "; ".join(f"of {', '.join(names)}: {presets}" for presets, names in planners_of.items())
    counts = dict.fromkeys(planner_names(), 0)
    return FacetCounts(facet="planners", counts=counts, note=f"PLANNER:PRESET; all have Default; {presets}")


async def find_scenarios(arguments: FindScenariosArguments, context: WorkflowContext) -> FindScenariosResult:
    """Filter by conditions, rank by text, store the search, and answer with one page of it."""
    open_catalogue(context.workspace, with_starter=context.services.with_starter)
    arguments = _resolved(arguments, context)
    search = opened_search(arguments, context)
    ranking = await _ranking(search, context) if search.needs_ranking else None
    hits = search.find(ranking)
    check_offset(arguments.offset, len(hits.matches), "matches", arguments.limit)
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
    context.workspace.put("search", search_id, recipe=recipe, record=record)
    context.made("search", search_id)
    return search.answer(search_id, hits, ranking)


def _resolved(arguments: FindScenariosArguments, context: WorkflowContext) -> FindScenariosArguments:
    """Return the arguments with ids instead of ``latest``, including the id of the entry for ``like``."""
    changes = {}
    if arguments.like is not None:
        changes["like"] = _example(arguments.like, context).scenario_id
    if arguments.within is not None:
        kind: ArtifactKind = "plan" if arguments.within.startswith("plan_") else "search"
        try:
            changes["within"] = context.artifact(arguments.within, kind).artifact_id
        except UnknownName as error:
            raise error.also(with_values(within=None)) from error.__cause__
    return arguments.model_copy(update=changes)


def _example(word: str, context: WorkflowContext) -> ScenarioFacts:
    """Return the entry for ``like``, which may be unlisted, for example a superseded version."""
    artifact, problem_id = one_scenario(word, context)
    facts = artifact.read(ScenarioRecord).facts
    return facts if problem_id is None else facts.seen_by(problem_id)


async def _ranking(search: Search, context: WorkflowContext) -> Ranking:
    arguments, candidates = search.arguments, search.candidates()
    text = arguments.text or ""
    if arguments.like is not None:
        text = f"{text} {description_of(_example(arguments.like, context))}".strip()
    request = RankRequest(
        database=context.workspace.database.path,
        index=context.workspace.root / INDEX_FOLDER,
        text=text,
        candidates=candidates,
        method="bm25" if arguments.method == "bm25" else "semantic",
        limit=max(len(candidates), 1),
        model=context.services.embedding_model,
    )
    return Ranking.of(await context.run(RANK, request))
