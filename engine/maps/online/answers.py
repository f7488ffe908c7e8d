"""Caches answers of map services on disk by question, so that the same question has the same answer.

An answer is valid no matter which mirror gave it. osmnx's own cache is not used: it depends on the mirror, has no
limits on size or age, and leaves half a file if its process is killed.
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
    """An answer of a service: the host, the time (seconds since 1970), and the answer, parsed from JSON."""

    question: str
    service: str
    asked_at: float
    answer: _Read

    @property
    def age_s(self) -> float:
        """The answer's age in s."""
        return abs(time.time() - self.asked_at)


class AnswerCache:
    """A folder of answers, one file each, written completely or not at all.

    If the answers together exceed ``most_mb``, the least recently used answers are removed.
    """

    def __init__(self, folder: Path, most_mb: int, most_days: float) -> None:
        self._folder, self._most_bytes, self._most_s = folder, most_mb * _MIB, most_days * _DAY_S

    def find(self, question: str, *, however_old: bool = False) -> KeptAnswer[Any] | None:
        """Return the answer to a question, or None if it is missing or too old, or its file is damaged."""
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
        ):  # damaged in any way: the question is asked again
            path.unlink(missing_ok=True)
            return None
        if kept.question != question or (not however_old and kept.age_s > self._most_s):
            return None
        with suppress(OSError):
            path.touch()
        return kept

    def keep(self, kept: KeptAnswer[Any]) -> None:
        """Store an answer; remove other answers if there is not enough room.

        Raises:
            ResourceFailure: the disk is full or the folder cannot be written; then nothing is stored.
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
            with suppress(FileNotFoundError):  # another process has made room
                stat = path.stat()
                found.append((stat.st_mtime, stat.st_size, path))
        size = sum(size for _, size, _ in found)
        for _, freed, path in sorted(found)[:-1]:  # keep the newest answer at least until its first use
            if size <= self._most_bytes:
                return
            path.unlink(missing_ok=True)
            size -= freed
