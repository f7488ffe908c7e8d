"""CommonRoad elements of road users that are not driven but moved in time or added on foot, and of the ego's start."""

import numpy as np
from lxml import etree

from plannerforge.engine.edits.changes import Replay
from plannerforge.engine.edits.handover import TouchedTrack
from plannerforge.engine.edits.scenario_document import ScenarioDocument
from plannerforge.engine.edits.scene import Ego
from plannerforge.engine.edits.state_elements import Element, exact, obstacle_element, point_element, state_step
from plannerforge.engine.traffic.smoothing import Motion
from plannerforge.engine.traffic.vehicle_classes import nearest_class

_INITIAL_OF = {"trajectory": "initialState", "signalSeries": "initialSignalState"}
_AT_REST = {"yawRate": 0.0, "slipAngle": 0.0, "acceleration": 0.0}


def write_replay(document: ScenarioDocument, replay: Replay, step_s: float) -> None:
    """Move the states of a recorded obstacle in time, or put an added walker in."""
    if replay.recording is None:
        motion = replayed_motion(replay, step_s)
        track = replay.track
        touched = TouchedTrack(
            vehicle_id=track.obstacle_id,
            first_step=track.first_step,
            motion=motion,
            length_m=track.length_m,
            width_m=track.width_m,
            wheelbase_m=nearest_class(track.kind, track.length_m).wheelbase_m,
            leaves=False,
            lanes=(),
        )
        element = obstacle_element(track.kind, touched, step_s, is_2018b=document.is_2018b)
        document.add_obstacle(element)
        return
    obstacle = document.obstacle(replay.track.obstacle_id)
    for tag, initial in _INITIAL_OF.items():
        _move(obstacle, tag, initial, replay)


def replayed_motion(replay: Replay, step_s: float) -> Motion:
    """A given track as a motion."""
    speeds = replay.track.speeds_mps
    accelerations = np.gradient(speeds, step_s) if len(speeds) > 1 else np.zeros(1)
    return Motion(replay.track.positions, replay.track.headings_rad, speeds, accelerations)


def write_ego_start(document: ScenarioDocument, ego: Ego) -> None:
    """Replace place, heading and speed of a planning problem's initial state; the rest of its motion is at rest."""
    state = document.problem(ego.problem_id).find("initialState")
    if state is None:
        return
    values = {"orientation": ego.heading_rad, "velocity": ego.speed_mps, **_AT_REST}
    for child in [one for one in state if isinstance(one.tag, str)]:
        made = point_element(ego.position) if child.tag == "position" else None
        if child.tag in values:
            made = exact(str(child.tag), values[str(child.tag)])
        if made is not None:
            document.replace_children(state, [child], [made])


def _move(obstacle: Element, tag: str, initial_tag: str, replay: Replay) -> None:
    """Move an initial state and those of a list by the replay's steps; those outside its track go."""
    initial, series = obstacle.find(initial_tag), obstacle.find(tag)
    states = [one for one in (initial, *([] if series is None else series)) if one is not None]
    kept = []
    for state in [one for one in states if isinstance(one.tag, str)]:
        step = state_step(state) + replay.shifted_steps
        if replay.track.first_step <= step <= replay.track.last_step:
            _set_step(state, step)
            kept.append(state)
        elif state is not initial and series is not None:
            series.remove(state)
    if initial is None or series is None or not kept or kept[0] is initial:
        return
    for child in list(initial):
        initial.remove(child)
    initial.extend(list(kept[0]))
    series.remove(kept[0])


def _set_step(state: Element, step: int) -> None:
    time = state.find("time")
    if time is None:
        return
    for child in list(time):
        time.remove(child)
    etree.SubElement(time, "exact").text = str(step)
