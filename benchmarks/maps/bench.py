"""The input of the parts of ``make bench-maps``."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class MapsBench:
    """Where a part finds its data and may write, and how much it measures.

    ``shared``: the folder with ``data/osm`` and ``corpora/dev``; ``scratch``: an empty folder, gone afterwards;
    ``scenarios``: of the plan; ``minutes``: that it takes at most, what was made till then counts; ``limit``: only so
    many requests, maps or tracks, all of them where it is None.
    """

    shared: Path
    scratch: Path
    workers: int = 2
    scenarios: int = 2000
    minutes: float | None = None
    limit: int | None = None

    @property
    def maps(self) -> Path:
        """The real extracts."""
        return self.shared / "data" / "osm"

    def folder(self, name: str) -> Path:
        """A new folder in the scratch."""
        folder = self.scratch / name
        folder.mkdir()
        return folder
