"""Floors: the results of keywords alone, ``regex`` in routing and ``bm25`` in selection.

The paper (Quantitative Evaluation) gives the two methods and their figures, but neither the rules of its router nor the
texts that it searched. The rules here were written once, with a few development requests of each class in view, and did
not change after they were first scored.
"""

import re
import time
from collections.abc import Mapping, Sequence

from .attempts import Attempt, EvalRequest, MadeCall, Task, ToolSession
from .oracle import routed_calls

_PLANNING_WORDS = r"weights?|presets?|parameters?|costs?|comfort\w*|balanced|sporty|safety|prediction|jerk|velocity\w*"
_CHANGES = r"set|change|use|switch|raise|lower|increase|decrease|reduce|double|halve"
_ASKS = r"(?:what|which|how|can|could|does|do|is|are|may)\b"
_RULES: Sequence[tuple[str, str]] = (
    ("batch_analysis", r"\b(?:compare|summar\w+|analy[sz]e|results?|failed)\b.*\bbatch|\bbatch\w*\b.*\bresults?\b"),
    ("batch_qa", rf"^{_ASKS}.*\bbatch"),
    ("batch_sim", r"\bbatch|\b(?:run|simulate|start)\b.*\bscenarios?\b"),
    ("param_mod", rf"\b(?:{_CHANGES})\b.*\b(?:{_PLANNING_WORDS})\b"),
    ("param_qa", rf"\b(?:{_PLANNING_WORDS})\b"),
    ("vehicle_mod", r"\b(?:vehicles?|cars?|trucks?|bus(?:es)?|goal|obstacles?)\b"),
    ("analysis", r"\b(?:analy[sz]e|why|last run|simulation|collision)\b"),
    ("qa", rf"^{_ASKS}|^explain\b|\?$"),
)
"""Classes with their patterns, in the order in which they are tried; chosen."""
_LETTERS: Mapping[str, str] = {
    "T": r"\b(?:re-?route|route|trajectory|turn|send)\b",
    "B": r"\b(?:aggressive|cautious|normal|speeders?|eco|behaviou?r)\b",
    "P": r"\b(?:add|remove|delete|insert|spawn)\b",
    "G": r"\bgoal\b",
}
"""Kinds of edits with their patterns; chosen."""
_SEEN = 5
"""Results of a keyword search that count, as in the paper."""


class RegexRouter:
    """An ``EvaluatedAgent`` that picks the first class with a pattern in the last turn; for routing only.

    A class becomes calls as in the ground truth; a text that matches no pattern is refused.
    """

    name = "regex"

    async def attempt(self, request: EvalRequest, tools: ToolSession) -> Attempt:
        """Make the calls of the matching class."""
        if request.task != "routing":
            return _not_for(request, self.name, "routing")
        began = time.perf_counter()
        found, letters = class_of(request.text)
        made = [await tools.call(call.tool, call.arguments) for call in routed_calls([found], letters)]
        return _answered(request, made, time.perf_counter() - began)


class KeywordSearch:
    """An ``EvaluatedAgent`` for selection that searches for the request's text by BM25, without conditions."""

    name = "bm25"

    async def attempt(self, request: EvalRequest, tools: ToolSession) -> Attempt:
        """Make one search; the nearest results count as found."""
        if request.task != "selection":
            return _not_for(request, self.name, "selection")
        began = time.perf_counter()
        arguments = {"text": request.text, "method": "bm25", "limit": _SEEN}
        made = [await tools.call("find_scenarios", arguments)]
        return _answered(request, made, time.perf_counter() - began)


def class_of(text: str) -> tuple[str, str]:
    """Return the class of a request by its first pattern, and the letters of its edits in canonical order."""
    lowered = text.strip().lower()
    found = next((name for name, pattern in _RULES if re.search(pattern, lowered)), "fail")
    letters = "".join(letter for letter, pattern in _LETTERS.items() if re.search(pattern, lowered))
    if found == "vehicle_mod" and not letters:
        return "fail", ""
    return found, letters if found == "vehicle_mod" else ""


def _answered(request: EvalRequest, made: Sequence[MadeCall], duration_s: float) -> Attempt:
    done = bool(made) and not made[-1].is_error
    texts = tuple(call.text for call in made[-1:])
    return Attempt(request.request_id, tuple(made), texts, "answered" if done else "refused", duration_s=duration_s)


def _not_for(request: EvalRequest, name: str, task: Task) -> Attempt:
    return Attempt(request.request_id, (), (), "failed", failure=f"{name} is a floor of {task} and does nothing else")
