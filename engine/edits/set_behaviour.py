"""Edit B: change how vehicles drive."""

from dataclasses import replace

from plannerforge.engine.edits.behaviours import (
    Behaviour,
    behaviour_from,
    own_minimum_gap_m,
    parameters_set,
    presets,
    values_set,
)
from plannerforge.engine.edits.changes import Changes, EditStep, plan_of
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.selection import select
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.modification import Edit

MOST_KEPT_NAMED = 8


def set_behaviour(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Give the selected vehicles a preset, single parameters, or a preset with single parameters on top.

    Class, length and width of a vehicle stay, and so does the minimum gap of a class that has its own, where no
    parameter sets it.

    Raises:
        InvalidRequest: neither preset nor parameters, or a value out of range.
        UnknownName: no such preset or parameter.
    """
    if edit.preset is None and not edit.params:
        raise InvalidRequest(
            "set_behaviour needs a preset or params",
            valid=[*presets(), "params=['tau=0.7']"],
            next_step="name a preset, or set single parameters",
        )
    vehicles = select(edit.vehicles, scene, changes)
    kept: list[str] = []
    made: list[Behaviour] = []
    for vehicle_id in vehicles:
        plan = plan_of(scene, changes, vehicle_id)
        own_gap_m = own_minimum_gap_m(plan.vehicle_class)
        behaviour = behaviour_from(plan.behaviour, edit.preset, edit.params, own_gap_m)
        if edit.preset and own_gap_m is not None and behaviour.values["minGap"] == own_gap_m:
            kept.append(f"{plan.vehicle_class.name} {vehicle_id} keeps its own minGap of {own_gap_m:g} m")
        changes = changes.with_plan(replace(plan, behaviour=behaviour))
        made.append(behaviour)
    words = [edit.preset.strip().lower()] if edit.preset else []
    shown = ", ".join(str(key) for key in vehicles[:8]) + (" …" if len(vehicles) > 8 else "")
    what = f"{' '.join([*words, *values_set(edit.params, made)])} for {shown}"
    said = "; ".join([what, *kept[:MOST_KEPT_NAMED]])
    return EditStep(changes, vehicles, said, parameters=parameters_set(edit.preset, edit.params))
