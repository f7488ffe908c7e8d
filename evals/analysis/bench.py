"""What the parts of ``make bench-analysis`` are given."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class AnalysisBench:
    """Where a part finds its data and may write, and how much it measures.

    ``shared``: the folder with ``data``; ``scratch``: an empty folder, gone afterwards; ``seed``: of all that is drawn
    (19 was looked at while the product was made, figures are reported of 20); ``limit``: only so many cases, all of
    them where it is None.
    """

    shared: Path
    scratch: Path
    seed: int = 20
    limit: int | None = None

    def folder(self, name: str) -> Path:
        """A new folder in the scratch."""
        folder = self.scratch / name
        folder.mkdir()
        return folder
