"""Edit T: hold vehicles to a speed from a time on."""

from plannerforge.engine.edits.changes import Changes, EditStep, class_of
from plannerforge.engine.edits.manoeuvre_plans import named, plan_from, with_manoeuvre
from plannerforge.engine.edits.manoeuvring import Manoeuvre
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.selection import select
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.grammar import parse_quantity
from plannerforge.schemas.modification import Edit


def set_speed(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Hold the selected vehicles to a speed from a time on, as far as the traffic ahead lets them.

    They speed up and slow down within their own power and brakes; 0 stops them.

    Raises:
        InvalidRequest: no speed, an impossible one, or a vehicle that is not there at the time.
        NotPossible: a vehicle cannot be driven.
    """
    if edit.speed is None:
        raise InvalidRequest(
            "set_speed needs a speed", valid=["speed='30km/h'", "speed='0m/s'"], next_step="name one in 'speed'"
        )
    vehicles, wanted = select(edit.vehicles, scene, changes), parse_quantity(edit.speed, "m/s")
    speeds: dict[int, tuple[float, int]] = {}
    for vehicle_id in vehicles:
        plan, step = plan_from(scene, changes, vehicle_id, edit.time_s)
        limit = class_of(plan.start.kind).maximum_speed_mps
        if not 0.0 <= wanted <= limit:
            raise InvalidRequest(
                f"a {plan.start.kind} does not drive {edit.speed}",
                valid=[f"0 … {limit:g} m/s"],
                next_step="choose another speed",
            )
        changes = changes.with_plan(with_manoeuvre(plan, Manoeuvre(step, speed_mps=wanted)))
        speeds[vehicle_id] = (wanted, step)
    when = "" if edit.time_s is None else f" from {edit.time_s:g} s on"
    return EditStep(changes, vehicles, f"{named(vehicles)} held to {wanted:.1f} m/s{when}", speeds=speeds)
