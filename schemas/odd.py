"""An operational design domain (ODD), and what scenarios and runs cover of it."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from pydantic import Field

from .base import Model
from .text import counted

OddValue = bool | int | float | str | None
"""A value of a concept; None if it is not stated."""


class OddEntry(Model):
    """A scenario for the ODD: its values by the name of the measurement, and how many of its runs failed."""

    scenario_id: str
    values: dict[str, OddValue]
    runs: int = 0
    failed: int = 0


class OddRequest(Model):
    """The file of an ODD, and the scenarios that it is compared with."""

    path: Path
    entries: tuple[OddEntry, ...] = ()


class OddLevel(Model):
    """A value or range of a concept: whether the ODD allows it, and what covers it.

    ``scenarios`` are those inside the ODD if the level is inside, and all others if it is outside.
    """

    level: str = Field(description="value or range")
    is_inside: bool = Field(description="whether the ODD allows it")
    scenarios: int = Field(0, description="scenarios with this value")
    runs: int = Field(0, description="runs on them")
    failed: int = Field(0, description="runs among these that did not reach the goal")

    def in_words(self) -> str:
        """Return text such as ``roundabout 4 (2 of 8 runs failed)``."""
        runs = f" ({self.failed} of {counted(self.runs, 'run')} failed)" if self.runs else ""
        return f"{self.level} {self.scenarios}{runs}"


class OddConcept(Model):
    """A concept of the ODD that is measured, with its levels."""

    name: str = Field(description="name in the ODD's taxonomy")
    unit: str = ""
    levels: tuple[OddLevel, ...] = Field(description="its values or ranges")

    def in_words(self) -> str:
        """Return the levels inside and outside, with their numbers of scenarios."""
        inside = ", ".join(level.in_words() for level in self.levels if level.is_inside)
        outside = ", ".join(level.in_words() for level in self.levels if not level.is_inside)
        unit = f" ({self.unit})" if self.unit else ""
        return f"{self.name}{unit}: inside {inside or 'nothing'}{f'; outside {outside}' if outside else ''}"


class OddShare(Model):
    """Scenarios and their runs on one side of the ODD."""

    scenarios: int = Field(0, description="scenarios")
    runs: int = Field(0, description="runs on them")
    failed: int = Field(0, description="runs among these that did not reach the goal")

    def in_words(self, assumed: int = 0) -> str:
        """Return text such as ``21 scenarios, 8 runs (2 failed)``.

        ``assumed``: the number of scenarios that count only because values are not stated.
        """
        scenarios = counted(self.scenarios, "scenario")
        scenarios += f" ({assumed} only because values are not stated)" if assumed else ""
        return f"{scenarios}, {counted(self.runs, 'run')} ({self.failed} failed)" if self.runs else scenarios


class OddCoverage(Model):
    """What scenarios and runs cover of an ODD, what is missing, and the calls that fill it.

    A scenario in which a value is not stated counts as inside if its other values are, as in ASAM OpenODD; ``assumed``
    counts these.
    """

    name: str = Field(description="name of the ODD")
    revision: str = Field(description="SHA-256 of the files it was read from")
    inside: OddShare = Field(description="scenarios and runs inside the ODD")
    outside: OddShare = Field(description="scenarios and runs outside")
    assumed: int = Field(description="scenarios inside only because values are not stated")
    concepts: tuple[OddConcept, ...] = Field(description="the measured concepts")
    not_measured: tuple[str, ...] = Field((), description="concepts in conditions of the ODD that no scenario states")
    pairs: int = Field(0, description="pairs of levels inside the ODD that generate_scenarios can vary")
    covered_pairs: int = Field(0, description="those with a scenario inside the ODD")
    missing: tuple[str, ...] = Field((), description="levels inside the ODD without a scenario")
    calls: tuple[dict[str, list[str]], ...] = Field((), description="arguments of generate_scenarios that fill them")

    @property
    def next_step(self) -> str:
        """The calls of generate_scenarios that fill what is missing."""
        return "; ".join(f"generate_scenarios {json.dumps(call)}" for call in self.calls)

    def lines(self) -> Iterator[str]:
        """Yield the lines of an answer."""
        yield f"ODD {self.name}: inside {self.inside.in_words(self.assumed)}; outside {self.outside.in_words()}."
        yield from (f"- {concept.in_words()}" for concept in self.concepts)
        if self.pairs:
            yield f"Pairs of levels that generate_scenarios can vary: {self.covered_pairs} of {self.pairs} covered."
        if self.not_measured:
            yield f"Not measured: {', '.join(self.not_measured)}."
        yield f"Missing: {', '.join(self.missing)}." if self.missing else "Every measured level has a scenario."


MOST_ODD_BYTES: Final = 1_000_000
"""The maximum size of an ODD file (chosen)."""
