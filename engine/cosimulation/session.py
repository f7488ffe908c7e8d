"""SUMO over a scenario's own network: the options for it, and the files that it reads and leaves."""

from collections.abc import Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from ..traffic import Sumo, sumo_running
from .manoeuvres import LANE_CHANGE_S

TYPES_FILE = "types.add.xml"
"""Name of the file of the vehicle types that SUMO read."""
ROUTES_FILE = "driven.rou.xml"
"""Name of the file of the routes that the vehicles drove, by which vehicle type."""
LANE_CHANGES_LAST = ("--lanechange.duration", LANE_CHANGE_S)
"""SUMO's usual lane change is a leap; the alternative to a duration is to divide the lanes into sublanes."""


@dataclass(frozen=True)
class SimulationSetup:
    """Where the network is, and how long and how finely is simulated; ``folder`` takes the vehicle types.

    ``keeps_routes``: SUMO writes ``ROUTES_FILE`` there too.
    """

    net: Path
    folder: Path
    step_s: float
    last_step: int
    seed: int
    keeps_routes: bool = False


def open_simulation(
    setup: SimulationSetup, vehicle_types: Iterable[str], lateral_motion: tuple[str, float] = LANE_CHANGES_LAST
) -> AbstractContextManager[Sumo]:
    """A simulation that ends with the block.

    Args:
        setup: the network and the steps.
        vehicle_types: ``vType`` elements.
        lateral_motion: SUMO's option for motion across lanes.

    Raises:
        WorkerFailure: SUMO refused the network, a vehicle type or an option, or stopped inside the block.
    """
    options = {
        "--default.action-step-length": setup.step_s,
        "--max-depart-delay": -1,
        "--collision.check-junctions": "false",
        lateral_motion[0]: lateral_motion[1],
        **(_route_output(setup.folder / ROUTES_FILE) if setup.keeps_routes else {}),
    }
    return sumo_running(
        setup.net, setup.folder / TYPES_FILE, vehicle_types, step_s=setup.step_s, seed=setup.seed, options=options
    )


def _route_output(path: Path) -> dict[str, object]:
    """SUMO's options for a record of the routes as they are at last, of vehicles that are still there too."""
    return {
        "--vehroute-output": path,
        "--vehroute-output.write-unfinished": "true",
        "--vehroute-output.last-route": "true",
    }
