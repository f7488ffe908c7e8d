"""Traffic for a generated scenario: drawn anew until every class that was asked for is there."""

import random
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from plannerforge.engine.execution.progress import ProgressReporter
from plannerforge.engine.scenarios.generate_place import Place
from plannerforge.engine.traffic.demand import TripMaker
from plannerforge.engine.traffic.motions import Participant, participants, sound
from plannerforge.engine.traffic.simulation import WARM_UP_S, simulate_traffic
from plannerforge.engine.traffic.vehicle_classes import vehicle_classes
from plannerforge.engine.traffic.vehicle_counts import Demand
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.generation import GenerationRequest

ATTEMPTS = 3
MOST_STATES = 100_000
"""So many recorded states of vehicles fit into a file that is still read back; its reader bounds the elements."""
SPARE_SHARE = 0.12
"""More vehicles than wanted are simulated, because some leave before step 0 or are left out."""
MORE_FOR_EACH_ABSENT = 2
"""Of a class that fell short, so many more are simulated at the next attempt for each that was missing."""
LASTING_S = 30.0
"""Trips prefer ways that last so long; preferring longer ones would keep traffic off the main roads of a small site."""


@dataclass(frozen=True)
class LivelyTraffic:
    """Smoothed vehicles at a site, spare ones among them, and the demand that they meet.

    ``left_out``: how many were not sound, as they could not be driven or overlapped others.
    """

    everyone: tuple[Participant, ...]
    left_out: int
    demand: Demand


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
    """Traffic without overlaps that holds all vehicles that were asked for: the first of several attempts.

    Raises:
        NotPossible: no road at the site is open to a class that was asked for, or too few of a class find room.
    """
    lasting_s = min(WARM_UP_S + request.duration_s, LASTING_S)
    needed = {name: least + (name == "car") for name, least in {"car": 0, **demand.least}.items()}
    shortfalls: list[dict[str, int]] = []
    more: Counter[str] = Counter()
    for attempt in range(ATTEMPTS):
        seed = mixed_seed(request.seed, request.index, attempt + ATTEMPTS * round_number)
        trips = TripMaker(place.net, lasting_s, random.Random(seed))  # noqa: S311 - reproducible, not secret
        for name in sorted(demand.counts):
            trips.check_open(vehicle_classes()[name])
        part = _Part(report, 0.3 + 0.4 * attempt / ATTEMPTS, 0.4 / ATTEMPTS)
        part(0.0, "simulating traffic")
        traffic = simulate_traffic(
            net_path,
            demand.with_spares(SPARE_SHARE, more),
            trips,
            duration_s=request.duration_s,
            step_s=step_s,
            seed=seed,
            scratch=scratch,
            report=part,
        )
        states = sum(len(track.front) - track.lead_in for track in traffic.tracks) / (1 + SPARE_SHARE)
        if states > MOST_STATES:
            demand = _fewer(demand, MOST_STATES / states, request.duration_s)
            continue
        part(1.0, "smoothing motion")
        everyone = participants(traffic)
        part(1.0, "looking for overlaps")
        kept = sound(everyone, needed)
        left_out = len(everyone) - len(kept)
        absent = missing(demand, kept)
        if not absent:
            return LivelyTraffic(kept, left_out, demand)
        shortfalls.append(absent)
        more.update({name: MORE_FOR_EACH_ABSENT * count for name, count in absent.items()})
    if not shortfalls:
        raise _too_large(request.duration_s)
    raise _no_room(demand, min(shortfalls, key=lambda absent: sum(absent.values())))


def _fewer(demand: Demand, share: float, duration_s: float) -> Demand:
    """Fewer vehicles where a file would hold too many states; those that stay leave earlier, so not by much more.

    Raises:
        NotPossible: the request names them all.
    """
    reason = f"a recording of {duration_s:g} s holds no more than {MOST_STATES:,} states of vehicles"
    less = demand.fewer(0.95 * share, reason)
    if less.counts == demand.counts:
        raise _too_large(duration_s)
    return less


def _too_large(duration_s: float) -> NotPossible:
    return NotPossible(
        f"so many vehicles for {duration_s:g} s make a file that is too large (more than {MOST_STATES:,} states)",
        next_step="ask for a shorter duration_s, a lower density or fewer vehicles",
    )


def without_spares(everyone: tuple[Participant, ...], demand: Demand) -> tuple[Participant, ...]:
    """Without the last vehicles of every class beyond those that are wanted; the ego has to come first."""
    seen: Counter[str] = Counter()
    kept: list[Participant] = []
    for vehicle in everyone:
        name = vehicle.vehicle_class.name
        seen[name] += 1
        if seen[name] <= demand.counts[name]:
            kept.append(vehicle)
    return tuple(kept)


class _Part:
    """Reports the share of a part as that of the whole."""

    def __init__(self, whole: ProgressReporter, begin: float, size: float) -> None:
        self._whole, self._begin, self._size = whole, begin, size

    def __call__(self, share: float, message: str = "") -> None:
        self._whole(self._begin + self._size * share, message)


def mixed_seed(seed: int, index: int, attempt: int) -> int:
    """One seed out of three numbers, the same on every machine."""
    return (seed * 1_000_003 + index * 7_919 + attempt * 104_729 + 17) % 2**31


def missing(demand: Demand, everyone: Sequence[Participant]) -> dict[str, int]:
    """How many vehicles of the classes asked for are not there; one car is the ego and does not count."""
    here = Counter(vehicle.vehicle_class.name for vehicle in everyone)
    here["car"] -= 1
    return {name: least - here[name] for name, least in demand.least.items() if here[name] < least}


def _no_room(demand: Demand, absent: Mapping[str, int]) -> NotPossible:
    found = {name: demand.least[name] - absent[name] for name in absent}
    return NotPossible(
        f"asked for at least {_listed({name: demand.least[name] for name in absent})}; "
        f"of them {_listed(found)} found room at this site",
        valid=[f"{name}={count}" for name, count in found.items() if count],
        next_step="ask for fewer, or choose another place, scenario_type or seed",
    )


def _listed(counts: Mapping[str, int]) -> str:
    return " and ".join(f"{count} {name}" for name, count in counts.items())
