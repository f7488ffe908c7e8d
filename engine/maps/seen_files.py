"""What became of the files in the map folders, so that one is unpacked and read once and not at every call."""

from dataclasses import dataclass
from pathlib import Path

from plannerforge.engine.workspace.database import Database
from plannerforge.engine.workspace.recipe import versions_of


@dataclass(frozen=True)
class SeenFile:
    """A file of a map folder: the map that it became, or why it was refused (the other is empty)."""

    map_id: str
    refusal: str


class SeenFiles:
    """The files seen so far by path; one that was changed since, or was read by another version of us, is new again."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def find(self, path: Path) -> SeenFile | None:
        """What became of a file; None where it is new or gone."""
        query = "SELECT map_id, refusal FROM map_files WHERE path = ? AND stamp = ?"
        row = self._database.connection().execute(query, (str(path), _stamp(path))).fetchone()
        return None if row is None else SeenFile(row["map_id"], row["refusal"])

    def keep(self, path: Path, seen: SeenFile) -> None:
        """Remember what became of a file as it is now.

        Raises:
            ResourceFailure: the database cannot be written.
        """
        row = (str(path), _stamp(path), seen.map_id, seen.refusal)
        with self._database.writing() as connection:
            connection.execute("INSERT OR REPLACE INTO map_files VALUES (?, ?, ?, ?)", row)


def _stamp(path: Path) -> str:
    """Size, time of the last change and our version; empty for a file that is gone."""
    try:
        found = path.stat()
    except OSError:
        return ""
    return f"{found.st_size} {found.st_mtime_ns} {versions_of()}"
