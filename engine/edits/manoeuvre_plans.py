"""Plans of vehicles that are told something on their way."""

from dataclasses import replace

from plannerforge.engine.edits.changes import Changes, DrivePlan, plan_of
from plannerforge.engine.edits.manoeuvring import Manoeuvre
from plannerforge.engine.edits.scene import Scene
from plannerforge.schemas.errors import InvalidRequest


def plan_from(scene: Scene, changes: Changes, vehicle_id: int, time_s: float | None) -> tuple[DrivePlan, int]:
    """The plan of a vehicle that is driven from a time on at the latest, and the step of that time.

    ``time_s``: from the scenario's start; None: from the vehicle's first step on.

    Raises:
        InvalidRequest: the vehicle is not there then.
        NotPossible: the vehicle cannot be driven.
    """
    before = changes.driven.get(vehicle_id)
    plan = plan_of(scene, changes, vehicle_id)
    first, last = plan.from_step, scene.last_step - 1
    if vehicle_id in scene.tracks and before is None:
        last = scene.tracks[vehicle_id].last_step - 1
    step = first if time_s is None else round(time_s / scene.step_s)
    if not first <= step <= last:
        asked_s = step * scene.step_s if time_s is None else time_s
        raise InvalidRequest(
            f"vehicle {vehicle_id} is not there at {asked_s:g} s",
            valid=[f"time_s in {first * scene.step_s:g} … {last * scene.step_s:g}"],
            next_step="choose a time_s at which it is there",
        )
    return replace(plan, from_step=step if before is None else min(step, before.from_step)), step


def with_manoeuvre(plan: DrivePlan, manoeuvre: Manoeuvre) -> DrivePlan:
    """The plan with one more manoeuvre; they stay in the order of their steps, later ones of a step last."""
    found = sorted((*plan.manoeuvres, manoeuvre), key=lambda one: one.from_step)
    return replace(plan, manoeuvres=tuple(found))


def named(vehicles: tuple[int, ...]) -> str:
    """Vehicles for a sentence; many are cut short."""
    shown = ", ".join(str(key) for key in vehicles[:8]) + (" …" if len(vehicles) > 8 else "")
    return f"vehicle{'s' if len(vehicles) > 1 else ''} {shown}"
