"""The arguments and results of the catalogue's tools: facets and searches."""

import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import ClassVar, Final, Literal

from pydantic import Field

from .base import Answer, Arguments, Model, Result
from .odd import OddCoverage
from .text import counted, one_line
from .vocabulary import Origin

Facet = Literal["all", "places", "tags", "features", "road_net", "obstacles", "maps", "behaviours", "planners"]
Method = Literal["funnel", "semantic", "hybrid", "rrf", "bm25"]
Stage = Literal["location", "tags", "road_net", "obstacles", "velocity"]
PACKAGED_MODEL, ENGLISH_MODEL = "packaged", "all-MiniLM-L6-v2"
PACKAGED_MODELS = (PACKAGED_MODEL, ENGLISH_MODEL)
"""The models installed with the package: two models combined, which read 16 languages, and the English one alone."""
EMBEDDINGS_EXTRA = "plannerforge-mcp[embeddings]"
"""The pip packages that all other models need: sentence-transformers with PyTorch."""
"""The embedding model that installs with the package."""
STAGES: tuple[Stage, ...] = ("location", "tags", "road_net", "obstacles", "velocity")


class DescribeCatalogArguments(Arguments):
    """What exists, with counts. Read before filtering."""

    facet: Facet = "all"
    """The facet to count; `all` shows each in brief, with the state of the server."""
    within: str | None = Field(None, description="search id, country or place")
    offset: int = Field(0, ge=0)
    """Entries of the facet to skip."""
    odd: str | None = Field(None, description="OpenODD file: what scenarios and runs cover of it")


class CountryMaps(Model):
    """The maps of a country, each with its id, place and the number of sites by type."""

    country: str = Field(description="ISO alpha-3; '?' if not known")
    maps: int = Field(description="maps of the country")
    sites: int = Field(description="sites in them")
    listed: tuple[str, ...] = Field((), description="one line a map")


class FacetCounts(Model):
    """Names of one kind with the number of scenarios; for maps and planners, ``note`` says what is counted."""

    facet: str = Field(description="name of the facet")
    counts: dict[str, int] = Field(description="how many scenarios have each value")
    note: str = Field("", description="what is counted, or what else exists")


class DescribeCatalogResult(Result):
    """The facets of the catalogue."""

    scenarios: int = Field(description="scenarios counted")
    facets: tuple[FacetCounts, ...] = Field(description="the counts, by facet")
    maps: tuple[CountryMaps, ...] = Field((), description="with facet maps: this page, by country")
    maps_rest: str = Field("", description="what is not on this page, and the call that shows it")
    odd: OddCoverage | None = Field(
        None, exclude_if=lambda odd: odd is None, description="with `odd`: what is covered of it, and what is missing"
    )

    def answer(self) -> Answer:
        """Return one line per facet, the most frequent names first; maps by country, one line per map."""
        if self.odd is not None:
            headline, *lines = self.odd.lines()
            return Answer(headline, listed=lines, next_step=self.odd.next_step)
        lines = []
        for facet in self.facets:
            note = f" ({facet.note})" if facet.note else ""
            lines.append(f"{facet.facet}{note}: {', '.join(_counts(facet)) or 'none'}")
        for land in self.maps:
            lines.append(f"{land.country}: {counted(land.maps, 'map')}, {counted(land.sites, 'site')}")
            lines += [f"- {line}" for line in land.listed]
        lines += [self.maps_rest] if self.maps_rest else []
        return Answer(f"{counted(self.scenarios, 'scenario')}.", listed=lines)


class FindScenariosArguments(Arguments):
    """Filter the catalogue by facts, rank by text. Pass the user's words: unknown ones are refused with the nearest
    valid."""

    longest_texts: ClassVar[Mapping[str, int]] = {"text": 2000}

    country: str | None = Field(None, description="ISO alpha-3")
    city: str | None = None
    """The town of the scenarios."""
    tags: list[str] = Field([], description="in the file, all of them; 'a|b' either, '!a' without")
    features: list[str] = Field([], description="computed: ramp, ego_turns_left, cut_in:truck …, 'ttc<=3s'")
    road_net: list[str] = Field(
        [],
        description="'stop', '!yield', 'traffic_light@map', 'lanes>=2', 'speed_limit=50km/h'; on the ego's lane, "
        "'@map' anywhere",
    )
    obstacles: list[str] = Field(
        [], description="'truck' (at least one), 'bus=2', 'car=2..5' (a few), 'bicycle=0', 'participants>=20'"
    )
    ego_speed: str | None = Field(None, description="'50km/h' (±2 m/s), '10..15m/s', '>=20mph'")
    origin: Origin | None = None
    """How the motion of the others was created."""
    text: str | None = Field(None, description="only ranks")
    like: str | None = Field(None, description="scenario id")
    within: str | None = Field(None, description="search id")
    method: Method = "funnel"
    """How text ranks the remaining scenarios."""
    sort: Literal["match", "criticality", "size"] = "match"
    """The order of the matches: by fit, by criticality, or by number of road users."""
    diverse: int | None = Field(None, ge=1, le=100, description="N unlike matches")
    fallback: Literal["nearest", "none"] = "nearest"
    """If nothing matches, show the nearest scenarios with their unmet conditions, or nothing."""
    limit: int = Field(5, ge=1, le=50)
    """How many matches to show."""
    offset: int = Field(0, ge=0)
    """Matches to skip."""

    def in_words(self) -> str:
        """Return the given conditions and the text, for a list of searches."""
        where = [f"{name} {value}" for name in ("country", "city") if (value := getattr(self, name))]
        lists = [f"{name} {', '.join(value)}" for name in _LISTS if (value := getattr(self, name))]
        others = [
            f"{name} {value}" for name in ("ego_speed", "origin", "like", "within") if (value := getattr(self, name))
        ]
        text = [f"text '{self.text}'"] if self.text else []
        return one_line("; ".join([*where, *lists, *others, *text]) or "no conditions", 200)


_LISTS = ("tags", "features", "road_net", "obstacles")


class FoundScenario(Model):
    """A scenario in the answer, with the evidence for it; one with ``unmet`` conditions is a fallback, not a match."""

    scenario_id: str
    summary: str = Field(description="the scenario in one line")
    counts: dict[str, int] = Field(default_factory=dict, description="road users by type")
    ego_speed_mps: float | None = Field(None, description="speed of the ego at its start; null without an ego")
    satisfied: tuple[str, ...] = Field((), description="conditions that it satisfies, with its own figures")
    unmet: tuple[str, ...] = Field((), description="conditions that it does not satisfy")
    score: float | None = Field(None, description="similarity to the text, larger is better; None without text")


class StageCount(Model):
    """The number of scenarios left after a stage, and the conditions that it applied."""

    stage: Stage = Field(description="name of the stage")
    conditions: tuple[str, ...] = Field(description="the conditions that it applied")
    kinds: tuple[str, ...] = Field((), description="what these conditions are about")
    left: int = Field(description="scenarios left after it")


def _counts(facet: FacetCounts) -> list[str]:
    """Return the names of a facet with their counts, which are in brackets if the names are numbers."""
    if facet.facet in ("lanes", "speed_limit"):
        first, *others = facet.counts.items() or [("", 0)]
        known = [f"{first[0]} ({counted(first[1], 'scenario')})"] if first[0] else []
        return [*known, *(f"{name} ({count})" for name, count in others)]
    shows_zero = facet.facet == "ego_speed"
    return [f"{name} {count}" if count or shows_zero else name for name, count in facet.counts.items()]


class Coverage(Model):
    """How many of the matches' values in one dimension a diverse selection covers."""

    dimension: str = Field(description="what varies: a place, a tag, …")
    covered: tuple[str, ...] = Field(description="values in the selection")
    missed: tuple[str, ...] = Field(description="values of other matches only")


class Relaxation(Model):
    """Conditions to drop, and how many scenarios satisfy all the other conditions."""

    drop: tuple[str, ...] = Field(description="conditions to leave out")
    matches: int = Field(description="scenarios that satisfy all others")
    examples: tuple[str, ...] = Field(description="ids of some of these")


class Emptied(Model):
    """The stage that left no scenario, its conditions that no candidate satisfied, and the values that exist."""

    stage: Stage = Field(description="the stage that left no scenario")
    conditions: tuple[str, ...] = Field(description="its conditions that no candidate satisfies")
    note: str = Field(description="values that exist")


class SearchRecord(Model):
    """A stored search: the request, the matching ids in order, and the counts per stage.

    ``total`` is the number of matches if not all are stored, otherwise None.
    """

    arguments: FindScenariosArguments
    scenario_ids: tuple[str, ...]
    stages: tuple[StageCount, ...]
    total: int | None = None


class FindScenariosResult(Result):
    """The matches, the count after every stage, and the reason if there are no matches."""

    search_id: str
    method: Method = Field(description="how scenarios were chosen and ranked")
    catalogue: int = Field(description="scenarios searched")
    total: int = Field(description="scenarios that satisfy every condition")
    stages: tuple[StageCount, ...] = Field(description="number left after each stage")
    matches: tuple[FoundScenario, ...] = Field(description="the scenarios on this page, the best first")
    coverage: tuple[Coverage, ...] = Field((), description="with diverse: what the selection covers")
    emptied_by: Emptied | None = Field(None, description="the stage that left no scenario; null if some are left")
    relaxations: tuple[Relaxation, ...] = Field((), description="conditions to drop for matches")
    fallback: tuple[FoundScenario, ...] = Field((), description="not matches: each leaves conditions unmet")
    notes: tuple[str, ...] = ()

    def answer(self) -> Answer:
        """Return counts and matches, and ways out of an empty result."""
        decided = [*self.notes]
        if len(self.stages) > 1:
            steps = [self._step(stage) for stage in self.stages]
            decided.append(f"Remaining: {' → '.join(steps)}")
        requested = {condition for stage in self.stages for condition in stage.conditions}
        lines = [_line(scenario, requested) for scenario in self.matches]
        if self.coverage:
            missed = "; ".join(_missed(one) for one in self.coverage if one.missed)
            lines.append(
                f"Only other matches have: {missed}"
                if missed
                else "The selection covers every feature value of the matches."
            )
        elif self.total > len(self.matches) > 0:
            lines.append(f"… {self.total - len(self.matches)} more: raise offset or limit.")
        if self.emptied_by:
            note = self.emptied_by.note
            lines.append(f"{note[0].upper()}{note[1:]}{'' if note.endswith('…') else '.'}")
            lines += [
                f"To run the {counted(stage.left, 'scenario')} left by the {stage.stage} filter, give run_planner "
                f"{self.search_id}:{stage.stage}"
                for stage in self.stages[-2:-1]
            ]
        for relaxation in self.relaxations:
            shown, count = ", ".join(relaxation.examples), relaxation.matches
            *others, last = relaxation.drop
            drop = f"{', '.join(others)} and {last} are" if others else f"{last} is"
            more = f" and {count - len(relaxation.examples)} more" if count > len(relaxation.examples) else ""
            lines.append(f"If {drop} dropped, {count} {'matches' if count == 1 else 'match'}: {shown}{more}")
        if self.fallback:
            lines.append("Nearest non-matches, with the conditions that they fail:")
            lines += [_line(scenario, requested) for scenario in self.fallback]
        verb = "matches" if self.total == 1 else "match"
        of = f"{self.total} of {self.catalogue:,} scenarios"
        method = "" if self.method == "funnel" else f", method {self.method}"
        headline = f"{of} {verb} ({self.search_id}{method})."
        return Answer(headline, decided, listed=lines)

    def _step(self, stage: StageCount) -> str:
        """Return how many scenarios a stage left, with its conditions if the search ends without a match."""
        conditions = f" [{', '.join(stage.conditions)}]" if not self.total else ""
        return f"{stage.left} after {' and '.join(stage.kinds) or stage.stage}{conditions}"


_DIMENSIONS: Final = {
    "countries": "country",
    "density_per_km": "density per km",
    "ego_speed_mps": "ego speed in m/s",
    "features": "feature",
    "lanes": "number of lanes",
    "obstacles": "road user",
    "obstacles_total": "number of road users",
    "ttc_s": "ttc in s",
}
_MOST_MISSED = 5
"""Number of values per dimension that the text lists (chosen); the structured answer has all."""


def _missed(coverage: Coverage) -> str:
    """Return the values of a dimension that a diverse selection lacks."""
    shown, more = coverage.missed[:_MOST_MISSED], len(coverage.missed) - _MOST_MISSED
    rest = f" and {more} more" if more > 0 else ""
    return f"{_DIMENSIONS.get(coverage.dimension, coverage.dimension)} {', '.join(shown)}{rest}"


_EVIDENT = re.compile(r"\w+=\d+|.+, [A-Z]{3}|ego [\d.]+ m/s .*")
"""Evidence that a scenario's id and summary already show: counts of road users, country and place, the ego's speed."""


def _line(scenario: FoundScenario, requested: Collection[str]) -> str:
    unmet = f" · unmet: {', '.join(scenario.unmet)}" if scenario.unmet else ""
    more = [
        evidence
        for evidence in scenario.satisfied
        if evidence.removeprefix("tag ") not in requested and not _EVIDENT.fullmatch(evidence)
    ]
    satisfied = f" · {'; '.join(more)}" if more else ""
    return f"- {scenario.scenario_id}: {scenario.summary}{satisfied}{unmet}"


class RankRequest(Model):
    """The scenarios to rank by similarity to a text, and the paths of the catalogue and the index.

    If ``candidates`` is None, all scenarios are ranked; if it is empty, no scenario is.
    """

    database: Path
    index: Path
    text: str
    candidates: tuple[str, ...] | None
    method: Literal["semantic", "bm25"]
    limit: int = Field(ge=1)
    model: str = PACKAGED_MODEL


class BuildIndexRequest(Model):
    """The catalogue that needs a text index, and the model that embeds it."""

    database: Path
    index: Path
    model: str = PACKAGED_MODEL


class BuildIndexResponse(Model):
    """The number of descriptions in the index, whether it was just built, and whether it had been damaged."""

    descriptions: int
    built: bool
    mended: bool = False


class RankResponse(Model):
    """Scenario ids with their scores, best first, and whether the index was built for this request or had been damaged.

    A text with no score above ``least_likeness`` is unrelated to all descriptions.
    """

    scenario_ids: tuple[str, ...]
    scores: tuple[float, ...]
    built_index: bool
    mended_index: bool = False
    least_likeness: float = 0.0
