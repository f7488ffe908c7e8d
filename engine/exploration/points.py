"""The worker's operations of an exploration: read a logical scenario, draw a road, evaluate a batch of points."""

from pathlib import Path

from ...schemas.boundaries import DescribeLogicalRequest, DrawRoadRequest, PointsRequest, PointsResponse, RoadDrawn
from ...schemas.exploration import EncounterSetting, LogicalScenario
from ..execution import Limits, ProgressReporter
from .concrete import concrete_edits
from .evaluation import Evaluator
from .logical import logical_scenario, logical_scenario_in
from .roads import write_road


def read_logical_scenario(request: DescribeLogicalRequest, report: ProgressReporter) -> LogicalScenario:
    """Return a logical scenario of the catalogue, of a YAML file, or of an OpenSCENARIO file.

    Raises:
        UnknownName: there is no such logical scenario.
        UnsafeInput: the file cannot be read.
        OutsideRoots: an OpenSCENARIO file refers to a file elsewhere.
        InvalidRequest: the file does not contain logical scenarios, or they cannot be used.
    """
    report(1.0, "read")
    if request.path is None:
        return logical_scenario(request.name)
    return logical_scenario_in(Path(request.path), request.name, Limits(request.roots).allowed_path)


def draw_road(request: DrawRoadRequest, report: ProgressReporter) -> RoadDrawn:
    """Write the CommonRoad file of a road.

    Raises:
        UnknownName: there is no such road.
    """
    write_road(request.road, Path(request.path))
    report(1.0, "drawn")
    return RoadDrawn(path=request.path)


def evaluate_points(request: PointsRequest, report: ProgressReporter) -> PointsResponse:
    """Return how the planner fares at each point.

    Raises:
        InvalidRequest: a template does not give a valid edit, or the prediction does not fit the traffic.
        PlannerFailure: a user-supplied planner broke its contract.
    """
    shared = request.model_dump(exclude={"logical", "points"})
    with Evaluator(EncounterSetting.model_validate(shared)) as evaluator:
        evaluations = []
        for number, values in enumerate(request.points):
            evaluations.append(evaluator.evaluate(concrete_edits(request.logical, values)))
            report((number + 1) / len(request.points), f"{number + 1} of {len(request.points)} points")
    return PointsResponse(evaluations=tuple(evaluations))
