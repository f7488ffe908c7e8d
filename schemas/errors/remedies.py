"""Remedies for a refused call, as changes of its arguments or as another call, so that a program can follow them.

An error gives remedies (:class:`Remedy`) without knowing the whole call: which word to replace, or which values of an
edit to set. The server applies them to the refused call (:func:`followed`). Its text and programs get the new call.
"""

import copy
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from ..text import cited_parts, quoted
from .likeness import misspelt_names

SHOWN_CALL = 400
"""The maximum length of a call that a refusal writes out in full (chosen). For a longer call, it writes the changes."""
Place = tuple[str | int, ...]
"""The position of an object in the arguments: ``("edits", 0)`` is the first edit, ``()`` the arguments themselves."""


@dataclass(frozen=True)
class Change:
    """A change of the arguments at a place: new values (None removes one), and replaced words.

    ``fields`` are the fields that contain the words, or empty if not known.
    """

    place: Place = ()
    values: Mapping[str, Any] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=dict)
    fields: tuple[str, ...] = ()


@dataclass(frozen=True)
class Remedy:
    """Changes of the refused call, in order, or another call: ``tool`` with ``arguments``.

    ``carried`` lists the arguments that the other call takes from the refused one. ``corrects_spelling``: the remedy
    only corrects names, so it is proposed even if there is no time to try it.
    """

    changes: tuple[Change, ...] = ()
    tool: str = ""
    arguments: Mapping[str, Any] = field(default_factory=dict)
    carried: tuple[str, ...] = ()
    corrects_spelling: bool = False

    def at(self, place: Place) -> "Remedy":
        """Return the same remedy with its changes moved to a place."""
        changes = tuple(replace(change, place=(*place, *change.place)) for change in self.changes)
        return replace(self, changes=changes)

    def to_json(self) -> dict[str, Any]:
        """Return plain values that :meth:`of_json` reads back."""
        return asdict(self)

    @classmethod
    def of_json(cls, value: Mapping[str, Any]) -> "Remedy":
        """Return the remedy that :meth:`to_json` wrote."""
        changes = tuple(
            Change(tuple(one["place"]), one["values"], one["words"], tuple(one["fields"])) for one in value["changes"]
        )
        return cls(changes, value["tool"], value["arguments"], tuple(value["carried"]), value["corrects_spelling"])


def instead(word: str, other: object, *fields: str) -> Remedy:
    """Return the call with a word replaced; ``fields`` are the only fields that contain it, if known."""
    return Remedy((Change(words={word: str(other)}, fields=fields),))


def with_values(**values: Any) -> Remedy:
    """Return the call with other values for fields; None removes a field."""
    return Remedy((Change(values=values),))


def calling(tool: str, *carried: str, **arguments: Any) -> Remedy:
    """Return another call; ``carried`` lists the arguments that it takes from the refused one."""
    return Remedy((), tool, arguments, carried)


VEHICLES_LISTED = calling("describe_scenario", "scenario_id", detail="vehicles")
LANELETS_LISTED = calling("describe_scenario", "scenario_id", detail="lanelets")
"""The description that helps to correct a refused edit."""

_ASSIGNED = re.compile(r"([a-z]\w*)=('[^']*'|\[[^\]]*\]|[\w.:+-]+)")


def assignments(valid: Iterable[str]) -> list[Remedy]:
    """Return, as remedies, the valid values that assign fields, such as ``at=156 position='137.2m'``."""
    found = []
    for text in valid:
        parts = _ASSIGNED.findall(text)
        if parts and " ".join(f"{name}={value}" for name, value in parts) == text:
            found.append(with_values(**{name: _value(value) for name, value in parts}))
    return found


def _value(text: str) -> Any:
    """Return a value as text, which the arguments' model parses."""
    return [_value(part.strip()) for part in text[1:-1].split(",")] if text.startswith("[") else text.strip("'")


def misspellings(message: str, valid: Iterable[str]) -> list[Remedy]:
    """Return replacements for the words quoted in a message: the valid names that they may misspell.

    Text after a valid name explains it: a bracket, or a range such as ``sigma from 0 to 1``.
    """
    names = [re.sub(r" (?:\(|from |above |below |up to |at least |at most ).*$", "", text) for text in valid]
    return [remedy for word in re.findall(r"'([^']+)'", message) for remedy in misspelt(word, names)]


def misspelt(word: str, names: Iterable[str], *fields: str) -> list[Remedy]:
    """Return replacements for a word, in the given fields or in all fields: the names that it may misspell."""
    found = misspelt_names(word, names)
    return [replace(instead(word, name, *fields), corrects_spelling=True) for name in found]


@dataclass(frozen=True)
class NextCall:
    """A whole call; ``changed`` lists the differences from the refused call, by path (None if removed).

    ``dropped`` lists what the refused call has and this one lacks, so that the text can say so.
    """

    tool: str
    arguments: Mapping[str, Any]
    changed: Mapping[str, Any] | None = None
    dropped: tuple[str, ...] = ()

    @classmethod
    def again(cls, tool: str, given: Mapping[str, Any], arguments: Mapping[str, Any]) -> "NextCall":
        """Return the same call with other arguments."""
        return cls(tool, arguments, dict(differences(given, arguments)), tuple(_dropped(given, arguments)))

    @property
    def only_drops(self) -> bool:
        """Whether this is the refused call without some of its parts."""
        return 0 < len(self.changed or {}) <= len(self.dropped)

    @property
    def text(self) -> str:
        """The call in words: ``call again with {…}``, or ``call describe_scenario with {…}``."""
        if self.only_drops and not self.arguments:
            return f"call {self.tool} without {', '.join(self.dropped)}"
        name = "again" if self.changed is not None else self.tool
        arguments = cited_parts(dict(self.arguments))
        if self.changed is not None:  # what the caller wrote stays as it was written
            arguments = _cite_new_texts(self.arguments, arguments, set(_texts(dict(self.changed))))
        whole = json.dumps(arguments, ensure_ascii=False)
        if self.changed is None or len(whole) <= SHOWN_CALL:
            without = f" (without {', '.join(self.dropped)})" if self.dropped else ""
            has_arguments = self.arguments or self.changed is not None
            return f"call {name} with {whole}{without}" if has_arguments else f"call {name}"
        removed = [path for path, value in self.changed.items() if value is None]
        new = [
            f"{path}={json.dumps(cited_parts(value), ensure_ascii=False)}"
            for path, value in self.changed.items()
            if value is not None
        ]
        parts = [*([f"without {', '.join(removed)}"] if removed else []), *([f"with {', '.join(new)}"] if new else [])]
        return f"call again with the same arguments, but {' and '.join(parts)}"


def _texts(value: Any) -> Iterator[str]:
    """Yield the texts in a JSON value."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list | tuple):
        for part in value.values() if isinstance(value, Mapping) else value:
            yield from _texts(part)


def _cite_new_texts(value: Any, cited: Any, new: set[str]) -> Any:
    """Return a JSON value with its new texts cited."""
    if isinstance(value, Mapping):
        pairs = zip(value.items(), cited.values(), strict=True)
        return {name: _cite_new_texts(part, other, new) for (name, part), other in pairs}
    if isinstance(value, list | tuple):
        return [_cite_new_texts(part, other, new) for part, other in zip(value, cited, strict=True)]
    return cited if value in new else value


def followed(remedy: Remedy, tool: str, given: Mapping[str, Any]) -> NextCall | None:
    """Return the call that a remedy gives after a refused call, or None if it does not fit or changes nothing."""
    if remedy.tool:
        carried = {name: given[name] for name in remedy.carried if name in given}
        following = {**carried, **remedy.arguments}
        return None if remedy.tool == tool and following == given else NextCall(remedy.tool, following)
    arguments = copy.deepcopy(dict(given))
    for change in remedy.changes:
        holder: Any = arguments
        try:
            for part in change.place:
                holder = holder[part]
        except (KeyError, IndexError, TypeError):
            return None
        if not isinstance(holder, dict):
            return None
        for name, value in change.values.items():
            if value is None:
                holder.pop(name, None)
            else:
                holder[name] = value
        for word, other in change.words.items():
            replaced = {
                name: _with_word(value, word, other) if not change.fields or name in change.fields else value
                for name, value in holder.items()
            }
            if replaced == holder:
                return None
            holder.clear()
            holder.update(replaced)
    if arguments == given:
        return None
    return NextCall.again(tool, given, arguments)


def differences(before: Any, after: Any, path: str = "") -> list[tuple[str, Any]]:
    """Return the differences, by paths such as ``edits[0].preset``, with None for a removed part."""
    if before == after:
        return []
    if isinstance(before, Mapping) and isinstance(after, Mapping):
        return [
            found
            for name in dict.fromkeys((*before, *after))
            for found in differences(before.get(name), after.get(name), f"{path}.{name}" if path else name)
        ]
    if isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        pairs = enumerate(zip(before, after, strict=True))
        return [found for index, (old, new) in pairs for found in differences(old, new, f"{path}[{index}]")]
    return [(path, after)]


def _dropped(before: Any, after: Any, path: str = "") -> Iterator[str]:
    """Yield the names of fields that are removed without a replacement, and the removed texts of lists."""
    if isinstance(before, Mapping) and isinstance(after, Mapping):
        is_replaced = bool(after.keys() - before.keys())
        for name, value in before.items():
            where = f"{path}.{name}" if path else name
            if name in after:
                yield from _dropped(value, after[name], where)
            elif not is_replaced:
                yield where
    elif isinstance(before, list) and isinstance(after, list):
        if len(before) == len(after):
            for index, (old, new) in enumerate(zip(before, after, strict=True)):
                yield from _dropped(old, new, f"{path}[{index}]")
        elif len(before) > len(after):
            yield from (
                f"{quoted(one)} in {path}" for one in before if one not in after and not isinstance(one, Mapping)
            )
    elif isinstance(before, str) and isinstance(after, str) and after and before.startswith(after):
        rest = before.removeprefix(after)
        if rest and not rest[0].isalnum():  # a condition without its value, not a corrected word
            yield f"{quoted(rest)} in {path}"


def _with_word(value: Any, word: str, other: str) -> Any:
    """Return the value with a whole word replaced in all its texts; numbers and parts of numbers stay unchanged."""
    if isinstance(value, dict):
        return {name: _with_word(part, word, other) for name, part in value.items()}
    if isinstance(value, list):
        return [_with_word(part, word, other) for part in value]
    if not isinstance(value, str):
        return value
    if value.strip() == word.strip():
        return other
    return re.sub(rf"(?<![\w.]){re.escape(word)}(?![\w.])", lambda _: other, value)
