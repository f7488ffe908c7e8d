"""``oracle``: the ground truth of a corpus as calls. Its results are the upper bound of the tools.

Arguments come from the truth alone, like those of a model that understands every request. Ids from earlier turns of a
conversation come from their answers. Unclear requests are answered with a question.
"""

import json
import re
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..schemas.base import Model
from .attempts import Attempt, EvalRequest, EvalTurn, MadeCall, ToolSession
from .ground_truth.generation import corpus_refusals, corpus_requests
from .ground_truth.modification import corpus_refusal, edit_of
from .ground_truth.selection import Request, arguments_of, refused_arguments

Arguments = Mapping[str, Any]
_MOVED = {"up": "+0.3", "down": "*0.5"}
"""The factor for a direction without a value (chosen)."""
_DETAILS = {
    "cost_terms": "costs",
    "recommendation": "findings",
    "correlation": "findings",
    "failure_reason": "timeline",
}
"""The detail of analyze_results for the question of a turn."""


@dataclass(frozen=True)
class Call:
    """A call to a tool."""

    tool: str
    arguments: Arguments


class Oracle:
    """An ``EvaluatedAgent`` that makes the calls of the ground truth."""

    name = "oracle"

    async def attempt(self, request: EvalRequest, tools: ToolSession) -> Attempt:
        """Make the calls of a request, turn by turn for a conversation; an unclear request gets a question instead."""
        began = time.perf_counter()
        if request.turns:
            made = [call async for call in _Conversation(tools).held(request.turns)]
        else:
            made = [await tools.call(call.tool, call.arguments) for call in calls_of(request)]
        asks = request.expect == "clarify" and not made
        refused = made[-1].is_error if made else request.expect == "refuse"
        turns = range(len(request.turns) or 1)
        answers = tuple("\n".join(call.text for call in made if call.turn == turn) for turn in turns)
        return Attempt(
            request.request_id,
            tuple(made),
            ("What exactly is meant?",) if asks else answers,
            "asked" if asks else "refused" if refused else "answered",
            duration_s=time.perf_counter() - began,
        )


def calls_of(request: EvalRequest) -> list[Call]:
    """Return the calls of a request that is not a conversation, in order; empty if a question is correct."""
    if request.expect == "clarify":
        return []
    if request.task == "selection":
        return [_selection(request)]
    if request.task == "tuning":
        return [_tuning(request)]
    return list({"generation": _generation, "modification": _modification, "routing": _routing}[request.task](request))


def _given(arguments: Model, without: Collection[str] = ()) -> Arguments:
    """Return arguments as a client sends them: only those that were given."""
    return arguments.model_dump(mode="json", exclude_defaults=True, exclude=set(without))


def _selection(request: EvalRequest) -> Call:
    truth = dict(request.truth)
    if request.expect == "refuse":
        refused = refused_arguments(Request(request.request_id, request.text, request.expect, truth))
        return Call("find_scenarios", {key: value for key, value in refused.items() if value})
    return Call("find_scenarios", _given(arguments_of(truth), {"limit"}))


def _generation(request: EvalRequest) -> list[Call]:
    line = json.dumps(
        {"id": request.request_id, "expect": request.expect, "map": request.map_file, "truth": request.truth}
    )
    maps = frozenset({request.map_file} if request.map_file else ())
    made = [
        Call("generate_scenarios", _given(one.arguments, request.truth.get("defaults", ())))
        for one in corpus_requests([line], maps)
    ]
    refused = [] if made else corpus_refusals([line])
    return made + [
        Call("generate_scenarios", {key: value for key, value in one.given.items() if value not in (None, [])})
        for one in refused
    ]


def _modification(request: EvalRequest) -> list[Call]:
    truths = request.truth.get("edits", [])
    if request.expect == "refuse":
        row = {"id": request.request_id, "text": request.text, "truth": request.truth, "task": request.corpus}
        refusal = corpus_refusal(row)
        edits = [] if refusal is None else list(refusal.edits)
    else:
        edits = [edit_of(truth) for truth in truths]
    scenario = str(request.scenario).removesuffix(".xml")
    written = [{"op": edit.op, **_given(edit)} for edit in edits]
    return [Call("modify_scenario", {"scenario_id": scenario, "edits": written})] if edits else []


def _tuning(request: EvalRequest) -> Call:
    truth, context = request.truth, request.context
    base = base_configuration(context)
    if request.expect == "refuse":
        return _refused_tuning(request)
    weights = [f"{name}={value}" for name, value in context.get("overrides", {}).items()] if not truth["preset"] else []
    named = {*truth.get("explicit", {}), *truth.get("relative", {})}
    weights = [text for text in weights if text.partition("=")[0] not in named]
    weights += [f"{name}={value}" for name, value in truth.get("explicit", {}).items()]
    for name, change in truth.get("relative", {}).items():
        weights.append(f"{name}={change['result']}")
    weights += [one["any_of"][0] + _MOVED[one["sign"]] for one in truth.get("direction", [])]
    chosen = {"preset": truth["preset"]} if truth.get("preset") else {}
    return Call("configure_planner", {**chosen, **({"weights": weights} if weights else {}), "base": base})


def base_configuration(context: Mapping[str, Any]) -> str:
    """Return the configuration before a request of the tuning corpus, as text."""
    return f"{context['planner']}:{context.get('preset') or 'Default'}"


def _refused_tuning(request: EvalRequest) -> Call:
    value = re.search(r"(?<![\w.])(?:minus |-)?\d*\.?\d+|inf\b", request.text)
    number = value[0].replace("minus ", "-") if value else "1"
    refused = [str(word).replace(" ", "_") for word in request.truth["refused"]]
    base = f"{request.context['planner']}:Default"
    if "preset" in request.text and refused == ["turbo"]:
        return Call("configure_planner", {"preset": refused[0], "base": base})
    return Call("configure_planner", {"weights": [f"{word}={number}" for word in refused], "base": base})


_ROUTED: Mapping[str, Call] = {
    "qa": Call("describe_catalog", {}),
    "param_qa": Call("list_planners", {}),
    "batch_qa": Call("list_artifacts", {"kind": "batch"}),
    "batch_sim": Call("run_planner", {"scenarios": ["preset:2"]}),
    "param_mod": Call("configure_planner", {"preset": "Comfort"}),
    "analysis": Call("analyze_results", {"results": ["latest_run"]}),
    "batch_analysis": Call("analyze_results", {"results": ["latest_batch"]}),
}
"""Calls that represent a class of requests without arguments in the corpus."""
_EDITS_BY_LETTER: Mapping[str, Arguments] = {
    "T": {"op": "reroute", "vehicles": ["nearest:1"], "turn": "straight"},
    "B": {"op": "set_behaviour", "vehicles": ["nearest:1"], "preset": "cautious"},
    "P": {"op": "remove_vehicle", "vehicles": ["nearest:1"]},
    "G": {"op": "set_goal", "turn": "straight"},
}


def _routing(request: EvalRequest) -> list[Call]:
    return routed_calls(request.truth["actions"], request.truth.get("vehicle_mod", ""))


def routed_calls(classes: Sequence[str], letters: str) -> list[Call]:
    """Return a representative call for each of the paper's routing classes; ``fail`` has none.

    ``letters``: the kinds of edits of ``vehicle_mod``, in canonical order.
    """
    edits = [_EDITS_BY_LETTER[letter] for letter in letters]
    edited = Call("modify_scenario", {"scenario_id": "latest", "edits": edits, "dry_run": True})
    return [edited if name == "vehicle_mod" else _ROUTED[name] for name in classes if name != "fail"]


@dataclass
class _Conversation:
    """A conversation with a server, turn by turn; stores what later turns build on."""

    tools: ToolSession
    scenario: str = ""
    found: list[str] = field(default_factory=list)
    search: str = ""
    config: str = "frenetix:Default"
    runs: dict[int, list[str]] = field(default_factory=dict)

    async def held(self, turns: Sequence[EvalTurn]) -> Any:
        """Return the calls of all turns; a turn that builds on a refused turn makes no calls."""
        for number, turn in enumerate(turns):
            for action in turn.action.split("+"):
                call = self.call_of(action, turn)
                if call is None:
                    continue
                made = await self.tools.call(call.tool, call.arguments, number)
                self.note(action, number + 1, made)
                yield made

    def call_of(self, action: str, turn: EvalTurn) -> Call | None:
        """Return the call for a turn's action, or None if the result that it builds on is missing."""
        truth = turn.truth
        if action == "generate":
            request = EvalRequest("", "generation", "generation", turn.text, truth, "ok", map_file=truth["map"])
            return next(iter(_generation(request)), None)
        if action == "select":
            return self._select(truth)
        if action == "modify":
            return self._modify(turn)
        if action == "tune":
            return self._tune(turn)
        if action == "test":
            return self._test(truth)
        if turn.expect == "refuse":
            return Call(f"{'analyze' if action == 'analyse' else 'compare'}_results", {})
        if action == "analyse":
            runs = self.runs.get(truth["about_turn"])
            details = [_DETAILS[ask] for ask in truth.get("asks", []) if ask in _DETAILS]
            arguments = {"detail": details[0]} if details else {}
            return Call("analyze_results", {"results": runs, **arguments}) if runs else None
        both = [self.runs.get(number) for number in truth.get("compare", truth)["between_turns"]]
        return Call("compare_results", {"results": [key for keys in both for key in keys or ()]}) if all(both) else None

    def _select(self, truth: Mapping[str, Any]) -> Call:
        if "slots" not in truth:
            return Call("describe_scenario", {"scenario_id": str(truth["scenario"]).removesuffix(".xml")})
        slots = truth["slots"]
        location = slots.get("location") or {}
        given: dict[str, Any] = {key: location[key] for key in ("country", "city") if location.get(key)}
        given |= {"tags": slots["tags"]} if "tags" in slots else {}
        counts = [f"{kind}>={count}" for kind, count in slots.get("obstacles", {}).items()]
        if "vehicle_count" in slots:
            counts.append(f"participants>={slots['vehicle_count']['min']}")
        given |= {"obstacles": counts} if counts else {}
        if "velocity" in slots:
            least, most = slots["velocity"].get("min_mps"), slots["velocity"].get("max_mps")
            both = f"{least}..{most}m/s" if least is not None and most is not None else ""
            given["ego_speed"] = both or (f">={least}m/s" if least is not None else f"<={most}m/s")
        return Call("find_scenarios", given)

    def _modify(self, turn: EvalTurn) -> Call | None:
        truth = turn.truth
        scenario = self.found[0] if truth.get("scenario") == "first_match" and self.found else self.scenario
        edits = [{"op": edit.op, **_given(edit)} for edit in map(edit_of, truth["edits"])]
        return Call("modify_scenario", {"scenario_id": scenario, "edits": edits}) if scenario else None

    def _tune(self, turn: EvalTurn) -> Call:
        truth = turn.truth
        if turn.expect == "refuse":
            reason, _, field_name = str(truth["reason"]).partition(":")
            number = re.search(r"-?\d+(?:\.\d+)?", turn.text)
            if reason == "unknown_preset":
                return Call("configure_planner", {"preset": "Turbo", "base": self.config})
            value = number[0] if number else "1"
            return Call("configure_planner", {"weights": [f"{field_name}={value}"], "base": self.config})
        weights = [f"{name}={value}" for name, value in truth.get("weights", {}).items()]
        weights += [one["any_of"][0] + _MOVED[one["sign"]] for one in truth.get("direction", [])]
        chosen = {"preset": truth["preset"]} if truth.get("preset") else {}
        named = {"weights": weights} if weights else {}
        return Call("configure_planner", {**chosen, **named, "base": self.config})

    def _test(self, truth: Mapping[str, Any]) -> Call | None:
        if truth["preset_named"] or truth["planner"] != "frenetix":
            self.config = f"{truth['planner']}:{truth['preset']}"
        all_of_them = truth["scenario"] == "all_matches"
        scenario = self.found[0] if truth["scenario"] == "first_match" and self.found else self.scenario
        wanted = self.search if all_of_them else scenario
        traffic = {"traffic": "reactive"} if truth["traffic"] == "reactive" else {}
        return Call("run_planner", {"scenarios": [wanted], "configs": [self.config], **traffic}) if wanted else None

    def note(self, action: str, turn: int, answer: MadeCall) -> None:
        """Store what later turns build on; ``turn`` counts from 1, as truths do."""
        if answer.is_error:
            return
        given = answer.structured
        if action == "generate":
            self.scenario = given["scenarios"][0]["scenario_id"]
        elif action == "select" and "search_id" in given:
            self.search = given["search_id"]
            self.found = [match["scenario_id"] for match in given["matches"]]
        elif action in ("select", "modify"):
            self.scenario = given["scenario_id"]
            self.found = []
        elif action == "tune":
            self.config = given["config_id"]
        elif action == "test":
            batch = given.get("batch_id") or next(iter(given.get("results", [])), None)
            self.runs[turn] = [batch] if batch else [run["run_id"] for run in given["runs"]]
