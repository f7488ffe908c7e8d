"""Parts of extracts of countries as maps: cut out for the request that means them, and used by no other."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...engine.maps import NOT_SHOWN, Closeness, MapEntry, country_code, file_stem, fold, place_parts, stored_name
from ...engine.workspace import Recipe, content_digest
from ...schemas.errors import InvalidRequest, NotPossible, PlannerForgeError, ResourceFailure, UnknownName
from ...schemas.generation import CutExtractRequest, CutOfExtract, GenerateScenariosArguments, MapFacts
from ...schemas.maps import Box
from ...schemas.text import cited, shown_name
from ..context import WorkflowContext
from ..extracts import extract_index
from ..maps import map_entry
from ..operations import CUT_EXTRACT
from .requests import box_of, plan_maps


@dataclass(frozen=True)
class MapChoice:
    """The maps that a request is looked up on, in the words that are left of it, and notes for the answer.

    ``failures``: of extracts that might show it too, but could not be read.
    """

    arguments: GenerateScenariosArguments
    entries: tuple[MapEntry, ...]
    note: str = ""
    failures: tuple[ResourceFailure, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """What was cut out, and what was left out."""
        left_out = [f"an extract was left out: {failure.message}; {failure.next_step}" for failure in self.failures]
        return (*([self.note] if self.note else []), *left_out)

    def with_failures(self, refusal: PlannerForgeError) -> PlannerForgeError:
        """Why nothing was found: where an extract could not be read, that it might have been there."""
        if not self.failures:
            return refusal
        first = self.failures[0]
        return ResourceFailure(f"{refusal.message.rstrip('.')}; {first.message}", next_step=first.next_step)


async def with_cuts(
    arguments: GenerateScenariosArguments, context: WorkflowContext, entries: Sequence[MapEntry]
) -> MapChoice:
    """The maps for a request; where no map shows what it means but an extract does, the part that is cut out of it.

    Without a place, a country or a box, extracts are not looked at. One whose index is gone or damaged is left out, and
    the notes say so; one that the request names is refused then.

    Raises:
        ResourceFailure: the index of the extract that is named cannot be read.
    """
    whole = [entry for entry in entries if entry.facts.extract is None]
    if arguments.source == "online":
        return MapChoice(arguments, tuple(whole))
    extracts = [entry for entry in entries if entry.facts.extract is not None]
    earlier = _named_cut(arguments, context)
    if earlier is not None:
        return MapChoice(arguments, (earlier,))
    named = [entry for entry in extracts if _is_named(entry.facts, arguments.place)]
    failures: list[ResourceFailure] = []
    for entry in named or _fitting(arguments, whole, extracts):
        with context.workspace.scratch() as folder:
            request = CutExtractRequest(
                index=str(extract_index(context, entry.facts.map_id)),
                folder=str(folder),
                facts=entry.facts,
                place=arguments.place,
                bbox=box_of(arguments.bbox),
                scenario_type=arguments.scenario_type,
                seed=arguments.seed,
            )
            try:
                cut = await context.run(CUT_EXTRACT, request, share=(0.0, 0.2))
            except ResourceFailure as failure:
                if named:
                    raise
                failures.append(failure)
                continue
            if cut.facts is not None:
                return _chosen(arguments, _stored(context, cut, cut.facts), cut, entry.facts, failures)
    return MapChoice(arguments, tuple(whole), failures=tuple(failures))


def _named_cut(arguments: GenerateScenariosArguments, context: WorkflowContext) -> MapEntry | None:
    """The part of an extract whose id is the place that was asked for."""
    artifact = context.workspace.find("map", arguments.place) if arguments.place is not None else None
    return None if artifact is None or not artifact.read(MapFacts).cut_of else map_entry(context, artifact)


def _is_named(facts: MapFacts, place: str | None) -> bool:
    """Whether a part of the words is an extract's id, its place or its file's name."""
    names = (facts.map_id, facts.place, facts.file_name, file_stem(facts.file_name))
    own = {fold(name) for name in names}
    return any(fold(part) in own for part in place_parts(place or ""))


def _fitting(
    arguments: GenerateScenariosArguments, whole: Sequence[MapEntry], extracts: Sequence[MapEntry]
) -> list[MapEntry]:
    """The extracts that may show what no other map does: those of the country and the box."""
    if not extracts or (arguments.place, arguments.country, arguments.bbox) == (None, None, None):
        return []
    try:
        usable = [one for one in whole if one.facts.source is None or one.facts.source.beside]
        plan_maps(arguments, usable, Closeness.HEARD)
    except (UnknownName, NotPossible) as refusal:
        if refusal.reason != NOT_SHOWN:
            return []
    except InvalidRequest:
        return []  # it is told by the plan itself
    else:
        return []
    country = None if arguments.country is None else country_code(arguments.country) or arguments.country.upper()
    box = box_of(arguments.bbox)
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
    """The part as a map, told by its content: cut out again, it is the same."""
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
    arguments: GenerateScenariosArguments,
    entry: MapEntry,
    cut: CutOfExtract,
    extract: MapFacts,
    failures: Sequence[ResourceFailure],
) -> MapChoice:
    """The part alone, with the words that name roads on it and the box in which its roads are whole."""
    asked = box_of(arguments.bbox)
    core = cut.core
    if asked is not None:
        core = max(asked[0], core[0]), max(asked[1], core[1]), min(asked[2], core[2]), min(asked[3], core[3])
    country = None if entry.facts.country is not None else arguments.country
    narrowed = arguments.model_copy(update={"place": cut.words or None, "bbox": list(core), "country": country})
    note = f"{cited(cut.label)} was cut out of {shown_name(extract.file_name)} ({extract.map_id})"
    return MapChoice(narrowed, (entry,), note, tuple(failures))
