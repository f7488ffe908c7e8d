"""SUMO started for one run over a scenario's network: its options, and the files that it reads and leaves."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...schemas.errors import WorkerFailure
from .manoeuvres import LANE_CHANGE_S

TYPES_FILE, ROUTES_FILE = "types.add.xml", "driven.rou.xml"
LANE_CHANGES_LAST = ("--lanechange.duration", LANE_CHANGE_S)
"""SUMO's usual lane change is a leap; the alternative to a duration is to divide the lanes into sublanes."""


@dataclass(frozen=True)
class SimulationSetup:
    """Where the network is, and how long and how finely is simulated; ``folder`` takes the vehicle types.

    ``keeps_routes``: SUMO writes there besides which route everybody drove, by which vehicle type.
    """

    net: Path
    folder: Path
    step_s: float
    last_step: int
    seed: int
    keeps_routes: bool = False


@contextmanager
def sumo_running(
    setup: SimulationSetup, vehicle_types: Iterable[str], sideways: tuple[str, float] = LANE_CHANGES_LAST
) -> Iterator[Any]:
    """The module libsumo with a simulation started in it; ``sideways``: the option for motion across lanes.

    Raises:
        WorkerFailure: SUMO refused the network, a vehicle type or an option.
    """
    import libsumo

    types = setup.folder / TYPES_FILE
    types.write_text("\n".join(["<additional>", *vehicle_types, "</additional>\n"]))
    options = {
        "--net-file": setup.net,
        "--additional-files": types,
        "--step-length": setup.step_s,
        "--default.action-step-length": setup.step_s,
        "--seed": setup.seed,
        "--time-to-teleport": -1,
        "--max-depart-delay": -1,
        "--collision.action": "none",
        "--collision.check-junctions": "false",
        sideways[0]: sideways[1],
        **(_routes_written(setup.folder / ROUTES_FILE) if setup.keeps_routes else {}),
    }
    arguments = [str(part) for option in options.items() for part in option]
    try:
        try:
            libsumo.start(["sumo", "--no-step-log", "--no-warnings", *arguments])
        except libsumo.TraCIException as error:
            raise WorkerFailure(f"SUMO did not start: {error}") from error
        yield libsumo
    finally:
        libsumo.close()


def _routes_written(path: Path) -> dict[str, object]:
    """SUMO's options for a record of the routes as they are at last, of those who are still there too."""
    return {
        "--vehroute-output": path,
        "--vehroute-output.write-unfinished": "true",
        "--vehroute-output.last-route": "true",
    }
