"""Edited scenes as CommonRoad files: states, obstacles, goals and the ego's start as XML elements.

Only elements of touched road users and of the planning problem are rewritten; all other elements stay identical to the
byte.
"""

import numpy as np
from lxml import etree

from ..commonroad import LoadedScenario, ScenarioDocument, Track, center_of, middle_of
from ..cosimulation import HandoverTrack, Replay
from ..geometry import Points, wrap_angle
from ..scene import Ego
from ..vehicles import Motion, nearest_class, steering_angles
from .changes import GoalChange
from .edited_scene import EditedScene

DECIMALS = 6
"""Coordinates to a micrometre (chosen)."""
_USUAL_FIELDS = ("position", "orientation", "time", "velocity", "acceleration")
USUAL_GOAL_SIZE_M = (6.0, 2.0)
"""Length and width of a goal region if neither the request nor the file gives one, as in the paper's code."""
_Element = etree._Element
_INITIAL_OF = {"trajectory": "initialState", "signalSeries": "initialSignalState"}
"""The element with the first state of each list of states."""
AT_REST = {"yawRate": 0.0, "slipAngle": 0.0, "acceleration": 0.0}
"""Motion values for a new start of the ego, which does not specify them."""


def write_edits(document: ScenarioDocument, edited: EditedScene) -> list[str]:
    """Write the changes of the edits into a document.

    Returns:
        Sentences on what else had to change.
    """
    changes, result, step_s = edited.changes, edited.result, edited.scene.step_s
    ordered = {key for key, plan in result.plans.items() if plan.manoeuvres or plan.ignores_lights}
    prescribed = ordered | {key for key, replay in changes.replays.items() if replay.is_scripted}
    if prescribed:
        document.set_prescribed(prescribed)
    scripts = {key: replay.script for key, replay in changes.replays.items() if replay.script is not None}
    document.set_scripts(
        [script.text() for script in scripts.values()],
        without=changes.removed | changes.replays.keys() | result.tracks.keys(),
    )
    for key in sorted(changes.removed):
        document.remove(document.obstacle(key))
    for replay in changes.replays.values():
        _write_replay(document, replay, step_s)
    for key, track in result.tracks.items():
        if result.plans[key].cause == "added":
            document.add_obstacle(_obstacle_element(track, track.motion, step_s, is_2018b=document.is_2018b))
        else:
            _write_touched(document, track, step_s)
    if changes.ego is not None:
        if starts_elsewhere(changes.ego, edited.scene.loaded):
            _write_ego_start(document, changes.ego)
        document.set_ego_class(changes.ego.problem_id, changes.ego.vehicle_class)
    return [] if changes.goal is None else write_goal(document, changes.goal)


def _write_touched(document: ScenarioDocument, track: HandoverTrack, step_s: float) -> None:
    """Replace the states of a recorded obstacle after its hand-over; earlier states stay unchanged."""
    trajectory = document.obstacle(track.obstacle_id).find("trajectory")
    if trajectory is None:
        return
    states = trajectory.findall("state")
    fields = tuple(str(child.tag) for child in states[0])
    later = [state for state in states if _state_step(state) > track.first_step]
    new = _state_elements(track, track.motion, fields, step_s)[1:]
    if later:
        document.replace_children(trajectory, later, new)
    else:
        document.replace_children(trajectory, states[-1:], [states[-1], *new])


def _state_elements(track: Track, motion: Motion, fields: tuple[str, ...], step_s: float) -> list[_Element]:
    """Return ``<state>`` elements for the motion along a track, with the given fields."""
    rates = np.gradient(motion.headings_rad, step_s)
    steering = steering_angles(motion, step_s, nearest_class(track.kind, track.length_m).wheelbase_m)
    states = []
    for index in range(len(motion.speeds_mps)):
        values = {
            "orientation": wrap_angle(float(motion.headings_rad[index])),
            "velocity": float(motion.speeds_mps[index]),
            "acceleration": float(motion.accelerations_mps2[index]),
            "yawRate": float(rates[index]),
            "slipAngle": 0.0,
            "steeringAngle": float(steering[index]),
        }
        state = etree.Element("state")
        for field in fields:
            if field == "position":
                state.append(_point_element(motion.positions[index]))
            elif field == "time":
                _sub(state, "time", exact=str(track.first_step + index))
            elif field in values:
                _sub(state, field, exact=_number(values[field]))
        states.append(state)
    return states


def _sub(parent: _Element, name: str, **texts: str) -> _Element:
    """Append a new element to another, with a child for each text, and return it."""
    element = etree.SubElement(parent, name)
    for tag, text in texts.items():
        etree.SubElement(element, tag).text = text
    return element


def _obstacle_element(track: Track, motion: Motion, step_s: float, *, is_2018b: bool) -> _Element:
    """Return the element of a moving road user."""
    obstacle = etree.Element("obstacle" if is_2018b else "dynamicObstacle", id=str(track.obstacle_id))
    if is_2018b:
        etree.SubElement(obstacle, "role").text = "dynamic"
    etree.SubElement(obstacle, "type").text = track.kind
    _sub(_sub(obstacle, "shape"), "rectangle", length=_number(track.length_m), width=_number(track.width_m))
    states = _state_elements(track, motion, _USUAL_FIELDS, step_s)
    states[0].tag = "initialState"
    obstacle.append(states[0])
    trajectory = etree.SubElement(obstacle, "trajectory")
    trajectory.extend(states[1:])
    return obstacle


def write_goal(document: ScenarioDocument, goal: GoalChange) -> list[str]:
    """Replace the goal of a planning problem; what the edit does not give stays unchanged.

    Returns:
        Sentences on what else had to change.
    """
    problem = document.problem(goal.problem_id)
    if goal.keeps_place:
        _set_intervals(document, problem, goal)
        return []
    states = problem.findall("goalState") or [_first_goal(problem)]
    notes = []
    if len(states) > 1:
        notes.append(f"the {len(states)} goal states of problem {goal.problem_id} were merged into one")
        for state in states[1:]:
            problem.remove(state)
    old = states[0]
    new = etree.Element("goalState")
    new.append(_goal_position(old, goal))
    orientation = old.find("orientation")
    if orientation is not None:
        new.append(_turned(orientation, goal.heading_rad))
        notes.append("the goal's orientation interval was rotated to its lanelet's direction")
    for name, interval in (("time", goal.steps), ("velocity", goal.speed_mps)):
        element = old.find(name)
        if interval is not None:
            new.append(_interval(name, *interval))
        elif element is not None:
            element.tail = None
            new.append(element)
    document.replace_children(problem, [old], [new])
    return notes


def _set_intervals(document: ScenarioDocument, problem: _Element, goal: GoalChange) -> None:
    """Give each goal state of a problem the time and speed of an edit; its place and orientation stay."""
    states = problem.findall("goalState") or [_first_goal(problem)]
    new_of = {name: one for name, one in (("time", goal.steps), ("velocity", goal.speed_mps)) if one is not None}
    changed = []
    for old in states:
        new = etree.Element("goalState")
        for element in list(old):
            element.tail = None
            interval = new_of.get(str(element.tag))
            new.append(element if interval is None else _interval(str(element.tag), *interval))
        # Time precedes velocity in the format, and both follow the place.
        new.extend(_interval(name, *one) for name, one in new_of.items() if new.find(name) is None)
        changed.append(new)
    document.replace_children(problem, states, changed)


def _first_goal(problem: _Element) -> _Element:
    """Append an empty goal state, indented like the other elements, to a problem without a goal, and return it."""
    before = problem[-1]
    goal = etree.SubElement(problem, "goalState")
    before.tail, goal.tail = problem.text, before.tail
    return goal


def _goal_position(old: _Element, goal: GoalChange) -> _Element:
    rectangle = old.find("position/rectangle")
    size = goal.size_m or USUAL_GOAL_SIZE_M
    if goal.size_m is None and rectangle is not None:
        size = float(rectangle.findtext("length", "0")), float(rectangle.findtext("width", "0"))
    position = etree.Element("position")
    heading = _number(wrap_angle(goal.heading_rad))
    shape = _sub(position, "rectangle", length=_number(size[0]), width=_number(size[1]), orientation=heading)
    _sub(shape, "center", x=_number(float(goal.center[0])), y=_number(float(goal.center[1])))
    return position


def _turned(orientation: _Element, heading_rad: float) -> _Element:
    """Return an orientation interval around a new heading, as wide as the old interval."""
    start, end = float(orientation.findtext("intervalStart", "0")), float(orientation.findtext("intervalEnd", "0"))
    half = min(abs(end - start) / 2, 3.14)
    middle = wrap_angle(heading_rad)
    return _interval("orientation", middle - half, middle + half)


def _interval(name: str, start: float, end: float) -> _Element:
    element = etree.Element(name)
    for tag, value in (("intervalStart", start), ("intervalEnd", end)):
        etree.SubElement(element, tag).text = str(value) if isinstance(value, int) else _number(value)
    return element


def _point_element(position: Points) -> _Element:
    """Return a ``<position>`` with one point."""
    element = etree.Element("position")
    _sub(element, "point", x=_number(float(position[0])), y=_number(float(position[1])))
    return element


def _state_step(state: _Element) -> int:
    """Return the time step of a state; the first step of an interval."""
    exact = state.findtext("time/exact")
    return int(exact if exact is not None else state.findtext("time/intervalStart", "0"))


def _number(value: float) -> str:
    rounded = round(value, DECIMALS)
    return f"{rounded + 0.0:.{DECIMALS}f}".rstrip("0").rstrip(".") if rounded else "0"


def _write_replay(document: ScenarioDocument, replay: Replay, step_s: float) -> None:
    """Write a replay: shift a recorded obstacle's states in time, replace them, or add a new obstacle."""
    if replay.is_parked:
        document.add_obstacle(_parked_element(replay.track, is_2018b=document.is_2018b), is_static=True)
        return
    if replay.recording is None:
        motion = replayed_motion(replay.track, step_s)
        document.add_obstacle(_obstacle_element(replay.track, motion, step_s, is_2018b=document.is_2018b))
        return
    obstacle = document.obstacle(replay.track.obstacle_id)
    if replay.shifted_steps == 0:
        _write_prescribed(document, obstacle, replay, step_s)
        return
    for tag, initial in _INITIAL_OF.items():
        _move(obstacle, tag, initial, replay)


def _write_prescribed(document: ScenarioDocument, obstacle: _Element, replay: Replay, step_s: float) -> None:
    """Replace the states that an edit prescribes, and the body if it changed; the other bytes are kept."""
    track, recording, trajectory = replay.track, replay.recording, obstacle.find("trajectory")
    if recording is None or trajectory is None:
        return
    if (track.kind, track.size_m) != (recording.kind, recording.size_m):
        _write_body(document, obstacle, track)
    states = trajectory.findall("state")
    fields = tuple(str(child.tag) for child in states[0])
    new = _state_elements(track, replayed_motion(track, step_s), fields, step_s)
    initial = obstacle.find("initialState")
    if replay.from_step < track.first_step and initial is not None:
        _write_first_state(document, initial, track, step_s)
    changed = [state for state in states if _state_step(state) > replay.from_step]
    if len(changed) == len(states):
        document.replace_children(trajectory, states, new[1:])
    else:
        begin = replay.from_step - track.first_step + 1
        kept = changed or states[-1:]
        document.replace_children(trajectory, kept, [*([] if changed else kept), *new[begin:]])


def _write_body(document: ScenarioDocument, obstacle: _Element, track: Track) -> None:
    """Write the class and the size of a road user."""
    kind, shape = obstacle.find("type"), obstacle.find("shape")
    if kind is not None:
        kind.text = track.kind
    if shape is not None:
        new = etree.Element("shape")
        _sub(new, "rectangle", length=_number(track.length_m), width=_number(track.width_m))
        document.replace_children(obstacle, [shape], [new])


def _write_first_state(document: ScenarioDocument, initial: _Element, track: Track, step_s: float) -> None:
    """Write a new position, heading and speed into an initial state; its other values are kept."""
    fields = tuple(str(child.tag) for child in initial if isinstance(child.tag, str))
    first = _state_elements(track.part(0, 2), replayed_motion(track.part(0, 2), step_s), fields, step_s)[0]
    document.replace_children(initial, [one for one in initial if isinstance(one.tag, str)], list(first))


def _parked_element(track: Track, *, is_2018b: bool) -> _Element:
    """Return the element of a parked vehicle."""
    obstacle = etree.Element("obstacle" if is_2018b else "staticObstacle", id=str(track.obstacle_id))
    if is_2018b:
        etree.SubElement(obstacle, "role").text = "static"
    etree.SubElement(obstacle, "type").text = track.kind
    _sub(_sub(obstacle, "shape"), "rectangle", length=_number(track.length_m), width=_number(track.width_m))
    state = etree.SubElement(obstacle, "initialState")
    state.append(_point_element(track.positions[0]))
    _sub(state, "orientation", exact=_number(wrap_angle(float(track.headings_rad[0]))))
    _sub(state, "time", exact="0")
    return obstacle


def replayed_motion(track: Track, step_s: float) -> Motion:
    """Return a given track as a motion."""
    accelerations = np.gradient(track.speeds_mps, step_s) if len(track.speeds_mps) > 1 else np.zeros(1)
    return Motion(track.positions, track.headings_rad, track.speeds_mps, accelerations)


def _write_ego_start(document: ScenarioDocument, ego: Ego) -> None:
    """Replace position, heading and speed in a problem's initial state; its other motion values become 0."""
    state = document.problem(ego.problem_id).find("initialState")
    if state is None:
        return
    values = {"orientation": ego.heading_rad, "velocity": ego.speed_mps, **AT_REST}
    for child in [one for one in state if isinstance(one.tag, str)]:
        if child.tag == "position":
            document.replace_children(state, [child], [_point_element(ego.position)])
        elif child.tag in values:
            new = etree.Element(child.tag)
            etree.SubElement(new, "exact").text = _number(values[str(child.tag)])
            document.replace_children(state, [child], [new])


def starts_elsewhere(ego: Ego, loaded: LoadedScenario) -> bool:
    """Return True if an ego's position, heading or speed at the start differs from its planning problem's."""
    state = loaded.problem(ego.problem_id).initial_state
    is_there = bool(np.array_equal(ego.position, np.asarray(center_of(state.position), dtype=float)))
    is_as_fast = ego.speed_mps == middle_of(state.velocity) and ego.heading_rad == middle_of(state.orientation)
    return not (is_there and is_as_fast)


def _move(obstacle: _Element, tag: str, initial_tag: str, replay: Replay) -> None:
    """Shift an initial state and a list of states by the replay's steps; remove the states outside its track."""
    initial, series = obstacle.find(initial_tag), obstacle.find(tag)
    states = [one for one in (initial, *([] if series is None else series)) if one is not None]
    kept = []
    for state in [one for one in states if isinstance(one.tag, str)]:
        step = _state_step(state) + replay.shifted_steps
        if replay.track.first_step <= step <= replay.track.last_step:
            set_step(state, step)
            kept.append(state)
        elif state is not initial and series is not None:
            series.remove(state)
    if initial is None or series is None or not kept or kept[0] is initial:
        return
    for child in list(initial):
        initial.remove(child)
    initial.extend(list(kept[0]))
    series.remove(kept[0])


def set_step(state: _Element, step: int) -> None:
    """Give a state of a file a new time step; a state without a time stays unchanged."""
    time = state.find("time")
    if time is None:
        return
    for child in list(time):
        time.remove(child)
    etree.SubElement(time, "exact").text = str(step)
