"""What the edits that follow leave of an edit."""

from collections.abc import Collection, Sequence

from plannerforge.engine.edits.cascade import Resimulated
from plannerforge.engine.edits.changes import Changes, DrivePlan, EditStep
from plannerforge.engine.edits.manoeuvring import Manoeuvre


def sent_elsewhere(step: EditStep, plan: DrivePlan, targets: frozenset[int]) -> bool:
    """Whether a later edit sends a vehicle, whose plan at last this is, another way than to an edit's targets."""
    key = plan.start.obstacle_id
    own = step.changes.driven[key]
    asked = [one for one in own.manoeuvres if one.lanes_left and one.from_step == step.since.get(key)]
    later = [one for one in plan.manoeuvres if one.lanes_left and one not in own.manoeuvres]
    if asked and any(one.lanes_left * asked[-1].lanes_left < 0 for one in later):
        return True
    is_changed = (plan.targets, plan.lanelets) != (own.targets, own.lanelets)
    return is_changed and not targets & (plan.through | set(plan.lanelets))


def next_speed(step: EditStep, plan: DrivePlan) -> Manoeuvre | None:
    """The order of another edit that follows in time on the speed to which an edit holds a vehicle."""
    wanted, first = step.speeds[plan.start.obstacle_id]
    own = Manoeuvre(first, speed_mps=wanted)
    after = plan.manoeuvres[plan.manoeuvres.index(own) + 1 :]
    return next((one for one in after if one.speed_mps is not None), None)


def overruled(
    step: EditStep, later: Sequence[EditStep], result: Resimulated, arrived: Collection[int]
) -> tuple[int, ...]:
    """The vehicles of an edit for which later edits leave nothing of it: gone, sent elsewhere, never held or driven so.

    ``arrived``: those who got where it sent them nevertheless.
    """
    final = (step, *later)[-1].changes
    left = [key for key in step.vehicles if key not in arrived]
    return tuple(
        key
        for key in left
        if is_gone(key, step, final) or _is_set_anew(step, key, later) or _is_overruled(step, key, result)
    )


def is_gone(key: int, step: EditStep, final: Changes) -> bool:
    """Whether a vehicle that an edit drives, adds or moves in time is taken out by a later one."""
    before = {*step.changes.driven, *step.changes.replays}
    return key in before and key not in {*final.driven, *final.replays}


def is_replaced(op: str, step: EditStep, final: Changes) -> bool:
    """Whether a later edit sets another goal or start of the ego than an edit of this operation."""
    if op == "set_goal":
        return final.goal is not step.changes.goal
    return op == "set_ego" and final.ego is not step.changes.ego


def _is_set_anew(step: EditStep, key: int, later: Sequence[EditStep]) -> bool:
    """Whether later edits set all parameters that an edit sets, whatever they were."""
    of_vehicle = [other.parameters for other in later if key in other.vehicles]
    anew = {name for parameters in of_vehicle for name, is_whatever in parameters.items() if is_whatever}
    return bool(step.parameters) and anew.issuperset(step.parameters)


def _is_overruled(step: EditStep, key: int, result: Resimulated) -> bool:
    plan, track = result.plans.get(key), result.tracks.get(key)
    if plan is None or track is None:
        return False
    if key in step.speeds:
        later = next_speed(step, plan)
        return later is not None and later.from_step <= step.speeds[key][1]
    aims = step.aims.get(key, ())
    return bool(aims) and all(sent_elsewhere(step, plan, targets) for targets in aims)
