"""Edits S, of the scene itself: crop it in time or space, mirror it, or change its lights and weather.

These change a whole file, not single elements. The edits before them are applied first; the edits after them start from
their result. Lengths are in m; times count from the scenario's start.
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from ...schemas.errors import LANELETS_LISTED, InvalidRequest, NotPossible, Remedy, misspelt, with_values
from ...schemas.generation import WEATHER_WORDS, WEATHERS, Weather
from ...schemas.grammar import parse_assignment
from ...schemas.modification import Edit, EditOperation
from ...schemas.text import counted, quoted
from ...schemas.vocabulary import LEAST_FRICTION, MOST_FRICTION, ROAD_FRICTIONS, WEATHER_ROADS
from ..commonroad import Track, set_friction, without_scripts
from ..geometry import Points, oriented_rectangle, point_at
from ..scene import Scene
from ..vehicles import GRAVITY_MPS2
from .changes import Changes, listed
from .placement import first_place
from .references import target_lanelets
from .writing import set_step

_Element = etree._Element
Transform = Callable[[Edit, _Element, Scene, Callable[[], Track | None]], str]
"""Changes the root of a file by an edit, in place, and returns what was done; the last argument returns the ego's
drive.
"""
_NEGATED = ("orientation", "steeringAngle", "yawRate", "slipAngle", "steeringAngleSpeed")
"""Values of states that change their sign when a scene is mirrored."""
_MIRRORED_TURNS = {"left": "right", "right": "left", "leftStraight": "straightRight", "straightRight": "leftStraight"}
_COLOURS = {
    "red": "red",
    "yellow": "yellow",
    "green": "green",
    "redyellow": "redYellow",
    "red_yellow": "redYellow",
    "off": "inactive",
    "inactive": "inactive",
}
_THEN = {"red": "green", "yellow": "red", "redYellow": "green", "green": "red"}
"""The colour that follows a light's only colour, as in the usual cycle; a light that is off stays off."""
_HELD_S = 3600.0
"""How long that colour lasts: beyond the end of every scenario and run (chosen)."""
_VALID_FRICTIONS = [f"friction={LEAST_FRICTION:g} to {MOST_FRICTION:g}", f"friction={'|'.join(ROAD_FRICTIONS)}"]
_MOVES_PLACES_OR_TIMES: tuple[EditOperation, ...] = ("crop", "mirror")
_MOVING = ("dynamicObstacle", "obstacle")
_REFERENCES = ("predecessor", "successor", "adjacentLeft", "adjacentRight")
_FEWEST_STATES = 2
_LARGER_M = (100.0, 200.0, 500.0, 1000.0)
"""Sides of the squares that are proposed instead of a rectangle that is too small (chosen)."""


def transformed(edit: Edit, xml: Path, scene: Scene, drive: Callable[[], Track | None], output: Path) -> str:
    """Apply an edit of the scene to a file, write the result to a new file, and return what was done.

    Raises:
        InvalidRequest: arguments are not valid.
        NotPossible: nothing would be left, or the ego or its goal would be gone.
    """
    root = etree.parse(xml, etree.XMLParser(resolve_entities=False, huge_tree=True)).getroot()
    what = TRANSFORMS[edit.op](edit, root, scene, drive)
    if edit.op in _MOVES_PLACES_OR_TIMES and without_scripts(root):
        what += "; motion that reacted to the ego is now a recording of a run in which SUMO drove the ego"
    output.write_bytes(etree.tostring(root.getroottree(), xml_declaration=True, encoding="UTF-8"))
    return what


def _mirror(edit: Edit, root: _Element, scene: Scene, drive: Callable[[], Track | None]) -> str:  # noqa: ARG001
    """Mirror a scene at the east-west axis, so that left becomes right; return what was done as text."""
    for tag in ("point", "center"):
        for point in root.iter(tag):
            _negate(point.find("y"))
    for tag in _NEGATED:
        for value in root.iter(tag):
            _negate_value(value)
    for lanelet in root.iterchildren("lanelet"):
        _exchange(lanelet, "leftBound", "rightBound")
        _exchange(lanelet, "adjacentLeft", "adjacentRight")
    for light in root.iterchildren("trafficLight"):
        direction = light.find("direction")
        if direction is not None:
            direction.text = _MIRRORED_TURNS.get(direction.text or "", direction.text)
    for incoming in root.iter("incoming"):
        _exchange(incoming, "successorsRight", "successorsLeft", repeated=True)
    _invert_left_of(root)
    for place in root.iter("geoTransformation"):
        place.getparent().remove(place)  # type: ignore[union-attr]
    return "left is now right, and traffic drives on the other side; the geographic location was removed"


def _negate(element: _Element | None) -> None:
    if element is not None and element.text:
        text = element.text.strip()
        element.text = text[1:] if text.startswith("-") else text if float(text) == 0.0 else f"-{text}"


def _negate_value(value: _Element) -> None:
    low, high = value.find("intervalStart"), value.find("intervalEnd")
    _negate(value.find("exact"))
    if low is not None and high is not None:
        _negate(low)
        _negate(high)
        low.text, high.text = high.text, low.text
    if not len(value):
        _negate(value)


def _exchange(parent: _Element, first: str, second: str, *, repeated: bool = False) -> None:
    """Swap the names and the positions of two kinds of child elements, so that the schema's order is kept."""
    ones, others = parent.findall(first), parent.findall(second)
    if not repeated and ones and others:
        at, to = parent.index(ones[0]), parent.index(others[0])
        one, other = ones[0], others[0]
        one.tail, other.tail = other.tail, one.tail
        parent.remove(one)
        parent.remove(other)
        low, high = (one, other) if at > to else (other, one)
        parent.insert(min(at, to), low)
        parent.insert(max(at, to), high)
    for one in ones:
        one.tag = second
    for other in others:
        other.tag = first
    if repeated and ones and others:
        places = sorted(parent.index(each) for each in (*ones, *others))
        for each in (*ones, *others):
            parent.remove(each)
        for place, each in zip(places, (*others, *ones), strict=True):
            parent.insert(place, each)


def _invert_left_of(root: _Element) -> None:
    for crossing in root.iter("intersection"):
        incomings = {one.get("id"): one for one in crossing.findall("incoming")}
        pairs = []
        for key, incoming in incomings.items():
            for left in incoming.findall("isLeftOf"):
                pairs.append((key, left.get("ref")))
                incoming.remove(left)
        for key, of in pairs:
            if of in incomings:
                etree.SubElement(incomings[of], "isLeftOf", ref=str(key))


def _crop(edit: Edit, root: _Element, scene: Scene, drive: Callable[[], Track | None]) -> str:
    """Keep a time span, an area, or both; return what was done as text."""
    words = []
    if edit.time_s is None and edit.duration_s is None and edit.rectangle_m is None:
        raise InvalidRequest(
            "crop needs a time or a place",
            valid=["time_s=2 duration_s=6", "at=ego rectangle_m=[100, 60]"],
            remedies=[with_values(duration_s=0.5 * scene.last_step * scene.step_s)],
            next_step="give one of them",
        )
    if edit.rectangle_m is not None:
        words.append(_crop_place(edit, root, scene))
    if edit.time_s is not None or edit.duration_s is not None:
        words.append(_crop_time(edit, root, scene, drive))
    return "; ".join(words)


def _crop_time(edit: Edit, root: _Element, scene: Scene, drive: Callable[[], Track | None]) -> str:
    begin = round((edit.time_s or 0.0) / scene.step_s)
    end = scene.last_step if edit.duration_s is None else begin + round(edit.duration_s / scene.step_s)
    if not 0 <= begin < end <= scene.last_step:
        raise InvalidRequest(
            f"the crop would last from {begin * scene.step_s:g} to {end * scene.step_s:g} s, but the scenario lasts "
            f"from 0 to {scene.last_step * scene.step_s:g} s",
            valid=[f"time_s + duration_s of at most {scene.last_step * scene.step_s:g} s"],
            next_step="choose a part of the scenario",
            remedies=[
                with_values(duration_s=None),
                with_values(time_s=None, duration_s=scene.last_step * scene.step_s),
            ],
        )
    gone = 0
    for obstacle in [one for one in root if one.tag in _MOVING and one.findtext("role") != "static"]:
        gone += not _keeps_states(obstacle, begin, end)
    for light in root.iterchildren("trafficLight"):
        _shift_light(light, begin)
    moved = _shift_problems(root, scene, drive, begin)
    seconds = f"from {begin * scene.step_s:g} to {end * scene.step_s:g} s"
    removed = f"{counted(gone, 'road user')} removed (absent in that time)" if gone else "no road user removed"
    return f"cut to the time {seconds}, now counted from 0; {removed}{moved}"


def _keeps_states(obstacle: _Element, begin: int, end: int) -> bool:
    """Keep the states between two steps and renumber them; remove the obstacle and return False if no state is left."""
    kept_any = False
    for series, first in (("trajectory", "initialState"), ("signalSeries", "initialSignalState")):
        initial, states = obstacle.find(first), obstacle.find(series)
        if initial is None:
            continue
        rows = [initial, *([] if states is None else states.findall("*"))]
        inside = [row for row in rows if begin <= _step_of(row) <= end]
        if first == "initialState":
            kept_any = len(inside) >= (_FEWEST_STATES if states is not None else 1)
            if states is None and obstacle.find("occupancySet") is None:
                kept_any = _step_of(initial) <= end
                inside = rows
            if not kept_any:
                break
        for row in rows[1:]:
            if row not in inside and states is not None:
                states.remove(row)
        for row in inside:
            set_step(row, max(_step_of(row) - begin, 0))
        if inside and inside[0] is not initial and states is not None:
            for child in list(initial):
                initial.remove(child)
            initial.extend(list(inside[0]))
            states.remove(inside[0])
    for occupancy in list(obstacle.iter("occupancy")):
        step = _step_of(occupancy)
        if begin <= step <= end:
            set_step(occupancy, step - begin)
        else:
            occupancy.getparent().remove(occupancy)  # type: ignore[union-attr]
    if not kept_any:
        obstacle.getparent().remove(obstacle)  # type: ignore[union-attr]
    return kept_any


def _step_of(state: _Element) -> int:
    exact = state.findtext("time/exact")
    return int(float(exact if exact is not None else state.findtext("time/intervalStart", "0")))


def _shift_light(light: _Element, begin: int) -> None:
    """Have a light show at time 0 what it showed at a step."""
    cycle = light.find("cycle")
    if cycle is None:
        return
    total = sum(int(one.findtext("duration", "0")) for one in cycle.findall("cycleElement"))
    offset = cycle.find("timeOffset")
    if total <= 0:
        return
    if offset is None:
        offset = etree.Element("timeOffset")
        elements = cycle.findall("cycleElement")
        elements[-1].addnext(offset)
        offset.text = "0"
    offset.text = str((int(offset.text or 0) - begin) % total)


def _shift_problems(root: _Element, scene: Scene, drive: Callable[[], Track | None], begin: int) -> str:
    """Shift the egos' times to start at a step, and return a note; an ego that starts earlier is put where it would be
    then.
    """
    words = ""
    for problem in root.iterchildren("planningProblem"):
        initial = problem.find("initialState")
        if initial is None:
            continue
        start = _step_of(initial)
        if start < begin:
            track = drive() if scene.ego is not None and problem.get("id") == str(scene.ego.problem_id) else None
            index = None if track is None else track.index_at(begin)
            if track is None or index is None:
                raise NotPossible(
                    f"the ego of planning problem {problem.get('id')} starts at {start * scene.step_s:g} s, and its "
                    "later position is unknown",
                    valid=[f"time_s up to {start * scene.step_s:g}"],
                    next_step="choose an earlier time_s",
                    remedies=[with_values(time_s=round(start * scene.step_s, 3))],
                )
            _place_ego(initial, track, index)
            words = "; the ego starts where an ordinary driver would be by then"
        set_step(initial, max(start - begin, 0))
        for goal in problem.findall("goalState"):
            time = goal.find("time")
            for tag in ("intervalStart", "intervalEnd", "exact"):
                value = None if time is None else time.find(tag)
                if value is not None and value.text:
                    value.text = str(max(int(float(value.text)) - begin, 0))
    return words


def _place_ego(initial: _Element, track: Track, index: int) -> None:
    point = initial.find("position/point")
    if point is not None:
        for tag, value in zip("xy", track.positions[index].tolist(), strict=True):
            child = point.find(tag)
            if child is not None:
                child.text = f"{value:.6f}"
    for tag, value in (
        ("orientation", math.remainder(float(track.headings_rad[index]), math.tau)),
        ("velocity", float(track.speeds_mps[index])),
        ("yawRate", 0.0),
        ("slipAngle", 0.0),
        ("acceleration", 0.0),
    ):
        element = initial.find(tag)
        if element is not None:
            for child in list(element):
                element.remove(child)
            etree.SubElement(element, "exact").text = f"{value:.6f}"


def _larger_rectangles(sizes: list[float]) -> list[Remedy]:
    """Return the squares that a refusal of a rectangle proposes."""
    return [with_values(rectangle_m=[side, side]) for side in _LARGER_M if side > max(sizes, default=0.0)]


_ROUND_M, _MARGIN_M = 10.0, 5.0
"""A proposed rectangle is rounded up to this, and keeps at least this margin around the start and the goal (chosen)."""


def _rectangle_around(points: list[Points], center: Points, heading_rad: float, sizes: list[float]) -> list[float]:
    """Return the length and width in m of the smallest rectangle about a centre that contains points and a size."""
    along = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    across = np.array([-along[1], along[0]])
    away = np.array(points) - center
    reach_m = np.abs(np.stack([away @ along, away @ across])).max(axis=1) + _MARGIN_M
    rounded = np.ceil(2 * reach_m / _ROUND_M) * _ROUND_M
    return [max(float(side), asked) for side, asked in zip(rounded, sizes, strict=True)]


def _crop_place(edit: Edit, root: _Element, scene: Scene) -> str:
    """Keep the lanelets that a rectangle touches, and the road users while they are in it; return a note."""
    import shapely

    sizes = edit.rectangle_m or []
    if len(sizes) != 2 or min(sizes) <= 0:
        raise InvalidRequest(
            "rectangle_m is [length, width] in m",
            valid=["rectangle_m=[100, 60]"],
            next_step="give both",
            remedies=_larger_rectangles(sizes),
        )
    place = first_place(edit.model_copy(update={"at": edit.at or "ego"}), scene, Changes(next_id=0, driven={}), 0.0)
    center, heading = place.pose(scene)
    box = shapely.Polygon(oriented_rectangle(center, heading, (sizes[0], sizes[1])))
    kept = {
        int(lanelet.lanelet_id) for lanelet in scene.network.lanelets if lanelet.polygon.shapely_object.intersects(box)
    }
    for problem in root.iterchildren("planningProblem"):
        point = problem.find("initialState/position/point")
        goals = [ref for ref in problem.iterfind("goalState/position/lanelet") if int(ref.get("ref", "0")) not in kept]
        centers = list(problem.iterfind("goalState/position/rectangle/center"))
        spots = [one for one in (point, *centers) if one is not None]
        points = [np.array([float(s.findtext("x", "0")), float(s.findtext("y", "0"))]) for s in spots]
        if goals or not all(box.contains(shapely.Point(*one)) for one in points):
            points += [scene.network.find_lanelet_by_id(int(ref.get("ref", "0"))).center_vertices[-1] for ref in goals]
            needed = _rectangle_around(points, center, heading, sizes)
            raise NotPossible(
                f"the start or the goal of planning problem {problem.get('id')} is outside the rectangle of "
                f"{sizes[0]:g} m by {sizes[1]:g} m",
                valid=[f"rectangle_m=[{needed[0]:g}, {needed[1]:g}]", "set_goal first"],
                next_step="choose a larger rectangle_m, or move the goal first",
                remedies=[with_values(rectangle_m=needed)],
            )
    lanelets = [one for one in root.iterchildren("lanelet") if int(one.get("id", "0")) not in kept]
    for lanelet in lanelets:
        root.remove(lanelet)
    _drop_references(root, kept)
    gone = 0
    for obstacle in [one for one in root if one.tag in (*_MOVING, "staticObstacle")]:
        gone += not _keeps_inside(obstacle, box, shapely.Point)
    counts = f"{counted(len(kept), 'lanelet')} kept, {len(lanelets)} removed, {counted(gone, 'road user')} removed"
    return f"cut to {sizes[0]:g} m by {sizes[1]:g} m: {counts}"


def _keeps_inside(obstacle: _Element, box: object, point_of: Callable[[float, float], object]) -> bool:
    initial = obstacle.find("initialState")
    if initial is None:
        return True
    rows = [initial, *obstacle.findall("trajectory/state")]
    steps = []
    for row in rows:
        point = row.find("position/point")
        if point is None:
            return True
        if box.contains(point_of(float(point.findtext("x", "0")), float(point.findtext("y", "0")))):  # type: ignore[attr-defined]
            steps.append(_step_of(row))
    if not steps or (len(rows) > 1 and steps[-1] - steps[0] < _FEWEST_STATES):
        obstacle.getparent().remove(obstacle)  # type: ignore[union-attr]
        return False
    if len(rows) > 1:
        trajectory = obstacle.find("trajectory")
        for row in rows[1:]:
            if not steps[0] <= _step_of(row) <= steps[-1] and trajectory is not None:
                trajectory.remove(row)
        if _step_of(initial) < steps[0] and trajectory is not None:
            first = trajectory.findall("state")[0]
            for child in list(initial):
                initial.remove(child)
            initial.extend(list(first))
            trajectory.remove(first)
    return True


def _drop_references(root: _Element, kept: set[int]) -> None:
    """Remove references to removed lanelets, and signs and lights that no lanelet refers to any more."""
    for lanelet in root.iterchildren("lanelet"):
        for child in list(lanelet):
            if child.tag in _REFERENCES and int(child.get("ref", "0")) not in kept:
                lanelet.remove(child)
    for crossing in root.findall("intersection"):
        for incoming in crossing.findall("incoming"):
            for child in list(incoming):
                if child.tag != "isLeftOf" and child.get("ref") and int(child.get("ref", "0")) not in kept:
                    incoming.remove(child)
            if incoming.find("incomingLanelet") is None:
                crossing.remove(incoming)
        there = {one.get("id") for one in crossing.findall("incoming")}
        for incoming in crossing.findall("incoming"):
            for left in incoming.findall("isLeftOf"):
                if left.get("ref") not in there:
                    incoming.remove(left)
        for part in crossing.findall("crossing"):
            crossing.remove(part)
        if not there:
            root.remove(crossing)
    for tag, reference in (("trafficSign", "trafficSignRef"), ("trafficLight", "trafficLightRef")):
        used = {one.get("ref") for one in root.iter(reference)}
        for element in root.findall(tag):
            if element.get("id") not in used:
                root.remove(element)


def _set_light(edit: Edit, root: _Element, scene: Scene, drive: Callable[[], Track | None]) -> str:  # noqa: ARG001
    """Give the lights of lanelets new phases, and add missing lights; return what was done as text."""
    lanelets = sorted(target_lanelets(edit.to, scene, Changes(next_id=0, driven={}))) if edit.to else []
    phases = [_phase(text, scene.step_s) for text in edit.params]
    if not lanelets or not phases:
        raise InvalidRequest(
            "set_light needs lanelets in 'to' and phases in 'params'",
            valid=["to=[LANELET] params=['red=10', 'green=20']"],
            next_step="give both",
            remedies=[with_values(params=["red=10", "green=20"])] if lanelets else [LANELETS_LISTED],
        )
    then = _THEN.get(phases[0][1]) if len({colour for _, colour in phases}) == 1 else None
    first_s = sum(steps for steps, _ in phases) * scene.step_s
    if then is not None:
        # A cycle of one colour would never change, so its duration would mean nothing.
        phases.append((round(_HELD_S / scene.step_s), then))
    by_id = {one.get("id"): one for one in root.iterchildren("lanelet")}
    lights = {one.get("id"): one for one in root.iterchildren("trafficLight")}
    changed, lit_now = [], []
    for key in lanelets:
        lanelet = by_id[str(key)]
        refs = [ref.get("ref") for ref in lanelet.findall("trafficLightRef")]
        if not [ref for ref in refs if ref in lights]:
            light = _new_light(root, scene, key)
            lights[light.get("id")] = light
            refs = [light.get("id")]
            reference = etree.Element("trafficLightRef", ref=str(light.get("id")))
            _after_last(lanelet, reference, ("trafficLightRef", "trafficSignRef", "userBidirectional", "userOneWay"))
            lit_now.append(key)
        for ref in refs:
            if ref in lights:
                _write_cycle(lights[ref], phases)
                changed.append(int(ref or 0))
    cycle = ", ".join(f"{colour} {steps * scene.step_s:g} s" for steps, colour in phases)
    new = f"added a light to lanelet {', '.join(map(str, lit_now))}; " if lit_now else ""
    inside = [key for key in lanelets if scene.layout.paths_through.get(key)]
    are = "lanelet {} is" if len(inside) == 1 else "lanelets {} are"
    why = are.format(listed(tuple(inside))) + " inside a junction, so vehicles stop at its entry"
    there = f"; {why}" if inside else ""
    end_s = scene.last_step * scene.step_s
    ends = f"; the scenario ends earlier, at {end_s:g} s" if first_s >= end_s else ""
    shown = sorted(set(changed))
    who = f"light {shown[0]} repeats" if len(shown) == 1 else f"lights {', '.join(map(str, shown))} repeat"
    if then is not None:
        who = f"light {shown[0]} is" if len(shown) == 1 else f"lights {', '.join(map(str, shown))} are"
        return f"{new}{who} {phases[0][1]} for {first_s:g} s from 0 s on, then {then}{ends}{there}"
    if len({colour for _, colour in phases}) == 1:
        who = f"light {shown[0]} is" if len(shown) == 1 else f"lights {', '.join(map(str, shown))} are"
        return f"{new}{who} {phases[0][1]} throughout{there}"
    return f"{new}{who} this cycle from 0 s on: {cycle}{there}"


def _phase(text: str, step_s: float) -> tuple[int, str]:
    given = parse_assignment(text.removesuffix("s"))
    colour = _COLOURS.get(given.name.lower())
    steps = 0 if given.operand is None else round(given.operand / step_s)
    if colour is None or given.operator != "=" or steps < 1:
        raise InvalidRequest(
            f"'{text}' is not a phase of a light",
            valid=["red=10", "green=20", "yellow=3"],
            next_step="write it like these",
            given=text,
        )
    return steps, colour


def _new_light(root: _Element, scene: Scene, lanelet: int) -> _Element:
    """Return a traffic light element at the right edge of a lanelet's end."""
    ids = [one.get("id", "") for one in root.iter() if isinstance(one.tag, str)]
    highest = max((int(one) for one in ids if one.isdigit()), default=0)
    light = etree.Element("trafficLight", id=str(highest + 1))
    etree.SubElement(light, "cycle")
    lane = scene.layout.table.lanes[lanelet]
    end, heading = point_at(lane.center, lane.length_m)
    right = end + lane.width_m / 2 * np.array([math.sin(heading), -math.cos(heading)])
    point = etree.SubElement(etree.SubElement(light, "position"), "point")
    for tag, value in zip("xy", right.tolist(), strict=True):
        etree.SubElement(point, tag).text = f"{value:.4f}"
    etree.SubElement(light, "direction").text = "all"
    etree.SubElement(light, "active").text = "true"
    _after_last(root, light, ("trafficLight", "trafficSign", "lanelet"))
    return light


def _after_last(parent: _Element, element: _Element, names: tuple[str, ...]) -> None:
    """Insert an element after the last element of the first existing name, as the schema's order requires."""
    for name in names:
        found = parent.findall(name)
        if found:
            element.tail = found[-1].tail
            found[-1].addnext(element)
            return
    for place in range(len(parent) - 1, -1, -1):
        if parent[place].tag in ("laneletType", "stopLine", *_REFERENCES, "rightBound"):
            parent.insert(place + 1, element)
            return
    parent.append(element)


def _write_cycle(light: _Element, phases: list[tuple[int, str]]) -> None:
    cycle = light.find("cycle")
    if cycle is None:
        cycle = etree.Element("cycle")
        light.insert(0, cycle)
    for child in list(cycle):
        cycle.remove(child)
    for steps, colour in phases:
        element = etree.SubElement(cycle, "cycleElement")
        etree.SubElement(element, "duration").text = str(steps)
        etree.SubElement(element, "color").text = colour
    active = light.find("active")
    if active is not None:
        active.text = "true"


@dataclass(frozen=True)
class _Conditions:
    """Weather and friction of the roads (None if unchanged), and how the words were interpreted."""

    weather: Weather | None
    friction: float | None
    road: str
    taken: str


def _conditions_named(edit: Edit) -> _Conditions:
    """Return the weather and the friction of an edit; by default, the friction of roads in this weather, if known.

    Raises:
        InvalidRequest: neither of them is given, or an argument of another kind is.
    """
    valid = [f"weather={word}" for word in WEATHERS]
    if not edit.params:
        raise InvalidRequest(
            "set_weather needs the weather or the friction in 'params'",
            valid=[*valid, *_VALID_FRICTIONS],
            next_step="choose one of these",
            complete=True,
        )
    weather, friction, road, taken = None, None, "", ""
    for text in edit.params:
        name, mark, value = (part.strip().lower() for part in text.partition("="))
        if not mark:
            name, value = "weather", name
        if name == "friction" and friction is None:
            friction, road = _friction_named(text, value)
            continue
        word = re.sub(r"[\s-]+", "_", value)
        wanted = next((known for known in WEATHERS if known == WEATHER_WORDS.get(word, word)), None)
        if wanted is None or name != "weather" or weather is not None:
            raise InvalidRequest(
                f"{quoted(text)} is not a kind of weather"
                if weather is None
                else "set_weather takes one kind of weather",
                valid=[*valid, *_VALID_FRICTIONS],
                next_step="choose one of these",
                remedies=[
                    *([] if wanted is None else [with_values(params=[f"weather={wanted}"])]),
                    *misspelt(value, [*WEATHERS, *WEATHER_WORDS]),
                ],
                complete=True,
            )
        weather, taken = wanted, f" ('{value}' read as {wanted})" if word != wanted else ""
    if friction is None and weather in WEATHER_ROADS:
        road = WEATHER_ROADS[weather]
        friction = ROAD_FRICTIONS[road]
    return _Conditions(weather, friction, road, taken)


def _friction_named(text: str, value: str) -> tuple[float, str]:
    """Return the coefficient of friction for a number or a road condition, and the condition as text."""
    word = re.sub(r"[\s-]+", "_", value)
    if word in ROAD_FRICTIONS:
        return ROAD_FRICTIONS[word], word
    try:
        friction = float(value)
    except ValueError:
        friction = math.nan
    if not LEAST_FRICTION <= friction <= MOST_FRICTION:
        nearest = min(max(friction, LEAST_FRICTION), MOST_FRICTION)
        near = (
            misspelt(value, ROAD_FRICTIONS) if math.isnan(friction) else [with_values(params=[f"friction={nearest:g}"])]
        )
        raise InvalidRequest(
            f"{quoted(text)} is neither a number nor a state of the road"
            if math.isnan(friction)
            else f"{quoted(text)} is out of range: friction is from {LEAST_FRICTION:g} to {MOST_FRICTION:g}",
            valid=_VALID_FRICTIONS,
            next_step="choose one of these",
            given=text,
            remedies=near,
            complete=True,
        )
    return round(friction, 6), ""


def _set_weather(edit: Edit, root: _Element, scene: Scene, drive: Callable[[], Track | None]) -> str:  # noqa: ARG001
    """Write the weather and the friction of the roads to the file; return the changes and what they affect, as text."""
    conditions = _conditions_named(edit)
    notes = []
    if conditions.weather is not None:
        _write_weather(root, conditions.weather)
        notes.append(f"the file now states {conditions.weather}{conditions.taken}, so searches can find it")
    if conditions.friction is None:
        return (
            f"{'; '.join(notes)}; friction stays unchanged, because no value is known for this weather, and traffic "
            "drives as before"
        )
    set_friction(root, conditions.friction)
    of_road = f" (road surface: {conditions.road.replace('_', ' ')})" if conditions.road else ""
    before = "" if scene.friction is None else f", {scene.friction:g} before"
    notes.append(
        f"friction {conditions.friction:g}{of_road}{before}: tyres can sustain at most "
        f"{conditions.friction * GRAVITY_MPS2:.2f} m/s², "
        "longitudinal and lateral combined. This friction applies to planners, reference drivers, motion checks and "
        "vehicles driven by SUMO; motion already recorded or simulated stays unchanged"
    )
    return "; ".join(notes)


def weather_of(edit: Edit) -> Weather | None:
    """Return the weather that an edit writes to the file, or None."""
    return _conditions_named(edit).weather if edit.op == "set_weather" else None


def _write_weather(root: _Element, weather: Weather) -> None:
    location = root.find("location")
    if location is None:
        raise NotPossible(
            "the file has no location element to store the weather in",
            valid=_VALID_FRICTIONS,
            next_step="set only the friction, or remove this edit",
        )
    before = {part.tag: part.text for part in location.iterfind("environment/*")}
    for old in location.findall("environment"):
        location.remove(old)
    environment = etree.SubElement(location, "environment")
    etree.SubElement(environment, "time").text = before.get("time") or "12:00:00"
    etree.SubElement(environment, "timeOfDay").text = before.get("timeOfDay") or "unknown"
    etree.SubElement(environment, "weather").text = weather
    etree.SubElement(environment, "underground").text = "snow" if weather in ("snow", "hail") else "wet"


TRANSFORMS: Mapping[EditOperation, Transform] = {
    "mirror": _mirror,
    "crop": _crop,
    "set_light": _set_light,
    "set_weather": _set_weather,
}
"""The edits of the scene itself, by their operation."""
