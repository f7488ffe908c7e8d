"""The input of the parts of ``make bench-maps``."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class MapsBench:
    """The folders and limits of a part.

    ``shared``: the folder with ``data/osm`` and ``corpora/dev``. ``scratch``: an empty folder that is deleted
    afterwards. ``scenarios``: of the plan. ``minutes``: its longest duration, after which the results so far count.
    ``limit``: the number of requests, maps or tracks, or None for all.
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
        """Return a new folder in the scratch."""
        folder = self.scratch / name
        folder.mkdir()
        return folder
