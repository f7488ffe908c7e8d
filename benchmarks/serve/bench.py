"""The input of the parts of ``make bench-serve``."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ServeBench:
    """Where a part may write, and how much it measures.

    Args:
        scratch: an empty folder, gone afterwards.
        minutes: how long the load lasts.
        clients: how many load the server at once.
        inputs: hostile inputs that are sent to it.
        kills: how often it is killed.
        node: program of Node; empty where one is to be fetched.
        hosts: the clients of others that are tried; all of them where none is named.
        environments: where their environments are kept; none for the usual folder.
        page: the page that their table is written into.
        pictures: where a picture of each page in a host is kept; none for nowhere.
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
        """A new folder in the scratch."""
        folder = self.scratch / name
        folder.mkdir()
        return folder
