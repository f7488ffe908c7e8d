"""The edits by the name of their operation, and a list of edits resolved against a scene.

An edit is a function ``(edit, scene, changes) -> EditStep``: it gets the scene as the edits before it leave it, and
what they ask for. Nothing is simulated or written here. A new edit is such a function in ``trajectory``, ``population``
or ``ego``, and its row in the table of the tool's schema (``EDITS``), which says what arguments it takes.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

from ...schemas.errors import InvalidRequest
from ...schemas.modification import EDITS, Edit, EditOperation
from ..scene import Scene
from . import ego, population, trajectory
from .changes import Changes, EditStep, ResolvedEdits, apply_changes
from .goal_feasibility import check_goal

EditFunction = Callable[[Edit, Scene, Changes], EditStep]
OPERATIONS: Mapping[EditOperation, EditFunction] = {
    op: next(getattr(module, op) for module in (trajectory, population, ego) if hasattr(module, op)) for op in EDITS
}
"""The edits by their operation: each is the function of this name in one of these modules."""


def resolve_edits(edits: tuple[Edit, ...], base: Scene, next_id: int, earlier: int = 0) -> ResolvedEdits:
    """Apply edits in order; any refusal refuses them all. Every edit sees the scene as those before it leave it.

    ``next_id``: the id that the first added vehicle gets. ``earlier``: how many edits come from earlier calls; the
    others are counted from 0 in errors.

    Raises:
        InvalidRequest: an edit that cannot be meant, or that the scenario does not allow.
    """
    changes, scene, steps = Changes(next_id=next_id, driven={}), base, list[EditStep]()
    for index, edit in enumerate(edits):
        try:
            _check_arguments(edit)
            step = OPERATIONS[edit.op](edit, scene, changes)
        except InvalidRequest as error:
            if len(edits) - earlier == 1:
                raise
            message = f"edit {index - earlier} ({edit.op}): {error.message}"
            raise type(error)(message, valid=error.valid, next_step=error.next_step, reason=error.reason) from error
        changes = replace(step.changes, added_by_edit=(*changes.added_by_edit, step.added))
        scene = apply_changes(base, changes)
        steps.append(replace(step, changes=changes))
    check_goal(scene, changes)
    return ResolvedEdits(edits, tuple(steps), changes, scene)


def _check_arguments(edit: Edit) -> None:
    """Refuse arguments that do not belong to the operation, so that nothing asked for is silently left out."""
    allowed = EDITS[edit.op].arguments
    foreign = [name for name in edit.given if name not in allowed]
    if foreign:
        raise InvalidRequest(
            f"{', '.join(foreign)} does not belong to op {edit.op}",
            valid=allowed,
            next_step="leave it out, or make it an edit of its own",
        )
