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
_AGAIN = re.compile(r"call again with (\{.*)", re.DOTALL)
_CHANGED = re.compile(r"call again with the same arguments but (.+)", re.DOTALL)
_OTHER = re.compile(r"call ([a-z_]+)(?: with (\{.*))?", re.DOTALL)
_PART = re.compile(r"(?:without ([\w\[\].]+)|([\w\[\].]+)=)")


@dataclass(frozen=True)
class Suggested:
    """A call that a text suggests."""

    tool: str
    arguments: Mapping[str, Any]


def first_suggestion(text: str, tool: str, arguments: Mapping[str, Any]) -> Suggested | None:
    """Return the first call that a refusal suggests, or None if its text holds no call that can be made as it is."""
    found = _NEXT.search(text)
    if found is None:
        return None
    step = found[1]
    if (changed := _CHANGED.match(step)) is not None:
        parts = _with_parts(changed[1], arguments)
        return None if parts is None else Suggested(tool, parts)
    if (again := _AGAIN.match(step)) is not None:
        value = _leading_object(again[1])
        return None if value is None else Suggested(tool, value)
    other = _OTHER.match(step)
    if other is None or (other[1] != "render" and "_" not in other[1]):
        return None
    value = _leading_object(other[2]) if other[2] else {}
    return None if value is None else Suggested(other[1], value)


def _leading_object(text: str) -> dict[str, Any] | None:
    try:
        value, _ = json.JSONDecoder().raw_decode(text)
    except ValueError:
        return None
    return value if isinstance(value, dict) else None


def _with_parts(text: str, arguments: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the arguments with ``edits[0].preset="eco", without edits[0].lane`` applied; None for another text."""
    changed, position = copy.deepcopy(dict(arguments)), 0
    while (part := _PART.match(text, position)) is not None:
        position, value = part.end(), None
        if part[2]:
            try:
                value, position = json.JSONDecoder().raw_decode(text, position)
            except ValueError:
                return None
        *holders, last = [int(one) if one.isdigit() else one for one in re.findall(r"\w+", part[1] or part[2])]
        holder: Any = changed
        for one in holders:
            holder = holder[one]
        if part[1]:
            holder.pop(last, None)
        else:
            holder[last] = value
        if text[position : position + 2] != ", ":
            break
        position += 2
    return changed
