"""Answers of map services, kept on disk by what was asked, so that the same question has the same answer.

Which of several mirrors answered does not count. osmnx's own cache is not used: it counts the mirror, knows neither
size nor age, and leaves half a file where its process is ended.
"""

import gzip
import hashlib
import json
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from ...workspace import write_whole

_DAY_S = 86_400.0
_MIB = 1024**2


_Read = TypeVar("_Read")


@dataclass(frozen=True)
class KeptAnswer(Generic[_Read]):
    """What a service answered: the host, when (seconds since 1970), and its answer, parsed from JSON."""

    question: str
    service: str
    asked_at: float
    answer: _Read

    @property
    def age_s(self) -> float:
        """Its age in seconds. An answer from the future, which a clock that was set back leaves, ages the other way."""
        return abs(time.time() - self.asked_at)


class AnswerCache:
    """A folder of answers, one file each, written whole or not at all.

    Those that were not used for longest go first where all together are larger than ``most_mb``.
    """

    def __init__(self, folder: Path, most_mb: int, most_days: float) -> None:
        self._folder, self._most_bytes, self._most_s = folder, most_mb * _MIB, most_days * _DAY_S

    def find(self, question: str, *, however_old: bool = False) -> KeptAnswer[Any] | None:
        """The answer to a question; None where there is none, or it is too old, or its file is damaged."""
        path = self._path(question)
        try:
            kept = KeptAnswer(**json.loads(gzip.decompress(path.read_bytes())))
        except FileNotFoundError:
            return None
        except (
            OSError,
            EOFError,
            ValueError,
            TypeError,
            RecursionError,
        ):  # damaged, by whatever: it is asked for again
            path.unlink(missing_ok=True)
            return None
        if kept.question != question or (not however_old and kept.age_s > self._most_s):
            return None
        with suppress(OSError):
            path.touch()
        return kept

    def keep(self, kept: KeptAnswer[Any]) -> None:
        """Keep an answer; others are removed where there is no room for all.

        Raises:
            ResourceFailure: the disk is full or the folder cannot be written; then nothing is kept.
        """
        text = json.dumps(asdict(kept), ensure_ascii=False, separators=(",", ":"))
        packed = gzip.compress(text.encode(), compresslevel=5, mtime=0)
        write_whole(self._path(kept.question), lambda partial: partial.write_bytes(packed))
        self._make_room()

    def remove(self, question: str) -> None:
        """Remove the answer to a question."""
        self._path(question).unlink(missing_ok=True)

    def _path(self, question: str) -> Path:
        return self._folder / f"{hashlib.sha256(question.encode()).hexdigest()[:32]}.json.gz"

    def _make_room(self) -> None:
        found: list[tuple[float, int, Path]] = []
        for path in self._folder.glob("*.json.gz"):
            with suppress(FileNotFoundError):  # another process made room meanwhile
                stat = path.stat()
                found.append((stat.st_mtime, stat.st_size, path))
        size = sum(size for _, size, _ in found)
        for _, freed, path in sorted(found)[:-1]:  # the one just kept is used at least once
            if size <= self._most_bytes:
                return
            path.unlink(missing_ok=True)
            size -= freed
