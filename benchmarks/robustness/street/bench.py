"""The input of the ``make bench-hostile`` parts about an exposed server."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class StreetBench:
    """Where a part may write, and how much it measures.

    Args:
        scratch: an empty folder, deleted afterwards.
        seed: of everything that is drawn.
        minutes: how long the stranger stays.
        archives: forged ones.
        answers: forged ones of map services and planner programs.
        kills: of coverage plans, optimisations and imports.
    """

    scratch: Path
    seed: int = 1
    minutes: float = 20.0
    archives: int = 500
    answers: int = 2_000
    kills: int = 50

    def folder(self, name: str) -> Path:
        """Create a folder in the scratch folder and return it."""
        folder = self.scratch / name
        folder.mkdir(parents=True)
        return folder
