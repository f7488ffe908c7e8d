"""Explains a refused edit further: misplaced arguments, and which of several vehicles an edit does not suit."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from ...schemas.errors import InvalidRequest, NotPossible, Remedy, with_values
from ...schemas.modification import EDITS, Edit
from ...schemas.text import counted
from ..scene import Scene
from .changes import Changes, EditStep
from .references import select

_MOST_TRIED = 40
"""How many vehicles of a refused edit are tried alone (chosen: one takes milliseconds)."""
_MOST_REASONS = 3
"""How many vehicles a refusal explains (chosen)."""


def check_arguments(edit: Edit) -> None:
    """Refuse arguments that do not belong to the operation, so that no argument is silently ignored.

    Raises:
        InvalidRequest: there are such arguments. A lanelet in ``at`` or ``to`` is proposed for the other of the two.
    """
    allowed = EDITS[edit.op].arguments
    foreign = [name for name in edit.given if name not in allowed]
    if not foreign:
        return
    removed = dict.fromkeys(foreign)
    raise InvalidRequest(
        f"{', '.join(foreign)} is not an argument of op {edit.op}",
        valid=allowed,
        next_step="remove it, or put it into a separate edit",
        remedies=[*_with_lanelet_moved(edit, foreign, removed), with_values(**removed)],
    )


def _with_lanelet_moved(edit: Edit, foreign: list[str], removed: dict[str, None]) -> list[Remedy]:
    """Return the edit with its lanelet in the argument that this operation has for one."""
    allowed, moved = EDITS[edit.op].arguments, dict[str, Any]()
    if "at" in foreign and "to" in allowed and not edit.to and edit.at is not None:
        of_vehicle = edit.at.removeprefix("vehicle:")
        moved = {"to": [edit.at if of_vehicle == edit.at else f"lanelet_of:{of_vehicle}"]}
    elif "to" in foreign and "at" in allowed and edit.at is None and len(edit.to) == 1:
        moved = {"at": edit.to[0]}
    return [with_values(**{**removed, **moved})] if moved else []


def of_several(
    refusal: InvalidRequest,
    edit: Edit,
    scene: Scene,
    changes: Changes,
    apply: Callable[[Edit, Scene, Changes], EditStep],
) -> InvalidRequest:
    """Return the refusal of an edit with the vehicles that it does not suit, and the edit without them.

    Each vehicle is tried alone. The refusal stays unchanged if its reason is the same for all of them.
    """
    vehicles = tuple[int, ...]()
    with suppress(InvalidRequest):
        vehicles = select(edit.vehicles, scene, changes)
    if not 1 < len(vehicles) <= _MOST_TRIED:
        return refusal
    refused: dict[int, InvalidRequest] = {}
    for key in vehicles:
        try:
            apply(edit.model_copy(update={"vehicles": [str(key)]}), scene, changes)
        except InvalidRequest as alone:
            refused[key] = alone
    messages = list(dict.fromkeys(one.message.rstrip(".") for one in refused.values()))
    more = f"; and {len(messages) - _MOST_REASONS} more" if len(messages) > _MOST_REASONS else ""
    reasons = f"{'; '.join(messages[:_MOST_REASONS])}{more}"
    if len(refused) == len(vehicles) and len(messages) > 1:
        return refusal.with_message(f"{edit.op} suits none of {counted(len(vehicles), 'vehicle')}: {reasons}")
    if not 0 < len(refused) < len(vehicles):
        return refusal
    asked = [text for text in edit.vehicles if not (text.isdigit() and int(text) in refused)]
    excluded = [f"!{key}" for key in refused if str(key) not in edit.vehicles]
    first = next(iter(refused.values()))
    return NotPossible(
        f"{edit.op} does not suit {len(refused)} of {counted(len(vehicles), 'vehicle')}: {reasons}",
        valid=[f"vehicles={_written([str(key) for key in vehicles if key not in refused])}"],
        next_step="exclude these vehicles, or edit them separately",
        reason=first.reason,
        remedies=[with_values(vehicles=[*asked, *excluded])],
    )


def _written(names: list[str]) -> str:
    return f"[{', '.join(repr(name) for name in names)}]"
