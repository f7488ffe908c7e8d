"""Describe a scenario in words and ids, so that an edit can be written from it.

The description covers the ego (start, goal, route), vehicles and lanelets near a focus, and a few checks: whether the
file is valid, the goal can be reached, and anything overlaps at the start. Lengths in m, speeds in m/s.
"""

from collections.abc import Collection, Mapping
from itertools import islice, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...schemas.errors import NotPossible, UnknownName, closest
from ...schemas.scenarios import (
    LANELETS_SHOWN,
    VEHICLES_SHOWN,
    DescribedEgo,
    DescribedFocus,
    DescribedLanelet,
    DescribedVehicle,
    DescribeRequest,
    Description,
    Reach,
)
from ...schemas.text import counted
from ..commonroad import Track, limits_kmh, schema_errors, signs_of
from ..cosimulation import not_drivable
from ..edits import Changes, is_unchanged, scene_of, select
from ..execution import ProgressReporter
from ..geometry import Points, arc_length, oriented_rectangle, point_at, project, rectangles_overlap, wrap_angle
from ..scene import (
    NOT_DRIVEN,
    TURN_RAD,
    EgoLane,
    EgoRoute,
    Scene,
    center_line,
    ego_lane,
    ego_route,
    goal_center_lanelets,
    goal_centers,
    is_own_recording,
    lanelets_of_pose,
    obstacle_of,
)
from ..vehicles import GRAVITY_MPS2, MODEL_WORDS, ego_class
from .motion import lanelet_of, motion_of

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem

CHECKED_SHOWN = 3
"""Largest number of vehicles that a failed check lists."""
REACH_SHOWN, _REACH_M = 8, 300.0
"""Largest number of lanelets listed as reachable from a focus, and their largest distance (chosen)."""
OWN_RECORDING = "at the ego's start and speed: its own recording, which counts as a collision until it is removed"


def describe(request: DescribeRequest, report: ProgressReporter) -> Description:
    """Return the ego, vehicles and lanelets near the focus; the detail decides how many.

    Raises:
        UnknownName: the focus is not a vehicle, lanelet or selector.
        NotPossible: the focus has no motion, or no vehicle is present at the requested time.
        UnsafeInput: the file is broken.
    """
    report(0.0, "reading the scenario")
    kept = scene_of(request.path, request.problem_id)
    scene = kept.scene
    ego = _describe_ego(scene)
    begin = (scene.ego.step if scene.ego else 0) + round(request.time_s / scene.step_s)
    center, focus = _center(scene, request.focus, begin)
    name = focus.name if focus is not None else "the ego" if scene.ego is not None else "the middle of the map"
    tracks = scene.tracks | scene.standing
    if request.time_s:
        tracks = _present_at(scene, tracks, begin)
    near = _near(tracks, begin, center, request.radius_m)
    own = next((key for key in near if focus is not None and focus.name == f"vehicle {key}"), None)
    shown = [key for key in near if key != own][: VEHICLES_SHOWN[request.detail]]
    roles = _roles(*kept.neighbours)
    vehicles = _vehicles(scene, center, [*shown, *([] if own is None else [own])], roles, begin)
    if focus is not None:
        focus = focus.model_copy(update={"vehicle": None if own is None else vehicles[own]})
    if request.detail == "motion":
        focus = _with_motion(scene, focus, request.base)
    lanelets, total = _describe_lanelets(scene, ego, center, request.radius_m, LANELETS_SHOWN[request.detail])
    return Description(
        ego=ego,
        focus=name,
        asked=focus,
        vehicles=tuple(vehicles[key] for key in shown),
        vehicles_total=len(tracks) - (own is not None),
        lanelets=lanelets,
        lanelets_total=total,
        checks=tuple(check(scene) for check in _CHECKS) if request.detail == "checks" else (),
        time_s=request.time_s,
        friction=scene.friction,
    )


def _present_at(scene: Scene, tracks: Mapping[int, Track], step: int) -> dict[int, Track]:
    """Return the vehicles that are present at a step, by id.

    Raises:
        NotPossible: no vehicle is present at the step.
    """
    there = {key: track for key, track in tracks.items() if track.index_at(step) is not None}
    if there or not tracks:
        return there
    begin = scene.ego.step if scene.ego else 0
    last_s = (max(track.last_step for track in tracks.values()) - begin) * scene.step_s
    raise NotPossible("the scenario has no vehicle at that time", valid=[f"time_s from 0 to {last_s:g}"])


def _with_motion(scene: Scene, focus: DescribedFocus | None, base: Path | None) -> DescribedFocus:
    """Return the focus with its whole motion; for the ego, the motion in its own recording.

    Raises:
        NotPossible: the focus is a lanelet, a vehicle without a recording, or an ego that was not recorded.
    """
    moving = [f"focus={key}" for key in list(scene.tracks)[:CHECKED_SHOWN]]
    if focus is None:
        own = [
            key for key, track in scene.tracks.items() if scene.ego is not None and is_own_recording(track, scene.ego)
        ]
        if not own:
            raise NotPossible(
                "the ego has no recorded motion: a planner drives it",
                valid=moving,
                next_step="call run_planner, or request the motion of another vehicle",
            )
        focus, key = DescribedFocus(name=f"vehicle {own[0]}", what="the ego's own recording"), own[0]
    else:
        word = focus.name.removeprefix("vehicle ")
        key = int(word) if word.isdigit() else -1
    if key not in scene.tracks:
        raise NotPossible(f"{focus.name} has no recorded motion", valid=moving)
    begin = scene.ego.step if scene.ego else 0
    motion = motion_of(scene, scene.tracks[key], begin, edited=base is not None and _is_edited(scene.tracks[key], base))
    return focus.model_copy(update={"motion": motion})


def _is_edited(track: Track, base: Path) -> bool:
    """Return whether a road user does not move as in the scenario that its file was edited from."""
    known = scene_of(base).scene.tracks.get(track.obstacle_id)
    return known is None or not is_unchanged(track, known)


def _center(scene: Scene, focus: str | None, step: int) -> tuple[Points, DescribedFocus | None]:
    """Return the point (2,) around which everything is listed, and the requested focus; None for ego and map."""
    tracks = scene.tracks | scene.standing
    word = (focus or "ego").strip()
    if word.lower() == "ego":
        if scene.ego is not None:
            return scene.ego.position, None
        vertices = np.vstack([lanelet.center_vertices for lanelet in scene.network.lanelets])
        return np.asarray(vertices.mean(axis=0)), None
    if word.isdigit() and int(word) not in tracks:
        lanelet = scene.network.find_lanelet_by_id(int(word))
        if lanelet is None:
            known = [*(str(key) for key in tracks), *(str(lane.lanelet_id) for lane in scene.network.lanelets)]
            raise UnknownName(f"'{word}' is neither a vehicle nor a lanelet", valid=["ego", *closest(word, known)])
        middle = np.asarray(lanelet.center_vertices[len(lanelet.center_vertices) // 2], dtype=float)
        what = f"{scene.lanelet_graph.length_m[int(word)]:.0f} m long"
        return middle, DescribedFocus(name=f"lanelet {word}", what=what, reach=_reach(scene, int(word), 0.0))
    matched = select([word], scene, Changes(next_id=0, driven={}))
    chosen, others = matched[0], f", the first of {len(matched)}" if len(matched) > 1 else ""
    index = tracks[chosen].index_at(step) or 0
    match, point = scene.matches.get(chosen), tracks[chosen].positions[index]
    described = DescribedFocus(name=f"vehicle {chosen}", what="" if word == str(chosen) else f"{word}{others}")
    if match is None:
        return point, described
    station_m = project(center_line(scene.network, match.at(index)), point)[0]
    route = () if chosen in scene.standing else match.sequence
    walks = tracks[chosen].kind in NOT_DRIVEN
    reach = () if walks else _reach(scene, match.at(index), station_m)
    return point, described.model_copy(update={"route": route, "reach": reach})


def _reach(scene: Scene, start: int, station_m: float) -> tuple[Reach, ...]:
    """Return the nearest lanelets outside junctions that a vehicle on a lanelet can reach, as SUMO's vehicles drive."""
    if start not in scene.layout.table.lanes:
        return ()
    graph, reachable = scene.driven_graph, []
    for key in islice(graph.reachable([start]), 1, 5 * REACH_SHOWN):
        route = graph.shortest_route([start], [key])
        if route is None or key not in scene.layout.lane_of:
            continue
        onward = [(at, after) for at, after in pairwise(route) if after in graph.successors[at]]
        distance_m = max(sum(graph.length_m[at] for at, _ in onward) - station_m, 0.0)
        forks = [after for at, after in onward if len(graph.successors[at]) > 1 or after not in scene.layout.lane_of]
        turns = [_direction(scene, after) for after in forks]
        changed = ["lane change"] if len(onward) < len(route) - 1 else []
        turned = tuple(turn for turn in turns if turn != "straight")
        reachable.append(Reach(lanelet_id=key, turns=(*changed, *turned), distance_m=round(distance_m, 1)))
    reachable.sort(key=lambda one: (one.distance_m, one.lanelet_id))
    return tuple(one for one in reachable if one.distance_m <= _REACH_M)[:REACH_SHOWN]


def _near(tracks: Mapping[int, Track], begin: int, center: Points, radius_m: float) -> list[int]:
    """Return the vehicles within a distance of the centre, nearest first, at their described positions."""
    away = sorted((_distance_m(track, begin, center), key) for key, track in tracks.items())
    return [key for distance_m, key in away if distance_m <= radius_m]


def _distance_m(track: Track, begin: int, center: Points) -> float:
    """Return the distance of a vehicle, at its described position, from a point."""
    return round(float(np.linalg.norm(track.positions[track.index_at(begin) or 0] - center)), 1)


def _vehicles(
    scene: Scene, center: Points, keys: Collection[int], roles: Mapping[int, str], at_step: int
) -> dict[int, DescribedVehicle]:
    """Return the given vehicles by id, each at a step or at its first appearance."""
    if not keys:
        return {}
    lane, known = ego_lane(scene, scene.ego) if scene.ego else None, scene.tracks | scene.standing
    begin = scene.ego.step if scene.ego else 0
    seen = {key: _vehicle(scene, lane, known[key], (begin, at_step), center, moves=key in scene.tracks) for key in keys}
    return seen if at_step != begin else {key: _with_role(scene, one, roles) for key, one in seen.items()}


def _with_role(scene: Scene, vehicle: DescribedVehicle, roles: Mapping[int, str]) -> DescribedVehicle:
    """Return the vehicle with its role: the ego's recording, undrivable, or ``lead``/``follow`` in another lane."""
    track = scene.tracks.get(vehicle.vehicle_id)
    if track is not None and scene.ego is not None and is_own_recording(track, scene.ego):
        return vehicle.model_copy(update={"where": OWN_RECORDING, "gap_m": None})
    role = roles.get(vehicle.vehicle_id) if vehicle.gap_m is None else None
    undrivable = _UNDRIVABLE if track is not None and _is_undrivable(scene, track) else None
    return vehicle.model_copy(update={"where": ", ".join(filter(None, [vehicle.where, role, undrivable]))})


_UNDRIVABLE = "its route leaves the lanes: edits cannot drive it"


def _is_undrivable(scene: Scene, track: Track) -> bool:
    """Return True if edits cannot drive a vehicle although its kind can be driven."""
    return track.kind not in NOT_DRIVEN and bool(not_drivable(scene, track.obstacle_id))


def _roles(lead: int | None, follow: int | None) -> dict[int, str]:
    roles = {lead: "lead vehicle (selector lead)", follow: "follower (selector follow)"}
    return {key: role for key, role in roles.items() if key is not None}


def _vehicle(
    scene: Scene, lane: EgoLane | None, track: Track, steps: tuple[int, int], center: Points, *, moves: bool
) -> DescribedVehicle:
    """Return a vehicle at the second of two steps; times count from the first."""
    begin, at_step = steps
    index = track.index_at(at_step) or 0
    match = scene.matches.get(track.obstacle_id)
    lanelet = match.at(index) if match else None
    where = lane.where(track, index, lanelet) if lane else None
    distance = float(np.linalg.norm(track.positions[index] - center))
    speed = float(track.speeds_mps[index])
    return DescribedVehicle(
        vehicle_id=track.obstacle_id,
        kind=track.kind,
        where=where.words if where else f"{distance:.0f} m away",
        lanelet=lanelet_of(scene, track, index),
        speed_mps=round(speed, 4),
        distance_m=round(distance, 1),
        ahead_m=where.ahead_m if where else None,
        gap_m=where.gap_m if where else None,
        from_s=round(max(track.first_step - begin, 0) * scene.step_s, 2),
        until_s=round((track.last_step - begin) * scene.step_s, 2),
        moves=moves and float(track.speeds_mps.max(initial=0.0)) > 0.1,
    )


def _describe_ego(scene: Scene) -> DescribedEgo | None:
    """Return the planning problem of the scene; None if the file has no problem."""
    if scene.ego is None:
        return None
    problem = scene.loaded.problem(scene.ego.problem_id)
    network, point = scene.network, scene.ego.position
    lanelets = lanelets_of_pose(network, point, scene.ego.heading_rad)
    route = ego_route(network, scene.lanelet_graph, problem)
    goals = goal_center_lanelets(network, problem)
    off_map = "none, because the goal is on no lanelet" if goal_centers(problem) else "none"
    route_text = "no route leads to the goal" if goals else off_map
    if route is not None:
        route_text = route.words
    return DescribedEgo(
        problem_id=scene.ego.problem_id,
        vehicle_class=scene.ego.vehicle_class,
        vehicle=vehicle_words(scene.ego.vehicle_class) + _friction_words(scene.friction),
        speed_mps=round(scene.ego.speed_mps, 4),
        lanelets=lanelets,
        lanes=max((len(scene.lanelet_graph.parallel_lanes([key])) for key in lanelets), default=0),
        goal=_goal_words(problem, scene.step_s, point, goals, route),
        **_goal_figures(problem, scene.step_s, point),
        goal_lanelets=goals,
        route=route.lanelets if route else (),
        way=route_text,
    )


def _goal_figures(problem: "PlanningProblem", step_s: float, start: Any) -> dict[str, float]:
    """Return the figures of a goal with one state: its time, and the distance to the centre of its region."""
    states = problem.goal.state_list
    if len(states) != 1:
        return {}
    time, centers = getattr(states[0], "time_step", None), goal_centers(problem)
    figures = {} if not centers else {"goal_distance_m": float(np.linalg.norm(centers[0] - start))}
    if time is None:
        return figures
    first, last = getattr(time, "start", time), getattr(time, "end", time)
    return {**figures, "goal_from_s": first * step_s, "goal_until_s": last * step_s}


def _friction_words(friction: float | None) -> str:
    if friction is None:
        return ""
    return f"; road friction {friction:g}: tyres can sustain at most {friction * GRAVITY_MPS2:.2f} m/s²"


def vehicle_words(name: str) -> str:
    """Return an ego class as text: its name, its motion model, and the source of its limits."""
    known = ego_class(name)
    return f"{known.in_words}, {MODEL_WORDS[known.motion_model]}; limits: {known.source}"


def _goal_words(
    problem: "PlanningProblem", step_s: float, start: Any, lanelets: tuple[int, ...], route: EgoRoute | None
) -> str:
    """Return the position, time, speed and heading that a goal states, as text."""
    states = problem.goal.state_list
    if not states:
        return "not stated"
    parts = []
    if lanelets and problem.goal.lanelets_of_goal_position:
        parts.append(f"lanelet {', '.join(map(str, lanelets[:6]))}{' …' if len(lanelets) > 6 else ''}")
    elif centers := goal_centers(problem):
        on = f" on lanelet{'s' * (len(lanelets) > 1)} {', '.join(map(str, lanelets[:3]))}" if lanelets else ""
        away = (
            f"{float(np.linalg.norm(centers[0] - start)):.0f} m away"
            if route is None
            else f"{route.length_m:.0f} m along the route"
        )
        parts.append(f"region {away}{on}")
    else:
        parts.append("any position")
    first = states[0]
    if getattr(first, "time_step", None) is not None:
        time = _span(first.time_step, step_s)
        parts.append(f"{'from' if ' to ' in time else 'at'} {time} s")
    if getattr(first, "velocity", None) is not None:
        parts.append(f"{_span(first.velocity, 1.0)} m/s")
    if getattr(first, "orientation", None) is not None:
        parts.append(f"heading {_span(first.orientation, 1.0)} rad")
    more = f" (and {counted(len(states) - 1, 'more goal state')})" if len(states) > 1 else ""
    return ", ".join(parts) + more


def _span(value: Any, factor: float) -> str:
    low, high = getattr(value, "start", value), getattr(value, "end", value)
    return f"{low * factor:.3g}" if low == high else f"{low * factor:.3g} to {high * factor:.3g}"


def _describe_lanelets(
    scene: Scene, ego: DescribedEgo | None, center: Points, radius_m: float, most: int
) -> tuple[tuple[DescribedLanelet, ...], int]:
    """Return the lanelets within the radius (those on the ego's route, then the nearest), and the network's total."""
    distances = {
        lanelet.lanelet_id: float(np.min(np.linalg.norm(lanelet.center_vertices - center, axis=1)))
        for lanelet in scene.network.lanelets
    }
    own = set(ego.route or ego.lanelets) if ego else set()
    near = [key for key, distance in distances.items() if distance <= radius_m]
    near.sort(key=lambda key: (key not in own, distances[key], key))
    standing = _vehicles_by_lanelet(scene)
    described = tuple(_lanelet(scene, ego, key, standing.get(key, ())) for key in near[:most])
    return described, len(distances)


def _lanelet(scene: Scene, ego: DescribedEgo | None, key: int, vehicles: tuple[int, ...]) -> DescribedLanelet:
    lanelet, graph = scene.network.find_lanelet_by_id(key), scene.lanelet_graph
    limits = limits_kmh(signs_of(scene.network, [key]))
    opposite = lanelet.adj_left if lanelet.adj_left is not None and not lanelet.adj_left_same_direction else None
    return DescribedLanelet(
        lanelet_id=key,
        edge=scene.layout.lane_of.get(key, (None, 0))[0],
        length_m=round(graph.length_m[key], 1),
        role=_role(ego, key),
        successors=tuple(f"{_direction(scene, following)} {following}" for following in graph.successors[key]),
        left=lanelet.adj_left if lanelet.adj_left is not None and lanelet.adj_left_same_direction else None,
        right=lanelet.adj_right if lanelet.adj_right is not None and lanelet.adj_right_same_direction else None,
        opposite=opposite,
        limit_kmh=limits[0] if limits else None,
        vehicles=vehicles,
    )


def _role(ego: DescribedEgo | None, key: int) -> str:
    if ego is None:
        return ""
    roles = ["ego starts here"] if key in ego.lanelets else []
    roles += ["goal"] if key in ego.goal_lanelets else []
    roles += ["on the ego's route"] if key in ego.route and not roles else []
    return ", ".join(roles)


def _direction(scene: Scene, key: int) -> str:
    """Return the direction in which a lanelet turns from its start to its end."""
    line = center_line(scene.network, key)
    if len(line) < 2:
        return "straight"
    turned = wrap_angle(point_at(line, float(arc_length(line)[-1]))[1] - point_at(line, 0.0)[1])
    if abs(turned) < TURN_RAD:
        return "straight"
    return "left" if turned > 0 else "right"


def _vehicles_by_lanelet(scene: Scene) -> dict[int, tuple[int, ...]]:
    """Return the vehicles by the lanelet on which each starts."""
    begins: dict[int, list[int]] = {}
    for key, match in sorted(scene.matches.items()):
        begins.setdefault(match.lanelets[0], []).append(key)
    return {lanelet: tuple(keys) for lanelet, keys in begins.items()}


def _schema(scene: Scene) -> str:
    errors = schema_errors(scene.loaded.path)
    if not errors:
        return "ok: valid against CommonRoad's XML schema 2020a"
    such = ":" if len(errors) == 1 else ", the first being"
    return f"problem: {counted(len(errors), 'violation')} of CommonRoad's XML schema 2020a{such} {errors[0][:200]}"


def _goal(scene: Scene) -> str:
    if scene.ego is None:
        return "problem: no planning problem"
    problem = scene.loaded.problem(scene.ego.problem_id)
    if not goal_center_lanelets(scene.network, problem):
        return "ok: the goal sets no position on a lanelet, so it needs no route"
    if ego_route(scene.network, scene.lanelet_graph, problem) is None:
        return "problem: no route leads from the ego's start to its goal"
    return "ok: lanelets lead from the ego's start to its goal"


def _overlaps(scene: Scene) -> str:
    if scene.ego is None:
        return "ok: without an ego, nothing overlaps it"
    own = oriented_rectangle(np.asarray(scene.ego.position), scene.ego.heading_rad, scene.ego.size_m)
    step = scene.ego.step
    tracks = [*(scene.tracks | scene.standing).values(), *(region.track for region in scene.regions)]
    there = [(track, track.index_at(step)) for track in tracks]
    boxes = [(obstacle_of(track.obstacle_id), track.corners_at(index)) for track, index in there if index is not None]
    hit = sorted({key for key, corners in boxes if rectangles_overlap(own, corners)})
    if not hit:
        return "ok: no road user overlaps the ego at its start"
    more = f" and {len(hit) - CHECKED_SHOWN} more" if len(hit) > CHECKED_SHOWN else ""
    return f"problem: the ego overlaps obstacle {', '.join(map(str, hit[:CHECKED_SHOWN]))}{more} at its start"


def _off_the_road(scene: Scene) -> str:
    lost = sorted(set(scene.tracks) - set(scene.matches))
    if not lost:
        return "ok: every moving vehicle is on or near a lanelet"
    return (
        f"problem: {counted(len(lost), 'moving vehicle')} not on a lanelet: {', '.join(map(str, lost[:CHECKED_SHOWN]))}"
    )


_CHECKS = (_schema, _goal, _overlaps, _off_the_road)
"""Each returns a sentence on its result that starts with ``ok`` or ``problem``."""
