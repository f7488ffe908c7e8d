"""``scripted``: the ground truth as small models would write it, with their corrections after a refusal.

Each kind of spoiling has its own rate per call. After a refusal, the agent does what a model of a few billion
parameters can do. It sends the corrected call if the refusal contains one. Otherwise it reverts what the refusal
mentions by field or value, and nothing else. It gives up after two refusals.
"""

import json
import random
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from .attempts import Attempt, EvalRequest, MadeCall, ToolSession
from .oracle import Oracle

MOST_REFUSALS = 2
"""Number of refusals of a call after which the agent gives up."""
_CORRECTED = re.compile(r"call again with (\{.*\})")
_SYNONYMS: Mapping[str, str] = {
    "scenario_id": "scenario",
    "duration_s": "duration",
    "edits": "edit",
    "vehicles": "vehicle",
    "configs": "config",
    "scenarios": "scenario",
    "vehicle_class": "class",
    "results": "result",
}
"""Names that small models give to arguments."""
_OPEN = ("dry_run", "seed")
"""Arguments of an edit that a model sets although the user left them open."""
_UNITS: Mapping[str, str] = {"_s": " s", "_m": " m", "_mps": " m/s"}


@dataclass(frozen=True)
class SpoilRates:
    """The chance of each kind of spoiling in a call that allows it (our choice, after the output of small models)."""

    number_as_text: float = 0.15
    one_for_list: float = 0.15
    json_in_text: float = 0.10
    ids_as_numbers: float = 0.20
    other_case: float = 0.15
    unit_in_value: float = 0.10
    null_for_open: float = 0.10
    synonym: float = 0.08
    extra_field: float = 0.06
    unknown_id: float = 0.03


@dataclass
class _Spoiled:
    """Spoiled arguments; ``undo`` maps texts that a refusal would contain to the reversal of each change."""

    arguments: dict[str, Any]
    undo: list[tuple[tuple[str, ...], Callable[[dict[str, Any]], None]]] = field(default_factory=list)


class Scripted:
    """An ``EvaluatedAgent``: the oracle behind a session that spoils its calls."""

    def __init__(self, seed: int = 0, rates: SpoilRates | None = None) -> None:
        self.name = "scripted"
        self._seed, self._rates, self._oracle = seed, rates or SpoilRates(), Oracle()

    async def attempt(self, request: EvalRequest, tools: ToolSession) -> Attempt:
        """Handle a request with spoiled calls; ``rounds`` counts the calls sent."""
        began = time.perf_counter()
        chance = random.Random(f"{self._seed} {request.request_id}")  # noqa: S311 - a reproducible choice, no secret
        session = _SpoilingSession(tools, chance, self._rates)
        attempt = await self._oracle.attempt(request, session)
        return Attempt(
            attempt.request_id,
            tuple(session.calls),
            attempt.answers,
            attempt.ending,
            rounds=len(session.calls),
            duration_s=time.perf_counter() - began,
        )


@dataclass
class _SpoilingSession:
    """A ``ToolSession`` that spoils every call, and corrects it after a refusal; ``calls``: all calls sent."""

    tools: ToolSession
    chance: random.Random
    rates: SpoilRates
    calls: list[MadeCall] = field(default_factory=list)

    async def call(self, tool: str, arguments: Mapping[str, Any], turn: int = 0) -> MadeCall:
        """Make a call in its spoiled form, and again after up to two refusals because of it."""
        spoiled = _spoil(arguments, self.chance, self.rates)
        made = await self._sent(tool, spoiled.arguments, turn)
        for _ in range(MOST_REFUSALS):
            mended = _mended(spoiled, made) if made.is_error else None
            if mended is None:
                break
            made = await self._sent(tool, mended, turn)
        return made

    async def _sent(self, tool: str, arguments: Mapping[str, Any], turn: int) -> MadeCall:
        made = await self.tools.call(tool, json.loads(json.dumps(arguments)), turn)
        self.calls.append(made)
        return made


def _mended(spoiled: _Spoiled, made: MadeCall) -> dict[str, Any] | None:
    """Return the arguments without what a refusal mentions, or None if it mentions no spoiled part."""
    if (found := _CORRECTED.search(made.text)) is not None:
        try:
            corrected: dict[str, Any] = json.loads(found[1])
        except json.JSONDecodeError:
            corrected = {}
        if corrected and corrected != made.arguments:
            spoiled.arguments = corrected
            return corrected
    named = [(words, undo) for words, undo in spoiled.undo if any(word in made.text for word in words)]
    if not named:
        return None
    for words, undo in reversed(named):
        undo(spoiled.arguments)
        spoiled.undo.remove((words, undo))
    return spoiled.arguments


def _spoil(arguments: Mapping[str, Any], chance: random.Random, rates: SpoilRates) -> _Spoiled:
    """Return a copy of arguments, with some of them as small models would write them."""
    spoiled = _Spoiled(json.loads(json.dumps(arguments)))
    for index, edit in enumerate(spoiled.arguments.get("edits", [])):
        _spoil_fields(edit, f"edits[{index}]", spoiled, chance, rates)
    _spoil_fields(spoiled.arguments, "", spoiled, chance, rates)
    return spoiled


def _spoil_fields(
    holder: dict[str, Any], where: str, spoiled: _Spoiled, chance: random.Random, rates: SpoilRates
) -> None:
    for name, value in list(holder.items()):
        written = _written(name, value, chance, rates)
        if written is not None:
            holder[name] = written
            spoiled.undo.append(((name, str(written)), _setter(holder, name, value)))
        if name in _SYNONYMS and _SYNONYMS[name] not in holder and chance.random() < rates.synonym:
            other = _SYNONYMS[name]
            holder[other] = holder.pop(name)
            spoiled.undo.append(((f"'{other}'", other), _renamer(holder, other, name)))
    if not where and chance.random() < rates.extra_field:
        holder["reasoning"] = "the user asked for it"
        spoiled.undo.append((("reasoning",), lambda _: holder.pop("reasoning", None)))
    open_names = [known for known in _OPEN if known not in holder]
    if not where and "edits" in holder and open_names and chance.random() < rates.null_for_open:
        holder[open_names[0]] = None
        spoiled.undo.append(((open_names[0],), lambda _: holder.pop(open_names[0], None)))


def _setter(holder: dict[str, Any], name: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def undo(_: dict[str, Any]) -> None:
        holder[name] = value

    return undo


def _renamer(holder: dict[str, Any], other: str, name: str) -> Callable[[dict[str, Any]], None]:
    def undo(_: dict[str, Any]) -> None:
        if other in holder:
            holder[name] = holder.pop(other)

    return undo


def _written(name: str, value: Any, chance: random.Random, rates: SpoilRates) -> Any:
    """Return the value as a small model may write it, or None to keep it."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        unit = next((words for end, words in _UNITS.items() if name.endswith(end)), None)
        if unit is not None and chance.random() < rates.unit_in_value:
            return f"{value}{unit}"
        return str(value) if chance.random() < rates.number_as_text else None
    if isinstance(value, list) and value:
        return _list_written(name, value, chance, rates)
    if isinstance(value, str) and name in ("op", "preset", "scenario_type", "density", "traffic", "turn", "lane"):
        return _cased(value, chance) if chance.random() < rates.other_case else None
    if name == "scenario_id" and isinstance(value, str) and value != "latest" and chance.random() < rates.unknown_id:
        return re.sub(r"\d", lambda found: str((int(found[0]) + 1) % 10), value, count=1)
    return None


def _list_written(name: str, value: Sequence[Any], chance: random.Random, rates: SpoilRates) -> Any:
    are_ids = name in ("vehicles", "to") and all(str(one).isdecimal() for one in value)
    if are_ids and chance.random() < rates.ids_as_numbers:
        return [int(one) for one in value]
    if len(value) == 1 and chance.random() < rates.one_for_list:
        return value[0]
    return json.dumps(value) if chance.random() < rates.json_in_text else None


def _cased(value: str, chance: random.Random) -> str:
    return chance.choice((value.upper(), value.capitalize(), value.replace("_", "-")))
