"""Which maps a call uses: those at hand that show the place, otherwise one that is fetched for it.

A map that was fetched for a request is kept, but used by the same request alone: so it gives the same bytes whatever
else was fetched since. One that a person fetched to have it beside them counts like any other.
"""

from collections.abc import Sequence
from pathlib import Path

from ...engine.maps import (
    NOT_SHOWN,
    Closeness,
    MapEntry,
    country_code,
    country_name,
    fold,
    is_map,
    match_fetched,
    place_parts,
    resolve_road_classes,
    settlements_called,
    stored_name,
)
from ...engine.workspace import Recipe, content_digest
from ...schemas.errors import InvalidRequest, NotPossible, PlannerForgeError, ServiceFailure, UnknownName
from ...schemas.generation import (
    FetchedMap,
    FetchMapRequest,
    GenerateScenariosArguments,
    MapFacts,
    MapSource,
    ScenarioType,
)
from ...schemas.maps import Box, LocateRequest, NamedPlace
from ...schemas.text import cited
from ..context import Question, WorkflowContext
from ..operations import FETCH_MAPS, LOCATE_PLACE
from .requests import GenerationPlan, box_of, check_demands, plan_maps, plan_matches

AMBIGUOUS = "ambiguous"
"""Reason of a refusal because several places have the name."""
_LOCATED, _FETCHED = 0.1, 0.3
"""Shares of a call that are done when the place is known, and the map there (chosen)."""


async def maps_for(
    arguments: GenerateScenariosArguments, context: WorkflowContext, entries: Sequence[MapEntry]
) -> GenerationPlan:
    """The maps that a call uses.

    Raises:
        InvalidRequest: no map shows what was asked for, here or on the net; or several places have the name.
        ServiceFailure: the net would have to be asked, and cannot be.
    """
    beside = [entry for entry in entries if entry.facts.source is None or entry.facts.source.beside]
    online = context.services.online
    if arguments.source != "online":
        if online.mode == "offline" or arguments.source == "local":
            return plan_maps(arguments, entries)
        try:
            return plan_maps(arguments, beside, Closeness.HEARD)
        except UnknownName as refusal:
            if refusal.reason != NOT_SHOWN or not _names_somewhere(arguments):
                raise
            return await _fetched_or_at_hand(arguments, context, entries, refusal)
    if online.mode == "offline":
        raise NotPossible(
            "source=online asks for a map from the net, and maps_online is offline",
            next_step="leave source out, or have maps_online set to online at the server's start",
        )
    if not _names_somewhere(arguments):
        raise InvalidRequest("source=online needs a place, a country or a bbox", next_step="name one")
    return await _fetched(arguments, context, await _located(arguments, context))


def _names_somewhere(arguments: GenerateScenariosArguments) -> bool:
    """Whether a call names a place on earth: the id of a map or a file is none."""
    if arguments.place is not None:
        return not arguments.place.startswith("map_") and not is_map(Path(arguments.place))
    return arguments.bbox is not None or arguments.country is not None


async def _fetched_or_at_hand(
    arguments: GenerateScenariosArguments, context: WorkflowContext, entries: Sequence[MapEntry], refusal: UnknownName
) -> GenerationPlan:
    """A fetched map; where the net cannot be asked, one that was fetched for another request and shows the place.

    Where the net does not know the words, or cannot be asked, they may be a part of what a map at hand shows.
    ``refusal``: why no map at hand is used.
    """
    is_located = False
    try:
        place = await _located(arguments, context)
        is_located = True
        return await _fetched(arguments, context, place)
    except UnknownName as unknown:
        half_typed = _half_typed(arguments, entries)
        if half_typed is None:
            raise _with_names_at_hand(unknown, refusal) from unknown
        return half_typed
    except (ServiceFailure, NotPossible) as failure:
        if isinstance(failure, NotPossible) and failure.reason != "not_asked":
            raise
        try:
            plan = plan_maps(arguments, [entry for entry in entries if _is_called_so(entry.facts, arguments.place)])
        except InvalidRequest:
            half_typed = _half_typed(arguments, entries)
            if half_typed is None:
                raise _told_with(failure, refusal, None if is_located else arguments.place) from failure
            return half_typed
        note = f"{failure.message.rstrip('.')}; a map that was fetched for another request is used"
        return GenerationPlan(plan.matches, (*plan.notes, note))


def _half_typed(arguments: GenerateScenariosArguments, entries: Sequence[MapEntry]) -> GenerationPlan | None:
    """A plan for the maps that the user added and that the words are a part of; None if there are none."""
    try:
        return plan_maps(arguments, [entry for entry in entries if entry.facts.source is None])
    except (UnknownName, NotPossible):
        return None


def _is_called_so(facts: MapFacts, place: str | None) -> bool:
    """Whether a fetched map shows what was asked for by its very names: one that is only called like it is another."""
    if facts.source is None or place is None:
        return facts.source is not None
    names = {fold(name) for name in (facts.place, *facts.source.place.split(","), *facts.streets, *facts.refs)}
    return all(fold(part) in names for part in place_parts(place))


def _with_names_at_hand(unknown: UnknownName, refusal: UnknownName) -> UnknownName:
    """What the net does not know either: with the names at hand that are like it."""
    valid, next_step = (unknown.valid, unknown.next_step) if unknown.valid else (refusal.valid, refusal.next_step)
    return UnknownName(unknown.message, valid=valid, next_step=next_step, reason=unknown.reason)


def _told_with(failure: PlannerForgeError, refusal: UnknownName, unlocated: str | None) -> PlannerForgeError:
    """The failure of the net behind what is at hand; ``unlocated``: the words that could not be looked up.

    Where the net must not be asked, the refusal is what counts; likewise where GeoNames does not know the place that
    could not be looked up, because asking again later would hardly find it.
    """
    if isinstance(failure, NotPossible):
        message = f"{refusal.message.rstrip('.')}; {failure.message}"
        return UnknownName(message, valid=refusal.valid, next_step=failure.next_step, reason=refusal.reason)
    if unlocated is not None and not any(settlements_called(part) for part in place_parts(unlocated)):
        message = (
            f"{refusal.message.rstrip('.')}, GeoNames knows no settlement of 5,000 inhabitants of that name, "
            f"and a smaller one could not be looked up: {failure.message}"
        )
        return UnknownName(message, valid=refusal.valid, next_step=refusal.next_step, reason=refusal.reason)
    message = f"{refusal.message.rstrip('.')}, and {failure.message}"
    return ServiceFailure(message, valid=refusal.valid, reason=failure.reason)


async def _located(arguments: GenerateScenariosArguments, context: WorkflowContext) -> NamedPlace | None:
    """The place that a request means, looked up on the net; None where its box says all."""
    check_demands(arguments)
    country = _code_of(arguments)
    words = arguments.place or (country_name(country) if country is not None and arguments.bbox is None else None)
    return None if words is None else await find_place(context, words, country)


def _code_of(arguments: GenerateScenariosArguments) -> str | None:
    return None if arguments.country is None else country_code(arguments.country) or arguments.country.upper()


async def _fetched(
    arguments: GenerateScenariosArguments, context: WorkflowContext, place: NamedPlace | None
) -> GenerationPlan:
    """A plan for the map that is fetched for the request."""
    box, country = box_of(arguments.bbox), _code_of(arguments)
    if box is not None and place is not None and not _overlap(place, box):
        raise UnknownName(
            f"{cited(place.label)} does not lie in the box {list(box)}",
            next_step="leave place or bbox out",
            reason=NOT_SHOWN,
        )
    entries, notes = await _fetch(
        context,
        FetchMapRequest(
            services=context.services.online,
            folder="",
            place=place,
            bbox=box,
            country=country,
            scenario_type=arguments.scenario_type,
            road_classes=() if arguments.road_classes is None else resolve_road_classes(arguments.road_classes),
            count=arguments.count,
        ),
    )
    asked = arguments.place if box is None else None
    matches = [match_fetched(entry, place, asked) for entry in entries]
    plan = plan_matches(arguments.model_copy(update={"bbox": None}), matches)
    return GenerationPlan(plan.matches, (*plan.notes, *notes))


def _overlap(place: NamedPlace, box: Box) -> bool:
    south, west, north, east = place.box
    return south <= box[2] and north >= box[0] and west <= box[3] and east >= box[1]


async def find_place(context: WorkflowContext, words: str, country: str | None) -> NamedPlace:
    """The place that is meant; of several, the one that the person at the client chooses.

    Raises:
        UnknownName: there is no such place.
        InvalidRequest: there are several, and nobody chose.
        ServiceFailure: the service cannot be asked.
    """
    request = LocateRequest(services=context.services.online, place=words, country=country)
    located = await context.run(LOCATE_PLACE, request, share=(0.0, _LOCATED))
    if located.place is not None:
        return located.place
    labels = tuple(candidate.label for candidate in located.candidates)
    chosen = await context.ask(Question(f"Which {words} is meant?", labels))
    for candidate in located.candidates:
        if candidate.label == chosen:
            return candidate
    raise _ambiguous(words, located.candidates)


def _ambiguous(place: str, candidates: Sequence[NamedPlace]) -> InvalidRequest:
    """The refusal where several places have a name, with how to choose one."""
    return InvalidRequest(
        f"several places are called {place!r}",
        valid=[cited(candidate.label) for candidate in candidates],
        next_step=f"name one of them, such as place={cited(candidates[0].label)}, or give its bbox",
        reason=AMBIGUOUS,
    )


async def _fetch(
    context: WorkflowContext, request: FetchMapRequest, *, beside: bool = False
) -> tuple[list[MapEntry], list[str]]:
    """Fetch maps and store them, or find them stored; and notes on where they come from.

    Raises:
        PlannerForgeError: they cannot be had; nothing is stored then.
    """
    with context.workspace.scratch() as folder:
        request = request.model_copy(update={"folder": str(folder)})
        fetched = await context.run(FETCH_MAPS, request, share=(_LOCATED, _FETCHED))
        entries = [_store(context, one, request, beside=beside) for one in fetched.maps]
    origins = [_origin(one, request) for one in fetched.maps]
    return entries, [*dict.fromkeys(origins), *fetched.notes]


def _store(context: WorkflowContext, fetched: FetchedMap, request: FetchMapRequest, *, beside: bool) -> MapEntry:
    path, place = Path(fetched.path), request.place
    source = MapSource(
        place=_named(request),
        osm_id="" if place is None else place.osm_id,
        core=fetched.core,
        query=fetched.query,
        service=fetched.service,
        data_time=fetched.data_time,
        beside=beside,
    )
    arguments = {"content": content_digest(path), **source.model_dump(mode="json")}
    recipe = Recipe(tool="fetch_map", arguments=arguments)
    map_id = f"map_{recipe.digest}"
    facts = fetched.facts.model_copy(update={"map_id": map_id, "source": source})
    artifact = context.workspace.put(
        "map", map_id, recipe=recipe, record=facts, files={stored_name(path): path}, name=facts.place
    )
    stored = artifact.read(MapFacts)
    return MapEntry(stored, context.workspace.file("map", map_id, stored_name(Path(stored.file_name))))


def _named(request: FetchMapRequest) -> str:
    return f"the box {list(request.bbox or ())}" if request.place is None else cited(request.place.label)


def _origin(fetched: FetchedMap, request: FetchMapRequest) -> str:
    """Where a map comes from, in a sentence."""
    how = "downloaded before" if fetched.kept else "downloaded"
    of_when = f", data of {fetched.data_time}" if fetched.data_time else ""
    return f"roads of {_named(request)} {how} from {fetched.service}{of_when}"


async def fetch_beside(
    context: WorkflowContext, words: str, country: str | None, scenario_type: ScenarioType
) -> tuple[MapFacts, list[str]]:
    """Fetch a place's map to have it beside one: it then counts like a map that was imported.

    Raises:
        PlannerForgeError: it cannot be had.
    """
    place = await find_place(context, words, country)
    request = FetchMapRequest(
        services=context.services.online, folder="", place=place, country=country, scenario_type=scenario_type
    )
    entries, notes = await _fetch(context, request, beside=True)
    return entries[0].facts, notes
