"""Traffic for a generated scenario: drawn anew until every class that was asked for is there."""

import random
from pathlib import Path

from plannerforge.engine.execution.progress import ProgressReporter
from plannerforge.engine.scenarios.generate_place import Place
from plannerforge.engine.traffic.demand import Demand, TripMaker
from plannerforge.engine.traffic.motions import Participant, participants
from plannerforge.engine.traffic.simulation import WARM_UP_S, simulate_traffic
from plannerforge.engine.traffic.vehicle_classes import vehicle_classes
from plannerforge.schemas.generation import GenerationRequest

ATTEMPTS = 4
LASTING_S = 30.0
"""Trips prefer ways that last so long; preferring longer ones would keep traffic off the main roads of a small site."""


def lively_traffic(
    request: GenerationRequest,
    demand: Demand,
    place: Place,
    net_path: Path,
    scratch: Path,
    step_s: float,
    report: ProgressReporter,
) -> tuple[tuple[Participant, ...], int]:
    """Smoothed traffic that holds what was asked, and how many vehicles were left out for overlapping at step 0.

    Of several attempts the first that holds everything, otherwise the one that misses least.

    Raises:
        NotPossible: no road at the site is open to a class that was asked for.
    """
    lasting_s = min(WARM_UP_S + request.duration_s, LASTING_S)
    found: list[tuple[int, tuple[Participant, ...], int]] = []
    for attempt in range(ATTEMPTS):
        seed = mixed_seed(request.seed, request.index, attempt)
        trips = TripMaker(place.net, lasting_s, random.Random(seed))  # noqa: S311 - reproducible, not secret
        for name in sorted(demand.counts):
            trips.check_open(vehicle_classes()[name])
        traffic = simulate_traffic(
            net_path,
            demand,
            trips,
            duration_s=request.duration_s,
            step_s=step_s,
            seed=seed,
            scratch=scratch,
            report=_Part(report, 0.2 + 0.6 * attempt / ATTEMPTS, 0.6 / ATTEMPTS),
        )
        everyone, dropped = participants(traffic)
        found.append((_missing(demand, everyone), everyone, dropped))
        if found[-1][0] == 0:
            break
    _, everyone, dropped = min(found, key=lambda entry: entry[0])
    return everyone, dropped


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
