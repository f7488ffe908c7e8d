"""Detects texts that replace calls: a call written as text, or a claim of work without a call."""

import json
import re
from collections.abc import Collection, Iterator
from typing import Any

_DONE = (
    "added|adjusted|analysed|analyzed|applied|changed|compared|configured|created|edited|executed|exported|found|"
    "generated|imported|made|modified|moved|optimised|optimized|produced|ran|removed|rendered|rerouted|run|searched|"
    "selected|set up|started|tested|updated"
)
_THING = (
    "batch|cars?|changes?|configurations?|edits?|everything|files?|goal|it|pictures?|planner|preset|runs?|scenarios?|"
    "simulations?|they|this|trucks?|vehicles?|weights?"
)
_CLAIM = re.compile(
    rf"\b(?:I|we)(?:['’]ve| have)? (?:(?:now|just|successfully|already) )*(?:{_DONE})\b"
    rf"|\b(?:{_THING}) (?:has|have) (?:now |just |successfully )*been (?:successfully )?(?:{_DONE})\b"
    rf"|\bsuccessfully (?:{_DONE})\b",
    re.IGNORECASE,
)
_NAME_KEYS, _ARGUMENT_KEYS = ("name", "tool", "function"), ("arguments", "parameters", "args", "input")


def claims_work(text: str) -> bool:
    """Return True if a text claims that something was done (generated, modified, run …)."""
    return bool(_CLAIM.search(text))


def written_call(text: str, tools: Collection[str]) -> str:
    """Return the tool of a call that a text contains as JSON, in marks or as a function; empty if there is none."""
    for value in _objects(text):
        name = next((value[key] for key in _NAME_KEYS if isinstance(value.get(key), str)), "")
        if name in tools and (len(value) == 1 or any(key in value for key in _ARGUMENT_KEYS)):
            return str(name)
    names = "|".join(re.escape(name) for name in tools) or r"(?!)"
    found = re.search(rf"^[\s`>*-]*({names})\((?:\s*\)|[^)]*[=:{{\"'])", text, re.MULTILINE)
    found = found or re.search(
        rf"^\W*(?:call|action|tool|function)\W{{1,6}}({names})\b", text, re.MULTILINE | re.IGNORECASE
    )
    found = found or re.search(rf"<(?:tool_call|function)\b[^{{]*?({names})", text)
    return found[1] if found else ""


def _objects(text: str) -> Iterator[dict[str, Any]]:
    decoder = json.JSONDecoder()
    for start in [match.start() for match in re.finditer(r"\{", text)][:50]:
        try:
            value, _ = decoder.raw_decode(text, start)
        except (ValueError, RecursionError):
            continue
        if isinstance(value, dict):
            yield value
