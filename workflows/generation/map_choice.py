"""Choose the maps of a call, and the site of each of its scenarios.

Local maps that contain the place come first. If no local map does, the matching part of a country extract is cut out,
or a map is downloaded. A map downloaded for a request is stored, but only the same request uses it, so the request
gives the same bytes regardless of later downloads. A map that a user downloaded counts like any other. Maps without an
assigned site may replace a map that fails.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...engine.maps import (
    NOT_SHOWN,
    Closeness,
    MapEntry,
    MapMatch,
    country_name,
    file_stem,
    find_maps,
    fold,
    is_map,
    match_fetched,
    place_parts,
    settlements_called,
    stored_name,
)
from ...engine.workspace import Recipe, content_digest
from ...schemas.errors import (
    InvalidRequest,
    NotPossible,
    PlannerForgeError,
    Remedy,
    ResourceFailure,
    ServiceFailure,
    UnknownName,
)
from ...schemas.generation import (
    CutExtractRequest,
    CutOfExtract,
    FetchMapRequest,
    GenerationRequest,
    GenerationSpec,
    MapFacts,
    ScenarioSpec,
    ScenarioType,
)
from ...schemas.maps import Box, NamedPlace
from ...schemas.text import cited, cited_all, shown_name, uncited
from ..context import WorkflowContext
from ..extracts import extract_index
from ..maps import map_entry
from ..operations import COUNT_SITES, CUT_EXTRACT
from .online import fetch_maps, find_place

_SHOWN_PLACES = 4
"""How many places a note or refusal lists (chosen)."""
_MOST_TRIED = 4
"""How many proposed places are tried, each on its map (chosen: the number that the search by names proposes)."""
_MOST_SPARE_MAPS = 3
"""Four extracts meet at a corner. More would only delay the refusal."""


@dataclass(frozen=True)
class GenerationPlan:
    """The maps that match the request, in order of use, and notes for the answer."""

    matches: tuple[MapMatch, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class AssignedSite:
    """The site of a scenario: the map, and the number of the site on the map.

    If the site fails, the site ``site_step`` further on is tried. ``site_step`` is the number of the call's scenarios
    on this map, so no two scenarios share a site.
    """

    match: MapMatch
    site_index: int = 0
    site_step: int = 1


@dataclass(frozen=True)
class SiteAssignment:
    """A site for every scenario, and maps without one that may replace a map that fails."""

    planned: tuple[AssignedSite, ...]
    spare: tuple[MapMatch, ...]


def plan_maps(spec: GenerationSpec, maps: Sequence[MapEntry], closeness: Closeness = Closeness.PART) -> GenerationPlan:
    """Return the maps for a call, without those that lack the requested type if another map has it.

    The seed rotates the order of the maps, so that another seed gives another map if several fit.

    Raises:
        UnknownName: no map contains the place, country or box.
        NotPossible: maps contain it, but no map has a site of the requested type.
    """
    return plan_matches(
        spec,
        find_maps(
            maps,
            place=spec.place,
            country=spec.country,
            bbox=spec.bbox,
            scenario_type=spec.scenario_type,
            closeness=closeness,
        ),
    )


def plan_matches(spec: GenerationSpec, matches: Sequence[MapMatch]) -> GenerationPlan:
    """Return the plan for maps that are known to match the place.

    Raises:
        NotPossible: no map has the requested type.
    """
    holding = [m for m in matches if spec.scenario_type in ("any", *m.entry.facts.sites)]
    if not holding and len(matches) > 1:
        raise _no_such_site(spec.scenario_type, matches)
    holding = holding or list(matches)
    turn = spec.seed % len(holding)
    unnamed = sorted({word for match in holding for word in match.unnamed})
    notes = [f"the map does not contain the name {word!r}, but its street was found" for word in unnamed]
    notes += list(dict.fromkeys(text for match in holding for text in match.understood))[:_SHOWN_PLACES]
    if spec.bbox is not None:
        notes += _uncovered_box_notes(spec.bbox, holding)
    return GenerationPlan((*holding[turn:], *holding[:turn]), tuple(notes))


def _no_such_site(scenario_type: ScenarioType, matches: Sequence[MapMatch]) -> NotPossible:
    facts = [match.entry.facts for match in matches]
    names = [f"{cited(f.place)} ({f.map_id})" for f in facts[:_SHOWN_PLACES]]
    more = f" and {len(facts) - _SHOWN_PLACES} more" * (len(facts) > _SHOWN_PLACES)
    return NotPossible(
        f"no {scenario_type} site on any of the {len(facts)} matching maps: {', '.join(names)}{more}",
        valid=sorted({kind for f in facts for kind in f.sites}),
        next_step="choose one of these scenario types, which the maps have, or another place",
        reason="no_such_site",
    )


def _uncovered_box_notes(box: Box, matches: Sequence[MapMatch]) -> list[str]:
    """Return a note for a box that no map covers, such as a country's box: which parts were searched."""
    shown = [match.entry.facts for match in matches]
    south, west, north, east = box
    if any(f.south <= south and f.west <= west and north <= f.north and east <= f.east for f in shown):
        return []
    places = list(dict.fromkeys(facts.place for facts in shown))
    places_shown = cited_all(places[:_SHOWN_PLACES]) + (
        f" and {len(places) - _SHOWN_PLACES} more" * (len(places) > _SHOWN_PLACES)
    )
    return [f"no map covers the whole bbox; its parts on these maps were searched: {places_shown}"]


async def widen_empty(spec: GenerationSpec, context: WorkflowContext, plan: GenerationPlan) -> GenerationPlan:
    """Return the plan with the whole map if the streets are outside the circle of the given town.

    Only maps with a circle are examined. If the whole map lacks the streets too, the original request is refused.
    """
    matches: list[MapMatch] = []
    notes = list(plan.notes)
    for match in plan.matches:
        wide = match.widened
        if wide is None or await _has_site(spec, context, match) or not await _has_site(spec, context, wide):
            matches.append(match)
            continue
        matches.append(wide)
        notes = [text for text in notes if text not in match.understood or text in wide.understood]
        notes += [text for text in wide.understood if text not in notes]
    return GenerationPlan(tuple(matches), tuple(notes))


async def without_refused(
    spec: GenerationSpec, context: WorkflowContext, entries: Sequence[MapEntry], refusal: PlannerForgeError
) -> PlannerForgeError:
    """Return the refusal of a place, without the places that it proposes but that would be refused too.

    If all of them would be refused, it proposes the towns of local maps that have a site of this type.
    """
    places = [place for remedy in refusal.remedies if (place := _other_place(remedy)) is not None]
    if not places or spec.scenario_type == "any":
        return refusal
    refused = {place for place in places[:_MOST_TRIED] if not await _is_available(spec, context, entries, place)}
    refused.update(places[_MOST_TRIED:])
    refusal.remedies = tuple(remedy for remedy in refusal.remedies if _other_place(remedy) not in refused)
    kept = tuple(value for value in refusal.valid if uncited(value) not in refused)
    holding = sorted({one.facts.place for one in entries if spec.scenario_type in one.facts.sites})
    refusal.valid = kept or tuple(map(cited, holding))
    return refusal


def _other_place(remedy: Remedy) -> str | None:
    """Return the place that a remedy proposes, if it changes nothing else."""
    values = remedy.changes[0].values if len(remedy.changes) == 1 else None
    return str(values["place"]) if values is not None and values.keys() == {"place"} and values["place"] else None


async def _is_available(
    spec: GenerationSpec, context: WorkflowContext, entries: Sequence[MapEntry], place: str
) -> bool:
    """Return whether a local map contains a place and has the requested type of site in it."""
    other = spec.model_copy(update={"place": place})
    try:
        match = plan_maps(other, entries).matches[0]
    except (UnknownName, NotPossible):
        return False
    return await _has_site(other, context, match)


async def check_site(spec: GenerationSpec, context: WorkflowContext, entries: Sequence[MapEntry]) -> None:
    """Refuse a call if the local maps show that it has no site; a place that may be downloaded or cut out passes.

    Raises:
        UnknownName: no map contains the place, and it cannot be downloaded.
        NotPossible: the maps have no site of the requested type.
    """
    if spec.source == "online" or any(entry.facts.extract is not None for entry in entries):
        return
    try:
        matches = plan_maps(spec, entries).matches
    except UnknownName as refusal:
        if refusal.reason == NOT_SHOWN and context.services.online.mode != "offline" and spec.source != "local":
            return
        raise
    await context.run(COUNT_SITES, request_for(spec, AssignedSite(matches[0]), 0), share=(0.0, 0.0))


async def _has_site(spec: GenerationSpec, context: WorkflowContext, match: MapMatch) -> bool:
    try:
        await context.run(COUNT_SITES, request_for(spec, AssignedSite(match), 0), share=(0.0, 0.0))
    except NotPossible as refusal:
        return refusal.reason != "no_such_site"
    return True


async def assign_sites(spec: GenerationSpec, context: WorkflowContext, matches: tuple[MapMatch, ...]) -> SiteAssignment:
    """Return sites for the requested number of scenarios, or as many as there are.

    Raises:
        NotPossible: no map has a matching site; the error gives the reason for the first map.
    """
    if spec.count == 1:
        return SiteAssignment((AssignedSite(matches[0]),), matches[1 : 1 + _MOST_SPARE_MAPS])
    counts: list[int] = []
    refusals: list[NotPossible] = []
    for match in matches:
        try:
            request = request_for(spec, AssignedSite(match), 0)
            counts.append((await context.run(COUNT_SITES, request, share=(0.0, 0.0))).count)
        except NotPossible as refusal:
            refusals.append(refusal)
            counts.append(0)
    if not any(counts):
        raise refusals[0]
    planned = share_sites(matches, counts, spec.count)
    taken = {site.match.entry.facts.map_id for site in planned}
    with_sites = [match for match, count in zip(matches, counts, strict=True) if count]
    spare = [match for match in with_sites if match.entry.facts.map_id not in taken]
    return SiteAssignment(planned, tuple(spare[:_MOST_SPARE_MAPS]))


def request_for(spec: GenerationSpec, site: AssignedSite, index: int) -> GenerationRequest:
    """Return the engine's request for scenario number ``index`` of a call."""
    facts = site.match.entry.facts
    values = {name: getattr(spec, name) for name in ScenarioSpec.model_fields}
    values["bbox"] = _search_box(spec, site.match)
    return GenerationRequest(
        **values,
        map_path=str(site.match.entry.path),
        map_id=facts.map_id,
        place=facts.place,
        country=facts.country or spec.country_code,
        attribution=facts.attribution,
        streets=site.match.streets,
        longer_streets=site.match.longer,
        index=index,
        site_index=site.site_index,
        site_step=site.site_step,
        folder="",
    )


def _search_box(spec: GenerationSpec, match: MapMatch) -> Box | None:
    """Return the box to search: the requested box, the requested part of the map, or their intersection."""
    requested, part = spec.bbox, match.box
    if requested is None or part is None:
        return requested or part
    south, west, north, east = zip(requested, part, strict=True)
    return max(south), max(west), min(north), min(east)


def share_sites(matches: Sequence[MapMatch], counts: Sequence[int], wanted: int) -> tuple[AssignedSite, ...]:
    """Return at most ``wanted`` sites, one map after the other; ``counts`` are the matching sites per map."""
    turns = [(site_index, place) for place, count in enumerate(counts) for site_index in range(count)]
    chosen = sorted(turns)[:wanted]
    on_map = Counter(place for _, place in chosen)
    return tuple(AssignedSite(matches[place], site_index, on_map[place]) for site_index, place in chosen)


def nth_site(counts: Sequence[int], turn: int) -> tuple[int, int, int]:
    """Return the map and the site for a turn, with maps in rotation, and how often all sites were used before.

    ``counts`` holds each map's number of sites. All first sites come before all second sites, as in
    :func:`share_sites`.
    """
    lap, left = divmod(turn, sum(counts))
    done = 0
    while True:
        holding = [place for place, count in enumerate(counts) if count > done]
        more = min(counts[place] for place in holding) - done
        if left < more * len(holding):
            return holding[left % len(holding)], done + left // len(holding), lap
        left -= more * len(holding)
        done += more


async def maps_for(spec: GenerationSpec, context: WorkflowContext, entries: Sequence[MapEntry]) -> GenerationPlan:
    """Return the maps that a call uses.

    Raises:
        InvalidRequest: no local or downloadable map matches, or several places have the name.
        ServiceFailure: an online service is needed, but not available.
    """
    local = [entry for entry in entries if entry.facts.source is None or entry.facts.source.beside]
    online = context.services.online
    if spec.source != "online":
        if online.mode == "offline" or spec.source == "local":
            return plan_maps(spec, entries)
        try:
            return plan_maps(spec, local, Closeness.HEARD)
        except UnknownName as refusal:
            if refusal.reason != NOT_SHOWN or not _names_real_place(spec):
                raise
            return await _downloaded_or_local(spec, context, entries, refusal)
    if online.mode == "offline":
        raise NotPossible(
            "source=online needs a download, but maps_online is offline",
            next_step="leave source out, or set maps_online to online at the server's start",
        )
    if not _names_real_place(spec):
        raise InvalidRequest("source=online needs a place, a country or a bbox", next_step="give one")
    return await _fetched(spec, context, await _located(spec, context))


def _names_real_place(spec: GenerationSpec) -> bool:
    """Return whether a call refers to a real place; the id of a map or a file does not."""
    if spec.place is not None:
        return not spec.place.startswith("map_") and not is_map(Path(spec.place))
    return spec.bbox is not None or spec.country is not None


async def _downloaded_or_local(
    spec: GenerationSpec, context: WorkflowContext, entries: Sequence[MapEntry], refusal: UnknownName
) -> GenerationPlan:
    """Return the plan with a downloaded map or, if that is impossible, with local maps that contain the place.

    If the online services do not know the words or are not available, the words may refer to a part of a local map.
    ``refusal`` is the reason why no local map matches.
    """
    is_located = False
    try:
        place = await _located(spec, context)
        is_located = True
        return await _fetched(spec, context, place)
    except UnknownName as unknown:
        half_typed = _partial_matches(spec, entries)
        if half_typed is None:
            raise _with_local_names(unknown, refusal) from unknown
        return half_typed
    except (ServiceFailure, NotPossible) as failure:
        if isinstance(failure, NotPossible) and failure.reason != "not_asked":
            raise
        try:
            plan = plan_maps(spec, [entry for entry in entries if _has_exact_name(entry.facts, spec.place)])
        except InvalidRequest:
            half_typed = _partial_matches(spec, entries)
            if half_typed is None:
                raise _failure_with(failure, refusal, None if is_located else spec.place) from failure
            return half_typed
        note = f"{failure.message.rstrip('.')}; a map downloaded for another request is used"
        return GenerationPlan(plan.matches, (*plan.notes, note))


def _partial_matches(spec: GenerationSpec, entries: Sequence[MapEntry]) -> GenerationPlan | None:
    """Return a plan for the user's maps with names that contain the words, or None if there is no such map."""
    try:
        return plan_maps(spec, [entry for entry in entries if entry.facts.source is None])
    except (UnknownName, NotPossible):
        return None


def _has_exact_name(facts: MapFacts, place: str | None) -> bool:
    """Return whether a downloaded map has exactly the requested name; a similar name means another place."""
    if facts.source is None or place is None:
        return facts.source is not None
    names = {fold(name) for name in (facts.place, *facts.source.place.split(","), *facts.streets, *facts.refs)}
    return all(fold(part) in names for part in place_parts(place))


def _with_local_names(unknown: UnknownName, refusal: UnknownName) -> UnknownName:
    """Return the refusal of an unknown place, with similar local names."""
    source = unknown if unknown.valid else refusal
    return UnknownName(
        unknown.message,
        valid=source.valid,
        next_step=source.next_step,
        reason=unknown.reason,
        remedies=(*unknown.remedies, *refusal.remedies),
    )


def _failure_with(failure: PlannerForgeError, refusal: UnknownName, unlocated: str | None) -> PlannerForgeError:
    """Return a failure of the online services together with the local refusal.

    ``unlocated`` is the text that could not be looked up. The refusal counts if online requests are not allowed, and
    also if GeoNames does not know the place, because a later attempt would hardly find it.
    """
    if isinstance(failure, NotPossible):
        message = f"{refusal.message.rstrip('.')}; {failure.message}"
        return UnknownName(
            message, valid=refusal.valid, next_step=failure.next_step, reason=refusal.reason, remedies=refusal.remedies
        )
    if unlocated is not None and not any(settlements_called(part) for part in place_parts(unlocated)):
        message = (
            f"{refusal.message.rstrip('.')}. GeoNames lists no settlement called {unlocated!r} with 5,000 or more "
            f"inhabitants, and smaller ones could not be looked up, because {failure.message}"
        )
        return UnknownName(
            message, valid=refusal.valid, next_step=refusal.next_step, reason=refusal.reason, remedies=refusal.remedies
        )
    message = (
        f"{refusal.message.rstrip('.')}, and {failure.message.rstrip('.')}; "
        "until it can be reached, only local maps are available"
    )
    return ServiceFailure(
        message,
        valid=refusal.valid,
        next_step=f"{refusal.next_step}; if you need exactly this place, call again when the service is available",
        reason=failure.reason,
        remedies=refusal.remedies,
    )


async def _located(spec: GenerationSpec, context: WorkflowContext) -> NamedPlace | None:
    """Return the place of a request, looked up online; None if its box is enough."""
    code = spec.country_code
    words = spec.place or (country_name(code) if code is not None and spec.bbox is None else None)
    return None if words is None else await find_place(context, words, code)


async def _fetched(spec: GenerationSpec, context: WorkflowContext, place: NamedPlace | None) -> GenerationPlan:
    """Return a plan for the map that is downloaded for the request."""
    box = spec.bbox
    if box is not None and place is not None and not _overlap(place.box, box):
        raise UnknownName(
            f"{cited(place.label)} is not in the box {list(box)}", next_step="leave place or bbox out", reason=NOT_SHOWN
        )
    entries, notes = await fetch_maps(
        context,
        FetchMapRequest(
            services=context.services.online,
            folder="",
            place=place,
            bbox=box,
            country=spec.country_code,
            scenario_type=spec.scenario_type,
            road_classes=spec.road_classes,
            count=spec.count,
        ),
    )
    requested = spec.place if box is None else None
    matches = [match_fetched(entry, place, requested) for entry in entries]
    plan = plan_matches(spec.model_copy(update={"bbox": None}), matches)
    return GenerationPlan(plan.matches, (*plan.notes, *notes))


@dataclass(frozen=True)
class MapChoice:
    """The maps to search, the remaining words of the request, and notes for the answer.

    ``failures`` are those of extracts that might match too, but could not be read.
    """

    spec: GenerationSpec
    entries: tuple[MapEntry, ...]
    note: str = ""
    failures: tuple[ResourceFailure, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """What was cut out, and what was left out."""
        left_out = [f"an extract was left out: {failure.message}; {failure.next_step}" for failure in self.failures]
        return (*([self.note] if self.note else []), *left_out)

    def with_failures(self, refusal: PlannerForgeError) -> PlannerForgeError:
        """Return a refusal that mentions an unreadable extract, because it might contain the place."""
        if not self.failures:
            return refusal
        first = self.failures[0]
        return ResourceFailure(f"{refusal.message.rstrip('.')}; {first.message}", next_step=first.next_step)


async def with_cuts(spec: GenerationSpec, context: WorkflowContext, entries: Sequence[MapEntry]) -> MapChoice:
    """Return the maps for a request, or the matching part of an extract if no map matches.

    Extracts are searched only for a place, a country or a box. One without a readable index is left out with a note, or
    refused if the request names it.

    Raises:
        ResourceFailure: the index of the requested extract cannot be read.
    """
    whole = [entry for entry in entries if entry.facts.extract is None]
    if spec.source == "online":
        return MapChoice(spec, tuple(whole))
    extracts = [entry for entry in entries if entry.facts.extract is not None]
    earlier = _named_cut(spec, context)
    if earlier is not None:
        return MapChoice(spec, (earlier,))
    requested = [entry for entry in extracts if _is_named(entry.facts, spec.place)]
    failures: list[ResourceFailure] = []
    for entry in requested or _fitting(spec, whole, extracts):
        with context.workspace.scratch() as folder:
            request = CutExtractRequest(
                index=str(extract_index(context, entry.facts.map_id)),
                folder=str(folder),
                facts=entry.facts,
                place=spec.place,
                bbox=spec.bbox,
                scenario_type=spec.scenario_type,
                seed=spec.seed,
            )
            try:
                cut = await context.run(CUT_EXTRACT, request, share=(0.0, 0.2))
            except ResourceFailure as failure:
                if requested:
                    raise
                failures.append(failure)
                continue
            if cut.facts is not None:
                return _chosen(spec, _stored(context, cut, cut.facts), cut, entry.facts, failures)
    return MapChoice(spec, tuple(whole), failures=tuple(failures))


def _named_cut(spec: GenerationSpec, context: WorkflowContext) -> MapEntry | None:
    """Return the part of an extract that was requested by its id."""
    artifact = context.workspace.find("map", spec.place) if spec.place is not None else None
    return None if artifact is None or not artifact.read(MapFacts).cut_of else map_entry(context, artifact)


def _is_named(facts: MapFacts, place: str | None) -> bool:
    """Return whether a part of the words is an extract's id, its place or its file's name."""
    names = (facts.map_id, facts.place, facts.file_name, file_stem(facts.file_name))
    own = {fold(name) for name in names}
    return any(fold(part) in own for part in place_parts(place or ""))


def _fitting(spec: GenerationSpec, whole: Sequence[MapEntry], extracts: Sequence[MapEntry]) -> list[MapEntry]:
    """Return the extracts that may match if no other map does: the extracts of the country and the box."""
    if not extracts or (spec.place, spec.country, spec.bbox) == (None, None, None):
        return []
    try:
        usable = [one for one in whole if one.facts.source is None or one.facts.source.beside]
        plan_maps(spec, usable, Closeness.HEARD)
    except (UnknownName, NotPossible) as refusal:
        if refusal.reason != NOT_SHOWN:
            return []
    except InvalidRequest:
        return []  # the plan itself reports it
    else:
        return []
    country, box = spec.country_code, spec.bbox
    return [
        entry
        for entry in extracts
        if country in (None, entry.facts.country, *entry.facts.countries_near)
        and (box is None or _overlap(box, _box(entry.facts)))
    ]


def _box(facts: MapFacts) -> Box:
    return facts.south, facts.west, facts.north, facts.east


def _overlap(one: Box, other: Box) -> bool:
    return one[0] <= other[2] and other[0] <= one[2] and one[1] <= other[3] and other[1] <= one[3]


def _stored(context: WorkflowContext, cut: CutOfExtract, facts: MapFacts) -> MapEntry:
    """Store the cut part of an extract as a map; its id is derived from its content, so a repeated cut keeps it."""
    path = Path(cut.path)
    arguments = {"content": content_digest(path), "extract": facts.cut_of, "place": facts.place}
    recipe = Recipe(tool="cut_extract", arguments=arguments | {"country": facts.country})
    map_id = f"map_{recipe.digest}"
    record = facts.model_copy(update={"map_id": map_id})
    name = stored_name(path)
    return map_entry(
        context,
        context.workspace.put("map", map_id, recipe=recipe, record=record, files={name: path}, name=facts.place),
    )


def _chosen(
    spec: GenerationSpec, entry: MapEntry, cut: CutOfExtract, extract: MapFacts, failures: Sequence[ResourceFailure]
) -> MapChoice:
    """Return only this part, with the words that refer to its roads and the box with complete roads."""
    requested = spec.bbox
    core = cut.core
    if requested is not None:
        core = (
            max(requested[0], core[0]),
            max(requested[1], core[1]),
            min(requested[2], core[2]),
            min(requested[3], core[3]),
        )
    narrowed = spec.model_copy(update={"place": cut.words or None, "bbox": core})
    if entry.facts.country is not None:
        narrowed = narrowed.model_copy(update={"country": None, "country_code": None})
    note = f"{cited(cut.label)} was cut out of {shown_name(extract.file_name)} ({extract.map_id})"
    return MapChoice(narrowed, (entry,), note, tuple(failures))
