"""Making one scenario: map → site → net → lanelets → traffic → ego and goal → CommonRoad file → checks."""

import random
import tempfile
from dataclasses import dataclass
from pathlib import Path

from plannerforge.engine.execution.progress import ProgressReporter
from plannerforge.engine.maps.cut import cut_map
from plannerforge.engine.maps.osm_reader import read_osm
from plannerforge.engine.maps.sites import Site
from plannerforge.engine.network.hairpins import remove_hairpins
from plannerforge.engine.network.lanelet_builder import build_road_network
from plannerforge.engine.network.net_parser import SumoNet, read_net
from plannerforge.engine.network.netconvert import convert_osm
from plannerforge.engine.network.road_network import RoadNetwork
from plannerforge.engine.network.speed_cap import cap_speeds
from plannerforge.engine.scenarios.generate_report import describe
from plannerforge.engine.scenarios.planning_problem import choose_task, parse_ego, parse_goal
from plannerforge.engine.scenarios.scenario_head import benchmark_id, head_of
from plannerforge.engine.scenarios.scene_order import along_the_site
from plannerforge.engine.scenarios.site_choice import choose_site, radius_for
from plannerforge.engine.scenarios.validate import check_scenario
from plannerforge.engine.scenarios.writer import write_scenario
from plannerforge.engine.traffic.demand import Demand, TripMaker, plan_counts
from plannerforge.engine.traffic.motions import Participant, participants
from plannerforge.engine.traffic.simulation import WARM_UP_S, simulate_traffic
from plannerforge.engine.traffic.vehicle_classes import vehicle_classes
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.generation import GeneratedScenario, GenerationRequest, VehicleDemand

STEP_S = 0.1
LASTING_S = 30.0
"""Trips prefer ways that last so long; preferring longer ones would keep traffic off the main roads of a small site."""

ATTEMPTS = 4
"""Traffic is drawn anew so many times until every class asked for is there."""

LEFT_HAND_COUNTRIES = frozenset(
    {
        "GBR",
        "IRL",
        "AUS",
        "NZL",
        "JPN",
        "IND",
        "ZAF",
        "MLT",
        "CYP",
        "HKG",
        "SGP",
        "THA",
        "MYS",
        "IDN",
        "KEN",
        "PAK",
        "LKA",
        "VIR",
    }
)
"""Countries (ISO 3166-1 alpha-3) where traffic keeps to the left."""


@dataclass(frozen=True)
class _Place:
    """A site as a net and as lanelets."""

    site: Site
    radius_m: float
    net: SumoNet
    network: RoadNetwork
    warnings: tuple[str, ...]
    notes: tuple[str, ...]


def generate(request: GenerationRequest, report: ProgressReporter) -> GeneratedScenario:
    """Make one scenario in the request's folder: ``scenario.xml`` and ``scenario.net.xml``.

    The same request gives the same bytes on one type of machine.

    Raises:
        NotPossible: the map holds no such site, a class finds no road, no car has such a goal.
        UnsafeInput: the map file is broken or hostile.
    """
    ego, goal = parse_ego(request.ego), parse_goal(request.goal)
    vehicles = request.vehicles
    notes: list[str] = []
    if ego.other_class is not None:
        notes.append(f"the ego is always a car; the asked {ego.other_class} drives in the traffic")
        if all(demand.vehicle_class != ego.other_class for demand in vehicles):
            vehicles = (*vehicles, VehicleDemand(vehicle_class=ego.other_class))
    demand = plan_counts(request.density, vehicles)
    folder = Path(request.folder)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        report(0.02, "reading the map")
        place = _build_place(request, folder / "scenario.net.xml", Path(scratch), report)
        everyone, dropped = _traffic(request, demand, place, folder / "scenario.net.xml", Path(scratch), report)
    everyone = along_the_site(everyone, place.site, place.net, place.network)
    report(0.8, "choosing ego and goal")
    task = choose_task(ego, goal, everyone, place.network, STEP_S)
    others = tuple(vehicle for vehicle in everyone if vehicle is not task.ego)
    path = folder / "scenario.xml"
    head = head_of(request, place.site, place.net, STEP_S)
    write_scenario(path, head, place.network, others, task)
    report(0.9, "checking the scenario")
    checks = check_scenario(path, ego_collision_free=task.collision is None)
    if dropped:
        notes.append(f"{dropped} vehicle(s) left out because they overlapped another at step 0")
    return describe(
        request,
        benchmark_id=benchmark_id(request),
        demand=demand,
        site=place.site,
        radius_m=place.radius_m,
        network=place.network,
        task=task,
        everyone=everyone,
        checks=checks,
        step_s=STEP_S,
        notes=(*place.notes, *notes),
        warnings=place.warnings,
    )


def _build_place(request: GenerationRequest, net_path: Path, scratch: Path, report: ProgressReporter) -> _Place:
    osm = read_osm(Path(request.map_path))
    site = choose_site(osm, request)
    radius = radius_for(site, request)
    cut = scratch / "site.osm"
    cut_map(osm, (site.latitude, site.longitude), radius, request.road_classes, cut)
    report(0.1, "building the road network")
    lefthand = request.country in LEFT_HAND_COUNTRIES
    notes: list[str] = []
    conversion = convert_osm(cut, net_path, lefthand=lefthand, drivable_service_roads=False)
    if not read_net(net_path).drivable_edges("passenger"):
        conversion = convert_osm(cut, net_path, lefthand=lefthand, drivable_service_roads=True)
        notes.append("only service roads lie here; they were opened to all vehicles")
        if not read_net(net_path).drivable_edges("passenger"):
            raise NotPossible(
                "no road at this site is open to cars", next_step="choose other road_classes or another place"
            )
    removed = remove_hairpins(net_path, scratch)
    if removed:
        notes.append(f"{removed} turn(s) too tight to be drawn as a lanelet were taken out of the net")
    cap_speeds(net_path)
    net = read_net(net_path)
    network = build_road_network(net, step_s=STEP_S, elapsed_s=WARM_UP_S)
    return _Place(site, radius, net, network, conversion.warnings, tuple(notes))


def _traffic(
    request: GenerationRequest, demand: Demand, place: _Place, net_path: Path, scratch: Path, report: ProgressReporter
) -> tuple[tuple[Participant, ...], int]:
    """Traffic that holds what was asked; of several attempts the first that does, otherwise the best one."""
    best: tuple[int, tuple[Participant, ...], int] | None = None
    for attempt in range(ATTEMPTS):
        seed = hash_seed(request.seed, request.index, attempt)
        trips = TripMaker(place.net, min(WARM_UP_S + request.duration_s, LASTING_S), random.Random(seed))  # noqa: S311 - reproducible
        for name in sorted(demand.counts):
            trips.check_open(vehicle_classes()[name])
        traffic = simulate_traffic(
            net_path,
            demand,
            trips,
            duration_s=request.duration_s,
            step_s=STEP_S,
            seed=seed,
            scratch=scratch,
            report=lambda share, message, attempt=attempt: report(  # type: ignore[misc]
                0.2 + 0.6 * (attempt + share) / ATTEMPTS, message
            ),
        )
        everyone, dropped = participants(traffic)
        missing = _missing(demand, everyone)
        if best is None or missing < best[0]:
            best = (missing, everyone, dropped)
        if missing == 0:
            break
    assert best is not None  # noqa: S101 - at least one attempt was made
    return best[1], best[2]


def hash_seed(seed: int, index: int, attempt: int) -> int:
    """One seed out of three numbers, the same on every machine."""
    return (seed * 1_000_003 + index * 7_919 + attempt * 104_729 + 17) % 2**31


def _missing(demand: Demand, everyone: tuple[Participant, ...]) -> int:
    """How many vehicles of classes that were asked for are not there; one car is the ego and does not count."""
    total = 0
    for name, least in demand.least.items():
        here = sum(vehicle.vehicle_class.name == name for vehicle in everyone) - (name == "car")
        total += max(0, least - here) + max(0, here - demand.most.get(name, here))
    return total
