"""Why a driven vehicle does not get where, or does not drive as fast as, an edit wants it to."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import groupby

import numpy as np
import shapely
from numpy.typing import NDArray

from ...schemas.errors import NotPossible
from ...schemas.modification import VehicleRoute
from ..commonroad import Track
from ..cosimulation import LANE_CHANGE_S, DrivePlan, Manoeuvre, TakenOverTrack, pedestrian_of
from ..geometry import Values, project
from ..scene import NOT_DRIVEN, Scene
from .changes import Changes, EditStep
from .edited_scene import EditedScene, SimulationResult, new_overlaps

# ---------- driven_way
# The lanelets that a vehicle drives over: those of SUMO's lanes that the motion which is written gets onto.

SHORT_M = 5.0
"""A vehicle may be past a lanelet shorter than this within one step, so that no step shows it there."""
LOOK_BACK = 4
ON_IT_M = 0.5
"""So much of a vehicle's front half is on a lanelet, or half of a shorter one's length: with less it is at its line."""


def driven_lanelets(scene: Scene, track: TakenOverTrack, plan: DrivePlan) -> tuple[int, ...]:
    """Lanelets that the driven part gets onto, in order, as SUMO assigns its lanes."""
    first = plan.lanelets[:1] if track.first_step == plan.start.first_step else ()
    found = _lanelets_passed(scene, track.lanes, first)
    over = plan.junction_lane_change
    if over is not None and over.lanelet_id in found:
        found = first + found[found.index(over.lanelet_id) :]
    return found[:1] + _gone_onto(scene, track, found[1:])


def driven_since(scene: Scene, track: TakenOverTrack, step: int) -> tuple[int, ...]:
    """Lanelets that a vehicle gets onto from a step on, in order."""
    begin = max(step - track.first_step, 0)
    return _gone_onto(scene, track, _lanelets_passed(scene, track.lanes[begin:]), begin)


def _lanelets_passed(scene: Scene, lanes: Iterable[str], first: Iterable[int] = ()) -> tuple[int, ...]:
    """The lanelets of SUMO's lanes in order, after those of ``first``, with those that are leapt over in one step."""
    found = list(first)
    for lane, _ in groupby(lanes):
        for key in scene.layout.lanelets_of_lane.get(lane, ()):
            if key not in found[-LOOK_BACK:]:
                found += [*_leapt_over(scene, found[-1:], key), key]
    return tuple(found)


def _gone_onto(scene: Scene, track: TakenOverTrack, lanelets: tuple[int, ...], begin: int = 0) -> tuple[int, ...]:
    """The lanelets without those at the end that the vehicle, from an index of its motion on, does not get onto."""
    count = len(lanelets)
    while count and not _gets_onto(scene, track, lanelets[count - 1], begin):
        count -= 1
    return lanelets[:count]


def _gets_onto(scene: Scene, track: TakenOverTrack, lanelet_id: int, begin: int) -> bool:
    """Whether more of a vehicle's front half than its bumper is on a lanelet at any step."""
    area = scene.matcher.area(lanelet_id)
    least_m = min(ON_IT_M, scene.lanelet_graph.length_m[lanelet_id] / 2)
    halves = np.stack([track.fronts, track.motion.positions], axis=1)[begin:]
    return any(
        bool((shapely.length(shapely.intersection(area, shapely.linestrings(part))) > least_m).any())
        for part in (halves[-1:], halves)
    )


def _leapt_over(scene: Scene, before: list[int], after: int) -> tuple[int, ...]:
    graph = scene.lanelet_graph
    if not before or after in (*graph.successors.get(before[0], ()), *graph.neighbours.get(before[0], ())):
        return ()
    between = (graph.shortest_route(before, [after]) or ())[1:-1]
    return between if all(graph.length_m[key] < SHORT_M for key in between) else ()


# ---------- leaders
# Behind whom a driven vehicle was, and what road users are called.

NEAR_M, NEAR_S, ASIDE_M = 5.0, 2.0, 2.0
"""Somebody so near ahead, by way or by time, and no farther beside, holds a vehicle up."""
LEADER_SHARE = 0.5
Indices = NDArray[np.intp]


def leader(track: TakenOverTrack, others: Mapping[int, Track], indices: Indices) -> int | None:
    """Behind whom a vehicle was for most of some steps (n,), which count from its first one; None for nobody."""
    found = []
    for key, other in others.items():
        there = indices + (track.first_step - other.first_step)
        both = (there >= 0) & (there < len(other.positions))
        if key == track.vehicle_id or both.sum() <= LEADER_SHARE * len(indices):
            continue
        gap_m = _gaps_m(track, other, indices[both], there[both])
        near = gap_m <= np.maximum(NEAR_M, NEAR_S * track.motion.speeds_mps[indices[both]])
        if near.sum() > LEADER_SHARE * len(indices):
            found.append((-int(near.sum()), float(gap_m[near].mean()), key))
    return min(found)[2] if found else None


def _in_words(scene: Scene, key: int) -> str:
    """What somebody is called; the ego has its planning problem's id, below zero where an obstacle has it too."""
    if scene.ego is not None and key not in scene.tracks and abs(key) == scene.ego.problem_id:
        return "the ego"
    if key < 0:
        return f"pedestrian {pedestrian_of(key)}"
    is_walker = key in scene.tracks and scene.tracks[key].kind in NOT_DRIVEN
    return f"{'pedestrian' if is_walker else 'vehicle'} {key}"


def _gaps_m(track: TakenOverTrack, other: Track, indices: Indices, there: Indices) -> Values:
    """The room between two vehicles at some steps (n,); infinite where the other is not right ahead."""
    heading = track.motion.headings_rad[indices]
    x, y = (other.positions[there] - track.motion.positions[indices]).T
    ahead, aside = x * np.cos(heading) + y * np.sin(heading), y * np.cos(heading) - x * np.sin(heading)
    room_m = ahead - (track.length_m + other.length_m) / 2
    return np.where((ahead > 0.0) & (np.abs(aside) <= ASIDE_M), room_m, np.inf)


# ---------- delays
# What kept a driven vehicle from getting on: red lights, standing, slow lanelets, and who drove ahead.

STANDING_MPS = 0.1
LEAST_STANDING_S = 1.0
SLOW_MPS = 8.0
"""A lanelet whose limit or bend allows less is a reason to be late."""
AT_THE_LIMIT, LEAST_SHARE = 0.9, 0.5
"""Who drives at so much of what its lanelets allow, for so much of its time, is held to it."""
AT_LINE_M = 3.0
"""Who stands no farther than this before the end of a lanelet is the first at its line."""
RED = frozenset("ru")


def delay(scene: Scene, track: TakenOverTrack, others: Mapping[int, Track], driven: tuple[int, ...] = ()) -> str:
    """What held a vehicle up, as the end of a sentence: where it stood longest, slow lanelets, somebody ahead, or "".

    ``others``: everybody as the edits leave them. ``driven``: the lanelets that it gets onto; with its bumper over the
    line of the next one it stands on the last.
    """
    steps, key = _longest_stand(scene, track, driven)
    stood_s = len(steps) * scene.step_s
    if stood_s >= LEAST_STANDING_S:
        where = f"{_standing(scene, track, steps, key)} lanelet {key}"
        return f", after {stood_s:.1f} s {where}{_behind(scene, track, others, steps)}"
    slow = _slow_lanelet(scene, track)
    if slow is None:
        behind = _behind(scene, track, others, range(track.first_step, track.last_step + 1))
        return f",{behind}" if behind else ""
    return f", on lanelets that allow no more than {scene.driven_speeds_mps[slow]:.1f} m/s ({slow})"


def _behind(scene: Scene, track: TakenOverTrack, others: Mapping[int, Track], steps: Sequence[int]) -> str:
    """Behind whom a vehicle was for most of some steps, in words; "" for nobody."""
    ahead = leader(track, others, np.array(steps) - track.first_step)
    return "" if ahead is None else f" behind {_in_words(scene, ahead)}"


def _standing(scene: Scene, track: TakenOverTrack, steps: list[int], key: int) -> str:
    """How a vehicle stands on a lanelet at some steps, in words that end before the lanelet's name."""
    if sum(is_red(scene, key, step) for step in steps) > len(steps) / 2:
        return "at a red light on"
    return "waiting at the junction after" if _is_at_junction(scene, track, steps[-1], key) else "standing on"


def _is_at_junction(scene: Scene, track: TakenOverTrack, step: int, key: int) -> bool:
    """Whether a vehicle is the first at the end of a lanelet that leads into a junction."""
    lane = scene.layout.table.lanes[key]
    if key not in scene.layout.lane_of or scene.layout.lane_of.keys() >= set(scene.layout.table.successors[key]):
        return False
    front = track.fronts[step - track.first_step]
    return project(lane.center, front)[0] >= lane.length_m - AT_LINE_M


def _longest_stand(scene: Scene, track: TakenOverTrack, driven: tuple[int, ...]) -> tuple[list[int], int]:
    """The steps at which a vehicle stood in the lanelet in which it stood longest, and its id; no steps if in none."""
    stands: dict[int, list[int]] = {}
    for index, (lane, speed) in enumerate(zip(track.lanes, track.motion.speeds_mps, strict=False)):
        if speed < STANDING_MPS:
            under = scene.layout.lanelets_of_lane.get(lane, ())
            for key in [key for key in under if key in driven or not driven][-1:] or driven[-1:]:
                stands.setdefault(key, []).append(track.first_step + index)
    if not stands:
        return [], 0
    key, steps = max(stands.items(), key=lambda stand: (len(stand[1]), -stand[0]))
    return steps, key


def is_red(scene: Scene, lanelet_id: int, step: int) -> bool:
    """Whether a lanelet has lights and all of them are red, or red and yellow, at a time step."""
    letters = [one.letter_at(step * scene.step_s) for one in scene.signals if lanelet_id in one.lanelets]
    return bool(letters) and RED.issuperset(letters)


def _slow_lanelet(scene: Scene, track: TakenOverTrack) -> int | None:
    """The lanelet that held a vehicle to its own low speed for longest; None where it drove slower or freely."""
    held: dict[int, int] = {}
    for lane, speed in zip(track.lanes, track.motion.speeds_mps, strict=False):
        for key in scene.layout.lanelets_of_lane.get(lane, ())[-1:]:
            allowed = scene.driven_speeds_mps[key]
            if allowed < SLOW_MPS and speed >= AT_THE_LIMIT * allowed:
                held[key] = held.get(key, 0) + 1
    if sum(held.values()) < LEAST_SHARE * len(track.motion.speeds_mps):
        return None
    return max(held, key=lambda key: (held[key], -key))


# ---------- missed_aims
# Why a driven vehicle does not get where, or does not drive as fast as, an edit wants it to.

SPEED_TOLERANCE_MPS = 0.3
STILL_CHANGING_MPS2 = 0.3
MOST_NAMED = 3


def vehicle_route(edited: EditedScene, step: EditStep, key: int) -> VehicleRoute:
    """The lanelets that a vehicle drives, as simulated, and whether it gets to one lanelet of each aim of an edit.

    For one that does not get there in time they go on as it would drive, as long as there is a route.
    """
    scene, plan, track = edited.scene, edited.result.plans[key], edited.result.tracks[key]
    driven, aims = driven_lanelets(scene, track, plan), step.aims.get(key, ())
    if not aims:
        return VehicleRoute(vehicle_id=key, lanelets=driven)
    later = driven_since(scene, track, step.since[key]) if key in step.since else driven
    missed = [targets for targets in aims if not targets & set(later)]
    if not missed:
        return VehicleRoute(vehicle_id=key, lanelets=driven, arrives=True)
    reason = _why_not(edited, step, key, driven, missed[0])
    return VehicleRoute(
        vehicle_id=key, lanelets=(*driven, *_rest_of_route(scene, plan, track, driven)), arrives=False, reason=reason
    )


def _rest_of_route(scene: Scene, plan: DrivePlan, track: TakenOverTrack, driven: tuple[int, ...]) -> tuple[int, ...]:
    """The lanelets after the driven ones to the nearest target of a plan; none where no route is left."""
    if track.leaves or not plan.targets or plan.targets & set(driven):
        return ()
    route = scene.lanelet_graph.shortest_route(driven[-1:] or plan.lanelets[:1], sorted(plan.targets))
    return () if route is None else route[len(driven[-1:]) :]


def _why_not(edited: EditedScene, step: EditStep, key: int, driven: tuple[int, ...], targets: frozenset[int]) -> str:
    """The reason for which a vehicle, which drives over these lanelets, gets to none of an edit's targets."""
    plan, track = edited.result.plans[key], edited.result.tracks[key]
    if _sent_elsewhere(step, plan, targets):
        return "a later edit sends it another way"
    since = step.since.get(key, track.first_step)
    return _held_up(edited.scene, plan, track, driven, targets, since, edited.road_users)


def check_not_driven_past(edited: EditedScene, key: int) -> None:
    """Refuse to send a recorded vehicle to a target that it passes for good.

    One that waits for a gap, or can still come back to its target, is on its way.

    Raises:
        NotPossible: naming the target, and why the vehicle does not get there.
    """
    scene, plan, track = edited.scene, edited.result.plans[key], edited.result.tracks[key]
    driven = driven_lanelets(scene, track, plan)
    leads_there = plan.targets & (set(plan.lanelets) | _beside_any(scene, frozenset(plan.lanelets)))
    if plan.cause != "edited" or not leads_there or plan.targets & set(driven):
        return
    ahead = None if track.leaves else scene.lanelet_graph.shortest_route(driven[-1:], sorted(plan.targets))
    if ahead is None:
        reason = _held_up(scene, plan, track, driven, plan.targets, track.first_step, {})
        raise NotPossible(
            f"vehicle {track.vehicle_id} would drive past lanelet {_first_target(plan, plan.targets)}: {reason}, and "
            "it is too fast to wait for a gap",
            next_step="choose a target farther on or straight ahead, or make room beside it",
        )


def speeds_reached(edited: EditedScene, step: EditStep) -> list[str]:
    """For each vehicle that is held to a speed, when it reaches it, or how close it comes and what keeps it from it."""
    scene, result = edited.scene, edited.result
    found = []
    for key, (wanted, first) in step.speeds.items():
        track = result.tracks.get(key)
        if track is None:
            continue
        later = _next_speed(step, result.plans[key])
        until = None if later is None else max(later.from_step - track.first_step + 1, 1)
        speeds = track.motion.speeds_mps[max(first - track.first_step, 0) : until]
        near = np.flatnonzero(np.abs(speeds - wanted) <= SPEED_TOLERANCE_MPS)
        if len(near):
            when = (max(first, track.first_step) + int(near[0])) * scene.step_s
            found.append(f"{key} reaches it at {when:.1f} s")
        elif later is not None:
            held = f"{later.speed_mps:.1f} m/s from {later.from_step * scene.step_s:g} s on"
            found.append(f"{key} does not reach it: another edit holds it to {held}")
        elif len(speeds):
            closest = float(speeds[np.argmin(np.abs(speeds - wanted))])
            found.append(
                f"{key} does not reach it, {closest:.1f} m/s at best: {_held_back(scene, track, speeds, wanted)}"
            )
    return found


def _held_up(
    scene: Scene,
    plan: DrivePlan,
    track: TakenOverTrack,
    driven: tuple[int, ...],
    targets: frozenset[int],
    since: int,
    others: Mapping[int, Track],
) -> str:
    """The missing gap if the vehicle was beside a target, else where it is at the end."""
    target, last = _first_target(plan, targets), driven[-1] if driven else plan.lanelets[0]
    ends = f"it leaves the network on lanelet {last}" if track.leaves else _scenario_ends(scene)
    edges = {scene.layout.lane_of[key][0] for key in targets if key in scene.layout.lane_of}
    lane = track.lanes[-1] if track.lanes else ""
    gets_over = not targets.isdisjoint(scene.layout.lanelets_of_lane.get(lane, ()))
    if lane.rpartition("_")[0] in edges and not gets_over:
        missing = "room" if (track.last_step - since) * scene.step_s > LANE_CHANGE_S else "time"
        beside = _beside_last(scene, track, targets)
        return f"no {missing} to change into lanelet {beside} before {ends}{_in_the_way(scene, track)}"
    if set(driven) & _beside_any(scene, targets) and not gets_over:
        return f"no room to change into lanelet {target} before its road ends{_in_the_way(scene, track)}"
    if track.leaves:
        return f"{ends} before lanelet {target}"
    if float(track.motion.speeds_mps[-1]) < 0.1:
        return f"it stands on lanelet {last} when {ends}{delay(scene, track, others, driven)}"
    return f"{ends} while it is on its way to lanelet {target}{delay(scene, track, others, driven)}"


def _in_the_way(scene: Scene, track: TakenOverTrack) -> str:
    """Who left no room for a change of lane, in words; empty where nobody is known to."""
    found = [_in_words(scene, key) for key in track.blocked_by]
    more = " and others" if len(found) > MOST_NAMED else ""
    return f"; in the way: {', '.join(found[:MOST_NAMED])}{more}" if found else ""


def _held_back(scene: Scene, track: TakenOverTrack, speeds: Values, wanted_mps: float) -> str:
    """Why a speed is not reached by the last of those since it was ordered: no time, or something in the way.

    Nothing in the way keeps a vehicle from slowing down, and in less than a second nothing can be told.
    """
    a_second = round(1.0 / scene.step_s)
    gained_mps = float(speeds[-1] - speeds[-a_second - 1]) if len(speeds) > a_second else math.inf
    if speeds[-1] < wanted_mps and gained_mps < STILL_CHANGING_MPS2:
        return "traffic ahead, a junction or a bend holds it back"
    if track.leaves:
        return "it leaves the network before"
    return _scenario_ends(scene)


def _scenario_ends(scene: Scene) -> str:
    return f"the scenario ends at {scene.last_step * scene.step_s:.1f} s"


def _beside_any(scene: Scene, lanelets: frozenset[int]) -> set[int]:
    """All lanelets side by side with any of some."""
    edges = {scene.layout.lane_of[key][0] for key in lanelets if key in scene.layout.lane_of}
    return {key for edge in edges for key in scene.layout.edges[edge]}


def _first_target(plan: DrivePlan, targets: frozenset[int]) -> int:
    return next((key for key in plan.lanelets if key in targets), min(targets))


def _beside_last(scene: Scene, track: TakenOverTrack, targets: frozenset[int]) -> int:
    """The target on the edge where the vehicle is last."""
    edge = track.lanes[-1].rpartition("_")[0]
    return min(key for key in targets if scene.layout.lane_of.get(key, ("", 0))[0] == edge)


def why_shifts_are_driven(edited: EditedScene, vehicles: tuple[int, ...]) -> list[str]:
    """For the first three of an edit's vehicles that are moved in time and driven after all: since when, and why."""
    driven = [key for key in edited.driven_shifts if key in vehicles]
    more = [f"{len(driven) - MOST_NAMED} more are driven, too"] if len(driven) > MOST_NAMED else []
    return [_why_shift_is_driven(edited, key) for key in driven[:MOST_NAMED]] + more


def _why_shift_is_driven(edited: EditedScene, key: int) -> str:
    scene, tracks = edited.scene, edited.result.tracks
    driven = f"{key} is driven from {tracks[key].first_step * scene.step_s:.1f} s on"
    mine = edited.shifted_bodies[key]
    after = {other: edited.bodies[other] for other in tracks}
    for there in (edited.requested_bodies, after):
        hits = new_overlaps([mine], (body for other, body in there.items() if other != key), {key: mine})
        if hits:
            return f"{driven}: its recording would hit vehicle {hits[0].second} at {hits[0].step * scene.step_s:.1f} s"
    return f"{driven}, because others react"


def why_undone(
    op: str, step: EditStep, later: tuple[EditStep, ...], result: SimulationResult, routes: tuple[VehicleRoute, ...]
) -> str | None:
    """Why nothing is left of an edit; None where something is."""
    final = (step, *later)[-1].changes
    if _is_replaced(op, step, final):
        return "a later edit replaces it"
    arrived = [route.vehicle_id for route in routes if route.arrives]
    if not step.vehicles or _superseded(step, later, result, arrived) != step.vehicles:
        return None
    is_removed = all(_is_gone(key, step, final) for key in step.vehicles)
    return "a later edit removes what it is about" if is_removed else "later edits overrule it"


def _sent_elsewhere(step: EditStep, plan: DrivePlan, targets: frozenset[int]) -> bool:
    """Whether a later edit sends a vehicle, whose plan at last this is, another way than to an edit's targets."""
    key = plan.start.obstacle_id
    own = step.changes.driven[key]
    asked = [one for one in own.manoeuvres if one.lanes_left and one.from_step == step.since.get(key)]
    later = [one for one in plan.manoeuvres if one.lanes_left and one not in own.manoeuvres]
    if asked and any(one.lanes_left * asked[-1].lanes_left < 0 for one in later):
        return True
    is_changed = (plan.targets, plan.lanelets) != (own.targets, own.lanelets)
    return is_changed and not targets & (plan.through | set(plan.lanelets))


def _next_speed(step: EditStep, plan: DrivePlan) -> Manoeuvre | None:
    """The order of another edit that follows in time on the speed to which an edit holds a vehicle."""
    wanted, first = step.speeds[plan.start.obstacle_id]
    own = Manoeuvre(first, speed_mps=wanted)
    after = plan.manoeuvres[plan.manoeuvres.index(own) + 1 :]
    return next((one for one in after if one.speed_mps is not None), None)


def _superseded(
    step: EditStep, later: Sequence[EditStep], result: SimulationResult, arrived: Collection[int]
) -> tuple[int, ...]:
    """The vehicles of an edit for which later edits leave nothing of it: gone, sent elsewhere, never held or driven so.

    ``arrived``: those who got where it sent them nevertheless.
    """
    final = (step, *later)[-1].changes
    left = [key for key in step.vehicles if key not in arrived]
    return tuple(
        key
        for key in left
        if _is_gone(key, step, final) or _is_set_anew(step, key, later) or _is_superseded_by_plan(step, key, result)
    )


def _is_gone(key: int, step: EditStep, final: Changes) -> bool:
    """Whether a vehicle that an edit drives, adds or moves in time is taken out by a later one."""
    before = {*step.changes.driven, *step.changes.replays}
    return key in before and key not in {*final.driven, *final.replays}


def _is_replaced(op: str, step: EditStep, final: Changes) -> bool:
    """Whether a later edit sets another goal or start of the ego than an edit of this operation."""
    if op == "set_goal":
        return final.goal is not step.changes.goal
    return op == "set_ego" and final.ego is not step.changes.ego


def _is_set_anew(step: EditStep, key: int, later: Sequence[EditStep]) -> bool:
    """Whether later edits set all parameters that an edit sets, whatever they were."""
    of_vehicle = [other.parameters for other in later if key in other.vehicles]
    anew = {name for parameters in of_vehicle for name, is_whatever in parameters.items() if is_whatever}
    return bool(step.parameters) and anew.issuperset(step.parameters)


def _is_superseded_by_plan(step: EditStep, key: int, result: SimulationResult) -> bool:
    plan, track = result.plans.get(key), result.tracks.get(key)
    if plan is None or track is None:
        return False
    if key in step.speeds:
        later = _next_speed(step, plan)
        return later is not None and later.from_step <= step.speeds[key][1]
    aims = step.aims.get(key, ())
    return bool(aims) and all(_sent_elsewhere(step, plan, targets) for targets in aims)
