"""The input of the parts of ``make bench-serve``."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ServeBench:
    """The folders and limits of a part.

    Args:
        scratch: an empty folder, deleted afterwards.
        minutes: duration of the load.
        clients: number of concurrent clients.
        inputs: number of hostile inputs.
        kills: number of kills.
        node: a Node program; empty to fetch one.
        hosts: the tested clients of other makers; all if empty.
        environments: folder of their environments; None for the usual folder.
        page: the page for their table.
        pictures: folder for a picture of each page in a host, or None.
    """

    scratch: Path
    minutes: float = 10.0
    clients: int = 8
    inputs: int = 20_000
    kills: int = 20
    node: str = ""
    hosts: tuple[str, ...] = ()
    environments: Path | None = None
    page: Path | None = None
    pictures: Path | None = None

    def folder(self, name: str) -> Path:
        """Return a new folder in the scratch."""
        folder = self.scratch / name
        folder.mkdir()
        return folder
