"""Opening traffic by mode, and which predictions go with a mode. Nothing heavy is imported until traffic is opened."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, get_args

from ....schemas.errors import InvalidRequest
from ....schemas.runs import Prediction
from ....schemas.runs import Traffic as TrafficMode

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem

    from ...commonroad import LoadedScenario
    from ...vehicles import VehicleParameters
    from .recorded import Traffic


def check_modes(traffic: TrafficMode, prediction: Prediction) -> None:
    """Refuse to tell a planner the future of vehicles that have none yet.

    Raises:
        InvalidRequest: ground-truth prediction of reactive traffic.
    """
    if traffic == "reactive" and prediction == "ground_truth":
        others = [name for name in get_args(Prediction) if name != "ground_truth"]
        raise InvalidRequest(
            "prediction ground_truth is the recording, which reactive traffic does not follow",
            valid=others,
            next_step="take one of these predictions, or traffic recorded",
        )


@contextmanager
def open_traffic(
    mode: TrafficMode, loaded: "LoadedScenario", problem: "PlanningProblem", vehicle: "VehicleParameters", seed: int
) -> "Iterator[Traffic]":
    """The others of a scenario at the ego's first step.

    Raises:
        NotPossible: no vehicle can react, because no lanelet is drivable.
        WorkerFailure: SUMO refused the network or a vehicle, or stopped.
    """
    if mode == "reactive":
        from ..interface import EgoState
        from .reactive import reactive_traffic

        with reactive_traffic(loaded, problem, EgoState.of(problem.initial_state), vehicle, seed) as traffic:
            yield traffic
        return
    from .recorded import RecordedTraffic

    yield RecordedTraffic(loaded.scenario)
