"""Reads the first suggestion of a refusal from its text with regular expressions, as a literal reader does.

It uses nothing of the product: neither its classes nor the metadata of its answers.
"""

import copy
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_NEXT = re.compile(r"(?:^|\s)Next: (.+)$", re.DOTALL)
_VALID = re.compile(r"\sValid: (.+?)\.? Next: ", re.DOTALL)
_CALL = re.compile(
    r"call again with the same arguments, but (?P<changed>.+)"
    r"|call again with (?P<again>\{.*)"
    r"|call (?P<tool>render|[a-z]+_[a-z_]+)(?: with (?P<arguments>\{.*))?(?: without (?P<dropped>\w+))?",
    re.DOTALL,
)
_WORD = re.compile(r"'([^']+)'|“([^”]+)”|\b(\d{2,})\b")
_PART = re.compile(r"(?:, | and )?(?P<kind>without |with )?(?P<path>[\w\[\]]+(?:\.[\w\[\]]+)*)")


@dataclass(frozen=True)
class Suggested:
    """A call that a text suggests."""

    tool: str
    arguments: Mapping[str, Any]


def first_suggestion(text: str, tool: str, arguments: Mapping[str, Any]) -> Suggested | None:
    """Return the first call that a refusal suggests, or None if its text suggests no call that can be made as it is.

    If it has no call but lists valid values, the first of these replaces the value that the refusal quotes.
    """
    found = _NEXT.search(text)
    if found is None:
        return None
    call = _CALL.search(found[1])
    if call is None:
        replaced = _with_first_valid(text, arguments)
        return None if replaced is None else Suggested(tool, replaced)
    if call["changed"]:
        parts = _with_parts(call["changed"], arguments)
        return None if parts is None else Suggested(tool, parts)
    if call["again"]:
        value = _leading_object(call["again"])
        return None if value is None else Suggested(tool, value)
    if call["dropped"]:
        return Suggested(call["tool"], {name: value for name, value in arguments.items() if name != call["dropped"]})
    value = _leading_object(call["arguments"]) if call["arguments"] else {}
    return None if value is None else Suggested(call["tool"], value)


def _with_first_valid(text: str, arguments: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the arguments with the value that a refusal quotes replaced by its first valid value, or None."""
    valid = _VALID.search(text)
    if valid is None:
        return None
    first = valid[1].split(", ")[0].strip("“”'")
    for words in _WORD.findall(text[: valid.start()]):
        word = next(filter(None, words))
        written = json.dumps(dict(arguments), ensure_ascii=False)
        pattern = rf"(?<![\w-]){re.escape(json.dumps(word, ensure_ascii=False)[1:-1])}(?![\w-])"
        replaced, count = re.subn(pattern, lambda _: json.dumps(first, ensure_ascii=False)[1:-1], written, count=1)
        if count:
            value: dict[str, Any] = json.loads(replaced)
            return value
    return None


def _leading_object(text: str) -> dict[str, Any] | None:
    try:
        value, _ = json.JSONDecoder().raw_decode(text)
    except ValueError:
        return None
    return value if isinstance(value, dict) else None


def _with_parts(text: str, arguments: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the arguments with ``without edits[0].lane and with seed=3`` applied, or None for another text."""
    changed, position = copy.deepcopy(dict(arguments)), 0
    is_removed = False
    while (part := _PART.match(text, position)) is not None:
        position, value = part.end(), None
        is_removed = part["kind"].strip() == "without" if part["kind"] else is_removed
        if not is_removed:
            try:
                value, position = json.JSONDecoder().raw_decode(text, position + 1)
            except ValueError:
                return None
        *holders, last = [int(one) if one.isdigit() else one for one in re.findall(r"\w+", part["path"])]
        holder: Any = changed
        for one in holders:
            holder = holder[one]
        if is_removed:
            holder.pop(last, None)
        else:
            holder[last] = value
    return changed if position else None
