"""Judges of the edit G, by the planning problem as written."""

import math
from typing import Any

import numpy as np
from lxml import etree

from plannerforge.engine.geometry.polyline import project
from plannerforge.engine.network.positions import POSITION_WORDS
from plannerforge.evals.modification_drivers import SIZE_TOLERANCE_M
from plannerforge.evals.modification_reach import length_m
from plannerforge.evals.modification_written import Truth, Written

GOAL_TOLERANCE_M = 0.5
USUAL_SIZE_M = (6.0, 2.0)
"""Length and width of a goal where neither the request nor the file gives any, as in the paper's code."""

ROUNDING = 1e-6


def goal_checks(written: Written, truth: Truth) -> dict[str, bool]:
    """The goal as written: on its lanelet, along it where the word says, of the size and at the time that were asked.

    On a lanelet is what commonroad-io finds there: planners look for the ego's way by it.
    What was not named is as in the source; a problem that had no goal state has nothing to keep.
    """
    state = written.loaded.problem().goal.state_list[0]
    network = written.loaded.scenario.lanelet_network
    lanelet = network.find_lanelet_by_id(int(truth["lanelet"]))
    center = np.asarray(state.position.center)
    share = POSITION_WORDS.get(str(truth.get("position") or "final"))
    station_m = project(lanelet.center_vertices, center)[0]
    new, old = _goal(written.xml), _goal(written.base)
    size = _size(new)
    return {
        "G_edge": lanelet.lanelet_id in network.find_lanelet_by_position([center])[0],
        "G_position": share is None or abs(station_m - share * length_m(lanelet)) <= GOAL_TOLERANCE_M,
        "G_rectangle": size is not None and any(_near(size, one) for one in _sizes(truth, old)),
        "G_time": _is_at_its_time(_interval(new, "time"), truth, written.scene.step_s, old),
        "G_preserve": old is None or _interval(new, "velocity") == _interval(old, "velocity"),
    }


def _goal(path: Any) -> Any:
    """The first goal state of a file's first planning problem; None where it has none."""
    return etree.parse(path).getroot().find("planningProblem/goalState")


def _sizes(truth: Truth, old: Any) -> list[tuple[float, float]]:
    """The sizes (length, width) in m that are right: the one asked for, else the one before, else the usual one."""
    asked = truth.get("rectangle")
    if asked:
        return [(float(asked["length_m"]), float(asked["width_m"]))]
    before = None if old is None else _size(old)
    return [USUAL_SIZE_M if before is None else before]


def _size(goal: Any) -> tuple[float, float] | None:
    rectangle = goal.find("position/rectangle")
    return None if rectangle is None else (float(rectangle.findtext("length")), float(rectangle.findtext("width")))


def _near(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return all(abs(a - b) <= SIZE_TOLERANCE_M for a, b in zip(one, other, strict=True))


def _is_at_its_time(steps: tuple[float, float] | None, truth: Truth, step_s: float, old: Any) -> bool:
    """Whether first and last step are as asked, rounded inwards; as before where nothing was; some where none were."""
    asked = truth.get("time")
    if asked:
        first, last = asked["start_s"] / step_s, asked["end_s"] / step_s
        return steps == (math.ceil(first - ROUNDING), math.floor(last + ROUNDING))
    if old is None:
        return steps is not None and 0 <= steps[0] < steps[1]
    return steps == _interval(old, "time")


def _interval(goal: Any, name: str) -> tuple[float, float] | None:
    """Both ends of an interval, or twice an exact value; None where it is not given."""
    element = goal.find(name)
    if element is None:
        return None
    exact = element.findtext("exact")
    ends = (exact, exact) if exact is not None else (element.findtext("intervalStart"), element.findtext("intervalEnd"))
    return float(ends[0]), float(ends[1])
