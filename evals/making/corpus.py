"""Makes all corpora from a workspace, and writes their files."""

import hashlib
import json
import random
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from ...schemas.errors import InvalidRequest
from ..attempts import Task
from .conversations import conversation_lines
from .generation import generation_lines
from .materials import CorpusLine, Draw, Materials
from .modification import LETTERS, PossibleEdits, modification_lines
from .routing import routing_lines
from .selection import selection_lines
from .tuning import tuning_lines

_PREFIXES = {"generation": "gen", "selection": "sel", "routing": "rt", "tuning": "tn", "e2e": "e2e"}
Announce = Callable[[str], None]


def make_corpora(
    materials: Materials, tasks: Sequence[Task], count: int, seed: int, announce: Announce | None = None
) -> Mapping[str, list[CorpusLine]]:
    """Make at most ``count`` requests per corpus of the tasks; the same materials and seed give the same requests.

    Args:
        announce: is called with every corpus before it is made.

    Raises:
        InvalidRequest: a task needs scenarios or maps, but there are none.
    """
    if not materials.scenarios or not materials.maps:
        raise InvalidRequest("the workspace has no scenario or no map", next_step="import some with import_files")
    possible = PossibleEdits(seed)
    makers: dict[str, tuple[Task, Callable[[Draw], Iterable[CorpusLine]]]] = {
        "generation": ("generation", lambda draw: generation_lines(materials, count, draw)),
        "selection": ("selection", lambda draw: selection_lines(materials, count, draw)),
        **{
            f"modification_{letter}": ("modification", _edits(letter, materials, possible, count)) for letter in LETTERS
        },
        "routing": ("routing", lambda draw: routing_lines(count, draw)),
        "tuning": ("tuning", lambda draw: tuning_lines(count, draw)),
        "e2e": ("e2e", lambda draw: conversation_lines(materials, possible, count, draw)),
    }
    made = {}
    for name, (task, maker) in makers.items():
        if task in tasks:
            if announce is not None:
                announce(name)
            made[name] = list(maker(random.Random(f"{seed}:{name}")))  # noqa: S311 - reproducible, no secret
    return made


def _edits(
    letter: str, materials: Materials, possible: PossibleEdits, count: int
) -> Callable[[Draw], Iterable[CorpusLine]]:
    return lambda draw: modification_lines(letter, materials, possible, count, draw)


def write_corpora(corpora: Mapping[str, Sequence[CorpusLine]], folder: Path, *, whole: bool) -> list[Path]:
    """Write corpora as files of JSON lines; return the paths.

    Args:
        whole: write all lines to one folder, instead of dividing the scenarios and maps between ``dev`` and ``test``.

    Raises:
        InvalidRequest: the folder cannot be written.
    """
    written = []
    for name, lines in corpora.items():
        by_split: dict[str, list[str]] = {}
        for line in lines:
            split = _split(line.about)
            texts = by_split.setdefault("" if whole else split, [])
            texts.append(_written(name, line, split, len(texts) + 1))
        for split, texts in by_split.items():
            path = folder / split / f"{name}.jsonl"
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text("\n".join(texts) + "\n", encoding="utf-8")
            except OSError as error:
                raise InvalidRequest(f"{path} cannot be written: {error}", next_step="use another --out") from error
            written.append(path)
    return written


def _split(about: str) -> str:
    return "test" if hashlib.sha256(about.encode()).digest()[0] % 2 else "dev"


def _written(name: str, line: CorpusLine, split: str, number: int) -> str:
    prefix = _PREFIXES.get(name) or f"mod{name.removeprefix('modification_')[0].upper()}"
    value = {
        "id": f"{prefix}-{split[0]}-{number:03d}",
        "task": name,
        "split": split,
        "text": line.text,
        **line.fields,
        "truth": line.truth,
        "expect": line.expect,
        "category": line.category,
        "style": line.style,
        "lang": "en",
        "note": "",
    }
    return json.dumps(value, ensure_ascii=False)
