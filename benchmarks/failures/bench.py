"""What the parts of the benchmark share: folder of public scenarios, seeds and sample sizes."""

from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from plannerforge.engine.exploration.roads import ROADS, write_road

from ..harness import existing, shared_scenarios
from .cases import Base, bases

TUNED_ON = ("DEU_Lohmar-32_1_T-1", "BEL_Antwerp-14_3_T-1", "ESP_Bilbao-6_9_T-1", "USA_US101-26_1_T-1")
"""Scenarios that were looked at while strata and scores were made; nothing is reported on them."""

PRACTICE_ROADS = ("two_way", "crossing_lights", "merge")
"""Drawn roads of the development."""


@dataclass(frozen=True)
class FailuresBench:
    """The input of the parts.

    ``practice``: whether the weaknesses and scenarios of the development are measured. ``weaknesses``: those to plant;
    empty for all.
    """

    folder: Path
    scratch: Path
    seeds: int
    first_seed: int
    count: int
    runs: int
    practice: bool = False
    weaknesses: tuple[str, ...] = ()
    _others: dict[tuple[Path, str], Base] = field(default_factory=dict)

    @classmethod
    def options(cls, text: str | None) -> ArgumentParser:
        """Return the parser of the options."""
        parser = ArgumentParser(description=text, formatter_class=RawDescriptionHelpFormatter)
        parser.add_argument("--folder", type=Path, default=shared_scenarios())
        parser.add_argument("--seeds", type=int, default=20)
        parser.add_argument("--first-seed", type=int, default=100)
        parser.add_argument("--bases", type=int, default=4)
        parser.add_argument("--runs", type=int, default=300, help="budget of the comparison with peers")
        parser.add_argument("--practice", action="store_true", help="measure what the search was developed on")
        parser.add_argument("--weaknesses", nargs="+", default=[], help="plant only these (by default all)")
        return parser

    @classmethod
    def of(cls, given: Namespace, scratch: Path) -> "FailuresBench":
        """Return the input that options ask for."""
        return cls(
            existing(given.folder),
            scratch,
            given.seeds,
            given.first_seed,
            given.bases,
            given.runs,
            practice=given.practice,
            weaknesses=tuple(given.weaknesses),
        )

    @property
    def all_seeds(self) -> range:
        """The seeds of the searches."""
        return range(self.first_seed, self.first_seed + self.seeds)

    @cached_property
    def idm_bases(self) -> list[Base]:
        """The drawn bases that IDM passes; those of the development are drawn from the other end."""
        return bases(self.folder, "idm", self.count, TUNED_ON, practice=self.practice)

    @cached_property
    def road_bases(self) -> list[Base]:
        """The drawn roads, empty of traffic, on which IDM drives: those of the development, or all others."""
        names = [name for name in ROADS if (name in PRACTICE_ROADS) == self.practice]
        return [Base(write_road(name, self.scratch / f"{name}.xml"), "idm") for name in names]

    def base_of(self, base: Base, planner: str) -> Base:
        """Return a base with another planner."""
        if planner == base.planner:
            return base
        return self._others.setdefault((base.path, planner), Base(base.path, planner))
