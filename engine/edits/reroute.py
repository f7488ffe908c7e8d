"""Edit T: send vehicles another way."""

from contextlib import suppress
from dataclasses import replace

from plannerforge.engine.edits.changes import Changes, DrivePlan, EditStep, plan_of
from plannerforge.engine.edits.forks import branch_for
from plannerforge.engine.edits.lane_change_inside import steering_over
from plannerforge.engine.edits.lanelet_targets import drive_to, nearest_driven, target_lanelets, way_through
from plannerforge.engine.edits.last_lane_change import check_lane_changes
from plannerforge.engine.edits.manoeuvre_plans import named
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.selection import select
from plannerforge.engine.edits.turn_speed import check_bends
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.modification import Edit


def reroute(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Send the selected vehicles to any of the target lanelets, or along a turn at their next fork.

    Raises:
        InvalidRequest: neither or both of ``to`` and ``turn``.
        NotPossible: a vehicle cannot get there, comes to a bend or the last place of a lane change too fast, or cannot
            be driven.
    """
    if bool(edit.to or edit.via) == bool(edit.turn):
        raise InvalidRequest(
            "reroute takes either 'to' or 'turn', and 'via' with 'to'",
            valid=["to=[lanelet]", "via=[lanelet] to=[lanelet]", "turn=left|right|straight"],
            next_step="give one of these",
        )
    vehicles = select(edit.vehicles, scene, changes)
    for vehicle_id in vehicles:
        plan = plan_of(scene, changes, vehicle_id)
        changes = changes.with_plan(_rerouted(edit, scene, changes, plan))
    where = f"turn {edit.turn} at the next fork" if edit.turn else f"to {' or '.join(edit.to or edit.via[-1:])}"
    through = f" through {', then '.join(edit.via)}" if edit.via and edit.to else ""
    legs = tuple(target_lanelets([text], scene, changes) for text in edit.via)
    aims = {key: (*legs, changes.driven[key].targets) for key in vehicles}
    return EditStep(changes, vehicles, f"{named(vehicles)} rerouted {where}{through}", aims=aims)


def _rerouted(edit: Edit, scene: Scene, changes: Changes, plan: DrivePlan) -> DrivePlan:
    """The plan from the lanelet that the vehicle is matched to, or from another under it where that leads nowhere."""
    try:
        return _rerouted_from(plan.lanelets[0], edit, scene, changes, plan)
    except NotPossible:
        for start in _other_starts(scene, plan):
            with suppress(NotPossible):
                return _rerouted_from(start, edit, scene, changes, plan)
        raise


def _other_starts(scene: Scene, plan: DrivePlan) -> tuple[int, ...]:
    """Lanelets on which a recorded vehicle stands just as well: at a fork its match is the branch that it drove."""
    if plan.cause == "added":
        return ()
    track, index = plan.start, plan.from_step - plan.start.first_step
    pose = track.positions[index], float(track.headings_rad[index]), float(track.speeds_mps[index])
    return scene.matcher.near_as_well(*pose, plan.lanelets[0])


def _rerouted_from(start: int, edit: Edit, scene: Scene, changes: Changes, plan: DrivePlan) -> DrivePlan:
    who = f"vehicle {plan.start.obstacle_id}"
    if edit.turn:
        targets = frozenset(branch_for(scene, start, edit.turn, who).lanelets)
        way = drive_to(scene, start, frozenset([_last_of_branch(scene, start, edit.turn, who)]), who, is_there=True)
    else:
        targets = target_lanelets(edit.to or edit.via[-1:], scene, changes)
        way = way_through(scene, start, edit.via, targets, changes, who)
    check_bends(scene, plan, way, who)
    check_lane_changes(scene, plan, way, who)
    through = {key for text in edit.via for key in target_lanelets([text], scene, changes)}
    over = steering_over(scene, plan, way, who)
    return replace(drive_along(scene, plan, way, targets), through=frozenset(through & set(way)), steering_over=over)


def drive_along(scene: Scene, plan: DrivePlan, way: tuple[int, ...], targets: frozenset[int]) -> DrivePlan:
    """The plan with another way, led on straight ahead after its end.

    Raises:
        NotPossible: SUMO's edges do not connect along the way.
    """
    edges = scene.edge_graph.route(way)
    if edges is None:
        raise NotPossible(
            f"vehicle {plan.start.obstacle_id} cannot drive from lanelet {way[0]} to {way[-1]}: lanes do not connect",
            valid=nearest_driven(scene, way[0], way[-1:]),
            next_step="choose another lanelet",
        )
    return replace(
        plan,
        through=frozenset(),
        steering_over=None,
        lanelets=way,
        targets=targets,
        edges=scene.edge_graph.extended(edges, way[-1]),
    )


def _last_of_branch(scene: Scene, start: int, turn: str, who: str) -> int:
    return branch_for(scene, start, turn, who).lanelets[-1]
