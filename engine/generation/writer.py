"""Writes CommonRoad 2020a XML: the same content always gives the same bytes.

Elements follow the order of CommonRoad's schema; ids follow the order of writing. Numbers are decimals without
exponents. The date is fixed, because a date would make every file differ.
"""

import textwrap
from collections.abc import Iterable, Iterator
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from ...schemas.generation import TrafficConditions
from ..commonroad import ego_class_instruction, set_friction
from ..geometry import Points, wrap_angle
from ..maps import RoadFile
from ..network import ROAD_DECIMALS, Incoming, RoadLanelet, RoadNetwork, SpeedSign, TrafficLight, Walkway
from ..traffic import DECIMALS, NIGHT_HOURS, GeneratedVehicle
from ..vehicles import Motion
from .planning_problem import HEADING_MARGIN_RAD, PlanningTask

_FIXED_DATE = "2025-01-01"
STEP_S = 0.1
"""Time step of all generated scenarios, as in nearly all scenarios of CommonRoad's collection."""
_PROBLEM = b" <planningProblem"
"""Start tag of the planning problem: the obstacles come before it."""
_NOON = 12


@dataclass(frozen=True)
class ScenarioMetadata:
    """The attributes of a file's root, its location and its tags.

    ``latitude`` and ``longitude`` are in degrees; ``offset_m`` is that of the projected coordinates. ``speed_sign`` is
    the country's sign for a speed limit, or None if CommonRoad has none. ``friction`` is the friction coefficient of
    the roads, or None if neither the weather nor the map states it.
    """

    benchmark_id: str
    affiliation: str
    source: str
    latitude: float
    longitude: float
    projection: str
    offset_m: tuple[float, float]
    tags: tuple[str, ...]
    speed_sign: str | None
    conditions: TrafficConditions | None = None
    friction: float | None = None


def write_scenario(
    path: Path,
    metadata: ScenarioMetadata,
    network: RoadNetwork,
    traffic: tuple[GeneratedVehicle, ...],
    task: PlanningTask,
    roads: RoadFile | None = None,
) -> dict[str, int]:
    """Write a scenario; copy the roads from ``roads`` if given, otherwise write those of the network.

    Returns:
        CommonRoad's obstacle id by the vehicle's id.
    """
    root = etree.Element(
        "commonRoad",
        {
            "timeStepSize": f"{STEP_S:g}",
            "commonRoadVersion": "2020a",
            "author": "PlannerForge",
            "affiliation": metadata.affiliation,
            "source": metadata.source,
            "benchmarkID": metadata.benchmark_id,
            "date": _FIXED_DATE,
        },
    )
    set_friction(root, metadata.friction)
    write_location(root, metadata, roads)
    tags = _add(root, "scenarioTags")
    for tag in sorted(set(metadata.tags)):
        etree.SubElement(tags, tag)
    if roads is None:
        write_network(root, network, metadata.speed_sign)
    else:
        copy_network(root, roads)
    ids = {vehicle.vehicle_id: network.next_id + number for number, vehicle in enumerate(traffic)}
    root.append(planning_problem_element(network.next_id + len(ids), task))
    etree.indent(root, space=" ")
    before, problem, after = etree.tostring(root, encoding="UTF-8", xml_declaration=True).rpartition(_PROBLEM)
    obstacles = "".join(_obstacle_text(ids[vehicle.vehicle_id], vehicle) for vehicle in traffic)
    path.write_bytes(b"".join((before, obstacles.encode(), problem, after, b"\n")))
    return ids


def write_location(root: etree._Element, metadata: ScenarioMetadata, roads: RoadFile | None = None) -> None:
    """Append the location of a scenario, from the file of its roads if there is one, and its conditions."""
    if roads is None:
        location = _add(root, "location")
        _add(location, "geoNameId", "-999")
        _add(location, "gpsLatitude", f"{metadata.latitude:.6f}")
        _add(location, "gpsLongitude", f"{metadata.longitude:.6f}")
        if metadata.projection:
            _write_projection(location, metadata)
    else:
        location = deepcopy(roads.location)
        root.append(location)
    _write_environment(location, metadata.conditions)


def _write_environment(location: etree._Element, conditions: TrafficConditions | None) -> None:
    """Append time and bad weather. commonroad-io cannot read the schema's values for daytime and good weather."""
    if conditions is None or conditions.weather is None:
        return
    hour = int(conditions.time[:2]) if conditions.time else _NOON
    for recorded in location.findall("environment"):
        location.remove(recorded)
    environment = _add(location, "environment")
    _add(environment, "time", f"{conditions.time or f'{_NOON}:00'}:00")
    _add(environment, "timeOfDay", "night" if hour in NIGHT_HOURS else "unknown")
    _add(environment, "weather", conditions.weather)
    _add(environment, "underground", "snow" if conditions.weather in ("snow", "hail") else "wet")


def _write_projection(location: etree._Element, metadata: ScenarioMetadata) -> None:
    transformation = _add(location, "geoTransformation")
    _add(transformation, "geoReference", metadata.projection)
    additional = _add(transformation, "additionalTransformation")
    _add(additional, "xTranslation", f"{metadata.offset_m[0]:.3f}")
    _add(additional, "yTranslation", f"{metadata.offset_m[1]:.3f}")
    _add(additional, "zRotation", "0.0")
    _add(additional, "scaling", "1.0")


def write_network(root: etree._Element, network: RoadNetwork, speed_sign: str | None) -> None:
    """Append all elements of the network in the order of CommonRoad's schema.

    ``speed_sign``: the country's sign for a speed limit; None leaves the signs out.
    """
    signs: dict[int, list[int]] = {}
    for sign in network.signs if speed_sign is not None else ():
        for key in sign.lanelet_ids:
            signs.setdefault(key, []).append(sign.sign_id)
    lights: dict[int, list[int]] = {}
    for light in network.lights:
        lights.setdefault(light.lanelet_id, []).append(light.light_id)
    for key, lanelet in network.lanelets.items():
        _write_lanelet(root, lanelet, signs.get(key, []), lights.get(key, []))
    for walkway in network.walkways:
        _write_walkway(root, walkway)
    if speed_sign is not None:
        for sign in network.signs:
            _write_sign(root, sign, speed_sign)
    for light in network.lights:
        _write_light(root, light)
    for intersection in network.intersections:
        element = etree.SubElement(root, "intersection", {"id": str(intersection.intersection_id)})
        for incoming in intersection.incomings:
            _write_incoming(element, incoming)


def copy_network(root: etree._Element, roads: RoadFile) -> None:
    """Append the roads of a file unchanged."""
    root.extend(deepcopy(element) for element in roads.elements)


def _write_point(parent: etree._Element, point: Points) -> None:
    """Append a point (2,) in metres."""
    element = _add(parent, "point")
    _add(element, "x", f"{point[0]:.{ROAD_DECIMALS}f}")
    _add(element, "y", f"{point[1]:.{ROAD_DECIMALS}f}")


def _add(parent: etree._Element, path: str, text: str | None = None) -> etree._Element:
    """Append nested elements for a path such as ``shape/rectangle``; give the last one a text and return it."""
    for tag in path.split("/"):
        parent = etree.SubElement(parent, tag)
    parent.text = text
    return parent


def _references(parent: etree._Element, tag: str, ids: Iterable[int]) -> None:
    for key in ids:
        etree.SubElement(parent, tag, {"ref": str(key)})


def _write_lanelet(root: etree._Element, lanelet: RoadLanelet, signs: list[int], lights: list[int]) -> None:
    element = etree.SubElement(root, "lanelet", {"id": str(lanelet.lanelet_id)})
    sides = (
        ("leftBound", lanelet.left, lanelet.left_neighbour, lanelet.left_same_direction),
        ("rightBound", lanelet.right, lanelet.right_neighbour, lanelet.right_same_direction),
    )
    for tag, line, neighbour, _same in sides:
        bound = etree.SubElement(element, tag)
        for point in line:
            _write_point(bound, point)
        marking = "no_marking" if lanelet.internal else ("dashed" if neighbour is not None else "solid")
        _add(bound, "lineMarking", marking)
    _references(element, "predecessor", lanelet.predecessors)
    _references(element, "successor", lanelet.successors)
    for tag, (_, _, neighbour, same) in zip(("adjacentLeft", "adjacentRight"), sides, strict=True):
        if neighbour is not None:
            direction = "same" if same else "opposite"
            etree.SubElement(element, tag, {"ref": str(neighbour), "drivingDir": direction})
    if lights:
        line_element = _add(element, "stopLine")
        _write_point(line_element, lanelet.left[-1])
        _write_point(line_element, lanelet.right[-1])
        _add(line_element, "lineMarking", "solid")
        _references(line_element, "trafficLightRef", lights)
    for word in lanelet.types:
        _add(element, "laneletType", word)
    for word in lanelet.users:
        _add(element, "userOneWay", word)
    _references(element, "trafficSignRef", signs)
    _references(element, "trafficLightRef", lights)


def _write_walkway(root: etree._Element, walkway: Walkway) -> None:
    """Append a footway: open to pedestrians in both directions, and not connected to lanelets for vehicles."""
    element = etree.SubElement(root, "lanelet", {"id": str(walkway.lanelet_id)})
    for tag, line in (("leftBound", walkway.left), ("rightBound", walkway.right)):
        bound = etree.SubElement(element, tag)
        for point in line:
            _write_point(bound, point)
        _add(bound, "lineMarking", "no_marking")
    _add(element, "laneletType", "crosswalk" if walkway.crosses else "sidewalk")
    _add(element, "userBidirectional", "pedestrian")


def _write_sign(root: etree._Element, sign: SpeedSign, speed_sign: str) -> None:
    element = etree.SubElement(root, "trafficSign", {"id": str(sign.sign_id)})
    inside = _add(element, "trafficSignElement")
    _add(inside, "trafficSignID", speed_sign)
    _add(inside, "additionalValue", f"{sign.speed_mps:.4f}")
    _write_point(_add(element, "position"), sign.position)
    _add(element, "virtual", "true")


def _write_light(root: etree._Element, light: TrafficLight) -> None:
    element = etree.SubElement(root, "trafficLight", {"id": str(light.light_id)})
    cycle = _add(element, "cycle")
    for steps, colour in light.cycle:
        phase = _add(cycle, "cycleElement")
        _add(phase, "duration", str(steps))
        _add(phase, "color", colour)
    if light.offset_steps:
        _add(cycle, "timeOffset", str(light.offset_steps))
    _write_point(_add(element, "position"), light.position)
    _add(element, "direction", light.direction)
    _add(element, "active", "true")


def _write_incoming(intersection: etree._Element, incoming: Incoming) -> None:
    element = etree.SubElement(intersection, "incoming", {"id": str(incoming.incoming_id)})
    _references(element, "incomingLanelet", incoming.lanelet_ids)
    _references(element, "successorsRight", incoming.right)
    _references(element, "successorsStraight", incoming.straight)
    _references(element, "successorsLeft", incoming.left)


_OBSTACLE = """ <dynamicObstacle id="{key}">
  <type>{kind}</type>
  <shape>
   <rectangle>
    <length>{length_m:g}</length>
    <width>{width_m:g}</width>
   </rectangle>
  </shape>
{initial}{trajectory} </dynamicObstacle>
"""
_STATE = """<{tag}>
 <position>
  <point>
   <x>{x:.{decimals}f}</x>
   <y>{y:.{decimals}f}</y>
  </point>
 </position>
 <orientation>
  <exact>{heading}</exact>
 </orientation>
 <time>
  <exact>{step}</exact>
 </time>
 <velocity>
  <exact>{speed}</exact>
 </velocity>
 <acceleration>
  <exact>{acceleration}</exact>
 </acceleration>
</{tag}>
"""


def _obstacle_text(obstacle_id: int, vehicle: GeneratedVehicle) -> str:
    """Return the element of a vehicle with its trajectory from step 0, at a file's first level."""
    states = "".join(_state_texts("state", vehicle.motion, range(1, vehicle.steps), 3))
    return _OBSTACLE.format(
        key=obstacle_id,
        kind=vehicle.vehicle_class.commonroad_type,
        length_m=vehicle.size_m[0],
        width_m=vehicle.size_m[1],
        initial="".join(_state_texts("initialState", vehicle.motion, range(1), 2)),
        trajectory=f"  <trajectory>\n{states}  </trajectory>\n" if states else "  <trajectory/>\n",
    )


def _state_texts(tag: str, motion: Motion, steps: range, level: int) -> Iterator[str]:
    """Yield the elements of states as text at a level of a file; states make up most of a file, so no tree is built."""
    state = textwrap.indent(_STATE, " " * level)
    chosen = slice(steps.start, steps.stop)
    columns = motion.headings_rad, motion.speeds_mps, motion.accelerations_mps2
    rows = zip(steps, motion.positions[chosen].tolist(), *(column[chosen].tolist() for column in columns), strict=True)
    for step, (x, y), *exact in rows:
        heading, speed, acceleration = map(_number, exact)
        yield state.format(
            tag=tag, decimals=DECIMALS, x=x, y=y, heading=heading, step=step, speed=speed, acceleration=acceleration
        )


def planning_problem_element(problem_id: int, task: PlanningTask) -> etree._Element:
    """Return the element of the ego's initial state and its goal."""
    element = etree.Element("planningProblem", {"id": str(problem_id)})
    if task.ego.vehicle_class.name != "car":
        element.append(ego_class_instruction(task.ego.vehicle_class.name))
    initial = etree.fromstring("".join(_state_texts("initialState", task.ego.motion, range(1), 0)))
    element.append(initial)
    _exact(initial, "yawRate", first_yaw_rate_radps(task.ego.motion))
    _exact(initial, "slipAngle", 0.0)
    goal = _add(element, "goalState")
    time = _add(goal, "time")
    _add(time, "intervalStart", str(task.time_steps[0]))
    _add(time, "intervalEnd", str(task.time_steps[1]))
    rectangle = _add(goal, "position/rectangle")
    _add(rectangle, "length", f"{task.size_m[0]:g}")
    _add(rectangle, "width", f"{task.size_m[1]:g}")
    _add(rectangle, "orientation", f"{task.heading_rad:.{DECIMALS}f}")
    center = _add(rectangle, "center")
    _add(center, "x", f"{task.center[0]:.{DECIMALS}f}")
    _add(center, "y", f"{task.center[1]:.{DECIMALS}f}")
    orientation = _add(goal, "orientation")
    for tag, margin in (("intervalStart", -HEADING_MARGIN_RAD), ("intervalEnd", HEADING_MARGIN_RAD)):
        _add(orientation, tag, f"{task.heading_rad + margin:.{DECIMALS}f}")
    return element


def first_yaw_rate_radps(motion: Motion) -> float:
    """Return a vehicle's yaw rate at its first step, or 0 if it has only one step.

    A planner that gets 0 for a turning ego starts with straight wheels, and may leave the road before they turn.
    """
    turned = motion.headings_rad[:2]
    return wrap_angle(float(turned[1] - turned[0])) / STEP_S if len(turned) > 1 else 0.0


def _exact(element: etree._Element, tag: str, value: float) -> None:
    _add(element, f"{tag}/exact", _number(value))


def _number(value: float) -> str:
    number = f"{value:.{DECIMALS}f}"
    return "0.000000" if float(number) == 0 else number
