"""What the parts of the benchmark share: folder of public scenarios, seeds and sample sizes."""

from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from plannerforge.schemas.failures import SearchSpace

from ..harness import existing, shared_scenarios
from .cases import Case, bases

TUNED_ON = ("DEU_Lohmar-32_1_T-1", "BEL_Antwerp-14_3_T-1", "ESP_Bilbao-6_9_T-1", "USA_US101-26_1_T-1")
"""Scenarios that were looked at while strata and scores were made; nothing is reported on them."""


@dataclass(frozen=True)
class FailuresBench:
    """The input of the parts."""

    folder: Path
    seeds: int
    first_seed: int
    count: int
    runs: int
    _spaces: dict[tuple[Path, str], SearchSpace] = field(default_factory=dict)

    def case(self, path: Path, planner: str, weakness: str = "") -> Case:
        """Return a case; the space of a base and planner is derived once."""
        case = Case(path, planner, weakness)
        if (path, planner) in self._spaces:
            case.space = self._spaces[path, planner]
        self._spaces[path, planner] = case.space
        return case

    @classmethod
    def options(cls, text: str | None) -> ArgumentParser:
        """Return the parser of the options."""
        parser = ArgumentParser(description=text, formatter_class=RawDescriptionHelpFormatter)
        parser.add_argument("--folder", type=Path, default=shared_scenarios())
        parser.add_argument("--seeds", type=int, default=20)
        parser.add_argument("--first-seed", type=int, default=100)
        parser.add_argument("--bases", type=int, default=4)
        parser.add_argument("--runs", type=int, default=300, help="budget of the comparison with peers")
        return parser

    @classmethod
    def of(cls, given: Namespace) -> "FailuresBench":
        """Return the input that options ask for."""
        return cls(existing(given.folder), given.seeds, given.first_seed, given.bases, given.runs)

    @cached_property
    def idm_bases(self) -> list[Path]:
        """The drawn bases that IDM passes."""
        return bases(self.folder, "idm", self.count, TUNED_ON)
