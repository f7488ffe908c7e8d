"""The story that every client follows call by call, and the required content of the workspace after each call.

A scripted model tells it (``model.py``): each call uses what the client showed of earlier answers, as a model would.
Two successive calls are wrong on purpose, to show how a client handles refusals.

Only the server's records count, never a client's statements: the journal of calls, and the artifacts.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from plannerforge.engine.workspace import Workspace

REQUEST = (
    "Find a scenario with at least two cars, make one of its cars drive aggressively, run Frenetix with its presets "
    "Default and Safety-Conservative on it, compare the two and draw the scenario."
)
"""The user's request."""
CLOSING = "Both runs are compared and the picture is drawn"
"""A part of the model's last message, which proves that the story reached its end."""
STEPS = ("find_scenarios", "modify_scenario", "run_planner", "compare_results", "render")
"""The required tools, in this order."""
_CONFIGS = ("frenetix:Default", "frenetix:Safety-Conservative")
_NO_SCENARIO, _NO_VEHICLE = "DEU_Nowhere-1_1_T-1", "999999"
_SCENARIO = re.compile(r"\b[A-Z]{3}_[A-Za-z]\w*-\d+_\d+_T-\d+")
_VEHICLE = re.compile(r"- (\d+) car:|vehicle_id\\*\"?: ?(\d+)")
_BATCH, _JOB = re.compile(r"\bbatch_[0-9a-f]{8,}"), re.compile(r"\bjob_[0-9a-f]{8,}")
_PNG, _PNG_AS_TEXT = b"\x89PNG\r\n\x1a\n", "iVBORw0KGgo"
_WRONG_EDITS = 2
_UNKNOWN = "unknown"
"""The name in a journal of a client that did not give one."""


@dataclass(frozen=True)
class ShownResult:
    """What a client showed its model or user of the answer to one call.

    Args:
        tool: the server's name of the tool.
        text: all text as shown, including structured content and links.
        pictures: number of pictures shown as pictures.
    """

    tool: str
    text: str
    pictures: int = 0


@dataclass(frozen=True)
class Move:
    """The model's next message: a call, or the last message if it has no tool."""

    tool: str = ""
    arguments: Mapping[str, Any] = field(default_factory=dict)
    text: str = ""


def next_move(shown: Sequence[ShownResult]) -> Move:
    """Return the model's next message after what it was shown so far."""
    told = _with_waits(shown)
    moves = (_find, _describe, _in_no_scenario, _with_no_vehicle, _modify, _run, _compare, _draw)
    if len(told) == len(moves):
        return Move(text=f"{CLOSING}. {_first_line(told[6].text)}")
    try:
        if moves[len(told)] is _compare and (job := _unfinished(told[-1])):
            return Move("get_job", {"job_id": job, "wait_s": 50})
        return moves[len(told)](told)
    except LookupError as missing:
        return Move(text=f"The answers that I was shown hold no {missing.args[0]}: I cannot go on.")


def _with_waits(shown: Sequence[ShownResult]) -> list[ShownResult]:
    """Return the results, with reports on a job assigned to the call that started it."""
    told: list[ShownResult] = []
    for result in shown:
        if result.tool == "get_job" and told:
            told[-1] = replace(told[-1], text=f"{told[-1].text}\n{result.text}")
        else:
            told.append(result)
    return told


def _find(told: Sequence[ShownResult]) -> Move:
    del told
    return Move("find_scenarios", {"obstacles": ["car>=2"], "limit": 3})


def _describe(told: Sequence[ShownResult]) -> Move:
    return Move("describe_scenario", {"scenario_id": _scenario(told[0]), "detail": "vehicles"})


def _in_no_scenario(told: Sequence[ShownResult]) -> Move:
    return _edit(_NO_SCENARIO, _vehicle(told[1]))


def _with_no_vehicle(told: Sequence[ShownResult]) -> Move:
    return _edit(_scenario(told[0]), _NO_VEHICLE)


def _modify(told: Sequence[ShownResult]) -> Move:
    return _edit(_scenario(told[0]), _vehicle(told[1]))


def _run(told: Sequence[ShownResult]) -> Move:
    return Move("run_planner", {"scenarios": [_edited(told)], "configs": list(_CONFIGS), "wait_s": 50})


def _compare(told: Sequence[ShownResult]) -> Move:
    return Move("compare_results", {"results": [_first(_BATCH, told[5], "id of a batch")]})


def _draw(told: Sequence[ShownResult]) -> Move:
    return Move("render", {"ids": [_edited(told)]})


def _edit(scenario_id: str, vehicle_id: str) -> Move:
    edit = {"op": "set_behaviour", "vehicles": [vehicle_id], "preset": "aggressive"}
    return Move("modify_scenario", {"scenario_id": scenario_id, "edits": [edit]})


def _scenario(result: ShownResult) -> str:
    return _first(_SCENARIO, result, "id of a scenario")


def _edited(told: Sequence[ShownResult]) -> str:
    """Return the id in the answer to the edit that is not the base's."""
    made = [found for found in _SCENARIO.findall(told[4].text) if found != _scenario(told[0])]
    if not made:
        raise LookupError("id of an edited scenario")
    return str(made[0])


def _vehicle(result: ShownResult) -> str:
    return _first(_VEHICLE, result, "id of a vehicle")


def _first(pattern: re.Pattern[str], result: ShownResult, what: str) -> str:
    found = pattern.search(result.text)
    if found is None:
        raise LookupError(what)
    return next(group for group in (*found.groups(), found[0]) if group)


def _unfinished(result: ShownResult) -> str:
    """Return the job to wait for, empty if the runs are done."""
    return "" if _BATCH.search(result.text) else _first(_JOB, result, "id of a job")


def _first_line(text: str) -> str:
    return text.strip().partition("\n")[0][:200]


Pictures = Literal["shown", "as text", "not shown"]
Answers = Literal["text", "structure", "both", "nothing"]


@dataclass(frozen=True)
class ShownSummary:
    """What a client passes on: the form of an answer, pictures, links, and the text of a refusal."""

    answers: Answers
    pictures: Pictures
    links: bool
    refusals: bool


def summary_of(shown: Sequence[ShownResult]) -> ShownSummary:
    """Return what a client passed on of one story's answers; only the drawing shows pictures."""
    edits = [result.text for result in shown if result.tool == "modify_scenario"]
    text = any("1 edit done" in told for told in edits)
    structure = any("base_id" in told for told in edits)
    answers: Answers = "both" if text and structure else "text" if text else "structure" if structure else "nothing"
    drawn = [result for result in shown if result.tool == "render"]
    as_text = any(_PNG_AS_TEXT in result.text for result in drawn)
    pictures: Pictures = "shown" if any(result.pictures for result in drawn) else "as text" if as_text else "not shown"
    links = any("plannerforge://scenario/" in told for told in edits)
    return ShownSummary(answers, pictures, links, refusals=any("Valid:" in told for told in edits))


@dataclass(frozen=True)
class JournalledCall:
    """A line of the server's journal: caller, call and result; ``error`` is empty if the call succeeded."""

    client: str
    tool: str
    result_ids: tuple[str, ...] = ()
    error: str = ""


@dataclass(frozen=True)
class StoredWork:
    """The content of a workspace after a story.

    Args:
        calls: the journal, oldest first.
        bases: edited scenario → its source.
        runs: run → scenario and configuration.
        pictures: valid picture files.
    """

    calls: tuple[JournalledCall, ...]
    bases: Mapping[str, str]
    runs: Mapping[str, tuple[str, str]]
    pictures: tuple[str, ...]


def stored_work(root: Path) -> StoredWork:
    """Read what an ended server left in its workspace; a missing part is empty."""
    journal = root / "journal" / "calls.jsonl"
    lines = journal.read_text(encoding="utf-8").splitlines() if journal.is_file() else []
    calls = tuple(_call(json.loads(line)) for line in lines)
    pictures = tuple(
        path.name for path in sorted((root / "pictures").glob("*.png")) if path.read_bytes().startswith(_PNG)
    )
    if not (root / "workspace.sqlite").is_file():
        return StoredWork(calls, {}, {}, pictures)
    workspace = Workspace(root)
    try:
        artifacts = workspace.newest(limit=1000)
    finally:
        workspace.close()
    bases = {one.artifact_id: one.recipe.parents[0] for one in artifacts if one.recipe.tool == "modify_scenario"}
    runs = {
        one.artifact_id: (one.record["scenario_id"], one.record["config_id"]) for one in artifacts if one.kind == "run"
    }
    return StoredWork(calls, bases, runs, pictures)


def _call(line: Mapping[str, Any]) -> JournalledCall:
    return JournalledCall(line["client"], line["tool"], tuple(line["result_ids"]), line["error"])


def faults_of(work: StoredWork, said: str, own_name: str = "") -> list[str]:
    """Describe what a complete story lacks, empty if it is complete.

    Args:
        work: the server's records.
        said: all that the client showed its user at the end.
        own_name: the client's own name, if known apart from the journal.
    """
    done = [call for call in work.calls if not call.error]
    missing = [tool for tool in STEPS if tool not in {call.tool for call in done}]
    faults = [f"not carried out: {', '.join(missing)}"] if missing else []
    if not missing and not _in_order([call.tool for call in done]):
        faults.append(f"the steps were not carried out in the order {', '.join(STEPS)}")
    faults += _refusal_faults(work.calls) + _name_faults(work.calls, own_name)
    edited = {made: base for made, base in work.bases.items() if made in _result_ids(done, "modify_scenario")}
    found = _result_ids(done, "find_scenarios")
    if not any(base in found for base in edited.values()):
        faults.append("no scenario that was found was modified")
    compared = _result_ids(done, "compare_results")
    on_edited = {run: config for run, (scenario, config) in work.runs.items() if scenario in edited}
    if len(set(on_edited.values())) < len(_CONFIGS):
        faults.append(f"{len(set(on_edited.values()))} configurations ran on the modified scenario, not two")
    elif len({config for run, config in on_edited.items() if run in compared}) < len(_CONFIGS):
        faults.append("the comparison does not hold a run of both configurations")
    if not work.pictures:
        faults.append("there is no file of a picture")
    if CLOSING not in " ".join(said.split()):
        faults.append("the model's last message did not reach the user")
    return faults


def _refusal_faults(calls: Sequence[JournalledCall]) -> list[str]:
    goes_on = goes_on_after_refusals(calls)
    if goes_on is None:
        return [f"fewer than {_WRONG_EDITS} wrong edits reached the server"]
    return [] if goes_on else ["nothing was carried out after the refusals"]


def goes_on_after_refusals(calls: Sequence[JournalledCall]) -> bool | None:
    """Return whether a call succeeded after both wrong edits, or None if they were not made."""
    refused = [place for place, call in enumerate(calls) if call.error and call.tool == "modify_scenario"]
    return None if len(refused) < _WRONG_EDITS else any(not call.error for call in calls[refused[-1] :])


def _name_faults(calls: Sequence[JournalledCall], own_name: str) -> list[str]:
    names = {call.client for call in calls}
    if not all(name.strip() and not name.startswith(_UNKNOWN) for name in names):
        return ["the journal does not name the client"]
    if len(names) > 1:
        return [f"the journal names several clients: {', '.join(sorted(names))}"]
    if own_name and names and names != {own_name}:
        return [f"the journal names {names.pop()}, and the client calls itself {own_name}"]
    return []


def _result_ids(calls: Sequence[JournalledCall], tool: str) -> set[str]:
    return {made for call in calls if call.tool == tool for made in call.result_ids}


def _in_order(tools: Sequence[str]) -> bool:
    left = iter(tools)
    return all(step in left for step in STEPS)
