"""Edit P: take vehicles out."""

from plannerforge.engine.edits.changes import Changes, EditStep
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.selection import select
from plannerforge.schemas.modification import Edit


def remove_vehicle(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Remove the selected vehicles; the others stay as recorded, driven ones no longer see them."""
    vehicles = select(edit.vehicles, scene, changes)
    for vehicle_id in vehicles:
        changes = changes.without(vehicle_id)
    shown = ", ".join(str(key) for key in vehicles[:12]) + (" …" if len(vehicles) > 12 else "")
    return EditStep(changes, vehicles, f"removed {len(vehicles)}: {shown}")
