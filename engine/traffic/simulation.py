"""Running SUMO traffic in this process and recording it (libsumo: one simulation a process)."""

import math
import random
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...schemas.errors import NotPossible
from ..execution import ProgressReporter
from ..geometry import Points, Values
from ..vehicles import VehicleClass, vehicle_classes
from .demand import TripMaker, write_vehicle_types
from .vehicle_counts import Demand

WARM_UP_S = 20.0
LAST_INSERTION_S = 18.5


@dataclass(frozen=True)
class RawTrack:
    """A vehicle as SUMO moved it since it was inserted: front bumper (n, 2) in m, the first heading in rad.

    ``along_m`` and ``aside_m``: how far it has rolled along its lane, and lane changes have moved it sideways (left
    positive), since the point before, shape (n,).
    ``lead_in``: how many of the points lie before step 0; they give smoothing a history, and long vehicles a way
    behind them.
    """

    vehicle_id: str
    vehicle_class: VehicleClass
    front: Points
    along_m: Values
    aside_m: Values
    first_heading_rad: float
    lead_in: int


@dataclass(frozen=True)
class SimulatedTraffic:
    """All vehicles that are there at step 0, in the order of their insertion, until they leave or time is up."""

    tracks: tuple[RawTrack, ...]
    step_s: float
    elapsed_s: float


def simulate_traffic(
    net_path: Path,
    demand: Demand,
    trips: TripMaker,
    *,
    duration_s: float,
    step_s: float,
    seed: int,
    scratch: Path,
    report: ProgressReporter,
) -> SimulatedTraffic:
    """Fill a site with the wanted vehicles, let them drive for the warm-up and record what follows.

    Vehicles that leave during the warm-up are replaced until shortly before its end; none enters later.

    Raises:
        NotPossible: SUMO refuses the net, naming its reason.
    """
    import libsumo

    types = scratch / "types.rou.xml"
    known = vehicle_classes()
    write_vehicle_types(types, [known[name] for name in sorted(demand.counts)])
    options = ["--net-file", str(net_path), "--route-files", str(types), "--step-length", f"{step_s:g}"]
    options += ["--lanechange.duration", "3", "--collision.action", "none", "--time-to-teleport", "-1"]
    options += ["--ignore-route-errors", "true", "--no-step-log", "true", "--no-warnings", "true"]
    try:
        libsumo.start(["sumo", *options, "--seed", str(seed % 2**31)])
    except libsumo.TraCIException as error:
        raise NotPossible(f"SUMO cannot simulate this network: {error!s}") from error
    try:
        source = _Source(libsumo, demand, trips, random.Random(seed))  # noqa: S311 - reproducible, not secret
        return _record(libsumo, source, duration_s, step_s, report)
    finally:
        libsumo.close()


class _Source:
    """Keeps as many vehicles of every class on the net as are wanted."""

    def __init__(self, sumo: Any, demand: Demand, trips: TripMaker, choice: random.Random) -> None:
        self._sumo, self._demand, self._trips, self._choice = sumo, demand, trips, choice
        self._classes: dict[str, VehicleClass] = {}
        self._made = 0

    def fill(self) -> None:
        """Insert what is missing; vehicles that find no place are taken back and tried again elsewhere."""
        here = set(self._sumo.vehicle.getIDList())
        for waiting in [key for key in self._classes if key not in here]:
            if waiting in self._sumo.vehicle.getLoadedIDList():
                self._sumo.vehicle.remove(waiting)
            del self._classes[waiting]
        known = vehicle_classes()
        missing = [
            known[name]
            for name, count in self._demand.counts.items()
            for _ in range(count - sum(found.name == name for found in self._classes.values()))
        ]
        self._choice.shuffle(missing)
        missing.sort(key=lambda found: found.name == "car")
        for vehicle_class in missing:
            self._insert(vehicle_class)

    def _insert(self, vehicle_class: VehicleClass) -> None:
        trip = self._trips.trip(vehicle_class)
        key = f"{self._made:05d}"
        self._made += 1
        self._sumo.route.add(f"route{key}", list(trip.edges))
        self._sumo.vehicle.add(
            key, f"route{key}", vehicle_class.name, departLane="best", departPos="random_free", departSpeed="desired"
        )
        self._classes[key] = vehicle_class

    def class_of(self, key: str) -> VehicleClass:
        """The class of an inserted vehicle."""
        return self._classes[key]


def _record(sumo: Any, source: _Source, duration_s: float, step_s: float, report: ProgressReporter) -> SimulatedTraffic:
    warm_up, last_insertion = round(WARM_UP_S / step_s), round(LAST_INSERTION_S / step_s)
    steps = round(duration_s / step_s)
    seen: dict[str, _Seen] = {}
    before: dict[str, int] = {}
    for step in range(1, warm_up + steps + 1):
        if step <= last_insertion and step % 10 == 1:
            source.fill()
        sumo.simulationStep()
        if step % 50 == 0:
            report(step / (warm_up + steps), "simulating traffic")
        for key in sumo.vehicle.getIDList():
            if key not in seen:
                seen[key] = _Seen(math.radians(90.0 - sumo.vehicle.getAngle(key)))
            seen[key].fronts.append(sumo.vehicle.getPosition(key)[:2])
            seen[key].speeds_mps.append(sumo.vehicle.getSpeed(key))
            seen[key].sideways_mps.append(sumo.vehicle.getLateralSpeed(key))
        if step == warm_up:
            before = {key: len(seen[key].fronts) - 1 for key in sorted(sumo.vehicle.getIDList())}
    tracks = (seen[key].track(key, source.class_of(key), lead_in, step_s) for key, lead_in in before.items())
    return SimulatedTraffic(
        tuple(track for track in tracks if len(track.front) - track.lead_in >= 2), step_s, warm_up * step_s
    )


@dataclass
class _Seen:
    """What has been recorded of a vehicle so far."""

    first_heading_rad: float
    fronts: list[tuple[float, float]] = field(default_factory=list)
    speeds_mps: list[float] = field(default_factory=list)
    sideways_mps: list[float] = field(default_factory=list)

    def track(self, key: str, vehicle_class: VehicleClass, lead_in: int, step_s: float) -> RawTrack:
        along, aside = np.array(self.speeds_mps) * step_s, np.array(self.sideways_mps) * step_s
        return RawTrack(key, vehicle_class, np.array(self.fronts), along, aside, self.first_heading_rad, lead_in)
