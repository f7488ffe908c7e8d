"""Writing CommonRoad 2020a XML: the same content always gives the same bytes.

The elements' order follows CommonRoad's schema; ids are given in the order of writing, numbers are decimals without
exponents, and the date is fixed, because a date would make every file differ.
"""

from collections.abc import Iterable
from pathlib import Path

from lxml import etree

from ..geometry import Points
from ..network import Incoming, RoadLanelet, RoadNetwork, SpeedSign, TrafficLight
from ..traffic import DECIMALS, GeneratedVehicle
from ..vehicles import Motion
from .metadata import ScenarioMetadata
from .planning_problem import PlanningTask

FIXED_DATE = "2025-01-01"
ROAD_DECIMALS = 4
"""Of coordinates of the road network in m: a tenth of a millimetre, finer than any map."""


def write_scenario(
    path: Path,
    metadata: ScenarioMetadata,
    network: RoadNetwork,
    traffic: tuple[GeneratedVehicle, ...],
    task: PlanningTask,
) -> dict[str, int]:
    """Write a scenario.

    Returns:
        CommonRoad's obstacle id by the vehicle's id.
    """
    root = etree.Element(
        "commonRoad",
        {
            "timeStepSize": f"{metadata.step_s:g}",
            "commonRoadVersion": "2020a",
            "author": "PlannerForge",
            "affiliation": metadata.affiliation,
            "source": metadata.source,
            "benchmarkID": metadata.benchmark_id,
            "date": FIXED_DATE,
        },
    )
    _write_location(root, metadata)
    tags = etree.SubElement(root, "scenarioTags")
    for tag in sorted(set(metadata.tags)):
        etree.SubElement(tags, tag)
    write_network(root, network, metadata.speed_sign)
    ids: dict[str, int] = {}
    next_id = network.next_id
    for vehicle in traffic:
        ids[vehicle.vehicle_id] = next_id
        _write_obstacle(root, next_id, vehicle)
        next_id += 1
    _write_planning_problem(root, next_id, task)
    etree.indent(root, space=" ")
    path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n")
    return ids


def _write_location(root: etree._Element, metadata: ScenarioMetadata) -> None:
    location = etree.SubElement(root, "location")
    etree.SubElement(location, "geoNameId").text = "-999"
    etree.SubElement(location, "gpsLatitude").text = f"{metadata.latitude:.6f}"
    etree.SubElement(location, "gpsLongitude").text = f"{metadata.longitude:.6f}"
    if not metadata.projection:
        return
    transformation = etree.SubElement(location, "geoTransformation")
    etree.SubElement(transformation, "geoReference").text = metadata.projection
    additional = etree.SubElement(transformation, "additionalTransformation")
    etree.SubElement(additional, "xTranslation").text = f"{metadata.offset_m[0]:.3f}"
    etree.SubElement(additional, "yTranslation").text = f"{metadata.offset_m[1]:.3f}"
    etree.SubElement(additional, "zRotation").text = "0.0"
    etree.SubElement(additional, "scaling").text = "1.0"


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
    if speed_sign is not None:
        for sign in network.signs:
            _write_sign(root, sign, speed_sign)
    for light in network.lights:
        _write_light(root, light)
    for intersection in network.intersections:
        element = etree.SubElement(root, "intersection", {"id": str(intersection.intersection_id)})
        for incoming in intersection.incomings:
            _write_incoming(element, incoming)


def _write_point(parent: etree._Element, point: Points, decimals: int = ROAD_DECIMALS) -> None:
    """Append a point (2,) in metres."""
    element = etree.SubElement(parent, "point")
    etree.SubElement(element, "x").text = f"{point[0]:.{decimals}f}"
    etree.SubElement(element, "y").text = f"{point[1]:.{decimals}f}"


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
        etree.SubElement(bound, "lineMarking").text = marking
    _references(element, "predecessor", lanelet.predecessors)
    _references(element, "successor", lanelet.successors)
    for tag, (_, _, neighbour, same) in zip(("adjacentLeft", "adjacentRight"), sides, strict=True):
        if neighbour is not None:
            direction = "same" if same else "opposite"
            etree.SubElement(element, tag, {"ref": str(neighbour), "drivingDir": direction})
    if lights:
        line_element = etree.SubElement(element, "stopLine")
        _write_point(line_element, lanelet.left[-1])
        _write_point(line_element, lanelet.right[-1])
        etree.SubElement(line_element, "lineMarking").text = "solid"
        _references(line_element, "trafficLightRef", lights)
    for word in lanelet.types:
        etree.SubElement(element, "laneletType").text = word
    for word in lanelet.users:
        etree.SubElement(element, "userOneWay").text = word
    _references(element, "trafficSignRef", signs)
    _references(element, "trafficLightRef", lights)


def _write_sign(root: etree._Element, sign: SpeedSign, speed_sign: str) -> None:
    element = etree.SubElement(root, "trafficSign", {"id": str(sign.sign_id)})
    inside = etree.SubElement(element, "trafficSignElement")
    etree.SubElement(inside, "trafficSignID").text = speed_sign
    etree.SubElement(inside, "additionalValue").text = f"{sign.speed_mps:.4f}"
    _write_point(etree.SubElement(element, "position"), sign.position)
    etree.SubElement(element, "virtual").text = "true"


def _write_light(root: etree._Element, light: TrafficLight) -> None:
    element = etree.SubElement(root, "trafficLight", {"id": str(light.light_id)})
    cycle = etree.SubElement(element, "cycle")
    for steps, colour in light.cycle:
        phase = etree.SubElement(cycle, "cycleElement")
        etree.SubElement(phase, "duration").text = str(steps)
        etree.SubElement(phase, "color").text = colour
    if light.offset_steps:
        etree.SubElement(cycle, "timeOffset").text = str(light.offset_steps)
    _write_point(etree.SubElement(element, "position"), light.position)
    etree.SubElement(element, "direction").text = light.direction
    etree.SubElement(element, "active").text = "true"


def _write_incoming(intersection: etree._Element, incoming: Incoming) -> None:
    element = etree.SubElement(intersection, "incoming", {"id": str(incoming.incoming_id)})
    _references(element, "incomingLanelet", incoming.lanelet_ids)
    _references(element, "successorsRight", incoming.right)
    _references(element, "successorsStraight", incoming.straight)
    _references(element, "successorsLeft", incoming.left)


def _write_obstacle(root: etree._Element, obstacle_id: int, vehicle: GeneratedVehicle) -> None:
    """Append a vehicle with its trajectory from step 0 on."""
    element = etree.SubElement(root, "dynamicObstacle", {"id": str(obstacle_id)})
    etree.SubElement(element, "type").text = vehicle.vehicle_class.commonroad_type
    rectangle = etree.SubElement(etree.SubElement(element, "shape"), "rectangle")
    etree.SubElement(rectangle, "length").text = f"{vehicle.size_m[0]:g}"
    etree.SubElement(rectangle, "width").text = f"{vehicle.size_m[1]:g}"
    _write_state(etree.SubElement(element, "initialState"), vehicle.motion, 0)
    trajectory = etree.SubElement(element, "trajectory")
    for step in range(1, vehicle.steps):
        _write_state(etree.SubElement(trajectory, "state"), vehicle.motion, step)


def _write_planning_problem(root: etree._Element, problem_id: int, task: PlanningTask) -> None:
    """Append the ego's initial state and its goal."""
    element = etree.SubElement(root, "planningProblem", {"id": str(problem_id)})
    initial = etree.SubElement(element, "initialState")
    _write_state(initial, task.ego.motion, 0)
    _exact(initial, "yawRate", 0.0)
    _exact(initial, "slipAngle", 0.0)
    goal = etree.SubElement(element, "goalState")
    time = etree.SubElement(goal, "time")
    etree.SubElement(time, "intervalStart").text = str(task.time_steps[0])
    etree.SubElement(time, "intervalEnd").text = str(task.time_steps[1])
    rectangle = etree.SubElement(etree.SubElement(goal, "position"), "rectangle")
    etree.SubElement(rectangle, "length").text = f"{task.size_m[0]:g}"
    etree.SubElement(rectangle, "width").text = f"{task.size_m[1]:g}"
    etree.SubElement(rectangle, "orientation").text = f"{task.heading_rad:.{DECIMALS}f}"
    center = etree.SubElement(rectangle, "center")
    etree.SubElement(center, "x").text = f"{task.center[0]:.{DECIMALS}f}"
    etree.SubElement(center, "y").text = f"{task.center[1]:.{DECIMALS}f}"
    orientation = etree.SubElement(goal, "orientation")
    for tag, margin in (("intervalStart", -task.heading_margin_rad), ("intervalEnd", task.heading_margin_rad)):
        etree.SubElement(orientation, tag).text = f"{task.heading_rad + margin:.{DECIMALS}f}"


def _write_state(element: etree._Element, motion: Motion, step: int) -> None:
    _write_point(etree.SubElement(element, "position"), motion.positions[step], DECIMALS)
    _exact(element, "orientation", float(motion.headings_rad[step]))
    etree.SubElement(etree.SubElement(element, "time"), "exact").text = str(step)
    _exact(element, "velocity", float(motion.speeds_mps[step]))
    _exact(element, "acceleration", float(motion.accelerations_mps2[step]))


def _exact(element: etree._Element, tag: str, value: float) -> None:
    number = f"{value:.{DECIMALS}f}"
    etree.SubElement(etree.SubElement(element, tag), "exact").text = "0.000000" if float(number) == 0 else number
