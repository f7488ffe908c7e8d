"""What the ego would do as an ordinary driver: the motion that stands for it where nothing was planned yet.

A planning problem holds a start and a goal, no motion. SUMO drives the ego once from its start towards its goal among
the recorded vehicles; that motion is then replayed, so that the vehicles that edits drive see an ego and keep clear of
it, and it is the path against which the danger before and after the edits is measured.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from plannerforge.engine.edits.behaviours import usual_behaviour
from plannerforge.engine.edits.changes import Changes, DrivePlan
from plannerforge.engine.edits.danger import Danger, danger_to
from plannerforge.engine.edits.handover import touched_track
from plannerforge.engine.edits.participants import Participant, driven_participant, participants, replayed_participant
from plannerforge.engine.edits.resimulation import resimulate
from plannerforge.engine.edits.scene import EGO_SIZE_M, Ego, Scene
from plannerforge.engine.edits.sumo_process import SimulationSetup
from plannerforge.engine.planners.route import goal_lanelets
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.engine.traffic.vehicle_classes import vehicle_classes

CLASS = "car"
UNCHANGED = Changes(next_id=0, driven={})


@dataclass(frozen=True)
class EgoDrive:
    """The ego's motion, and how dangerous it is among the recorded ones."""

    track: Track
    danger: Danger


def base_drive(base: Scene, setup: SimulationSetup) -> EgoDrive | None:
    """The ego's motion among the recorded vehicles of a base scenario; None without one."""
    if base.ego is None:
        return None
    track = ordinary_drive(base, base.ego, problem_goals(base, base.ego), setup)
    if track is None:
        return None
    others = [*base.standing.values(), *(region.track for region in base.regions)]
    return EgoDrive(track, danger_to(track, others, base.tracks.values(), step_s=base.step_s))


def drive_after(
    before: EgoDrive | None, base: Scene, scene: Scene, changes: Changes, setup: SimulationSetup
) -> Track | None:
    """The ego's motion in the scene that edits make of a base scenario: another one where they change start or goal."""
    ego, goal = scene.ego, changes.goal
    if ego is None or (ego is base.ego and goal is None):
        return None if before is None else before.track
    goals = problem_goals(scene, ego) if goal is None else (goal.lanelet_id,)
    return ordinary_drive(scene, ego, goals, setup, changes)


def problem_goals(scene: Scene, ego: Ego) -> tuple[int, ...]:
    """Lanelets of the goal of the ego's planning problem, ascending; empty where the goal has no place."""
    return tuple(goal_lanelets(scene.network, scene.loaded.problem(ego.problem_id).goal) or ())


def ordinary_drive(
    scene: Scene, ego: Ego, goals: Collection[int], setup: SimulationSetup, changes: Changes = UNCHANGED
) -> Track | None:
    """The ego's motion on the shortest way to any of the goal lanelets, else straight on.

    None where the ego stands on no lanelet or begins when the scenario ends.
    """
    plan = _plan(scene, ego, goals)
    if plan is None:
        return None
    recorded = participants(scene, {}, changes.removed, changes.replays.values())
    driven = resimulate(setup, (*recorded, driven_participant(scene, plan)))
    seen = driven.get(plan.start.obstacle_id)
    motion = None if seen is None else touched_track(plan.start, seen, scene.step_s, scene.last_step)
    return None if motion is None else motion.whole(plan.start)


def ego_participant(scene: Scene, drive: Track) -> Participant | None:
    """The ego as a replayed road user of a re-simulation; None where it is off the lanes."""
    match = scene.matcher.match(drive)
    return None if match is None else replayed_participant(scene, drive, match)


def _plan(scene: Scene, ego: Ego, goals: Collection[int]) -> DrivePlan | None:
    drivable = [key for key in ego.lanelets if key in scene.layout.table.lanes]
    if not drivable:
        return None
    way = scene.lanelet_graph.shortest_route(drivable, sorted(goals)) or drivable[:1]
    way = tuple(key for key in way if key in scene.layout.table.lanes)
    edges = scene.edge_graph.route(way) or scene.edge_graph.route(drivable[:1])
    if edges is None:
        return None
    vehicle_class = vehicle_classes()[CLASS]
    return DrivePlan(
        start=_start(scene, ego),
        cause="added",
        from_step=ego.step,
        lanelets=way,
        edges=scene.edge_graph.extended(edges, way[-1]),
        targets=frozenset(goals),
        behaviour=usual_behaviour(vehicle_class),
        vehicle_class=vehicle_class,
    )


def _start(scene: Scene, ego: Ego) -> Track:
    """The ego's first pose. Its id is below zero where a file gives its planning problem's to an obstacle as well."""
    is_taken = ego.problem_id in scene.tracks or ego.problem_id in scene.standing
    return Track(
        obstacle_id=-ego.problem_id if is_taken else ego.problem_id,
        kind=CLASS,
        length_m=EGO_SIZE_M[0],
        width_m=EGO_SIZE_M[1],
        first_step=ego.step,
        positions=ego.position[None],
        headings_rad=np.array([ego.heading_rad]),
        speeds_mps=np.array([ego.speed_mps]),
    )
