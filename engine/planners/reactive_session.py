"""Opening reactive traffic: the network, the vehicle types, and a first trial of where SUMO sees everybody."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from plannerforge.engine.edits.sumo_process import SimulationSetup, sumo_running
from plannerforge.engine.planners.aim import aimed_at
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.reactive_cast import Cast, ego_type, first_index
from plannerforge.engine.planners.reactive_traffic import ReactiveTraffic
from plannerforge.engine.planners.sumo_vehicles import SumoVehicles
from plannerforge.engine.planners.vehicle import VehicleParameters
from plannerforge.engine.scenarios.reader import LoadedScenario
from plannerforge.schemas.errors import NotPossible, WorkerFailure

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem

SUBLANES = ("--lateral-resolution", 0.4)
"""Both lanes see a vehicle across their line; without sublanes only the lane of its front centre does."""


@contextmanager
def reactive_traffic(
    loaded: LoadedScenario, problem: "PlanningProblem", ego: EgoState, vehicle: VehicleParameters, seed: int
) -> Iterator[ReactiveTraffic]:
    """The others of a scenario, driven by SUMO from the ego's first step on.

    Raises:
        NotPossible: no lanelet of the scenario can be driven on.
        WorkerFailure: SUMO refused the network or a vehicle.
    """
    import libsumo

    with TemporaryDirectory() as name:
        folder = Path(name)
        cast = Cast.of(loaded, ego.step)
        if not cast.scene.layout.edges:
            raise NotPossible("no lanelet is drivable, so nobody can react", next_step="run with traffic recorded")
        cast.write_net(folder / "scenario.net.xml")
        setup = SimulationSetup(folder / "scenario.net.xml", folder, loaded.step_s, 0, seed)
        everybody = cast.driven + cast.shown
        types = [*(one.vehicle_type() for one in everybody), ego_type(vehicle)]
        try:
            with sumo_running(setup, types, SUBLANES) as sumo:
                cast = cast.keeping_to_route(_astray(SumoVehicles(sumo), cast))
            with sumo_running(setup, types, SUBLANES) as sumo:
                goal = aimed_at(cast.scene.network, problem.goal, ego, vehicle, loaded.step_s)
                yield ReactiveTraffic(SumoVehicles(sumo), cast, cast.ego_edges(goal, ego), ego, vehicle)
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            raise WorkerFailure(f"SUMO stopped: {error}") from error


def _astray(vehicles: SumoVehicles, cast: Cast) -> frozenset[str]:
    """Driven vehicles whose first pose SUMO takes for another road than their own; tried in a step of its own."""
    for one in cast.driven:
        vehicles.insert(one.key, one.edges)
        vehicles.place_recorded(one, first_index(one))
    there = vehicles.step()
    return frozenset(one.key for one in cast.driven if one.key in there and vehicles.is_astray(one))
