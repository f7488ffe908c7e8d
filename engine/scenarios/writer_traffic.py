"""The traffic's part of a CommonRoad file: moving obstacles and the planning problem."""

from lxml import etree

from plannerforge.engine.scenarios.planning_problem import PlanningTask
from plannerforge.engine.scenarios.writer_network import write_point
from plannerforge.engine.traffic.motions import DECIMALS, Participant
from plannerforge.engine.traffic.smoothing import Motion


def write_obstacle(root: etree._Element, obstacle_id: int, vehicle: Participant) -> None:
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


def write_planning_problem(root: etree._Element, problem_id: int, task: PlanningTask) -> None:
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
    write_point(etree.SubElement(element, "position"), motion.positions[step], DECIMALS)
    _exact(element, "orientation", float(motion.headings_rad[step]))
    etree.SubElement(etree.SubElement(element, "time"), "exact").text = str(step)
    _exact(element, "velocity", float(motion.speeds_mps[step]))
    _exact(element, "acceleration", float(motion.accelerations_mps2[step]))


def _exact(element: etree._Element, tag: str, value: float) -> None:
    number = f"{value:.{DECIMALS}f}"
    etree.SubElement(etree.SubElement(element, tag), "exact").text = "0.000000" if float(number) == 0 else number
