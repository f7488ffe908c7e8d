"""Generates a scenario's traffic: draws it again until every requested class is present, and orders it.

Vehicles are ordered by their relevance to the site, so that "the first car" does not wait at the edge of the map.
"""

import logging
import random
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ...schemas.errors import NotPossible
from ...schemas.generation import GenerationRequest, SiteType, VehicleDemand
from ...schemas.text import counted
from ..cosimulation import presets
from ..execution import ProgressReporter
from ..maps import FAST_ROADS, RAMP_LINKS, RURAL_CLASSES
from ..network import LaneletLookup, SumoNet
from ..traffic import (
    FEWEST,
    SPEED_FACTORS,
    WARM_UP_S,
    Demand,
    DrivingStyle,
    DroppedVehicle,
    GeneratedVehicle,
    TooFewFoundRoom,
    TripMaker,
    WalkedPerson,
    drop_infeasible,
    generated_vehicles,
    lane_km_of,
    published_calibrations,
    simulate_traffic,
)
from ..vehicles import vehicle_classes
from .flows import FlowPlan, FlowTrips, plan_flows
from .people import pedestrians_for, people_among, target_pedestrians
from .site_network import SiteNetwork
from .sites import middle_of, road_classes
from .turning_trips import TurningTrips, has_ways
from .writer import STEP_S

logger = logging.getLogger(__name__)
ATTEMPTS = 3
"""Simulations before a class that falls short is refused (chosen)."""
MOST_STATES = 100_000
"""Maximum recorded vehicle states in a file: its reader limits the elements that it reads back."""
SPARE_SHARE = 0.12
"""More vehicles than wanted are simulated, because some leave before step 0 or are removed (chosen)."""
MORE_FOR_EACH_ABSENT = 2
"""Extra vehicles that the next attempt simulates for each missing vehicle of a class."""
FEW_ABSENT, ABSENT_SHARE = 10, 0.05
"""If more vehicles than both are missing, the site is full: further attempts never found room for all (measured)."""
EGO_CANDIDATES = 4
"""Extra simulated vehicles of the ego's class unless it is a car or must turn (chosen): some have no goal."""
NO_ROOM = "no_room"
"""Reason for refusing a full site."""
LASTING_S = 30.0
"""Trips prefer routes of this duration; preferring longer ones would keep traffic off a small site's main roads."""


@dataclass(frozen=True)
class TrafficAim:
    """The traffic target of a site: vehicles per kilometre of lane, the target's source, and counted routes.

    ``per_lane_km`` is None if the request's density applies; otherwise ``density_source`` is a time of day or
    ``counts``. The site gets at least ``fewest`` vehicles. ``turning``: vehicles of the ego's class are routed through
    the site, along the ego's requested turn if there is one.
    """

    per_lane_km: float | None = None
    density_source: str = ""
    plan: FlowPlan | None = None
    fewest: int = FEWEST
    turning: bool = False

    @classmethod
    def of(cls, request: GenerationRequest, net: SumoNet) -> "TrafficAim":
        """Return the target of a request at a site.

        Raises:
            NotPossible: no counted road is at the site.
        """
        conditions = request.conditions
        if conditions is None:
            return cls()
        if not conditions.flows:
            return cls(conditions.per_lane_km, conditions.time if conditions.per_lane_km else "")
        seed = _mixed_seed(request.seed, request.index, 0)
        plan = plan_flows(conditions.flows, net, random.Random(seed))  # noqa: S311 - reproducible, not secret
        return cls(plan.vehicles / lane_km_of(net), "counts", plan, 1)


@dataclass(frozen=True)
class GeneratedTraffic:
    """The smoothed vehicles at a site, including spares; the demand that they meet; pedestrians and cyclists.

    ``dropped``: recorded vehicles that were removed.
    """

    vehicles: tuple[GeneratedVehicle, ...]
    demand: Demand
    people: tuple[WalkedPerson, ...] = ()
    dropped: tuple[DroppedVehicle, ...] = ()


def generate_traffic(
    request: GenerationRequest,
    demand: Demand,
    aim: TrafficAim,
    site: SiteNetwork,
    round_number: int,
    scratch: Path,
    report: ProgressReporter,
) -> GeneratedTraffic:
    """Return the first traffic drawn that has no overlaps and contains all requested vehicles.

    ``round_number`` draws other traffic with the same seed.

    Raises:
        NotPossible: no road at the site is open to a requested class, or too few of a class find room.
    """
    lasting_s = min(WARM_UP_S + request.duration_s, LASTING_S)
    needed = {demand.ego_class: 1} | {name: count for name, count in demand.needed.items() if count}
    shortfalls: list[dict[str, int]] = []
    on_foot = request.people
    people = 0 if on_foot is None else target_pedestrians(on_foot, request.density, demand.total)
    most_people = 0
    more: Counter[str] = Counter()
    if demand.ego_class != "car" or aim.turning:
        more[demand.ego_class] = EGO_CANDIDATES
    for attempt in range(ATTEMPTS):
        seed = _mixed_seed(request.seed, request.index, attempt + ATTEMPTS * round_number)
        choice = random.Random(seed)  # noqa: S311 - reproducible, not secret
        trips = _trips(request, aim, site.net, lasting_s, choice)
        if aim.turning and aim.plan is None and has_ways(site.focus):
            ego_class = vehicle_classes()[demand.ego_class]
            most_late = demand.counts[demand.ego_class] + EGO_CANDIDATES
            trips = TurningTrips(
                site.net, lasting_s, choice, site.focus, request.goal.turn, ego_class, request.duration_s, most_late
            )
        for name in sorted(demand.counts):
            trips.check_open(vehicle_classes()[name])
        pedestrians = None
        if site.footways is not None:
            middle = middle_of(site.site, site.net)
            pedestrians = pedestrians_for(
                site.footways, site.network, people, middle, duration_s=request.duration_s, step_s=STEP_S, seed=seed
            )
        part = _Part(report, 0.3 + 0.4 * attempt / ATTEMPTS, 0.4 / ATTEMPTS)
        part(0.0, "simulating traffic")
        try:
            recorded = simulate_traffic(
                site.net_path,
                demand.with_spares(SPARE_SHARE, more),
                trips,
                is_enough=partial(_is_not_full, demand),
                duration_s=request.duration_s,
                step_s=STEP_S,
                seed=seed,
                scratch=scratch,
                report=part,
                style=_style_of(request, site.metadata.friction),
                pedestrians=pedestrians,
            )
        except TooFewFoundRoom as full:
            shortfalls.append(_absent(demand, full.counts))
            break
        states = sum(len(track.front) - track.lead_in for track in recorded) / (1 + SPARE_SHARE)
        if states > MOST_STATES:
            demand = _fewer(demand, MOST_STATES / states, request.duration_s)
            continue
        part(1.0, "smoothing motion")
        smoothed = generated_vehicles(recorded, STEP_S)
        part(1.0, "looking for overlaps")
        kept, dropped = drop_infeasible(smoothed, needed)
        absent = _absent(demand, Counter(vehicle.vehicle_class.name for vehicle in kept))
        walked = () if pedestrians is None else people_among(pedestrians, kept, people)
        most_people = max(most_people, len(walked))
        if not absent and (len(walked) == people or (walked and attempt == ATTEMPTS - 1 and not _is_counted(on_foot))):
            return GeneratedTraffic(kept, demand, walked, dropped)
        logger.debug("traffic_drawn_again attempt=%d absent=%s people=%d", attempt, absent, len(walked))
        if not absent:
            continue
        shortfalls.append(absent)
        if _is_hopeless(demand, absent):
            break
        more.update({name: MORE_FOR_EACH_ABSENT * count for name, count in absent.items()})
    if not shortfalls and most_people < people:
        raise NotPossible(
            f"{counted(people, 'pedestrian')} requested, but {most_people} found room on the pavements of this site",
            valid=[f"pedestrian={most_people}"] if most_people else [],
            next_step="request fewer, or choose another place, scenario_type or seed",
        )
    if not shortfalls:
        raise _too_large(request.duration_s)
    raise _no_room(demand, min(shortfalls, key=lambda absent: sum(absent.values())))


def _is_counted(demand: VehicleDemand | None) -> bool:
    """Return whether the request sets a number of a class."""
    return demand is not None and demand.least is not None


def _trips(
    request: GenerationRequest, aim: TrafficAim, net: SumoNet, lasting_s: float, choice: random.Random
) -> TripMaker:
    if aim.plan is not None:
        return FlowTrips(net, lasting_s, choice, aim.plan)
    kind = "usual" if request.conditions is None else request.conditions.trips
    return TripMaker(net, lasting_s, choice, *_requested_ramps(request, net), kind=kind)


def _requested_ramps(request: GenerationRequest, net: SumoNet) -> tuple[frozenset[str], frozenset[str]]:
    """Return the motorway links where extra trips begin (if a road user must merge) or end (if the ego exits)."""
    begins = request.goal.turn == "merge" or (request.others is not None and request.others.name == "merging")
    if not begins and request.goal.turn != "exit":
        return frozenset(), frozenset()
    roads = (edge for edge in net.edges.values() if not edge.internal)
    links = frozenset(edge.edge_id for edge in roads if road_classes(edge) & RAMP_LINKS)
    return (links, frozenset()) if begins else (frozenset(), links)


def _style_of(request: GenerationRequest, friction: float | None) -> DrivingStyle | None:
    """Return the driving style for the request's conditions and a friction; None means the usual style."""
    conditions = request.conditions
    if conditions is None:
        return None if friction is None else DrivingStyle(friction=friction)
    factor = 1.0 if conditions.weather is None else SPEED_FACTORS.get(conditions.weather, 1.0)
    if conditions.drivers in presets():
        return DrivingStyle(factor, presets()[conditions.drivers], friction=friction)
    known = published_calibrations()
    return DrivingStyle(factor, calibrations=tuple(known[name] for name in conditions.calibrations), friction=friction)


class _Part:
    """A reporter that passes the progress of a part on as progress of the whole."""

    def __init__(self, whole: ProgressReporter, begin: float, size: float) -> None:
        self._whole, self._begin, self._size = whole, begin, size

    def __call__(self, share: float, message: str = "") -> None:
        self._whole(self._begin + self._size * share, message)


def _mixed_seed(seed: int, index: int, attempt: int) -> int:
    """Combine three numbers into one seed, the same on every machine; prime factors keep equal sums rare."""
    return (seed * 1_000_003 + index * 7_919 + attempt * 104_729 + 17) % 2**31


def _fewer(demand: Demand, share: float, duration_s: float) -> Demand:
    """Return a demand with fewer vehicles, for a file that would otherwise have too many states.

    The factor 0.95 allows for longer drives of the remaining vehicles.

    Raises:
        NotPossible: the request sets the numbers of all vehicles.
    """
    reason = f"a recording of {duration_s:g} s has at most {MOST_STATES:,} states of vehicles"
    less = demand.fewer(0.95 * share, reason)
    if less.counts == demand.counts:
        raise _too_large(duration_s)
    return less


def _too_large(duration_s: float) -> NotPossible:
    return NotPossible(
        f"this many vehicles in {duration_s:g} s would make the file too large (more than {MOST_STATES:,} states)",
        next_step="choose a shorter duration_s, a lower density or fewer vehicles",
    )


def _absent(demand: Demand, counts: Mapping[str, int]) -> dict[str, int]:
    """Return the number of missing vehicles by class; the ego does not count."""
    here = Counter(counts)
    here[demand.ego_class] -= 1
    absent = {name: least - here[name] for name, least in demand.least.items() if here[name] < least}
    if demand.ego_class not in ("car", *demand.least) and here[demand.ego_class] < 0:
        absent[demand.ego_class] = 1
    return absent


def _is_hopeless(demand: Demand, absent: Mapping[str, int]) -> bool:
    """Return whether so many vehicles are missing that the site must be full."""
    return sum(absent.values()) > max(FEW_ABSENT, ABSENT_SHARE * sum(demand.least.values()))


def _is_not_full(demand: Demand, counts: Mapping[str, int]) -> bool:
    return not _is_hopeless(demand, _absent(demand, counts))


def _no_room(demand: Demand, absent: Mapping[str, int]) -> NotPossible:
    wanted = {name: max(demand.least.get(name, 0), absent[name]) for name in absent}
    room = {name: wanted[name] - absent[name] for name in absent}
    return NotPossible(
        f"{_listed(wanted)} requested, but only {_listed(room)} found room at this site",
        valid=[f"{name}={count}" for name, count in room.items() if count],
        next_step="request fewer, or choose another place, scenario_type or seed",
        reason=NO_ROOM if _is_hopeless(demand, absent) else "",
    )


def _listed(counts: Mapping[str, int]) -> str:
    return " and ".join(counted(count, name) for name, count in counts.items())


def without_spares(vehicles: tuple[GeneratedVehicle, ...], demand: Demand) -> tuple[GeneratedVehicle, ...]:
    """Remove the vehicles of each class beyond the wanted number, last vehicles first; the ego must come first."""
    seen: Counter[str] = Counter()
    kept: list[GeneratedVehicle] = []
    for vehicle in vehicles:
        name = vehicle.vehicle_class.name
        seen[name] += 1
        if seen[name] <= demand.counts[name]:
            kept.append(vehicle)
    return tuple(kept)


STANDS_WITHIN_M = 15.0
"""A vehicle that ends nearer to its start has waited (chosen)."""
NEARS_BY_M = 5.0
"""A vehicle approaches the middle of the site if its distance falls by more than this (chosen)."""
WATCHED_STEPS = 80
"""Steps from the start (8 s) that decide whether a vehicle reaches the site."""
WATCHED_EVERY = 10
"""Steps (1 s) between two samples of the road under a vehicle."""
ROADS_OF: dict[SiteType, frozenset[str]] = {
    "highway": FAST_ROADS,
    "ramp": FAST_ROADS | RAMP_LINKS | {"primary_link", "secondary_link"},
    "rural": RURAL_CLASSES,
}
"""OSM classes of the roads that a site of this type is about; sites at junctions are about all."""


def along_the_site(vehicles: tuple[GeneratedVehicle, ...], site: SiteNetwork) -> tuple[GeneratedVehicle, ...]:
    """Return the vehicles; those that drive through the middle of the site on its main roads come first."""
    middle = middle_of(site.site, site.net)
    lookup = LaneletLookup(site.network)

    def rank(vehicle: GeneratedVehicle) -> tuple[bool, bool, bool, float, str]:
        positions = vehicle.motion.positions
        distance = np.linalg.norm(positions[:WATCHED_STEPS] - middle, axis=1)
        stands = bool(np.linalg.norm(positions[-1] - positions[0]) < STANDS_WITHIN_M)
        nears = float(distance[0]) > float(distance.min()) + NEARS_BY_M
        nearest = round(float(distance.min()) + (0.0 if nears else 100.0), 3)  # 100 m: after those that approach
        away = not _on_road(vehicle, site, lookup)
        return away, not _takes_ramp(vehicle, site, lookup), stands, nearest, vehicle.vehicle_id

    return tuple(sorted(vehicles, key=rank))


def _on_road(vehicle: GeneratedVehicle, site: SiteNetwork, lookup: LaneletLookup) -> bool:
    """Return whether a vehicle begins on one of the site's main roads."""
    wanted = ROADS_OF.get(site.site.kind)
    if wanted is None:
        return True
    classes = _classes_under(vehicle, 0, site, lookup)
    return classes is not None and (not classes or bool(classes & wanted))


def _takes_ramp(vehicle: GeneratedVehicle, site: SiteNetwork, lookup: LaneletLookup) -> bool:
    """Return whether a vehicle soon leaves or joins the main road via a ramp's link; True at other sites."""
    if site.site.kind != "ramp":
        return True
    steps = range(0, min(len(vehicle.motion.positions), WATCHED_STEPS), WATCHED_EVERY)
    passed = [classes for step in steps if (classes := _classes_under(vehicle, step, site, lookup))]
    on_link = [bool(classes & RAMP_LINKS) for classes in passed]
    return any(on_link) and not all(on_link)


def _classes_under(
    vehicle: GeneratedVehicle, step: int, site: SiteNetwork, lookup: LaneletLookup
) -> frozenset[str] | None:
    """Return OSM classes of the road under a vehicle; empty inside a junction, None off all roads."""
    lanelet = lookup.under(vehicle.motion.positions[step], float(vehicle.motion.headings_rad[step]))
    if lanelet is None:
        return None
    return frozenset() if lanelet.internal else road_classes(site.net.edges[lanelet.edge_id])
