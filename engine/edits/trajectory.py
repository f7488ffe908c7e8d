"""Edits T and B: where, when, how fast and in which manner recorded or added vehicles drive.

Each edit makes or changes plans of vehicles (``DrivePlan``) or replays of recordings; SUMO drives the plans later.
Times count from the scenario's start.
"""

from contextlib import suppress
from dataclasses import replace

from ...schemas.errors import InvalidRequest, NotPossible
from ...schemas.grammar import parse_quantity
from ...schemas.modification import Edit
from ..commonroad import Track
from ..cosimulation import (
    Behaviour,
    DrivePlan,
    Manoeuvre,
    Replay,
    behaviour_from,
    check_curves,
    class_of,
    own_minimum_gap_m,
    parameters_set,
    presets,
    values_set,
)
from ..scene import Scene
from .changes import FEWEST_STATES, Changes, EditStep, moved_in_time, plan_of
from .manoeuvre_limits import check_lane_changes, junction_lane_change
from .references import branch_for, drive_to, nearest_driven, nearest_ids, route_via, select, target_lanelets

_MOST_NAMED = 8
"""Vehicles that a sentence names before it is cut short."""


def reroute(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Send the selected vehicles to any of the target lanelets, or along a turn at their next fork.

    Raises:
        InvalidRequest: neither or both of ``to`` and ``turn``.
        NotPossible: a vehicle cannot get there, comes to a curve or the last place of a lane change too fast, or cannot
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
    return EditStep(changes, vehicles, f"{_named(vehicles)} rerouted {where}{through}", aims=aims)


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
        branch = branch_for(scene, start, edit.turn, who).lanelets
        targets = frozenset(branch)
        route = drive_to(scene, start, frozenset(branch[-1:]), who, is_there=True)
    else:
        targets = target_lanelets(edit.to or edit.via[-1:], scene, changes)
        route = route_via(scene, start, edit.via, targets, changes, who)
    check_curves(scene, plan, route, who)
    check_lane_changes(scene, plan, route, who)
    through = {key for text in edit.via for key in target_lanelets([text], scene, changes)}
    over = junction_lane_change(scene, plan, route, who)
    return replace(
        drive_along(scene, plan, route, targets), through=frozenset(through & set(route)), junction_lane_change=over
    )


def drive_along(scene: Scene, plan: DrivePlan, route: tuple[int, ...], targets: frozenset[int]) -> DrivePlan:
    """The plan with another route, led on straight ahead after its end.

    Raises:
        NotPossible: SUMO's edges do not connect along the route.
    """
    edges = scene.edge_graph.route(route)
    if edges is None:
        raise NotPossible(
            f"vehicle {plan.start.obstacle_id} cannot drive from lanelet {route[0]} to {route[-1]}: lanes do not "
            "connect",
            valid=nearest_driven(scene, route[0], route[-1:]),
            next_step="choose another lanelet",
        )
    return replace(
        plan,
        through=frozenset(),
        junction_lane_change=None,
        lanelets=route,
        targets=targets,
        edges=scene.edge_graph.extended(edges, route[-1]),
    )


def change_lane(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Send the selected vehicles one lane to the left or right at a time, as soon as there is a gap.

    A vehicle keeps its route where the new lane leads along it, and drives on in the new lane where it does not.

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
        plan, step = _plan_from(scene, changes, vehicle_id, edit.time_s)
        is_first = vehicle_id not in changes.driven
        here = _lanelets_at(scene, plan, step, exact=is_first)
        beside = [lane for key in here if (lane := _beside(scene, key, edit.lane)) is not None]
        if not beside:
            raise _no_such_lane(edit, scene, plan, here[0])
        plan = _with_route_of_lane(scene, plan, here, beside[0])
        order = Manoeuvre(step, lanes_left=1 if edit.lane == "left" else -1)
        changes = changes.with_plan(_with_manoeuvre(plan, order))
        since[vehicle_id] = step
        aims[vehicle_id] = (frozenset({*beside, *_all_beside(scene, plan, edit.lane)}),)
    when = "" if edit.time_s is None else f" from {edit.time_s:g} s on"
    return EditStep(
        changes, vehicles, f"{_named(vehicles)} sent one lane to the {edit.lane}{when}", aims=aims, since=since
    )


def _lanelets_at(scene: Scene, plan: DrivePlan, step: int, *, exact: bool) -> tuple[int, ...]:
    """The lanelet at a step (``exact``); for a vehicle that drives another route than recorded, all of its route.

    Changes of lane that were ordered before are taken as done.
    """
    match = scene.matches.get(plan.start.obstacle_id)
    lanelets = (match.at(step - plan.start.first_step),) if exact and match else plan.lanelets
    shift = sum(order.lanes_left for order in plan.manoeuvres if order.from_step <= step)
    for _ in range(abs(shift)):
        beside = [_beside(scene, key, "left" if shift > 0 else "right") for key in lanelets]
        lanelets = tuple(other for other in beside if other is not None) or lanelets
    return lanelets


def _beside(scene: Scene, lanelet_id: int, side: str) -> int | None:
    lane = scene.layout.table.lanes[lanelet_id]
    other = lane.left if side == "left" else lane.right
    return other if other in scene.layout.table.lanes else None


def _all_beside(scene: Scene, plan: DrivePlan, side: str) -> list[int]:
    """The lanes beside the whole route: the change may be done farther on than it was asked for."""
    return [lane for key in plan.lanelets if (lane := _beside(scene, key, side)) is not None]


def _with_route_of_lane(scene: Scene, plan: DrivePlan, here: tuple[int, ...], beside: int) -> DrivePlan:
    """The plan as it is if the new lane leads along it, else on straight ahead in the new lane."""
    edge = scene.layout.lane_of.get(beside, ("", 0))[0]
    if edge not in plan.edges or _leads_on(scene, plan, beside, edge):
        return plan
    start = next(place for place, key in enumerate(plan.lanelets) if _is_beside(scene, key, beside) or key in here)
    route = (*plan.lanelets[: start + 1], beside)
    edges = scene.edge_graph.route(route)
    return plan if edges is None else replace(plan, lanelets=route, edges=scene.edge_graph.extended(edges, beside))


def _is_beside(scene: Scene, key: int, other: int) -> bool:
    lane = scene.layout.table.lanes[key]
    return other in (lane.left, lane.right)


def _leads_on(scene: Scene, plan: DrivePlan, lanelet_id: int, edge: str) -> bool:
    """Whether a lane leads to the edge that follows on the route (always at its end)."""
    onward = plan.edges[plan.edges.index(edge) + 1 :][:1]
    paths, lane_of = scene.layout.paths, scene.layout.lane_of
    indices = scene.edge_graph.paths_from.get(lanelet_id, ())
    return not onward or any(lane_of[paths[index].exit][0] == onward[0] for index in indices)


def _no_such_lane(edit: Edit, scene: Scene, plan: DrivePlan, here: int) -> NotPossible:
    other = {"left": "right", "right": "left"}[str(edit.lane)]
    there = [f"lane={other}"] if _beside(scene, here, other) is not None else []
    later = [f"on lanelet {key}" for key in plan.lanelets if _beside(scene, key, str(edit.lane)) is not None]
    return NotPossible(
        f"vehicle {plan.start.obstacle_id} has no lane of its direction to its {edit.lane} on lanelet {here}",
        valid=[*there, *later],
        next_step="choose another time or another lane",
    )


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
        plan, step = _plan_from(scene, changes, vehicle_id, edit.time_s)
        limit = class_of(plan.start.kind).maximum_speed_mps
        if not 0.0 <= wanted <= limit:
            raise InvalidRequest(
                f"a {plan.start.kind} does not drive {edit.speed}",
                valid=[f"0 … {limit:g} m/s"],
                next_step="choose another speed",
            )
        changes = changes.with_plan(_with_manoeuvre(plan, Manoeuvre(step, speed_mps=wanted)))
        speeds[vehicle_id] = (wanted, step)
    when = "" if edit.time_s is None else f" from {edit.time_s:g} s on"
    return EditStep(changes, vehicles, f"{_named(vehicles)} held to {wanted:.1f} m/s{when}", speeds=speeds)


def shift_time(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Move the recordings of the selected vehicles in time; what falls outside the scenario is cut off.

    The motion itself stays as recorded, unless the vehicle would hit another one: then it is handed over, too.

    Raises:
        InvalidRequest: no time, or one that leaves nothing of a recording.
        NotPossible: a vehicle that was added, is driven by an earlier edit, or has no trajectory.
    """
    steps = 0 if edit.time_s is None else round(edit.time_s / scene.step_s)
    if steps == 0:
        raise InvalidRequest(
            "shift_time needs a time_s of at least one time step",
            valid=["time_s=2 (later)", "time_s=-1.5 (earlier)"],
            next_step=f"name a time_s of {scene.step_s:g} or more, or of {-scene.step_s:g} or less",
        )
    vehicles = select(edit.vehicles, scene, changes)
    for vehicle_id in vehicles:
        _check(scene, changes, vehicle_id)
        before = changes.replays.get(vehicle_id)
        recording = before.recording if before and before.recording else scene.tracks[vehicle_id]
        total = steps + (before.shifted_steps if before else 0)
        track = moved_in_time(recording, total, scene)
        if track is None:
            raise _nothing_left(recording, total, scene)
        changes = changes.with_replay(Replay(track, scene.matcher.match(track), recording, total))
    how = f"{abs(steps) * scene.step_s:g} s {'later' if steps > 0 else 'earlier'}"
    return EditStep(changes, vehicles, f"{_named(vehicles)} {how} than recorded")


def _check(scene: Scene, changes: Changes, vehicle_id: int) -> None:
    if changes.is_added(vehicle_id):
        raise NotPossible(f"vehicle {vehicle_id} is not recorded", next_step=f"leave it out with '!{vehicle_id}'")
    if vehicle_id in changes.driven:
        raise NotPossible(
            f"vehicle {vehicle_id} does not drive its recording any more",
            next_step="shift it before the edit that drives it, on the scenario without that edit",
        )
    if vehicle_id not in scene.tracks:
        raise NotPossible(
            f"obstacle {vehicle_id} has no trajectory that moves in time",
            valid=nearest_ids(vehicle_id, list(scene.tracks)),
            next_step="name one that drives",
        )


def _nothing_left(track: Track, steps: int, scene: Scene) -> InvalidRequest:
    low = (FEWEST_STATES - 1 - track.last_step) * scene.step_s
    high = (scene.last_step - FEWEST_STATES + 1 - track.first_step) * scene.step_s
    return InvalidRequest(
        f"{steps * scene.step_s:g} s leave nothing of vehicle {track.obstacle_id}'s recording",
        valid=[f"time_s in {low:g} … {high:g}"],
        next_step="shift it by less",
    )


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
    behaviours: list[Behaviour] = []
    for vehicle_id in vehicles:
        plan = plan_of(scene, changes, vehicle_id)
        own_gap_m = own_minimum_gap_m(plan.vehicle_class)
        behaviour = behaviour_from(plan.behaviour, edit.preset, edit.params, own_gap_m)
        if edit.preset and own_gap_m is not None and behaviour.values["minGap"] == own_gap_m:
            kept.append(f"{plan.vehicle_class.name} {vehicle_id} keeps its own minGap of {own_gap_m:g} m")
        changes = changes.with_plan(replace(plan, behaviour=behaviour))
        behaviours.append(behaviour)
    words = [edit.preset.strip().lower()] if edit.preset else []
    what = f"{' '.join([*words, *values_set(edit.params, behaviours)])} for {_listed(vehicles)}"
    notes = "; ".join([what, *kept[:_MOST_NAMED]])
    return EditStep(changes, vehicles, notes, parameters=parameters_set(edit.preset, edit.params))


def _plan_from(scene: Scene, changes: Changes, vehicle_id: int, time_s: float | None) -> tuple[DrivePlan, int]:
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


def _with_manoeuvre(plan: DrivePlan, manoeuvre: Manoeuvre) -> DrivePlan:
    """The plan with one more manoeuvre; they stay in the order of their steps, later ones of a step last."""
    manoeuvres = sorted((*plan.manoeuvres, manoeuvre), key=lambda order: order.from_step)
    return replace(plan, manoeuvres=tuple(manoeuvres))


def _named(vehicles: tuple[int, ...]) -> str:
    """Vehicles for a sentence; many are cut short."""
    return f"vehicle{'s' if len(vehicles) > 1 else ''} {_listed(vehicles)}"


def _listed(vehicles: tuple[int, ...]) -> str:
    return ", ".join(str(key) for key in vehicles[:_MOST_NAMED]) + (" …" if len(vehicles) > _MOST_NAMED else "")
