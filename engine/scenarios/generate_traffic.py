"""Traffic for a generated scenario: drawn anew until every class that was asked for is there."""

import random
from dataclasses import dataclass
from pathlib import Path

from plannerforge.engine.execution.progress import ProgressReporter
from plannerforge.engine.scenarios.generate_place import Place
from plannerforge.engine.traffic.demand import Demand, TripMaker
from plannerforge.engine.traffic.motions import Participant, participants, sound
from plannerforge.engine.traffic.simulation import WARM_UP_S, simulate_traffic
from plannerforge.engine.traffic.vehicle_classes import vehicle_classes
from plannerforge.schemas.generation import GenerationRequest

ATTEMPTS = 3
SPARE_SHARE = 0.12
"""More cars than wanted are simulated, because some leave before step 0 or are left out."""
LASTING_S = 30.0
"""Trips prefer ways that last so long; preferring longer ones would keep traffic off the main roads of a small site."""


@dataclass(frozen=True)
class LivelyTraffic:
    """Smoothed vehicles at a site, how many were left out because they overlapped another, and what is missing.

    ``missing``: vehicles of classes that were asked for and found no room, or are more than asked.
    """

    everyone: tuple[Participant, ...]
    left_out: int
    missing: int


def lively_traffic(
    request: GenerationRequest,
    demand: Demand,
    place: Place,
    round_number: int,
    net_path: Path,
    scratch: Path,
    step_s: float,
    report: ProgressReporter,
) -> LivelyTraffic:
    """Traffic without overlaps; of several attempts the first that holds all that was asked, or else most of it.

    Raises:
        NotPossible: no road at the site is open to a class that was asked for.
    """
    lasting_s = min(WARM_UP_S + request.duration_s, LASTING_S)
    needed = {name: least + (name == "car") for name, least in {"car": 0, **demand.least}.items()}
    found: list[LivelyTraffic] = []
    for attempt in range(ATTEMPTS):
        seed = mixed_seed(request.seed, request.index, attempt + ATTEMPTS * round_number)
        trips = TripMaker(place.net, lasting_s, random.Random(seed))  # noqa: S311 - reproducible, not secret
        for name in sorted(demand.counts):
            trips.check_open(vehicle_classes()[name])
        part = _Part(report, 0.3 + 0.4 * attempt / ATTEMPTS, 0.4 / ATTEMPTS)
        part(0.0, "simulating traffic")
        traffic = simulate_traffic(
            net_path,
            demand.with_spare_cars(SPARE_SHARE),
            trips,
            duration_s=request.duration_s,
            step_s=step_s,
            seed=seed,
            scratch=scratch,
            report=part,
        )
        part(1.0, "smoothing motion")
        everyone = participants(traffic)
        part(1.0, "looking for overlaps")
        kept = sound(everyone, needed)
        left_out = len(everyone) - len(kept)
        kept = _without_spare_cars(kept, demand)
        found.append(LivelyTraffic(kept, left_out, _missing(demand, kept)))
        if found[-1].missing == 0:
            break
    return min(found, key=lambda traffic: traffic.missing)


def _without_spare_cars(everyone: tuple[Participant, ...], demand: Demand) -> tuple[Participant, ...]:
    """Without the last cars beyond those that are wanted."""
    cars = [vehicle for vehicle in everyone if vehicle.vehicle_class.name == "car"]
    surplus = {vehicle.vehicle_id for vehicle in cars[demand.counts["car"] :]}
    return tuple(vehicle for vehicle in everyone if vehicle.vehicle_id not in surplus)


class _Part:
    """Reports the share of a part as that of the whole."""

    def __init__(self, whole: ProgressReporter, begin: float, size: float) -> None:
        self._whole, self._begin, self._size = whole, begin, size

    def __call__(self, share: float, message: str = "") -> None:
        self._whole(self._begin + self._size * share, message)


def mixed_seed(seed: int, index: int, attempt: int) -> int:
    """One seed out of three numbers, the same on every machine."""
    return (seed * 1_000_003 + index * 7_919 + attempt * 104_729 + 17) % 2**31


def _missing(demand: Demand, everyone: tuple[Participant, ...]) -> int:
    """How many vehicles of classes that were asked for are not there; one car is the ego and does not count."""
    total = 0
    for name, least in demand.least.items():
        here = sum(vehicle.vehicle_class.name == name for vehicle in everyone) - (name == "car")
        total += max(0, least - here) + max(0, here - demand.most.get(name, here))
    return total
