"""Records every answer to the requests of the dev corpora with its tokens, from this checkout or another one.

The calls are the ground truth: arguments of the selection, generation, modification and tuning corpora as their benches
use them, and each turn of a conversation in order, with the ids of earlier answers. The routing corpus names no
arguments, so one call represents each class of request. Requests that need a question back are not called. If work
becomes a job, only its last answer counts.
"""

import json
import os
import re
import statistics
import sys
from collections.abc import AsyncIterator, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from mcp import Client, StdioServerParameters
from mcp.types import CallToolResult

from plannerforge.evals.ground_truth.generation import corpus_refusals, corpus_requests
from plannerforge.evals.ground_truth.modification import corpus_refusal, edit_of
from plannerforge.evals.ground_truth.selection import Request, arguments_of, refused_arguments
from plannerforge.schemas.base import Model
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings
from plannerforge.server.tokens import count_tokens

from ..harness import percentile_95, shared_folder, shared_scenarios

CORPORA = ("selection", "tuning", "modification", "generation", "routing", "e2e")
_MODIFICATION = ("T", "B", "P", "G", "composite")
_WAIT_S = 50
_MOVED = {"up": "+0.3", "down": "*0.5"}
"""The change for a direction without a value (chosen)."""
_DETAILS = {
    "cost_terms": "costs",
    "recommendation": "findings",
    "correlation": "findings",
    "failure_reason": "timeline",
}
"""The detail of analyze_results that fits a turn's request."""
Arguments = Mapping[str, Any]


@dataclass(frozen=True)
class Call:
    """A call of a tool."""

    tool: str
    arguments: Arguments


@dataclass(frozen=True)
class Answer:
    """The answer to a call: all text that a client shows, the structured content, and whether it is an error."""

    call: Call
    text: str
    structured: Mapping[str, Any]
    is_error: bool


@dataclass(frozen=True)
class Recorded:
    """An answer of a corpus: its line and its cost."""

    corpus: str
    line: str
    tool: str
    arguments: Arguments
    text: str
    tokens: int
    is_error: bool


@dataclass(frozen=True)
class Summary:
    """The tokens of a recording's answers; ``of``: the checkout, ``command``: the recording command."""

    of: str
    command: str
    answers: int
    median: float
    p95: float
    by_tool: Mapping[str, tuple[int, float]] = field(default_factory=dict)
    by_corpus: Mapping[str, tuple[int, float]] = field(default_factory=dict)


def opened(
    workspace: Path, roots: Sequence[Path], checkout: Path | None = None, *, maps: Path | None = None
) -> AbstractAsyncContextManager[Client]:
    """Open a client of a server on a workspace, in this process or in a separate one with another checkout.

    Its maps are the built-in ones and those of a folder, by default the shared data.
    """
    maps = maps or shared_folder() / "data" / "osm"
    if checkout is None:
        settings = Settings(
            workspace=workspace,
            roots=tuple(roots),
            map_folders=(maps,),
            starter=False,
            warm_up=False,
            maps_online="offline",
            journal=False,
        )
        return Client(create_server(settings))
    environment = {
        **os.environ,
        "PYTHONPATH": str(checkout),
        "PLANNERFORGE_ROOTS": os.pathsep.join(map(str, roots)),
        "PLANNERFORGE_MAP_FOLDERS": str(maps),
        "PLANNERFORGE_STARTER": "false",
        "PLANNERFORGE_MAPS_ONLINE": "offline",
        "PLANNERFORGE_WARM_UP": "false",
        "PLANNERFORGE_JOURNAL": "false",
    }
    serve = ["-m", "plannerforge", "serve", "--workspace", str(workspace)]
    return Client(StdioServerParameters(command=sys.executable, args=serve, env=environment, cwd=workspace.parent))


async def answer_to(client: Client, call: Call) -> Answer:
    """Return the answer of a call; for work that becomes a job, the answer of ``get_job`` after its end."""
    result = await client.call_tool(call.tool, dict(call.arguments))
    while _is_running(result):
        job = str((result.structured_content or {})["job_id"])
        result = await client.call_tool("get_job", {"job_id": job, "wait_s": _WAIT_S})
    texts = [str(getattr(part, "text", "")) for part in result.content]
    return Answer(call, "\n".join(text for text in texts if text), result.structured_content or {}, result.is_error)


def _is_running(result: CallToolResult) -> bool:
    return (result.structured_content or {}).get("state") == "running"


async def record(
    workspace: Path, corpora: Collection[str] = CORPORA, checkout: Path | None = None, every: int = 1
) -> AsyncIterator[Recorded]:
    """Yield answers to all calls of the corpora, or to those of every n-th line of each, as they come."""
    scenarios, maps = shared_scenarios(), shared_folder() / "data" / "osm"
    async with opened(workspace, (scenarios, maps), checkout) as client:
        imported = await answer_to(client, Call("import_files", {"path": str(scenarios)}))
        if imported.is_error:
            raise RuntimeError(imported.text)
        for corpus in corpora:
            if corpus == "e2e":
                for row in _rows("e2e")[::every]:
                    async for found in _Conversation(client).held(row):
                        yield found
                continue
            for line, call in list(_single_calls(corpus))[::every]:
                yield _recorded(corpus, line, await answer_to(client, call))


def _recorded(corpus: str, line: str, answer: Answer) -> Recorded:
    tool, arguments = answer.call.tool, answer.call.arguments
    return Recorded(corpus, line, tool, arguments, answer.text, count_tokens(answer.text), answer.is_error)


def _rows(name: str) -> list[dict[str, Any]]:
    path = shared_folder() / "corpora" / "dev" / f"{name}.jsonl"
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def _single_calls(corpus: str) -> Iterator[tuple[str, Call]]:
    """Yield the line and the call of each request of a corpus of single requests."""
    if corpus == "selection":
        yield from ((row["id"], call) for row in _rows("selection") if (call := _selection_call(row)))
    elif corpus == "tuning":
        yield from ((row["id"], Call("configure_planner", _tuning(row))) for row in _rows("tuning") if _is_clear(row))
    elif corpus == "generation":
        lines = [json.dumps(row) for row in _rows("generation")]
        rows = {row["id"]: row for row in _rows("generation")}
        for request in corpus_requests(lines, _map_names()):
            yield request.name, _generation_call(request.arguments, rows[request.name]["truth"]["defaults"])
        for refusal in corpus_refusals(lines):
            given = {key: value for key, value in refusal.given.items() if value not in (None, [])}
            yield refusal.name, Call("generate_scenarios", given)
    elif corpus == "modification":
        for letter in _MODIFICATION:
            for row in _rows(f"modification_{letter}"):
                call = _modification_call(row)
                if call is not None:
                    yield row["id"], call
    else:
        for row in _rows("routing"):
            for action in row["truth"]["actions"]:
                if action in _ROUTED:
                    yield row["id"], _ROUTED[action]


_ROUTED: Mapping[str, Call] = {
    "qa": Call("describe_catalog", {}),
    "param_qa": Call("list_planners", {}),
    "batch_qa": Call("list_artifacts", {"kind": "batch"}),
    "batch_sim": Call("run_planner", {"scenarios": ["ZAM_Zip-1_6_T-1", "DEU_Moelln-7_1_T-1", "BEL_Antwerp-30_1_T-1"]}),
    "param_mod": Call("configure_planner", {"preset": "Comfort", "weights": ["prediction=0.45"]}),
    "analysis": Call("analyze_results", {"results": ["latest_run"]}),
    "batch_analysis": Call("analyze_results", {"results": ["latest_batch"]}),
    "vehicle_mod": Call("describe_scenario", {"scenario_id": "ZAM_Zip-1_6_T-1", "detail": "vehicles"}),
}
"""The call for a class of requests without written arguments; an edit begins with a look at the vehicles."""


def _map_names() -> frozenset[str]:
    return frozenset(path.name for path in (shared_folder() / "data" / "osm").iterdir() if ".osm" in path.name)


def _is_clear(row: Mapping[str, Any]) -> bool:
    return bool(row["expect"] != "clarify")


def _selection_call(row: Mapping[str, Any]) -> Call | None:
    if row["expect"] == "clarify":
        return None
    request = Request(row["id"], row["text"], row["expect"], row["truth"])
    if row["expect"] == "refuse":
        return Call("find_scenarios", {key: value for key, value in refused_arguments(request).items() if value})
    return Call("find_scenarios", _given(arguments_of(row["truth"]), {"limit"}))


def _given(arguments: Model, without: Collection[str] = ()) -> Arguments:
    """Return the arguments as a client sends them, without unset ones."""
    return arguments.model_dump(mode="json", exclude_defaults=True, exclude=set(without))


def _generation_call(arguments: Model, defaults: Collection[str]) -> Call:
    return Call("generate_scenarios", _given(arguments, defaults))


def _modification_call(row: Mapping[str, Any]) -> Call | None:
    if row["expect"] == "refuse":
        asked = corpus_refusal(row)
        edits = [] if asked is None else list(asked.edits)
    else:
        edits = [edit_of(truth) for truth in row["truth"].get("edits", [])] if row["expect"] == "ok" else []
    scenario = str(row["scenario"]).removesuffix(".xml")
    written = [{"op": edit.op, **_given(edit)} for edit in edits]
    return Call("modify_scenario", {"scenario_id": scenario, "edits": written}) if edits else None


def _tuning(row: Mapping[str, Any]) -> Arguments:
    """Return arguments of configure_planner for a line of the tuning corpus, on the configuration of its context."""
    truth, context = row["truth"], row["context"]
    if row["expect"] == "refuse":
        return _refused_tuning(row)
    weights = [f"{name}={value}" for name, value in truth.get("explicit", {}).items()]
    for name, change in truth.get("relative", {}).items():
        written = {"multiply": "*{by}", "add": "{by:+}", "copy": "={from}"}[change["op"]]
        weights.append(name + written.format(**change))
    weights += [one["any_of"][0] + _MOVED[one["sign"]] for one in truth.get("direction", [])]
    chosen = {"preset": truth["preset"]} if truth.get("preset") else {}
    base = f"{context['planner']}:{context.get('preset') or 'Default'}"
    return {**chosen, **({"weights": weights} if weights else {}), "base": base}


def _refused_tuning(row: Mapping[str, Any]) -> Arguments:
    value = re.search(r"(?<![\w.])(?:minus |-)?\d*\.?\d+|inf\b", row["text"])
    number = value[0].replace("minus ", "-") if value else "1"
    refused = [str(word).replace(" ", "_") for word in row["truth"]["refused"]]
    base = f"{row['context']['planner']}:Default"
    if "preset" in row["text"] and refused == ["turbo"]:
        return {"preset": refused[0], "base": base}
    return {"weights": [f"{word}={number}" for word in refused], "base": base}


class _Conversation:
    """A conversation of the corpus with a server, turn by turn."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._scenario = ""
        self._found: list[str] = []
        self._search = ""
        self._config = "frenetix:Default"
        self._runs: dict[int, list[str]] = {}

    async def held(self, row: Mapping[str, Any]) -> AsyncIterator[Recorded]:
        """Yield the answers of its turns; a turn that depends on a refused one calls nothing."""
        for turn in row["turns"]:
            for action in str(turn["action"]).split("+"):
                call = self._call(action, turn)
                if call is None:
                    continue
                answer = await answer_to(self._client, call)
                self._note(action, turn, answer)
                yield _recorded("e2e", f"{row['id']}.{turn['turn']}", answer)

    def _call(self, action: str, turn: Mapping[str, Any]) -> Call | None:
        truth = turn["truth"]
        if action == "generate":
            line = json.dumps({"id": "", "expect": "ok", "map": truth["map"], "truth": truth})
            requests = corpus_requests([line], _map_names())
            return _generation_call(requests[0].arguments, truth["defaults"]) if requests else None
        if action == "select":
            return self._select(truth)
        if action == "modify":
            return self._modify(truth)
        if action == "tune":
            return self._tune(turn)
        if action == "test":
            return self._test(truth)
        if turn["expect"] == "refuse":
            return Call(f"{'analyze' if action == 'analyse' else 'compare'}_results", {})
        if action == "analyse":
            runs = self._runs.get(truth["about_turn"])
            details = [_DETAILS[ask] for ask in truth.get("asks", []) if ask in _DETAILS]
            asked = {"detail": details[0]} if details else {}
            return Call("analyze_results", {"results": runs, **asked}) if runs else None
        between = truth.get("compare", truth)["between_turns"]
        both = [self._runs.get(number) for number in between]
        return Call("compare_results", {"results": [key for keys in both for key in keys or ()]}) if all(both) else None

    def _select(self, truth: Mapping[str, Any]) -> Call:
        if "slots" not in truth:
            return Call("describe_scenario", {"scenario_id": str(truth["scenario"]).removesuffix(".xml")})
        slots = truth["slots"]
        location = slots.get("location") or {}
        given = {key: location[key] for key in ("country", "city") if location.get(key)}
        given |= {"tags": slots["tags"]} if "tags" in slots else {}
        counts = [f"{kind}>={count}" for kind, count in slots.get("obstacles", {}).items()]
        if "vehicle_count" in slots:
            counts.append(f"car>={slots['vehicle_count']['min']}")
        given |= {"obstacles": counts} if counts else {}
        if "velocity" in slots:
            least, most = slots["velocity"].get("min_mps"), slots["velocity"].get("max_mps")
            both = f"{least}..{most}m/s" if least is not None and most is not None else ""
            given["ego_speed"] = both or (f">={least}m/s" if least is not None else f"<={most}m/s")
        return Call("find_scenarios", given)

    def _modify(self, truth: Mapping[str, Any]) -> Call | None:
        scenario = self._found[0] if truth.get("scenario") == "first_match" and self._found else self._scenario
        edits = [{"op": edit.op, **_given(edit)} for edit in map(edit_of, truth["edits"])]
        return Call("modify_scenario", {"scenario_id": scenario, "edits": edits}) if scenario else None

    def _tune(self, turn: Mapping[str, Any]) -> Call:
        truth = turn["truth"]
        if turn["expect"] == "refuse":
            reason, _, field_name = str(truth["reason"]).partition(":")
            number = re.search(r"-?\d+", turn["text"])
            if reason == "unknown_preset":
                return Call("configure_planner", {"preset": "Turbo", "base": self._config})
            value = number[0] if number else "1"
            return Call("configure_planner", {"weights": [f"{field_name}={value}"], "base": self._config})
        weights = [f"{name}={value}" for name, value in truth.get("weights", {}).items()]
        weights += [one["any_of"][0] + _MOVED[one["sign"]] for one in truth.get("direction", [])]
        chosen = {"preset": truth["preset"]} if truth.get("preset") else {}
        return Call("configure_planner", {**chosen, **({"weights": weights} if weights else {}), "base": self._config})

    def _test(self, truth: Mapping[str, Any]) -> Call | None:
        if truth["preset_named"] or truth["planner"] != "frenetix":
            self._config = f"{truth['planner']}:{truth['preset']}"
        all_of_them = truth["scenario"] == "all_matches"
        scenario = self._found[0] if truth["scenario"] == "first_match" and self._found else self._scenario
        wanted = self._search if all_of_them else scenario
        traffic = {"traffic": "reactive"} if truth["traffic"] == "reactive" else {}
        return Call("run_planner", {"scenarios": [wanted], "configs": [self._config], **traffic}) if wanted else None

    def _note(self, action: str, turn: Mapping[str, Any], answer: Answer) -> None:
        """Keep the values that later turns need."""
        if answer.is_error:
            return
        given = answer.structured
        if action == "generate":
            self._scenario = given["scenarios"][0]["scenario_id"]
        elif action == "select" and "search_id" in given:
            self._search = given["search_id"]
            self._found = [match["scenario_id"] for match in given["matches"]]
        elif action in ("select", "modify"):
            self._scenario = given["scenario_id"]
        elif action == "tune":
            self._config = given["config_id"]
        elif action == "test":
            batch = given.get("batch_id") or next(iter(given.get("results", [])), None)
            self._runs[turn["turn"]] = [batch] if batch else [run["run_id"] for run in given["runs"]]


def summary_of(answers: Sequence[Recorded], of: str, command: str) -> Summary:
    """Return median and 95th percentile of the tokens of all answers, and counts and medians by tool and by corpus."""
    tokens = [answer.tokens for answer in answers]

    def by(name: str) -> dict[str, tuple[int, float]]:
        groups: dict[str, list[int]] = {}
        for answer in answers:
            groups.setdefault(str(getattr(answer, name)), []).append(answer.tokens)
        return {key: (len(values), statistics.median(values)) for key, values in sorted(groups.items())}

    return Summary(of, command, len(tokens), statistics.median(tokens), percentile_95(tokens), by("tool"), by("corpus"))


def written(value: Summary | Recorded) -> str:
    """Return a summary or an answer as one line of JSON."""
    return json.dumps(asdict(value), ensure_ascii=False)


def read_recording(path: Path) -> list[Recorded]:
    """Return the answers that ``written`` wrote, one per line."""
    return [Recorded(**json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines()]
