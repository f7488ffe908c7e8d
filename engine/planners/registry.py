"""Planners and traffic by name. What is heavy, numpy and the C++ core, is imported when one is made.

To add a planner, add a function that makes it to ``PLANNERS``, and its ``PlannerTuning`` under the same name to
``engine/tuning/tunings.py``.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, get_args

from ...schemas.errors import InvalidRequest, UnknownName, closest
from ...schemas.runs import Prediction
from ...schemas.runs import Traffic as TrafficMode

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem

    from ..commonroad import LoadedScenario
    from ..vehicles import VehicleParameters
    from .interface import Planner
    from .traffic.recorded import Traffic


def _frenetix() -> "Planner":
    from .frenetix.planner import Frenetix

    return Frenetix()


def _intelligent_driver() -> "Planner":
    from .idm import IntelligentDriver

    return IntelligentDriver()


PLANNERS: dict[str, "Callable[[], Planner]"] = {"frenetix": _frenetix, "idm": _intelligent_driver}


def known_planner(name: str) -> str:
    """The name as registered, whatever its case.

    Raises:
        UnknownName: no such planner.
    """
    folded = name.strip().lower().replace("-", "_")
    if folded not in PLANNERS:
        raise UnknownName(
            f"there is no planner '{name}'",
            valid=closest(name, PLANNERS) or list(PLANNERS),
            next_step="call list_planners",
        )
    return folded


def make_planner(name: str) -> "Planner":
    """A new planner.

    Raises:
        UnknownName: no such planner.
    """
    return PLANNERS[known_planner(name)]()


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


def open_traffic(
    mode: TrafficMode, loaded: "LoadedScenario", problem: "PlanningProblem", vehicle: "VehicleParameters", seed: int
) -> "AbstractContextManager[Traffic]":
    """The others of a scenario at the ego's first step, for a ``with`` block.

    Raises:
        NotPossible: no vehicle can react, because no lanelet is drivable.
        WorkerFailure: SUMO refused the network or a vehicle, or stopped.
    """
    if mode == "reactive":
        from .traffic.reactive import reactive_traffic

        return reactive_traffic(loaded, problem, vehicle, seed)
    from .traffic.recorded import RecordedTraffic

    return nullcontext(RecordedTraffic.of(loaded))
