"""The edits by the name of their operation."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from plannerforge.engine.edits.add_vehicle import add_vehicle
from plannerforge.engine.edits.altered_scene import altered
from plannerforge.engine.edits.change_lane import change_lane
from plannerforge.engine.edits.changes import Changes, EditStep
from plannerforge.engine.edits.edit_arguments import check_arguments
from plannerforge.engine.edits.remove_vehicle import remove_vehicle
from plannerforge.engine.edits.reroute import reroute
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.set_behaviour import set_behaviour
from plannerforge.engine.edits.set_ego import check_goal, set_ego
from plannerforge.engine.edits.set_goal import set_goal
from plannerforge.engine.edits.set_speed import set_speed
from plannerforge.engine.edits.shift_time import shift_time
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.modification import Edit, Operation

EditFunction = Callable[[Edit, Scene, Changes], EditStep]

OPERATIONS: Mapping[Operation, EditFunction] = {
    "reroute": reroute,
    "change_lane": change_lane,
    "set_speed": set_speed,
    "shift_time": shift_time,
    "set_behaviour": set_behaviour,
    "add_vehicle": add_vehicle,
    "remove_vehicle": remove_vehicle,
    "set_goal": set_goal,
    "set_ego": set_ego,
}


def resolve_edits(
    edits: tuple[Edit, ...], scene: Scene, next_id: int, earlier: int = 0
) -> tuple[Changes, tuple[EditStep, ...]]:
    """Apply edits in order; nothing is simulated or written, and any refusal refuses them all.

    ``next_id``: the id that the first added vehicle gets. ``earlier``: how many edits come from earlier calls; the
    others are counted from 0 in errors. Every edit sees the scene as those before it leave it.

    Raises:
        InvalidRequest: an edit that cannot be meant, or that the scenario does not allow.
    """
    changes, steps = Changes(next_id=next_id, driven={}), []
    for index, edit in enumerate(edits):
        try:
            check_arguments(edit)
            step = OPERATIONS[edit.op](edit, altered(scene, changes), changes)
        except InvalidRequest as error:
            if len(edits) - earlier == 1:
                raise
            message = f"edit {index - earlier} ({edit.op}): {error.message}"
            raise type(error)(message, valid=error.valid, next_step=error.next_step) from error
        changes = replace(step.changes, added_by_edit=(*changes.added_by_edit, step.added))
        steps.append(replace(step, changes=changes))
    check_goal(altered(scene, changes), changes)
    return changes, tuple(steps)
