"""The materials of corpora: the scenarios and maps of a workspace; and the form of a generated request."""

import random
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from ...engine.catalog import open_catalogue
from ...engine.maps import built_in_maps
from ...engine.workspace import Workspace
from ...schemas.generation import MapFacts
from ...schemas.scenarios import ScenarioFacts, ScenarioRecord
from ..attempts import Expectation

Style = Literal["normal", "terse", "long", "messy"]
STYLES: tuple[Style, ...] = ("normal", "terse", "long", "messy")
_MOST = 100_000
_ORIGINALS = ("starter", "imported", "generated")
"""Scenarios that requests are about: those made by an edit count as their original."""


@dataclass(frozen=True)
class KnownScenario:
    """A scenario with its facts and its file."""

    facts: ScenarioFacts
    path: Path

    @property
    def name(self) -> str:
        """The name of its file, as in corpora."""
        return f"{self.facts.scenario_id}.xml"


@dataclass(frozen=True)
class Materials:
    """Scenarios by id in alphabetical order, and maps."""

    scenarios: tuple[KnownScenario, ...]
    maps: tuple[MapFacts, ...]

    def matching(self, *conditions: "Condition") -> list[str]:
        """Return sorted ids of the scenarios that satisfy all conditions."""
        return [one.facts.scenario_id for one in self.scenarios if all(holds(one.facts) for holds in conditions)]


class Condition:
    """A condition on facts, with its slot in the ground truth and its text in a request."""

    def __init__(self, slot: str, value: Any, words: str, holds: Any) -> None:
        self.slot, self.value, self.words, self._holds = slot, value, words, holds

    def __call__(self, facts: ScenarioFacts) -> bool:
        """Return whether the scenario satisfies the condition."""
        return bool(self._holds(facts))


@dataclass(frozen=True)
class CorpusLine:
    """A generated request; ``about`` is the scenario or map by which corpora are split."""

    corpus: str
    text: str
    truth: Mapping[str, Any]
    expect: Expectation
    category: str
    style: Style
    about: str
    fields: Mapping[str, Any] = field(default_factory=dict)


Draw = random.Random


def read_materials(workspace: Path) -> Materials:
    """Return the scenarios and maps of a workspace, with the starter catalogue and the built-in maps.

    Raises:
        ResourceFailure: the workspace cannot be written.
    """
    with closing(Workspace(workspace)) as opened:
        open_catalogue(opened)
        found = [
            KnownScenario(record.facts, opened.file("scenario", artifact.artifact_id, "scenario.xml"))
            for artifact in opened.newest(kind="scenario", limit=_MOST)
            if (record := artifact.read(ScenarioRecord)).origin in _ORIGINALS and record.supersedes is None
        ]
        maps = [artifact.read(MapFacts) for artifact in opened.newest(kind="map", limit=_MOST)]
    scenarios = sorted(found, key=lambda one: one.facts.scenario_id)
    return Materials(tuple(scenarios), (*maps, *(entry.facts for entry in built_in_maps())))


def styled(text: str, terse: str, style: Style, draw: Draw) -> str:
    """Return a request in a style: unchanged, terse, within a story, or typed in haste.

    Names and numbers stay unchanged in all styles.
    """
    if style == "terse":
        return terse
    if style == "long":
        before, after = draw.choice(_STORIES)
        return f"{before} {text} {after}".strip()
    if style == "messy":
        return draw.choice(_HASTE).format(_mistyped(text[:1].lower() + text[1:].rstrip("."), draw))
    return text


_STORIES = (
    ("We are preparing the review on Thursday and one example is still missing.", "Thanks in advance!"),
    ("My supervisor asked for this yesterday, and I have not come to it until now.", "Nothing else needs to change."),
    ("Before the long series starts tonight I would like to see one thing.", "Tell me briefly what came out."),
    ("This is for a comparison with another tool, so please keep to the wording.", ""),
)
_HASTE = ("ok so {}", "hey, {} pls", "{} - thx", "uhm {}, quickly")


def _mistyped(text: str, draw: Draw) -> str:
    """Swap two letters in one everyday word."""
    words = text.split(" ")
    plain = [index for index, word in enumerate(words) if word in _EVERYDAY]
    if plain:
        index = draw.choice(plain)
        word, at = words[index], draw.randrange(2, len(words[index]) - 2)
        words[index] = word[:at] + word[at + 1] + word[at] + word[at + 2 :]
    return " ".join(words)


_EVERYDAY = {
    "between",
    "country",
    "crossing",
    "exactly",
    "nearest",
    "scenarios",
    "seconds",
    "stretch",
    "switch",
    "tagged",
}
_EVERYDAY |= {"starts", "street", "vehicle", "vehicles", "weight"}
"""Words in which requests have their typing mistakes: a misspelt name would be another name."""


def rounds(items: Sequence[Any], draw: Draw) -> Iterator[Any]:
    """Yield the items over and over, each round in a different order."""
    while items:
        yield from draw.sample(list(items), len(items))
