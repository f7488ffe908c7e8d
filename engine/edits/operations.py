"""The edits by the name of their operation."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from plannerforge.engine.edits.add_vehicle import add_vehicle
from plannerforge.engine.edits.changes import Changes, EditStep
from plannerforge.engine.edits.edit_arguments import check_arguments
from plannerforge.engine.edits.remove_vehicle import remove_vehicle
from plannerforge.engine.edits.reroute import reroute
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.set_behaviour import set_behaviour
from plannerforge.engine.edits.set_goal import set_goal
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.modification import Edit, Operation

EditFunction = Callable[[Edit, Scene, Changes], EditStep]

OPERATIONS: Mapping[Operation, EditFunction] = {
    "reroute": reroute,
    "set_behaviour": set_behaviour,
    "add_vehicle": add_vehicle,
    "remove_vehicle": remove_vehicle,
    "set_goal": set_goal,
}


def resolve_edits(
    edits: tuple[Edit, ...], scene: Scene, next_id: int, earlier: int = 0
) -> tuple[Changes, tuple[EditStep, ...]]:
    """Apply edits in order; nothing is simulated or written, and any refusal refuses them all.

    ``next_id``: the id that the first added vehicle gets. ``earlier``: how many edits come from earlier calls; the
    others are counted from 0 in errors.

    Raises:
        InvalidRequest: an edit that cannot be meant, or that the scenario does not allow.
    """
    changes, steps = Changes(next_id=next_id, driven={}), []
    for index, edit in enumerate(edits):
        try:
            check_arguments(edit)
            step = OPERATIONS[edit.op](edit, scene, changes)
        except InvalidRequest as error:
            if len(edits) - earlier == 1:
                raise
            message = f"edit {index - earlier} ({edit.op}): {error.message}"
            raise type(error)(message, valid=error.valid, next_step=error.next_step) from error
        added = step.vehicles if edit.op == "add_vehicle" else ()
        changes = _with_added(step.changes, added)
        steps.append(EditStep(changes, step.vehicles, step.what))
    return changes, tuple(steps)


def _with_added(changes: Changes, added: tuple[int, ...]) -> Changes:
    return replace(changes, added_by_edit=(*changes.added_by_edit, added))
