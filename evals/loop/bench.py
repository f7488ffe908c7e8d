"""What every part of ``make bench-loop`` receives."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class LoopBench:
    """Where a part finds its data, where it may write, and how much it measures.

    ``shared``: the folder that contains ``data``; ``scratch``: an empty folder that is deleted afterwards; ``seed``: of
    everything that is drawn; ``limit``: the number of cases per part, or None for all of them.
    """

    shared: Path
    scratch: Path
    seed: int = 20
    limit: int | None = None

    def folder(self, name: str) -> Path:
        """Create a folder in the scratch folder and return it."""
        folder = self.scratch / name
        folder.mkdir()
        return folder
