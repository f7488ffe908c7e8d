"""Maps from online services: find the place, download its roads and store them."""

from collections.abc import Sequence
from pathlib import Path

from ...engine.maps import MapEntry, stored_name
from ...engine.workspace import Recipe, content_digest
from ...schemas.errors import InvalidRequest
from ...schemas.generation import FetchedMap, FetchMapRequest, MapFacts, MapSource, ScenarioType
from ...schemas.maps import LocateRequest, NamedPlace
from ...schemas.text import cited
from ..context import Question, WorkflowContext
from ..operations import FETCH_MAPS, LOCATE_PLACE

AMBIGUOUS = "ambiguous"
"""The reason of a refusal because several places have the name."""
_LOCATED, _FETCHED = 0.1, 0.3
"""The shares of a call that are done when the place is known, and when the map has been downloaded (chosen)."""


async def find_place(context: WorkflowContext, words: str, country: str | None) -> NamedPlace:
    """Return the place for the words; if there are several, the user chooses one.

    Raises:
        UnknownName: there is no such place.
        InvalidRequest: there are several, and the user did not choose.
        ServiceFailure: the service is not available.
    """
    request = LocateRequest(services=context.services.online, place=words, country=country)
    located = await context.run(LOCATE_PLACE, request, share=(0.0, _LOCATED))
    if located.place is not None:
        return located.place
    labels = tuple(candidate.label for candidate in located.candidates)
    chosen = await context.ask(Question(f"Which {words} do you mean?", labels))
    for candidate in located.candidates:
        if candidate.label == chosen:
            return candidate
    raise _ambiguous(words, located.candidates)


def _ambiguous(place: str, candidates: Sequence[NamedPlace]) -> InvalidRequest:
    """Return the refusal of a name that several places have; the error says how to choose one."""
    return InvalidRequest(
        f"several places have the name {place!r}",
        valid=[cited(candidate.label) for candidate in candidates],
        next_step=f"use one of them, such as place={cited(candidates[0].label)}, or give its bbox",
        reason=AMBIGUOUS,
    )


async def fetch_maps(
    context: WorkflowContext, request: FetchMapRequest, *, by_user: bool = False
) -> tuple[list[MapEntry], list[str]]:
    """Return downloaded or stored maps, and notes on their origin.

    Raises:
        PlannerForgeError: they are not available; nothing is stored then.
    """
    with context.workspace.scratch() as folder:
        request = request.model_copy(update={"folder": str(folder)})
        fetched = await context.run(FETCH_MAPS, request, share=(_LOCATED, _FETCHED))
        entries = [_store(context, one, request, by_user=by_user) for one in fetched.maps]
    origins = [_origin(one, request) for one in fetched.maps]
    return entries, [*dict.fromkeys(origins), *fetched.notes]


def _store(context: WorkflowContext, fetched: FetchedMap, request: FetchMapRequest, *, by_user: bool) -> MapEntry:
    path, place = Path(fetched.path), request.place
    source = MapSource(
        place=_named(request),
        osm_id="" if place is None else place.osm_id,
        core=fetched.core,
        query=fetched.query,
        service=fetched.service,
        data_time=fetched.data_time,
        beside=by_user,
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
    """Return the origin of a map in one sentence."""
    how = "downloaded earlier" if fetched.kept else "downloaded"
    of_when = f", data of {fetched.data_time}" if fetched.data_time else ""
    return f"roads of {_named(request)}, {how} from {fetched.service}{of_when}"


async def fetch_to_keep(
    context: WorkflowContext, words: str, country: str | None, scenario_type: ScenarioType
) -> tuple[MapFacts, list[str]]:
    """Download a place's map so that it counts like an imported map.

    Raises:
        PlannerForgeError: it is not available.
    """
    place = await find_place(context, words, country)
    request = FetchMapRequest(
        services=context.services.online, folder="", place=place, country=country, scenario_type=scenario_type
    )
    entries, notes = await fetch_maps(context, request, by_user=True)
    return entries[0].facts, notes
