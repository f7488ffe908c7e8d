"""Edit T: send vehicles to the lane beside theirs."""

from dataclasses import replace

from plannerforge.engine.edits.changes import Changes, DrivePlan, EditStep
from plannerforge.engine.edits.manoeuvre_plans import named, plan_from, with_manoeuvre
from plannerforge.engine.edits.manoeuvring import Manoeuvre
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.selection import select
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.modification import Edit


def change_lane(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Send the selected vehicles one lane to the left or right at a time, as soon as there is a gap.

    A vehicle keeps its way where the new lane leads along it, and drives on in the new lane where it does not.

    Raises:
        InvalidRequest: neither left nor right, or a vehicle that is not there at the time.
        NotPossible: no such lane of the vehicle's direction then, or the vehicle cannot be driven.
    """
    if edit.lane not in ("left", "right"):
        raise InvalidRequest(
            "change_lane goes left or right", valid=["lane=left", "lane=right"], next_step="name one in 'lane'"
        )
    vehicles = select(edit.vehicles, scene, changes)
    aims: dict[int, tuple[frozenset[int], ...]] = {}
    since: dict[int, int] = {}
    for vehicle_id in vehicles:
        plan, step = plan_from(scene, changes, vehicle_id, edit.time_s)
        is_first = vehicle_id not in changes.driven
        here = _lanelets_at(scene, plan, step, exact=is_first)
        beside = [lane for key in here if (lane := _beside(scene, key, edit.lane)) is not None]
        if not beside:
            raise _no_such_lane(edit, scene, plan, here[0])
        way = _way_on(scene, plan, here, beside[0])
        order = Manoeuvre(step, lanes_left=1 if edit.lane == "left" else -1)
        changes = changes.with_plan(with_manoeuvre(way, order))
        since[vehicle_id] = step
        aims[vehicle_id] = (frozenset({*beside, *_along(scene, way, edit.lane)}),)
    when = "" if edit.time_s is None else f" from {edit.time_s:g} s on"
    return EditStep(
        changes, vehicles, f"{named(vehicles)} sent one lane to the {edit.lane}{when}", aims=aims, since=since
    )


def _lanelets_at(scene: Scene, plan: DrivePlan, step: int, *, exact: bool) -> tuple[int, ...]:
    """The lanelet at a step; for a vehicle that drives another way than recorded, all of its way.

    Changes of lane that it was told before are taken as done.
    """
    match = scene.matches.get(plan.start.obstacle_id)
    found = (match.at(step - plan.start.first_step),) if exact and match else plan.lanelets
    shift = sum(one.lanes_left for one in plan.manoeuvres if one.from_step <= step)
    for _ in range(abs(shift)):
        beside = [_beside(scene, key, "left" if shift > 0 else "right") for key in found]
        found = tuple(other for other in beside if other is not None) or found
    return found


def _beside(scene: Scene, lanelet_id: int, side: str) -> int | None:
    lane = scene.layout.table.lanes[lanelet_id]
    found = lane.left if side == "left" else lane.right
    return found if found in scene.layout.table.lanes else None


def _along(scene: Scene, plan: DrivePlan, side: str) -> list[int]:
    """The lanes beside the whole way: the change may be done farther on than it was asked for."""
    return [lane for key in plan.lanelets if (lane := _beside(scene, key, side)) is not None]


def _way_on(scene: Scene, plan: DrivePlan, here: tuple[int, ...], beside: int) -> DrivePlan:
    """The plan as it is if the new lane leads along it, else on straight ahead in the new lane."""
    edge = scene.layout.lane_of.get(beside, ("", 0))[0]
    if edge not in plan.edges or _leads_on(scene, plan, beside, edge):
        return plan
    start = next(place for place, key in enumerate(plan.lanelets) if _is_beside(scene, key, beside) or key in here)
    way = (*plan.lanelets[: start + 1], beside)
    edges = scene.edge_graph.route(way)
    return plan if edges is None else replace(plan, lanelets=way, edges=scene.edge_graph.extended(edges, beside))


def _is_beside(scene: Scene, key: int, other: int) -> bool:
    lane = scene.layout.table.lanes[key]
    return other in (lane.left, lane.right)


def _leads_on(scene: Scene, plan: DrivePlan, lanelet_id: int, edge: str) -> bool:
    """Whether the way from a lane leads to the edge that follows on the route (always at its end)."""
    onward = plan.edges[plan.edges.index(edge) + 1 :][:1]
    paths, lane_of = scene.layout.paths, scene.layout.lane_of
    ways = scene.edge_graph.paths_from.get(lanelet_id, ())
    return not onward or any(lane_of[paths[index].exit][0] == onward[0] for index in ways)


def _no_such_lane(edit: Edit, scene: Scene, plan: DrivePlan, here: int) -> NotPossible:
    other = {"left": "right", "right": "left"}[str(edit.lane)]
    there = [f"lane={other}"] if _beside(scene, here, other) is not None else []
    later = [f"on lanelet {key}" for key in plan.lanelets if _beside(scene, key, str(edit.lane)) is not None]
    return NotPossible(
        f"vehicle {plan.start.obstacle_id} has no lane of its direction to its {edit.lane} on lanelet {here}",
        valid=[*there, *later],
        next_step="choose another time or another lane",
    )
