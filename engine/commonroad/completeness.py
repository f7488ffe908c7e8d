"""Checks for elements that commonroad-io requires: if they are missing, it fails or invents values.

If the meaning is clear, missing parts are added and unusable parts are removed. Otherwise the error gives the element;
commonroad-io itself would fail with a Python error, or place an ego without a position at the origin.
"""

from typing import Any

from .value_limits import OLD_GOAL, BeyondLimits, superfluous_polygons

READ_VERSIONS = ("2020a", "2018b")
OLD_VERSION = "2017a"
"""A network alone has the content of 2018b; its obstacles have other elements."""
_START = ("position", "orientation", "velocity", "time")
"""Elements of a planning problem's initial state; commonroad-io uses 0 for missing ones."""
_PLACE = {"geoNameId": "-999", "gpsLatitude": "999", "gpsLongitude": "999"}
"""CommonRoad's elements for an unknown location."""


def complete(root: Any) -> None:
    """Complete a parsed document (ElementTree), in place, if its meaning is clear.

    Heights of lanelets' points are removed, because roads are treated as flat. A file without tags gets an empty list,
    and a location without a place gets the elements for an unknown place. A network of format 2017a is read as one of
    2018b. A ``<goalRegion>`` of formats older than 2017a is removed, as in commonroad-io; its problem then has no goal.
    A polygon that adds no area to its shape is removed, because CommonRoad's collision checker crashes on it.
    """
    for shape, polygon in superfluous_polygons(root):
        shape.remove(polygon)
    for point in root.iterfind("lanelet/*/point"):
        for height in point.findall("z"):
            point.remove(height)
    for problem in root.iterfind("planningProblem"):
        for region in problem.findall(OLD_GOAL):
            problem.remove(region)
    if _is_old_network(root):
        root.set("commonRoadVersion", "2018b")
    if root.get("commonRoadVersion") == "2018b":
        if root.get("tags") is None:
            root.set("tags", "")
        return
    if root.find("scenarioTags") is None:
        root.append(root.makeelement("scenarioTags", {}))
    location = root.find("location")
    if location is not None:
        for tag, unknown in _PLACE.items():
            if location.find(tag) is None:
                element = location.makeelement(tag, {})
                element.text = unknown
                location.append(element)


def _is_old_network(root: Any) -> bool:
    """Return whether a document is in format 2017a and contains only lanelets."""
    return root.get("commonRoadVersion") == OLD_VERSION and {one.tag for one in root.iterfind("*")} == {"lanelet"}


def check_complete(root: Any) -> None:
    """Check a parsed document (ElementTree or lxml) for elements that every scenario needs.

    Raises:
        BeyondLimits: the format is not supported, a planning problem has no start, or a goal lacks its time or lanelet.
    """
    version = root.get("commonRoadVersion")
    if version not in READ_VERSIONS and not _is_old_network(root):
        what = f"its format is {version or 'not stated'} (commonRoadVersion)"
        raise BeyondLimits(root, what, " or ".join(READ_VERSIONS), "convert the file with a program that reads it")
    for name in ("timeStepSize", "benchmarkID"):
        if not root.get(name):
            raise BeyondLimits(root, f"<commonRoad> has no {name}", f"an attribute {name}", "add it to the file")
    lanelets = {one.get("id") for one in root.iterfind("lanelet")}
    for problem in root.iterfind("planningProblem"):
        owner = f"planningProblem {problem.get('id')}"
        start = problem.find("initialState")
        if start is None:
            raise BeyondLimits(problem, f"{owner} has no <initialState>", "one", "add it to the file")
        for name in _START:
            if start.find(name) is None:
                raise BeyondLimits(start, f"the initialState of {owner} has no <{name}>", "one", "add it to the file")
        for goal in problem.iterfind("goalState"):
            _check_goal(goal, owner, lanelets)


def _check_goal(goal: Any, owner: str, lanelets: set[str | None]) -> None:
    if goal.find("time") is None:
        what = f"a goal of {owner} has no <time>"
        raise BeyondLimits(goal, what, "the steps in which it applies", "add <time> with intervalStart and intervalEnd")
    for lanelet in goal.iterfind("position/lanelet"):
        if lanelet.get("ref") not in lanelets:
            what = f"a goal of {owner} is lanelet {lanelet.get('ref')}, which is not in the file"
            raise BeyondLimits(lanelet, what, "a lanelet of the file", "use another lanelet, or add this one")
