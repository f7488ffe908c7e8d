"""Traffic made by SUMO: a site is filled with vehicles, they drive for a while, and what follows is recorded."""

import logging
import random
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from ...schemas.errors import NotPossible
from ..execution import ProgressReporter
from ..geometry import Points, Values
from ..vehicles import GRAVITY_MPS2, VehicleClass, vehicle_classes
from .conditions import SPEED_CUT, Calibration, time_gaps_s
from .demand import TripMaker
from .sumo import Sumo, heading_of_angle_rad, sumo_running, vehicle_type, vehicle_type_distribution
from .vehicle_counts import Demand

logger = logging.getLogger(__name__)
WARM_UP_S = 20.0
"""Simulated before the first recorded step, so that vehicles have met and stand at lights (chosen)."""
LAST_INSERTION_S = 18.5
"""No vehicle enters later, so that none is recorded in the first second after SUMO put it on the road (chosen)."""
USUAL_SPEEDS = (0.95, 0.08, 0.75, 1.1)
"""Speeds over the limit: mean, standard deviation, least and most (chosen)."""
LANE_CHANGE_S = 3.0
"""How long a change of lane takes; SUMO's usual one is a leap."""


@dataclass(frozen=True)
class RawTrack:
    """A vehicle as SUMO moved it since it was inserted: front bumper (n, 2) in m, the first heading in rad.

    ``along_m`` and ``aside_m``: how far it has rolled along its lane, and lane changes have moved it sideways (left
    positive), since the point before, shape (n,).
    ``lead_in``: how many of the points lie before step 0; they give smoothing a history, and long vehicles a path
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
class DrivingStyle:
    """How all drivers of a traffic drive.

    ``speed_factor``: of all free speeds; ``parameters``: of SUMO's vehicle types, in the place of the class's own;
    ``calibrations``: in the place of both, for the classes that they hold for. ``friction``: the road's coefficient of
    friction, which bounds how hard they accelerate and brake; None if it is not stated.
    """

    speed_factor: float = 1.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    calibrations: tuple[Calibration, ...] = ()
    friction: float | None = None


class OnFoot(Protocol):
    """People on foot in a simulation; ``sumo_type``: the ``vType`` element that they need."""

    sumo_type: str

    def before_step(self, sumo: Sumo, step: int) -> None:
        """Called before each step, from 1 on."""
        ...

    def after_step(self, sumo: Sumo, step: int) -> None:
        """Called after each step."""
        ...


class TooFewFoundRoom(Exception):
    """At step 0 there are too few vehicles; ``counts``: of each class."""

    def __init__(self, counts: Mapping[str, int]) -> None:
        super().__init__("too few vehicles found room")
        self.counts = counts


def simulate_traffic(
    net_path: Path,
    demand: Demand,
    trips: TripMaker,
    *,
    is_enough: Callable[[Mapping[str, int]], bool],
    duration_s: float,
    step_s: float,
    seed: int,
    scratch: Path,
    report: ProgressReporter,
    style: DrivingStyle | None = None,
    pedestrians: OnFoot | None = None,
) -> tuple[RawTrack, ...]:
    """Fill a site with the wanted vehicles, let them drive for the warm-up and record what follows.

    All that are there at step 0, in the order of their insertion, until they leave or time is up. Those that leave
    during the warm-up are replaced until shortly before its end; none enters later.

    Args:
        is_enough: whether to go on with so many vehicles of each class at step 0.
        style: how all drive; None: as usual.
        pedestrians: the people on foot, who are put in and looked at by the way.

    Raises:
        NotPossible: SUMO refuses the net, naming its reason.
        TooFewFoundRoom: those at step 0 are not enough.
        WorkerFailure: SUMO stopped.
    """
    known = vehicle_classes()
    running = sumo_running(
        net_path,
        scratch / "types.add.xml",
        [
            *(_vehicle_type(known[name], style or DrivingStyle()) for name in sorted(demand.counts)),
            *(() if pedestrians is None else (pedestrians.sumo_type,)),
        ],
        step_s=step_s,
        seed=seed % 2**31,  # SUMO's seeds have 31 bits
        options={"--lanechange.duration": LANE_CHANGE_S, "--ignore-route-errors": "true"},
        refusal=lambda why: NotPossible(f"SUMO cannot simulate this network: {why}"),
    )
    with running as sumo:
        source = _Source(sumo, demand, trips, random.Random(seed))  # noqa: S311 - reproducible, not secret
        return _record(sumo, source, is_enough, duration_s, step_s, report, pedestrians)


def _vehicle_type(vehicle_class: VehicleClass, style: DrivingStyle) -> str:
    """SUMO's type for a class: EIDM as the follower model, real dimensions, speeds around the limit.

    A distribution of types where the drivers of the class differ in more than their speed.
    """
    own = {
        "accel": vehicle_class.acceleration_mps2,
        "decel": vehicle_class.deceleration_mps2,
        "minGap": vehicle_class.minimum_gap_m,
    } | {name: value for name, value in style.parameters.items() if name != "speedFactor"}
    speeds = tuple(bound * style.parameters.get("speedFactor", 1.0) for bound in USUAL_SPEEDS)
    gaps_s: tuple[float, ...] = ()
    for calibration in style.calibrations:
        if vehicle_class.name not in calibration.classes:
            continue
        own |= calibration.parameters
        if (factor := calibration.speed_factor) is not None:
            reach = SPEED_CUT * factor.deviation
            speeds = factor.mean, factor.deviation, factor.mean - reach, factor.mean + reach
        if calibration.time_gap_s is not None:
            gaps_s = time_gaps_s(calibration.time_gap_s)
    if vehicle_class.minimum_gap_m != vehicle_classes()["car"].minimum_gap_m:  # a class that stands closer by nature
        own["minGap"] = vehicle_class.minimum_gap_m
    if style.friction is not None:
        held_mps2 = style.friction * GRAVITY_MPS2
        own |= {name: min(own[name], held_mps2) for name in ("accel", "decel")} | {"emergencyDecel": held_mps2}

    def with_values(type_id: str, values: Mapping[str, float]) -> str:
        return vehicle_type(
            type_id,
            vClass=vehicle_class.sumo_class,
            carFollowModel="EIDM",
            length=f"{vehicle_class.length_m:g}",
            width=f"{vehicle_class.width_m:g}",
            **{name: f"{value:g}" for name, value in values.items()},
            maxSpeed=f"{vehicle_class.maximum_speed_mps:g}",
            speedFactor=f"normc({','.join(f'{speed * style.speed_factor:g}' for speed in speeds)})",
        )

    if not gaps_s:
        return with_values(vehicle_class.name, own)
    kinds = [with_values(f"{vehicle_class.name}_{number}", own | {"tau": gap_s}) for number, gap_s in enumerate(gaps_s)]
    return vehicle_type_distribution(vehicle_class.name, kinds)


class _Source:
    """Keeps as many vehicles of every class on the net as are wanted; ``classes``: of those inserted, by SUMO's id."""

    def __init__(self, sumo: Sumo, demand: Demand, trips: TripMaker, choice: random.Random) -> None:
        self._sumo, self._demand, self._trips, self._choice = sumo, demand, trips, choice
        self.classes: dict[str, VehicleClass] = {}
        self._made = 0

    def fill(self) -> None:
        """Insert what is missing; vehicles that find no place are taken back and tried again elsewhere."""
        here = set(self._sumo.vehicles())
        for waiting in [key for key in self.classes if key not in here]:
            logger.debug("vehicle_waits_or_left vehicle=%s class=%s", waiting, self.classes[waiting].name)
            self._sumo.withdraw(waiting)
            del self.classes[waiting]
        known = vehicle_classes()
        missing = [
            known[name]
            for name, count in self._demand.counts.items()
            for _ in range(count - sum(present.name == name for present in self.classes.values()))
        ]
        self._choice.shuffle(missing)
        missing.sort(key=lambda vehicle_class: vehicle_class.name == "car")  # large ones first: they need more room
        for vehicle_class in missing:
            self._insert(vehicle_class)

    def _insert(self, vehicle_class: VehicleClass) -> None:
        key = f"{self._made:05d}"
        self._made += 1
        self._sumo.add_route(f"route{key}", self._trips.trip(vehicle_class))
        self._sumo.insert_anywhere(key, f"route{key}", vehicle_class.name)
        self.classes[key] = vehicle_class


def _record(
    sumo: Sumo,
    source: _Source,
    is_enough: Callable[[Mapping[str, int]], bool],
    duration_s: float,
    step_s: float,
    report: ProgressReporter,
    pedestrians: OnFoot | None,
) -> tuple[RawTrack, ...]:
    warm_up, last_insertion = round(WARM_UP_S / step_s), round(LAST_INSERTION_S / step_s)
    steps = round(duration_s / step_s)
    seen: dict[str, _Recording] = {}
    before: dict[str, int] = {}
    for step in range(1, warm_up + steps + 1):
        if step <= last_insertion and step % 10 == 1:
            source.fill()
        if pedestrians is not None:
            pedestrians.before_step(sumo, step)
        sumo.step()
        if pedestrians is not None:
            pedestrians.after_step(sumo, step)
        if step % 50 == 0:
            report(step / (warm_up + steps), "simulating traffic")
        present = sumo.vehicles()
        for key in present:
            if key not in seen:
                seen[key] = _Recording(heading_of_angle_rad(sumo.angle_deg(key)))
            seen[key].fronts.append(sumo.front(key))
            seen[key].speeds_mps.append(sumo.speed_mps(key))
            seen[key].sideways_mps.append(sumo.lateral_speed_mps(key))
        if step == warm_up:
            before = {key: len(seen[key].fronts) - 1 for key in sorted(present)}
            counts = Counter(source.classes[key].name for key in before)
            if not is_enough(counts):
                raise TooFewFoundRoom(counts)
    tracks = (seen[key].track(key, source.classes[key], lead_in, step_s) for key, lead_in in before.items())
    return tuple(track for track in tracks if len(track.front) - track.lead_in >= 2)


@dataclass
class _Recording:
    """What has been recorded of a vehicle up to the present step."""

    first_heading_rad: float
    fronts: list[tuple[float, float]] = field(default_factory=list)
    speeds_mps: list[float] = field(default_factory=list)
    sideways_mps: list[float] = field(default_factory=list)

    def track(self, key: str, vehicle_class: VehicleClass, lead_in: int, step_s: float) -> RawTrack:
        along, aside = np.array(self.speeds_mps) * step_s, np.array(self.sideways_mps) * step_s
        return RawTrack(key, vehicle_class, np.array(self.fronts), along, aside, self.first_heading_rad, lead_in)
