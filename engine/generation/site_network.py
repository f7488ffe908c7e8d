"""From a map to a place where traffic can drive: site, SUMO net and lanelets."""

from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from ...schemas.errors import NotPossible
from ...schemas.generation import GenerationRequest
from ...schemas.network_rules import RuleFinding
from ..commonroad import road_document
from ..execution import ProgressReporter
from ..maps import NetMap, OsmMap, Site, cut_map, cut_net
from ..network import (
    Conversion,
    RoadNetwork,
    SumoNet,
    build_road_network,
    cap_speeds,
    check_network,
    convert_osm,
    read_net,
    remove_hairpins,
    told,
)
from ..traffic import WARM_UP_S
from .metadata import head_of
from .sites import classes_for, radius_for, why_not_realised
from .writer import ScenarioHead, write_network

# ---------- generate_place
# From a map to a place where traffic can drive: site, SUMO net and lanelets.

_LEFT = """
AIA ATG AUS BGD BHS BMU BRB BRN BTN BWA CCK COK CXR CYM CYP DMA FJI FLK GBR GGY GRD GUY HKG IDN IMN IND IRL JAM JEY
JPN KEN KIR KNA LCA LKA LSO MAC MDV MLT MOZ MSR MUS MWI MYS NAM NFK NIU NPL NRU NZL PAK PCN PNG SGP SHN SLB SUR SWZ
SYC TCA THA TKL TLS TON TTO TUV TZA UGA VCT VGB VIR WSM ZAF ZMB ZWE
"""
LEFT_HAND_COUNTRIES = frozenset(_LEFT.split())
"""Countries (ISO 3166-1 alpha-3) where traffic keeps to the left."""
UNKNOWN_SIDE = "the country of the map is unknown, so traffic keeps to the right; where it does not, name the country"
MANY_HAIRPINS = 10
"""So many turns that cannot be drawn mean that netconvert made one huge junction of several."""


@dataclass(frozen=True)
class Place:
    """A site as a SUMO net and as lanelets; ``notes`` are for the answer, ``warnings`` are netconvert's."""

    site: Site
    radius_m: float
    net: SumoNet
    network: RoadNetwork
    warnings: tuple[str, ...]
    notes: tuple[str, ...]


def build_place(
    osm: OsmMap,
    site: Site,
    request: GenerationRequest,
    net_path: Path,
    scratch: Path,
    step_s: float,
    report: ProgressReporter,
) -> Place:
    """Cut a site out of the map and build its net (written to ``net_path``) and its lanelets.

    Raises:
        NotPossible: no road there is open to cars.
    """
    radius = radius_for(site, request)
    center, classes = (site.latitude, site.longitude), classes_for(site, request)
    cut = scratch / "site.osm"
    notes: list[str] = []
    report(0.05, "cutting out the site")
    if isinstance(osm, NetMap):
        conversion = _checked(cut_net(osm, center, radius, classes, net_path, scratch))
    else:
        cut_map(osm, center, radius, classes, cut)
        report(0.1, "running netconvert")
        conversion, notes = convert_map(cut, net_path, lefthand=request.country in LEFT_HAND_COUNTRIES)
    report(0.15, "building the lanelets")
    network = _network(net_path, step_s)
    if len(network.dropped_lanes) > MANY_HAIRPINS and not isinstance(osm, NetMap):
        service = bool(notes)
        lefthand = request.country in LEFT_HAND_COUNTRIES
        conversion = convert_osm(cut, net_path, lefthand=lefthand, drivable_service_roads=service, join_junctions=False)
        notes.append("junctions close together were not joined, because one of them became too large to be drawn")
        network = _network(net_path, step_s)
    warnings = conversion.warnings
    if network.dropped_lanes:
        removed, later = remove_hairpins(net_path, scratch)
        warnings += later
        notes.append(f"{removed} turn(s) too tight to be drawn as a lanelet were taken out of the net")
        network = _network(net_path, step_s)
    if request.country is None and not isinstance(osm, NetMap):  # a network says itself on which side it drives
        notes.append(UNKNOWN_SIDE)
    cap_speeds(net_path)
    return Place(site, radius, read_net(net_path), network, warnings, tuple(notes))


def _network(net_path: Path, step_s: float) -> RoadNetwork:
    """The lanelets of a net, with the limits as posted: speeds are capped for bends afterwards."""
    return build_road_network(read_net(net_path), step_s=step_s, elapsed_s=WARM_UP_S)


def _checked(conversion: Conversion) -> Conversion:
    """A network that the user made, if cars can drive on it."""
    if not read_net(conversion.net_path).drivable_edges("passenger"):
        raise NotPossible("no road here is open to cars", next_step="choose other road_classes or another place")
    return conversion


def convert_map(cut: Path, net_path: Path, *, lefthand: bool) -> tuple[Conversion, list[str]]:
    """The net with the mildest settings that give one on which cars can drive, and notes on what had to be changed."""
    conversion = convert_osm(cut, net_path, lefthand=lefthand)
    if read_net(net_path).drivable_edges("passenger"):
        return conversion, []
    conversion = convert_osm(cut, net_path, lefthand=lefthand, drivable_service_roads=True)
    if not read_net(net_path).drivable_edges("passenger"):
        raise NotPossible("no road here is open to cars", next_step="choose other road_classes or another place")
    return conversion, ["only service roads lie here; they were opened to all vehicles"]


# ---------- generate_ground
# The ground of a scenario: a place that shows what was asked for, with a road network that passes the rules.
#
# Judged before traffic is made for it, so that a site that is not fit costs little.

ANOTHER_TYPE = "choose another scenario_type, or another place"
"""What to do about a site that is lost: the types that the map holds besides are looked for only where all are."""


@dataclass(frozen=True)
class Ground:
    """A place with its net file, the head of scenarios there, and what the rules remark on its network."""

    place: Place
    net_path: Path
    head: ScenarioHead
    findings: tuple[RuleFinding, ...]


def prepare_ground(
    request: GenerationRequest, osm: OsmMap, site: Site, folder: Path, step_s: float, report: ProgressReporter
) -> Ground:
    """Build a site's network and judge it.

    Raises:
        NotPossible: the network does not show the site's type, breaks a rule, or no road there is open to cars.
    """
    net_path = folder / "scenario.net.xml"
    place = build_place(osm, site, request, net_path, folder, step_s, report)
    if (reason := why_not_realised(site, place.net)) is not None:
        raise NotPossible(reason, next_step=ANOTHER_TYPE)
    report(0.25, "checking the network")
    head = head_of(request, site, place.net, step_s)
    findings = _network_findings(place.network, head)
    if errors := told(findings, "error"):
        where = f"{site.latitude:.5f}, {site.longitude:.5f}"
        raise NotPossible(
            f"the road network at {where} is wrong: {'; '.join(errors)}",
            next_step="choose another place, scenario_type or seed",
        )
    return Ground(place, net_path, head, findings)


def _network_findings(network: RoadNetwork, head: ScenarioHead) -> tuple[RuleFinding, ...]:
    """What the rules find in a network as it will stand in the file."""
    root = etree.Element("commonRoad", {"benchmarkID": head.benchmark_id})
    write_network(root, network, head.speed_sign)
    return check_network(road_document(root))
