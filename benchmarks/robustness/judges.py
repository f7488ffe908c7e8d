"""Judges an input from its answer, the server's process and the surrounding files, without asking the server."""

import hashlib
import json
import os
import re
import stat
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .inputs import INJECTED

LONGEST_ANSWER = 20_000
"""Most characters of an answer; a longer one fills a model's context."""
CANARY_TEXT = "4f1c-canary-of-the-bench"
"""A word in the files outside the roots that must appear in no answer."""
_LONGEST_KEPT = 201
"""Most characters of a caller's text in the journal: 200, and the ellipsis."""
_CONTROLS = ("Cc", "Cf", "Co", "Cs", "Zl", "Zp")
_REFUSAL = re.compile(r"\[[a-z_]+\] ")
"""Prefixes of refusals."""
_LINE_ENDS = re.compile(r"[\n\r\x0b\x0c\x1c-\x1e\x85\u2028\u2029]")


@dataclass(frozen=True)
class Fault:
    """A law that an input broke, the details, and the figure if the law has one."""

    law: str
    details: str
    value: float = 0.0


def faults_of(text: str) -> Iterator[Fault]:
    """Return the faults of one answer's text."""
    if "[unexpected]" in text:
        at = text.find("[unexpected]")
        yield Fault("unexpected", text[max(0, at - 80) : at + 300])
    if _REFUSAL.match(text) and "Next: " not in text:
        yield Fault("unadvised", text[:300])
    if len(text) > LONGEST_ANSWER:
        yield Fault("oversized", f"{len(text):,} characters: {text[:200]}")
    for line in _LINE_ENDS.split(text):
        if line.lstrip(" \t-*•>#|").startswith(INJECTED):
            at = text.find(line)
            yield Fault("forged", repr(text[max(0, at - 150) : at + 150]))
            break
    if CANARY_TEXT in text:
        yield Fault("outside_read", text[:300])


class Canary:
    """A tree of files that must not be touched, and its last known state."""

    def __init__(self, *folders: Path) -> None:
        self._folders = folders
        self._before = self._look()

    def changes(self) -> list[str]:
        """Return the files created, changed or removed since the last look."""
        now = self._look()
        before, self._before = self._before, now
        made = [f"made {path}" for path in now.keys() - before.keys()]
        gone = [f"removed {path}" for path in before.keys() - now.keys()]
        return made + gone + [f"changed {path}" for path in now.keys() & before.keys() if now[path] != before[path]]

    def _look(self) -> dict[str, str]:
        return {path: digest for folder in self._folders for path, digest in _looks(folder)}


def _looks(folder: Path) -> Iterator[tuple[str, str]]:
    for parent, folders, names in os.walk(folder):
        for name in (*folders, *names):
            path = Path(parent) / name
            status = path.lstat()
            content = path.read_bytes() if stat.S_ISREG(status.st_mode) else b""
            yield str(path), f"{stat.filemode(status.st_mode)} {hashlib.sha256(content).hexdigest()}"


def journal_faults(workspace: Path) -> Iterator[str]:
    """Return the faults of a server's journal: its permissions, and the callers' texts in it."""
    for path in sorted((workspace / "journal").glob("*")):
        if path.stat().st_mode & 0o077:
            yield f"{path.name} may be read by others: {stat.filemode(path.stat().st_mode)}"
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            for text in _texts(json.loads(line).get("arguments")):
                if len(text) > _LONGEST_KEPT or any(unicodedata.category(c) in _CONTROLS for c in text):
                    yield f"{path.name}:{number}: {len(text):,} characters: {text[:80]!r}"


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str | int):
        yield str(value)
    elif isinstance(value, dict):
        yield from (text for key, part in value.items() for text in (key, *_texts(part)))
    elif isinstance(value, list):
        yield from (text for part in value for text in _texts(part))


def peak_memory_mb(pid: int) -> float:
    """Return the peak memory of a process (VmHWM) in MB, 0 if it has ended."""
    return _status_mb(pid, "VmHWM")


def memory_mb(pid: int) -> float:
    """Return the current memory of a process (VmRSS) in MB, 0 if it has ended."""
    return _status_mb(pid, "VmRSS")


def _status_mb(pid: int, name: str) -> float:
    try:
        text = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0.0
    match = re.search(rf"^{name}:\s+(\d+) kB", text, re.MULTILINE)
    return int(match[1]) / 1024 if match else 0.0
