"""Parse what a coverage plan varies, and find the levels of existing scenarios.

A level is a value of an argument of the call, or a turn, which is a goal. Factors for the location of a scenario
(place, country, type of site) define groups of sites.
"""

import json
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import Any, get_args

from pydantic import ValidationError

from ...engine.generation import Levels, made_before
from ...engine.maps import MapEntry, MapMatch
from ...engine.vehicles import PEDESTRIAN, vehicle_classes
from ...engine.workspace import Recipe, versions_of
from ...schemas.base import problems_of
from ...schemas.errors import InvalidRequest, UnknownName, closest, instead
from ...schemas.generation import (
    THROUGH,
    TURNS_AT,
    USUAL_GOAL,
    Combination,
    Density,
    GenerateScenariosArguments,
    GenerationSpec,
    PlanFactor,
    RequestedGoal,
    SiteType,
    Turn,
)
from ...schemas.text import counted, quoted
from ..context import WorkflowContext
from .making import shape_of
from .map_choice import AssignedSite, maps_for, request_for
from .specification import read_specification

MOST_FACTORS, MOST_LEVELS, MOST_COMBINATIONS = 10, 60, 20_000
"""The maximum numbers of factors, levels and combinations of a plan (chosen so that selecting rows takes seconds)."""
_USUAL: Mapping[str, tuple[str, ...]] = {
    "scenario_type": get_args(SiteType),
    "density": get_args(Density),
    "turn": get_args(Turn),
    "vehicles": ("cars", "truck", "bus", "motorcycle", "bicycle"),
}
"""The levels of a factor given without values."""
_FREE = ("place", "country", "duration_s", "ego")
"""Further arguments that a plan can vary, with values from the call."""


def read_cover(texts: Sequence[str]) -> tuple[tuple[PlanFactor, ...], int]:
    """Return the factors of a plan, and the number of factors in a combination.

    Raises:
        InvalidRequest: a line is unreadable, a level is unknown, or the plan is too large.
        UnknownName: there is no such factor.
    """
    factors: list[PlanFactor] = []
    strength: int | None = None
    for text in texts:
        name, mark, values = (part.strip() for part in text.partition("="))
        if name == "strength":
            strength = _strength(text, values)
        else:
            factors.append(_factor(name, values if mark else None, [factor.name for factor in factors]))
    if not factors:
        raise InvalidRequest("cover does not vary anything", valid=[*_USUAL, *_FREE], next_step=_HOW)
    strength = min(2, len(factors)) if strength is None else strength
    if not 1 <= strength <= len(factors) or len(factors) > MOST_FACTORS:
        raise InvalidRequest(
            f"cover has {counted(len(factors), 'factor')} and the strength {strength}",
            valid=[f"strength=1 to strength={min(len(factors), MOST_FACTORS)}", f"at most {MOST_FACTORS} factors"],
        )
    count = _combinations(factors, strength)
    if count > MOST_COMBINATIONS:
        raise InvalidRequest(
            f"cover requests {count:,} combinations",
            valid=[f"at most {MOST_COMBINATIONS:,}"],
            next_step="lower the strength, or give fewer levels",
        )
    return tuple(factors), strength


_HOW = "write cover such as ['scenario_type=intersection|roundabout', 'density=low|high', 'turn=left|right']"


def _strength(text: str, value: str) -> int:
    if not re.fullmatch(r"\d", value):
        raise InvalidRequest(f"{quoted(text)} is not a strength", valid=["strength=1", "strength=2", "strength=3"])
    return int(value)


def _combinations(factors: Sequence[PlanFactor], strength: int) -> int:
    """Return the number of combinations: the elementary symmetric polynomial of the numbers of levels."""
    sums = [1, *[0] * strength]
    for factor in factors:
        for size in range(strength, 0, -1):
            sums[size] += sums[size - 1] * len(factor.levels)
    return sums[strength]


def _factor(name: str, values: str | None, known: Sequence[str]) -> PlanFactor:
    if name not in _USUAL and name not in _FREE:
        near = closest(name, [*_USUAL, *_FREE])
        raise UnknownName(
            f"cover cannot vary {quoted(name)}", valid=near or [*_USUAL, *_FREE, "strength"], next_step=_HOW
        )
    if name in known and name != "vehicles":
        raise InvalidRequest(f"cover contains {name} twice", next_step="give its levels together: density=low|high")
    levels = (
        _USUAL.get(name, ()) if values is None else tuple(dict.fromkeys(part.strip() for part in values.split("|")))
    )
    if not levels or not all(levels) or len(levels) > MOST_LEVELS:
        raise InvalidRequest(
            f"{name} in cover has {len(levels)} levels, or an empty one", valid=[f"1 to {MOST_LEVELS}"], next_step=_HOW
        )
    if name in ("scenario_type", "density", "turn") and (wrong := [one for one in levels if one not in _USUAL[name]]):
        raise InvalidRequest(f"there is no {name} {', '.join(map(quoted, wrong))}", valid=_USUAL[name]).also(
            instead(str(values), "|".join(one for one in levels if one not in wrong) or "|".join(_USUAL[name]))
        )
    times = sum(one.partition(" ")[0] == name for one in known)
    return PlanFactor(name=f"{name} {times + 1}" if times else name, levels=levels)


@dataclass(frozen=True)
class RequestedPlan:
    """A requested plan; ``arguments`` are those that all of its scenarios share.

    ``shown`` maps levels of place and country to their maps. ``notes`` state how the maps were found.
    """

    arguments: GenerateScenariosArguments
    factors: tuple[PlanFactor, ...]
    strength: int
    shown: dict[tuple[tuple[int, int], ...], tuple[MapMatch, ...]] = field(default_factory=dict)
    notes: dict[str, None] = field(default_factory=dict)

    @classmethod
    async def of(
        cls,
        arguments: GenerateScenariosArguments,
        spec: GenerationSpec,
        context: WorkflowContext,
        entries: Sequence[MapEntry],
    ) -> "RequestedPlan":
        """Parse the factors, find or download the maps, and check each level once.

        Args:
            arguments: the call in words, because levels are values of its arguments.
            spec: the parsed call, with the remaining words if a part of a map was cut out for it.
            context: the resources of the workflow.
            entries: the local maps.

        Raises:
            InvalidRequest: arguments contradict each other, or a level is invalid.
            UnknownName: no map contains a place.
            ServiceFailure: a map needs a download, which is not possible.
        """
        factors, strength = read_cover(arguments.cover)
        names = {factor.name.partition(" ")[0] for factor in factors}
        if arguments.criticality != "usual":
            raise InvalidRequest(
                "criticality is for single scenarios", next_step="leave it out, or call find_failures for a scenario"
            )
        if arguments.trial_run:
            raise InvalidRequest(
                "trial_run is for single scenarios", next_step="leave it out, and call run_planner with the plan's id"
            )
        if spec.goal.lanelet is not None:
            raise InvalidRequest(
                "a goal on a lanelet refers to one site, but a plan has many", valid=[THROUGH, "steps:50"]
            )
        if "turn" in names and spec.goal not in (RequestedGoal.of(THROUGH), RequestedGoal.of(USUAL_GOAL)):
            raise InvalidRequest(f"cover varies the turn, but goal {quoted(spec.goal)} has no turn", valid=[THROUGH])
        bbox = None if spec.bbox is None else list(spec.bbox)
        left = {"place": spec.place, "country": spec.country, "bbox": bbox}
        plan = cls(arguments.model_copy(update=left), factors, strength)
        for group in plan.groups("place", "country"):
            found = await maps_for(plan.row_spec(group), context, entries)
            plan.shown[tuple(group.items())] = found.matches
            plan.notes.update(dict.fromkeys(found.notes))
        for factor, levels in enumerate(one.levels for one in factors):
            for level in range(len(levels)):
                plan.check({factor: level})
        return plan

    def check(self, levels: Mapping[int, int]) -> None:
        """Refuse invalid levels before anything is generated.

        Raises:
            InvalidRequest: a level is invalid.
            UnknownName: there is no such vehicle class, or no map contains the place.
        """
        request = request_for(self.row_spec(levels), AssignedSite(self.matches(levels)[0]), 0)
        known = (*vehicle_classes(), PEDESTRIAN.name)
        for demand in request.vehicles:
            if demand.vehicle_class not in known:
                name = demand.vehicle_class
                raise UnknownName(f"there is no vehicle class {quoted(name)}", valid=closest(name, known))

    def row_spec(self, levels: Mapping[int, int]) -> GenerationSpec:
        """Return the parsed request for a scenario with the given levels.

        Raises:
            InvalidRequest: a level is invalid.
        """
        return read_specification(self._row_arguments(levels))

    def _row_arguments(self, levels: Mapping[int, int]) -> GenerateScenariosArguments:
        """Return the arguments of a scenario with the given levels.

        Raises:
            InvalidRequest: a level is invalid.
        """
        changed: dict[str, Any] = {"cover": [], "count": 1}
        vehicles = list(self.arguments.vehicles)
        for factor, level in levels.items():
            name, value = self.factors[factor].name.partition(" ")[0], self.factors[factor].levels[level]
            if name == "vehicles":
                vehicles += [] if value == "cars" else [part.strip() for part in value.split("+")]
            elif name == "turn":
                changed["goal"] = f"{THROUGH}:{value}"
            elif name == "duration_s":
                changed[name] = float(value) if re.fullmatch(r"\d+(\.\d+)?", value) else value
            else:
                changed[name] = value
        if any(factor.name == "density" for factor in self.factors):
            changed.setdefault("density", self.arguments.density)
        # A default is not a request: the time of day sets the density, and a turn the duration, unless they are given.
        given = self.arguments.model_dump(exclude_unset=True) | changed | {"vehicles": vehicles}
        try:
            return GenerateScenariosArguments.model_validate(given)
        except ValidationError as error:
            (problem, valid), *_ = problems_of(GenerateScenariosArguments, error, "argument")
            raise InvalidRequest(
                f"cover requests {self.words(levels)}, which is invalid: {problem}", valid=valid, next_step=_HOW
            ) from error

    def matches(self, levels: Mapping[int, int]) -> tuple[MapMatch, ...]:
        """Return the maps for the given levels, or those of all places and countries if the levels contain neither."""
        names = ("place", "country")
        where = {(factor, level) for factor, level in levels.items() if self.factors[factor].name in names}
        fitting = (matches for key, matches in self.shown.items() if where <= set(key))
        each = {(match.entry.facts.map_id, match.streets, match.box): match for matches in fitting for match in matches}
        return tuple(each.values())

    @cached_property
    def recipe(self) -> Recipe:
        """The recipe of the plan, which does not include the number of scenarios."""
        unset = {"density", "duration_s"} - self.arguments.model_fields_set
        shared = self.arguments.model_dump(mode="json", exclude={"cover", "count", "trial_run", "seed"} | unset)
        cover = [f"{factor.name}={'|'.join(factor.levels)}" for factor in self.factors]
        maps = sorted({match.entry.facts.map_id for match in self._all_matches()})
        return Recipe(
            tool="generate_scenarios",
            arguments={**shared, "cover": [*cover, f"strength={self.strength}"], "maps": maps},
            seed=self.arguments.seed,
            versions=versions_of("covertable", "eclipse-sumo", "libsumo", "numpy"),
        )

    @property
    def plan_id(self) -> str:
        """The id of the plan."""
        return f"plan_{self.recipe.digest}"

    @property
    def wanted(self) -> int | None:
        """The requested number of scenarios, or None to use as many as the combinations need."""
        return self.arguments.count if "count" in self.arguments.model_fields_set else None

    def of_spot(self) -> Iterator[dict[int, int]]:
        """Yield all combinations of levels of the factors for the location of a scenario."""
        by_type = any(factor.name == "scenario_type" for factor in self.factors)
        return self.groups("place", "country", "scenario_type" if by_type else "turn")

    def other_types(self, there: Collection[str]) -> list[str]:
        """Return the site types among ``there`` that the plan does not use and that allow one of its turns."""
        levels = {factor.name: factor.levels for factor in self.factors}
        used = levels.get("scenario_type", (self.arguments.scenario_type,))
        turns = levels.get("turn")
        return [
            kind
            for kind in get_args(SiteType)
            if kind in there and kind not in used and (turns is None or set(turns) & set(TURNS_AT[kind]))
        ]

    def groups(self, *names: str) -> Iterator[dict[int, int]]:
        """Yield all combinations of levels of the given factors, or one empty group if the plan has none of them."""
        saying = [index for index, factor in enumerate(self.factors) if factor.name in names]
        for levels in product(*(range(len(self.factors[index].levels)) for index in saying)):
            yield dict(zip(saying, levels, strict=True))

    def words(self, levels: Mapping[int, int]) -> str:
        """Return the levels in the notation of a call, joined with plus signs."""
        return " + ".join(self.factors[factor].text(level) for factor, level in levels.items())

    def _all_matches(self) -> Iterator[MapMatch]:
        for group in self.of_spot():
            yield from self.matches(group)


def impossible_turns(plan: RequestedPlan) -> Iterator[tuple[Combination, str]]:
    """Yield the turns that an ego cannot make at sites of the given type on any map, each with the reason."""
    indices = {factor.name: index for index, factor in enumerate(plan.factors)}
    if "turn" not in indices:
        return
    turn, types = indices["turn"], indices.get("scenario_type")
    kinds = [plan.arguments.scenario_type] if types is None else list(plan.factors[types].levels)
    for index, kind in enumerate(kinds):
        possible: tuple[Turn, ...] = get_args(Turn) if kind == "any" else TURNS_AT[kind]  # type: ignore[index]
        for level, name in enumerate(plan.factors[turn].levels):
            if name not in possible:
                key = ((turn, level),) if types is None else tuple(sorted(((types, index), (turn, level))))
                yield key, f"the ego cannot make that turn at {kind} sites"


def existing_levels(plan: RequestedPlan, context: WorkflowContext) -> list[Levels]:
    """Return the levels of existing scenarios, each combination once, from the requests that generated them."""
    existing = ExistingLevels(plan)
    found = {existing.of(shape): None for shape in made_before(context.workspace.database.connection())}
    return [levels for levels in found if levels is not None and any(level is not None for level in levels)]


_WHERE = ("map_id", "streets", "bbox")
_OWN: Mapping[str, tuple[str, ...]] = {
    "scenario_type": ("scenario_type",),
    "density": ("density",),
    "turn": ("goal",),
    "duration_s": ("duration_s",),
    "ego": ("ego",),
    "vehicles": ("vehicles",),
    "place": _WHERE,
    "country": _WHERE,
}
"""The fields of a scenario's request that a factor determines."""


class ExistingLevels:
    """Finds the levels of a plan that an existing scenario has, from its request."""

    def __init__(self, plan: RequestedPlan) -> None:
        self._plan = plan
        self._common = self._shape({})
        self._names = [factor.name.partition(" ")[0] for factor in plan.factors]
        self._shapes = [
            [self._shape({index: level}) for level in range(len(factor.levels))]
            for index, factor in enumerate(plan.factors)
        ]
        self._where = [
            [
                self._spots({index: level}) if self._names[index] in ("place", "country") else set()
                for level in range(len(factor.levels))
            ]
            for index, factor in enumerate(plan.factors)
        ]
        self._everywhere = {spot for group in plan.of_spot() for spot in self._spots(group)}

    def of(self, shape: Mapping[str, Any]) -> Levels | None:
        """Return the request's level per factor (None if not in the plan), or None if it belongs to another plan."""
        determined = {field for name in self._names for field in _OWN[name]} | {*_WHERE, "longest_s"}
        fields = (set(self._common) | set(shape)) - determined
        if any(self._common.get(field) != shape.get(field) for field in fields):
            return None
        if _spot_of(shape) not in self._everywhere:
            return None
        levels = tuple(self._level(index, shape) for index in range(len(self._names)))
        classes = [*self._common["vehicles"]]
        for index, level in enumerate(levels):
            if self._names[index] == "vehicles" and level is not None:
                classes += [one for one in self._shapes[index][level]["vehicles"] if one not in classes]
        return levels if all(one in classes for one in shape["vehicles"]) else None

    def _level(self, factor: int, shape: Mapping[str, Any]) -> int | None:
        name = self._names[factor]
        if name in ("place", "country"):
            return next((level for level, spots in enumerate(self._where[factor]) if _spot_of(shape) in spots), None)
        own = self._shapes[factor]
        if name == "vehicles":
            fitting = [level for level, one in enumerate(own) if all(part in shape[name] for part in one[name])]
            return max(fitting, key=lambda level: len(own[level][name]), default=None)
        return next(
            (level for level, one in enumerate(own) if all(one[key] == shape.get(key) for key in _OWN[name])), None
        )

    def _shape(self, levels: Mapping[int, int]) -> dict[str, Any]:
        match = self._plan.matches(levels)[0]
        return shape_of(request_for(self._plan.row_spec(levels), AssignedSite(match), 0))

    def _spots(self, levels: Mapping[int, int]) -> set[str]:
        spec = self._plan.row_spec(levels)
        return {_spot_of(shape_of(request_for(spec, AssignedSite(match), 0))) for match in self._plan.matches(levels)}


def _spot_of(shape: Mapping[str, Any]) -> str:
    return json.dumps([shape.get(field) for field in _WHERE])
