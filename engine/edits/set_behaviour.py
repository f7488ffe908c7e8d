"""Edit B: change how vehicles drive."""

from dataclasses import replace

from plannerforge.engine.edits.behaviours import behaviour_from, presets
from plannerforge.engine.edits.changes import Changes, EditStep, plan_of
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.selection import select
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.modification import Edit


def set_behaviour(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Give the selected vehicles a preset, single parameters, or a preset with single parameters on top.

    Class, length and width of a vehicle stay.

    Raises:
        InvalidRequest: neither preset nor parameters, or a value out of range.
        UnknownName: no such preset or parameter.
    """
    if edit.preset is None and not edit.params:
        raise InvalidRequest("set_behaviour needs a preset or params", valid=[*presets(), "params=['tau=0.7']"])
    vehicles = select(edit.vehicles, scene, changes)
    for vehicle_id in vehicles:
        plan = plan_of(scene, changes, vehicle_id)
        behaviour = behaviour_from(plan.behaviour, edit.preset, edit.params)
        changes = changes.with_plan(replace(plan, behaviour=behaviour))
    words = [edit.preset.strip().lower()] if edit.preset else []
    shown = ", ".join(str(key) for key in vehicles[:8]) + (" …" if len(vehicles) > 8 else "")
    return EditStep(changes, vehicles, f"{' '.join([*words, *edit.params])} for {shown}")
