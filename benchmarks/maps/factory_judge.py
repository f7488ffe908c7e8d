"""Judges a CommonRoad file from either generator with commonroad-io, CommonRoad's schema and shapely.

This module shares no code with the generators: files of Scenario Factory 2.0 and ours pass the same checks. Frenetix
then drives them with its default weights, and the drivability checker tests some of the recorded tracks.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lxml import etree

from plannerforge.engine.commonroad import read_scenario
from plannerforge.engine.execution import silent
from plannerforge.engine.planners import make_planner, simulate
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.runs import NO_TRAJECTORY

from ..generation.motion import MotionFigures, measure_motion

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
    from commonroad.scenario.scenario import Scenario

EGO_LENGTH_M, EGO_WIDTH_M = 4.508, 1.61
"""CommonRoad's vehicle 2 (BMW 320i), which the default planner drives."""
_TRACKS = 3
"""Number of tracks per scenario for the drivability checker (chosen): each takes half a second."""


@dataclass(frozen=True)
class FileVerdict:
    """The faults of a file (empty if it is right), the outcome of the default planner, and the motion of the
    traffic.
    """

    fault: str
    outcome: str = ""
    motion: MotionFigures | None = None

    @property
    def executable(self) -> bool:
        """Without a fault, and driven to an end; a collision is an end too."""
        return not self.fault and self.outcome not in ("", *NO_TRAJECTORY)


def judge_file(path: Path, seed: int) -> FileVerdict:
    """Judge a file; ``seed`` draws the tracks."""
    try:
        fault = _fault(path)
    except Exception as error:  # noqa: BLE001 - whatever stops commonroad-io is a fault of the file
        return FileVerdict(f"commonroad-io does not read it: {type(error).__name__}: {error}"[:200])
    try:
        loaded = read_scenario(path)
        default, planner = built_in("frenetix:Default"), make_planner("frenetix")
        run = simulate(loaded.scenario, loaded.problem(), default, planner, "constant_velocity", silent)
    except PlannerForgeError as error:
        return FileVerdict(fault or f"the planner's reader refuses it: {error.message}"[:200])
    outcome = run.final.outcome
    broken = f"no run: {run.final.invalid_reason or outcome}" if outcome in NO_TRAJECTORY else ""
    return FileVerdict(fault or broken, outcome, measure_motion(loaded, _TRACKS, seed))


def _fault(path: Path) -> str:
    """Return the fault in schema, start or goal, empty if there is none."""
    import commonroad
    from commonroad.common.file_reader import CommonRoadFileReader

    folder = Path(str(commonroad.__file__)).parent / "scenario_definition" / "xml_definition_files"
    schema = etree.XMLSchema(etree.parse(folder / "XML_commonRoad_XSD.xsd"))
    if not schema.validate(etree.parse(path)):
        return "breaks CommonRoad's schema"
    scenario, problems = CommonRoadFileReader(str(path)).open()
    found = list(problems.planning_problem_dict.values())
    if not found:
        return "no planning problem"
    if _begins_in_a_collision(scenario, found[0]):
        return "the ego begins in a collision"
    return "" if _reaches_its_goal(scenario.lanelet_network, found[0]) else "no way from the start to the goal"


def _begins_in_a_collision(scenario: "Scenario", problem: "PlanningProblem") -> bool:
    from commonroad.geometry.shape import Rectangle

    start = problem.initial_state
    ego = Rectangle(EGO_LENGTH_M, EGO_WIDTH_M, start.position, start.orientation).shapely_object
    occupied = (obstacle.occupancy_at_time(start.time_step) for obstacle in scenario.obstacles)
    return any(found is not None and found.shape.shapely_object.intersects(ego) for found in occupied)


def _reaches_its_goal(network: "LaneletNetwork", problem: "PlanningProblem") -> bool:
    """Return True if lanelets lead from the start to one with a part of the goal; lane changes are allowed."""
    goal = _goal_lanelets(network, problem)
    if goal is None:
        return True
    ways = {lanelet.lanelet_id: lanelet for lanelet in network.lanelets}
    found = {key for keys in network.find_lanelet_by_position([problem.initial_state.position]) for key in keys}
    open_ends = list(found)
    while open_ends:
        following = [key for key in _next(ways[open_ends.pop()]) if key in ways and key not in found]
        found.update(following)
        open_ends += following
    return bool(found & goal)


def _next(lanelet: "Lanelet") -> list[int]:
    left = [lanelet.adj_left] if lanelet.adj_left is not None and lanelet.adj_left_same_direction else []
    right = [lanelet.adj_right] if lanelet.adj_right is not None and lanelet.adj_right_same_direction else []
    return [*lanelet.successor, *left, *right]


def _goal_lanelets(network: "LaneletNetwork", problem: "PlanningProblem") -> set[int] | None:
    """Return the lanelets of the goal, or None if it has no place."""
    named = problem.goal.lanelets_of_goal_position
    if named:
        return {key for keys in named.values() for key in keys}
    places = [state.position for state in problem.goal.state_list if state.has_value("position")]
    if not places:
        return None
    return {
        lanelet.lanelet_id
        for lanelet in network.lanelets
        for place in places
        if lanelet.polygon.shapely_object.intersects(place.shapely_object)
    }
