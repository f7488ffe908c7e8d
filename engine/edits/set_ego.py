"""Edit G: let the ego start elsewhere, or be another of the recorded cars."""

from dataclasses import replace

import numpy as np

from plannerforge.engine.edits.behaviours import usual_behaviour
from plannerforge.engine.edits.car_limits import LARGEST_SPEED_MPS
from plannerforge.engine.edits.changes import Changes, DrivePlan, EditStep, GoalChange
from plannerforge.engine.edits.goal_reach import check_task, distance_along, goal_task, kept_goal, kept_speeds
from plannerforge.engine.edits.occupancy import free_places, occupant
from plannerforge.engine.edits.placing import Place, first_place
from plannerforge.engine.edits.scene import EGO_SIZE_M, Ego, Scene
from plannerforge.engine.edits.selection import select
from plannerforge.engine.geometry.polyline import project
from plannerforge.engine.scenarios.ego_route import goal_lanelets
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.engine.traffic.vehicle_classes import vehicle_classes
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.grammar import parse_quantity
from plannerforge.schemas.modification import Edit

LET_VANISH = "let it vanish: nobody can drive it on"
AFTER_START = "add a set_goal edit after set_ego, or choose another start"


def set_ego(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Start the ego at another place or speed, or put it in the place of a recorded car, which leaves the traffic.

    In the place of a car the goal becomes the end of that car's recording. The former ego vanishes, or becomes a car
    that SUMO drives to the former goal.

    Raises:
        InvalidRequest: neither a car nor a start, or both, or a former ego that stays where the ego still starts.
        NotPossible: no ego, no such car at the ego's first step, or a place that is taken.
    """
    ego = scene.ego
    if ego is None:
        raise NotPossible("the scenario has no ego", next_step="choose a scenario with a planning problem")
    moved = edit.at is not None or edit.speed is not None
    if bool(edit.vehicles) == moved:
        raise InvalidRequest(
            "set_ego takes either a car in 'vehicles' or a start",
            valid=["vehicles=[ID]", "at=LANELET", "speed='8m/s'"],
            next_step="give one of these",
        )
    if edit.former_ego == "traffic" and not edit.vehicles and edit.at is None:
        raise InvalidRequest(
            "former_ego=traffic would put a car where the ego still starts",
            valid=["at=LANELET", "vehicles=[ID]", "former_ego=vanish"],
            next_step="let the ego start elsewhere too",
        )
    before = changes
    if edit.vehicles:
        changes, what = _instead_of(edit, scene, changes, ego)
    else:
        changes, what = _started(edit, scene, changes, ego)
    if edit.former_ego != "traffic":
        return EditStep(changes, (), what)
    plan = _former(scene, before, ego)
    who = plan.start.obstacle_id
    changes = replace(changes.with_plan(plan), next_id=who + 1)
    return EditStep(changes, (who,), f"{what}; the former ego is car {who}", added=(who,))


def check_goal(scene: Scene, changes: Changes) -> None:
    """Refuse a new start of the ego from which its goal cannot be reached, or not in its time at its speed.

    Raises:
        NotPossible: the goal lies where no lanelet leads from the start, or no car meets it from there.
    """
    if changes.ego is None:
        return
    _check_way(scene, changes, changes.ego)
    goal = changes.goal or kept_goal(scene, changes.ego)
    way = None if goal is None else scene.lanelet_graph.shortest_route(changes.ego.lanelets, (goal.lanelet_id,))
    if goal is None or way is None:
        return
    station = project(scene.layout.table.lanes[goal.lanelet_id].center, goal.center)[0]
    task = goal_task(scene, changes.ego, goal, distance_along(scene, changes.ego, way, station))
    try:
        check_task(scene, changes.ego, goal, task)
    except NotPossible as error:
        message = f"the goal on lanelet {goal.lanelet_id} cannot be met from the ego's new start: {error.message}"
        raise NotPossible(message, valid=error.valid, next_step=AFTER_START) from error


def _check_way(scene: Scene, changes: Changes, ego: Ego) -> None:
    problem = scene.loaded.problem(ego.problem_id)
    goals = (changes.goal.lanelet_id,) if changes.goal else goal_lanelets(scene.network, problem)
    if goals and scene.lanelet_graph.shortest_route(ego.lanelets, goals) is None:
        raise NotPossible(
            f"the goal on lanelet {', '.join(map(str, goals))} cannot be reached from the ego's new start on lanelet "
            f"{', '.join(map(str, ego.lanelets))}",
            next_step=AFTER_START,
        )


def _instead_of(edit: Edit, scene: Scene, changes: Changes, ego: Ego) -> tuple[Changes, str]:
    chosen = select(edit.vehicles, scene, changes)
    cars = [key for key, track in scene.tracks.items() if _fits(scene, changes, track, ego.step)]
    if len(chosen) != 1 or chosen[0] not in cars:
        names = ", ".join(map(str, chosen))
        raise NotPossible(
            f"vehicle {names} cannot become the ego: that takes one recorded car, on a lanelet when the ego starts",
            valid=cars,
            next_step="name one of these",
        )
    track = scene.tracks[chosen[0]]
    index = ego.step - track.first_step
    new = Ego(
        ego.problem_id,
        ego.step,
        track.positions[index],
        float(track.headings_rad[index]),
        max(float(track.speeds_mps[index]), 0.0),
        (scene.matches[chosen[0]].at(index),),
    )
    changes = replace(changes.without(chosen[0]), ego=new)
    what = f"the ego is car {chosen[0]} at {new.speed_mps:.1f} m/s"
    goal = _goal_at_its_end(scene, track)
    if goal is None:
        return changes, what
    return replace(
        changes, goal=goal
    ), f"{what}, its goal where that car's recording ends, on lanelet {goal.lanelet_id}"


def _fits(scene: Scene, changes: Changes, track: Track, step: int) -> bool:
    key = track.obstacle_id
    there = track.index_at(step) is not None and track.last_step > step and key in scene.matches
    return track.kind == "car" and there and key not in changes.removed


def _goal_at_its_end(scene: Scene, track: Track) -> GoalChange | None:
    """The last recorded place of a car as goal, which time and speed are widened to; None where it has no place."""
    ego = scene.ego
    if ego is None or not goal_lanelets(scene.network, scene.loaded.problem(ego.problem_id)):
        return None
    state = scene.loaded.problem(ego.problem_id).goal.state_list[0]
    time = getattr(state, "time_step", track.last_step)
    first, last = int(getattr(time, "start", time)), int(getattr(time, "end", time))
    asked, there = kept_speeds(scene, ego), max(float(track.speeds_mps[-1]), 0.0)
    keeps_speeds = asked is None or asked[0] <= there <= asked[1]
    return GoalChange(
        problem_id=ego.problem_id,
        lanelet_id=scene.matches[track.obstacle_id].lanelets[-1],
        center=track.positions[-1],
        heading_rad=float(track.headings_rad[-1]),
        size_m=None,
        steps=(min(first, track.last_step), max(last, track.last_step)),
        speed_mps=None if asked is None or keeps_speeds else (min(asked[0], there), max(asked[1], there)),
    )


def _started(edit: Edit, scene: Scene, changes: Changes, ego: Ego) -> tuple[Changes, str]:
    speed = ego.speed_mps if edit.speed is None else parse_quantity(edit.speed, "m/s")
    if not 0.0 <= speed <= LARGEST_SPEED_MPS:
        raise InvalidRequest(
            f"the ego does not drive {edit.speed}",
            valid=[f"0 … {LARGEST_SPEED_MPS:g} m/s"],
            next_step="choose another speed",
        )
    if edit.at is None:
        return replace(changes, ego=replace(ego, speed_mps=speed)), f"the ego starts at {speed:.1f} m/s"
    place = first_place(edit, scene, changes, EGO_SIZE_M[0])
    _check_free(edit, scene, changes, place, ego)
    position, heading = place.pose(scene)
    new = Ego(ego.problem_id, ego.step, position, heading, speed, (place.lanelet_id,))
    what = f"the ego starts on lanelet {place.lanelet_id} at {place.station_m:.1f} m, {speed:.1f} m/s"
    return replace(changes, ego=new), what


def _check_free(edit: Edit, scene: Scene, changes: Changes, place: Place, ego: Ego) -> None:
    """The former ego is in the way only where it stays as traffic."""
    others = scene if edit.former_ego == "traffic" else replace(scene, ego=None)
    who = occupant(others, changes, place, EGO_SIZE_M, ego.step)
    if who:
        raise NotPossible(
            f"lanelet {place.lanelet_id} at {place.station_m:.1f} m is taken by {who}",
            valid=free_places(others, changes, place, EGO_SIZE_M, ego.step),
            next_step="choose a free place",
        )


def _former(scene: Scene, changes: Changes, ego: Ego) -> DrivePlan:
    """The former ego as a car that drives to the former goal, or straight on."""
    if not ego.lanelets:
        raise NotPossible("the former ego stands on no lanelet", valid=["former_ego=vanish"], next_step=LET_VANISH)
    problem = scene.loaded.problem(ego.problem_id)
    goals = (changes.goal.lanelet_id,) if changes.goal else goal_lanelets(scene.network, problem)
    goals = tuple(key for key in goals if key in scene.layout.table.lanes)
    way = scene.lanelet_graph.shortest_route(ego.lanelets[:1], goals) if goals else None
    edges = scene.edge_graph.route(way or ego.lanelets[:1])
    if edges is None:
        way, edges = None, scene.edge_graph.route(ego.lanelets[:1])
    if edges is None:
        raise NotPossible(
            "the former ego's way leaves the lanelet graph", valid=["former_ego=vanish"], next_step=LET_VANISH
        )
    lanelets, car = way or ego.lanelets[:1], vehicle_classes()["car"]
    start = Track(
        obstacle_id=changes.next_id,
        kind=car.commonroad_type,
        length_m=EGO_SIZE_M[0],
        width_m=EGO_SIZE_M[1],
        first_step=ego.step,
        positions=np.asarray(ego.position)[None],
        headings_rad=np.array([ego.heading_rad]),
        speeds_mps=np.array([ego.speed_mps]),
    )
    return DrivePlan(
        start=start,
        cause="added",
        from_step=ego.step,
        lanelets=lanelets,
        edges=scene.edge_graph.extended(edges, lanelets[-1]),
        targets=frozenset(goals) if way else frozenset(),
        behaviour=usual_behaviour(car),
        vehicle_class=car,
    )
