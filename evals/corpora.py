"""Corpora: files of requests with their ground truth, one JSON object per line; the package's, or a user's own."""

import json
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, get_args

from pydantic import TypeAdapter, ValidationError

from ..schemas.errors import InvalidRequest, UnknownName
from .attempts import EvalRequest, EvalTurn, Task

TASKS: tuple[Task, ...] = get_args(Task)
"""All tasks, in the order of ``all``."""
CORPORA: Mapping[Task, tuple[str, ...]] = {
    "generation": ("generation",),
    "selection": ("selection",),
    "modification": tuple(f"modification_{letter}" for letter in ("T", "B", "P", "G", "composite")),
    "routing": ("routing",),
    "tuning": ("tuning",),
    "e2e": ("e2e",),
}
"""Names of the corpora of each task: a file has this name with the ending ``.jsonl``."""
_READ: TypeAdapter[EvalRequest] = TypeAdapter(EvalRequest)


def packaged_corpora() -> Path:
    """Return the folder of the corpora that come with the package."""
    return Path(str(files(__package__) / "packaged"))


def corpus_files(place: Path, task: str) -> list[Path]:
    """Return the files of a task's corpora: those that exist in a folder, or the file itself.

    Args:
        place: a corpus file, or a folder with files named after ``CORPORA``.
        task: one of ``TASKS``, or ``all``.

    Raises:
        UnknownName: there is no such task.
        InvalidRequest: the folder has no file of the task, or does not exist.
    """
    if task != "all" and task not in TASKS:
        raise UnknownName(f"there is no task '{task}'", valid=(*TASKS, "all"), next_step="use one of them")
    if place.is_file():
        return [place]
    names = [name for known in TASKS if task in ("all", known) for name in CORPORA[known]]
    found = [place / f"{name}.jsonl" for name in names if (place / f"{name}.jsonl").is_file()]
    if not found:
        raise InvalidRequest(
            f"{place} has no corpus of {task}",
            valid=[f"{name}.jsonl" for name in names],
            next_step="use a corpus file or a folder of them; `plannerforge corpus make` creates one",
        )
    return found


def read_corpus(path: Path) -> tuple[EvalRequest, ...]:
    """Return the requests of a corpus file, in file order.

    Raises:
        InvalidRequest: a line is not a request, or an id occurs twice; the error gives the line and the reason.
    """
    found: dict[str, EvalRequest] = {}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            request = _request(json.loads(line))
        except (json.JSONDecodeError, KeyError, TypeError, AttributeError, ValidationError) as error:
            problem = f"{error.args[0]} is missing" if isinstance(error, KeyError) else str(error).replace("\n", " ")
            raise InvalidRequest(
                f"line {number} of {path.name} is not a request: {problem}",
                next_step="write it like the lines of the packaged corpora; docs/evaluation.md lists the fields",
            ) from error
        if request.request_id in found:
            raise InvalidRequest(
                f"line {number} of {path.name} has the id {request.request_id} of an earlier line",
                next_step="give every line a unique id",
            )
        found[request.request_id] = request
    return tuple(found.values())


def _request(line: Mapping[str, Any]) -> EvalRequest:
    corpus = str(line["task"])
    return _READ.validate_python(
        {
            "request_id": line["id"],
            "task": corpus.partition("_")[0],
            "corpus": corpus,
            "text": line["text"],
            "truth": line["truth"],
            "expect": line["expect"],
            "category": line.get("category", ""),
            "scenario": line.get("scenario"),
            "map_file": line.get("map"),
            "history": tuple((turn["role"], turn["text"]) for turn in line.get("history", ())),
            "context": line.get("context", {}),
            "turns": tuple(
                EvalTurn(turn["text"], turn["action"], turn["truth"], turn["expect"]) for turn in line.get("turns", ())
            ),
        }
    )
