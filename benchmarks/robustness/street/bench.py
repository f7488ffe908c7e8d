"""The input of the ``make bench-hostile`` parts about an exposed server."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class StreetBench:
    """The folder and the limits of a part.

    Args:
        scratch: an empty folder, deleted afterwards.
        seed: of all draws.
        minutes: duration of the stranger's visit.
        archives: number of forged archives.
        answers: number of forged answers of map services and planner programs.
        kills: number of kills of coverage plans, optimisations and imports.
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
