"""Builds a site from a map: its SUMO net, its lanelets, and the findings of the road rules.

A site's network is checked before its traffic is generated, so an unsuitable site costs little time.
"""

import math
import unicodedata
import weakref
from collections.abc import Hashable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from lxml import etree

from ...schemas.errors import NotPossible
from ...schemas.generation import GenerationRequest, SiteType
from ...schemas.scenarios import RuleFinding
from ...schemas.text import cited, cited_all, counted
from ..commonroad import road_document, speed_limit_number
from ..execution import ProgressReporter
from ..maps import (
    LaneletMap,
    NetMap,
    OsmMap,
    Pavements,
    RoadFile,
    RoadReader,
    Site,
    country_at,
    country_name,
    cut_lanelets,
    cut_map,
    cut_net,
    find_pavements,
    jurisdiction_of,
    read_lanelet_map,
    site_finder,
)
from ..network import (
    RoadNetwork,
    SumoNet,
    TrafficLight,
    add_connections,
    build_road_network,
    cap_speeds,
    check_network,
    convert_osm,
    lights_begin_at,
    read_net,
    remove_edges,
    remove_hairpins,
    stated_frictions,
    summarise_findings,
)
from ..traffic import VEHICLES_PER_LANE_KM, WARM_UP_S, lane_km_of, sumo_version
from .people import Footways, footways_of, nowhere_to_walk, open_footways, with_walkways
from .sites import SiteFocus, classes_for, drawn_ring, lines_of_streets, middle_of, radius_for, why_not_realised
from .writer import STEP_S, ScenarioMetadata, copy_network, write_network

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

_LEFT = """
AIA ATG AUS BGD BHS BMU BRB BRN BTN BWA CCK COK CXR CYM CYP DMA FJI FLK GBR GGY GRD GUY HKG IDN IMN IND IRL JAM JEY
JPN KEN KIR KNA LCA LKA LSO MAC MDV MLT MOZ MSR MUS MWI MYS NAM NFK NIU NPL NRU NZL PAK PCN PNG SGP SHN SLB SUR SWZ
SYC TCA THA TKL TLS TON TTO TUV TZA UGA VCT VGB VIR WSM ZAF ZMB ZWE
"""
LEFT_HAND_COUNTRIES = frozenset(_LEFT.split())
"""Countries (ISO 3166-1 alpha-3) with left-hand traffic."""
UNKNOWN_SIDE = "the country of the map is unknown, so traffic keeps right; for left-hand traffic, set the country"
MANY_HAIRPINS = 10
"""More undrawable turns than this mean that netconvert merged several junctions into one huge one (chosen)."""
MOST_CROWDED = 1.2
"""More vehicles per lane kilometre than this multiple of high density rarely find room to move (chosen)."""
MOST_WIDENED = 2.5
"""Maximum factor by which a site's cut is widened (chosen)."""
WHOLE_LANE_KM = 15.0
"""A lanelet network with at most this length of lanes is taken whole, regardless of the site (chosen)."""
NOT_LOCATED = "the road network does not state its location on earth; its degrees are invented, near 0°, 0°"
_NO_COUNTRY = "ZAM"
"""Zamunda: CommonRoad's country for places that are not in any country."""
_TAGS: dict[SiteType, tuple[str, ...]] = {
    "highway": ("highway", "multi_lane"),
    "ramp": ("highway", "slip_road", "merging_lanes"),
    "rural": ("rural",),
    "urban": ("urban",),
    "intersection": ("urban", "intersection"),
    "signalised_intersection": ("urban", "intersection"),
    "roundabout": ("urban", "roundabout"),
}
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss"})
SITE_LOST = "site_lost"
"""Reason for refusing a site with a type that the net does not show."""


@dataclass(frozen=True)
class SiteNetwork:
    """A site as a SUMO net (in the file at ``net_path``) and as lanelets, ready for traffic.

    ``notes`` are for the answer, ``warnings`` are netconvert's, and ``findings`` are those of the road rules. ``roads``
    is the content that a filled lanelet network takes over from its file. ``footways`` is None if no pedestrians are
    requested. ``streets``: the lines of the requested streets, if any.
    """

    site: Site
    radius_m: float
    net_path: Path
    net: SumoNet
    network: RoadNetwork
    metadata: ScenarioMetadata
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    findings: tuple[RuleFinding, ...] = ()
    roads: RoadFile | None = None
    footways: Footways | None = None
    streets: "BaseGeometry | None" = None

    @cached_property
    def focus(self) -> SiteFocus:
        """The areas that the site consists of."""
        return SiteFocus(self.site, self.net, self.network, self.streets)


def prepare_site(
    request: GenerationRequest, osm: OsmMap, site: Site, folder: Path, report: ProgressReporter
) -> SiteNetwork:
    """Build and check a site's network in a folder; widen the cut if the counted vehicles need more road.

    Raises:
        NotPossible: the network does not have the features of the site's type, breaks a rule, or has no road open to
            cars.
    """
    here = country_at(osm, site.position, request.country)
    prepared = _prepared(request.model_copy(update={"country": here}), osm, site, folder, report)
    if here is not None and request.country not in (None, here):
        note = f"the site is across the border, in {country_name(here)}: the laws of that country apply"
        prepared = replace(prepared, notes=(note, *prepared.notes))
    return replace(prepared, streets=lines_of_streets(osm, request.streets, prepared.net))


def _prepared(
    request: GenerationRequest, osm: OsmMap, site: Site, folder: Path, report: ProgressReporter
) -> SiteNetwork:
    usual_m = radius_for(site, request)
    usual = _known_sites().get(request, osm, site, usual_m, folder, report)
    built = usual.built(request, folder)
    requested = 1 + sum(demand.needed for demand in request.on_wheels)
    share = requested / max(VEHICLES_PER_LANE_KM["high"] * lane_km_of(built.net), 1.0)
    if share <= MOST_CROWDED or isinstance(osm, LaneletMap):
        return usual.judged(request, folder, report)
    wider_m, wider = usual_m * min(math.sqrt(share), MOST_WIDENED), folder / "wider"
    wider.mkdir()
    try:
        roomy = _known_sites().get(request, osm, site, wider_m, wider, report).judged(request, wider, report)
    except NotPossible as refusal:
        note = f"a wider cut for so many vehicles failed: {refusal.message}"
        narrow = usual.judged(request, folder, report)
        return replace(narrow, notes=(*narrow.notes, note))
    note = f"cut out {wider_m:.0f} m around the site, not {usual_m:.0f} m, to make room for {requested} vehicles"
    return replace(roomy, notes=(*roomy.notes, note))


MOST_KNOWN = 24
"""Networks that a worker keeps, some MB each (chosen): few maps have more sites of a type."""


class _KnownSites:
    """The networks of recently used sites of one map, and the refusals of sites without a network.

    Scenarios of a plan reuse sites with other traffic, and building a network takes as long as generating traffic.
    Stored networks never change; their file is written again for each scenario.
    """

    def __init__(self) -> None:
        self._map: weakref.ref[OsmMap] | None = None
        self._kept: dict[Hashable, _KnownSite] = {}

    def get(
        self,
        request: GenerationRequest,
        osm: OsmMap,
        site: Site,
        radius_m: float,
        folder: Path,
        report: ProgressReporter,
    ) -> "_KnownSite":
        """Return the stored result for a site and a radius; build the site in the folder if there is none."""
        if self._map is None or self._map() is not osm:
            self._map = weakref.ref(osm)
            self._kept.clear()
        on_foot = request.people is not None
        friction = None if request.conditions is None else request.conditions.friction
        key = site, radius_m, classes_for(site, request), request.country, on_foot, friction
        known = self._kept.pop(key, None) or _KnownSite.of(request, osm, site, radius_m, folder, report)
        self._kept[key] = known
        if len(self._kept) > MOST_KNOWN:
            del self._kept[next(iter(self._kept))]
        return known

    def forget(self) -> None:
        """Discard all networks, so that each is built again, as in a new worker."""
        self._kept.clear()


@cache
def _known_sites() -> _KnownSites:
    """Return this process's store of sites; a worker does one thing at a time."""
    return _KnownSites()


def forget_sites() -> None:
    """Discard the networks of all sites, so that each is built again."""
    _known_sites().forget()


class _KnownSite:
    """A site's network with the text of its file, or the refusal; after the first check also its verdict."""

    def __init__(self, built: SiteNetwork | NotPossible, net: bytes) -> None:
        self._built, self._net = built, net
        self._judged: SiteNetwork | NotPossible | None = None

    @classmethod
    def of(
        cls,
        request: GenerationRequest,
        osm: OsmMap,
        site: Site,
        radius_m: float,
        folder: Path,
        report: ProgressReporter,
    ) -> "_KnownSite":
        """Build a site in the folder."""
        try:
            built = build_network(request, osm, site, radius_m, folder, report)
            if is_lit := _lacks_lights(built, osm):
                osm = _with_signal_at_junction(osm, site)
                built = build_network(request, osm, site, radius_m, folder, report)
            if built.network.folded_edges and summarise_findings(_network_findings(built), "error"):
                built = build_network(request, osm, site, radius_m, folder, report, folded=built.network.folded_edges)
            built = _note_added_lights(built) if is_lit else built
        except NotPossible as refusal:
            return cls(_without_traceback(refusal), b"")
        return cls(built, built.net_path.read_bytes())

    def built(self, request: GenerationRequest, folder: Path) -> SiteNetwork:
        """Return the network for a request, and write its file into a folder.

        Raises:
            NotPossible: as ``build_network``.
        """
        return self._for(self._built, request, folder)

    def judged(self, request: GenerationRequest, folder: Path, report: ProgressReporter) -> SiteNetwork:
        """Return the network for a request with the rules' findings, and write its file into a folder.

        Raises:
            NotPossible: as ``build_network`` and ``judged``.
        """
        if self._judged is None:
            try:
                self._judged = judged(self.built(request, folder), report)
            except NotPossible as refusal:
                self._judged = _without_traceback(refusal)
        return self._for(self._judged, request, folder)

    def _for(self, known: SiteNetwork | NotPossible, request: GenerationRequest, folder: Path) -> SiteNetwork:
        if isinstance(known, NotPossible):
            raise _without_traceback(known)
        net_path = folder / "scenario.net.xml"
        net_path.write_bytes(self._net)
        stated = known.metadata
        metadata = replace(_metadata_of(request, known.site, known.net), tags=stated.tags, friction=stated.friction)
        return replace(known, net_path=net_path, metadata=metadata)


def _lacks_lights(built: SiteNetwork, osm: OsmMap) -> bool:
    """Return whether netconvert created no lights at a junction that has signals on the map.

    It creates lights only if all roads to a junction have a signal. Some roads have it on a link road or a crossing
    outside the cut.
    """
    is_map_of_lines = not isinstance(osm, (LaneletMap, NetMap))
    is_wanted = built.site.kind == "signalised_intersection" and built.site.mark in osm.nodes
    return is_map_of_lines and is_wanted and why_not_realised(built.site, built.net) is not None


def _with_signal_at_junction(osm: OsmMap, site: Site) -> OsmMap:
    """Return the map with a signal at each junction of the site; netconvert then creates lights for all its roads."""
    at_junctions = {part.mark: osm.nodes[part.mark] for part in site.parts}
    lit = {key: replace(node, tags={**node.tags, "highway": "traffic_signals"}) for key, node in at_junctions.items()}
    return replace(osm, nodes={**osm.nodes, **lit})


def _note_added_lights(built: SiteNetwork) -> SiteNetwork:
    note = "the map has signals on some of the junction's roads; lights were created for all of them"
    return replace(built, notes=(*built.notes, note))


def with_later_lights(site: SiteNetwork, later_s: float, folder: Path) -> SiteNetwork:
    """Return the site with its lights ``later_s`` seconds earlier in their cycles; write its net into a folder.

    A site without lights stays as it is. Use this function only for nets from OpenStreetMap. That map has no programs
    for lights, so netconvert invents the programs and their start.
    """
    if not site.network.lights or not later_s:
        return site
    net_path = folder / "scenario.net.xml"
    root = etree.fromstring(site.net_path.read_bytes())
    for program in root.iterfind("tlLogic"):
        program.set("offset", f"{float(program.get('offset', '0')) + later_s:g}")
    net_path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True))
    lights = tuple(_later(light, round(later_s / STEP_S)) for light in site.network.lights)
    note = f"the lights begin {later_s:g} s earlier in their cycles, so that the ego passes in time"
    network = replace(site.network, lights=lights)
    return replace(site, net_path=net_path, net=read_net(net_path), network=network, notes=(*site.notes, note))


def _later(light: TrafficLight, steps: int) -> TrafficLight:
    return replace(light, offset_steps=(light.offset_steps + steps) % sum(count for count, _ in light.cycle))


def _passing_note(site: Site, request: GenerationRequest) -> str:
    """Return the note on a site that the requested streets only pass: none of its junctions is on these streets."""
    kind = site.kind.replace("_", " ")
    if len(request.streets) > 1:
        streets = cited_all((names[0] for names in request.streets), " and ")
        return f"{streets} do not meet here, but both pass this {kind}"
    return f"no {kind} is on {cited(request.streets[0][0])} itself; this one is nearby"


def _without_traceback(refusal: NotPossible) -> NotPossible:
    """Return the same refusal without its traceback, which would keep all objects that existed when it was raised."""
    return NotPossible(refusal.message, valid=refusal.valid, next_step=refusal.next_step, reason=refusal.reason)


def judged(built: SiteNetwork, report: ProgressReporter) -> SiteNetwork:
    """Return a network with the findings of the rules.

    Raises:
        NotPossible: it does not have the features of the site's type, or breaks a rule.
    """
    site = built.site
    is_a_road = built.roads is not None and site.kind in ("highway", "rural", "urban")  # of a network taken as it is
    if not is_a_road and (reason := why_not_realised(site, built.net)) is not None:
        raise NotPossible(reason, next_step="choose another scenario_type, or another place", reason=SITE_LOST)
    report(0.25, "checking the network")
    findings = _network_findings(built)
    if built.roads is not None:
        return _report_file_errors(built, findings)
    errors = list(summarise_findings(findings, "error"))
    if lost := built.network.lost_connections:
        errors.append(f"{counted(len(lost), 'connection')} of the net lost, first: {lost[0][0]} to {lost[0][1]}")
    if errors:
        where = f"{site.latitude:.5f}, {site.longitude:.5f}"
        raise NotPossible(
            f"the road network at {where} is wrong: {'; '.join(errors)}",
            next_step="choose another place, scenario_type or seed",
        )
    return replace(built, findings=findings)


def _report_file_errors(built: SiteNetwork, findings: tuple[RuleFinding, ...]) -> SiteNetwork:
    """Return a filled network with the rules' findings; errors in the file itself are reported but not mended."""
    errors = summarise_findings(findings, "error")
    notes = [f"errors of the given road network remain: {'; '.join(errors)}"] if errors else []
    milder = tuple(finding.model_copy(update={"severity": "warning"}) for finding in findings)
    return replace(built, findings=milder, notes=(*built.notes, *notes))


def build_network(
    request: GenerationRequest,
    osm: OsmMap,
    site: Site,
    radius_m: float,
    folder: Path,
    report: ProgressReporter,
    folded: tuple[str, ...] = (),
) -> SiteNetwork:
    """Cut a site out of the map and build its net and its lanelets, without checking them.

    ``folded``: edges of an OpenStreetMap extract's net to leave out, because no lanelet can follow them.

    Raises:
        NotPossible: no road at the site is open to cars.
    """
    on_foot = request.people is not None
    if isinstance(osm, LaneletMap):
        if on_foot:
            raise _no_pavements_in_lanelets()
        return _fill_lanelets(request, osm, site, radius_m, folder, report)
    net_path = folder / "scenario.net.xml"
    lefthand = request.country in LEFT_HAND_COUNTRIES
    classes = classes_for(site, request)
    cut = folder / "site.osm"
    notes: list[str] = []
    pavements: Pavements | None = None
    report(0.05, "cutting out the site")
    if isinstance(osm, NetMap):
        warnings = cut_net(osm, site.position, radius_m, classes, net_path, folder, pavements=on_foot)
        if not _is_drivable(net_path):
            raise _closed_to_cars()
        report(0.15, "building the lanelets")
        later, notes, network = _without_hairpins(_lanelets(read_net(net_path)), net_path, folder)
        warnings += later
    else:
        if on_foot:
            pavements = find_pavements(osm, osm.roads(frozenset(classes)), site.position, radius_m, lefthand=lefthand)
            if not pavements.mapped_km + pavements.guessed_km:
                raise nowhere_to_walk()
        reader = RoadReader(
            site_finder(osm).built_up, jurisdiction_of(request.country, site.position), lefthand=lefthand
        )
        cut_map(osm, site.position, radius_m, classes, cut, pavements, reader)
        warnings, notes, hairpins, network = _convert_site(
            site, cut, net_path, lefthand=lefthand, on_foot=on_foot, folded=folded, report=report
        )
        notes += [*reader.notes(), *hairpins]
    if site.only_passed:
        notes.insert(0, _passing_note(site, request))
    if request.country is None and not isinstance(osm, NetMap):  # a network itself states its driving side
        notes.append(UNKNOWN_SIDE)
    if on_foot:
        open_footways(net_path)
    friction = _friction_of(request, stated_frictions(net_path) if isinstance(osm, NetMap) else frozenset())
    cap_speeds(net_path, friction)
    net = read_net(net_path)
    metadata = replace(_metadata_of(request, site, net), friction=friction)
    footways = footways_of(net_path, net, pavements) if on_foot else None
    if footways is not None:
        network = with_walkways(network, footways)
        notes = [*footways.notes, *notes]
    notes += _friction_notes(request, friction)
    return SiteNetwork(site, radius_m, net_path, net, network, metadata, warnings, tuple(notes), footways=footways)


def _friction_of(request: GenerationRequest, stated: frozenset[float | None]) -> float | None:
    """Return the friction of the roads in the requested weather, else the value that the map states for all roads."""
    requested = None if request.conditions is None else request.conditions.friction
    return next(iter(stated)) if requested is None and len(stated) == 1 else requested


def _friction_notes(request: GenerationRequest, friction: float | None) -> tuple[str, ...]:
    """Return a note on the roads' friction if the map states it; friction from the weather has its own note."""
    if friction is None or (request.conditions is not None and request.conditions.friction is not None):
        return ()
    return (f"the map states a friction of {friction:g} for its roads, and the scenario keeps it",)


def _metadata_of(request: GenerationRequest, site: Site, net: SumoNet) -> ScenarioMetadata:
    """Return the metadata of a scenario; its benchmark id is COUNTRY_Place-number_index_T-1, as in format 2020a."""
    country = request.country or _NO_COUNTRY
    return ScenarioMetadata(
        benchmark_id=f"{country}_{plain_name(request.place)}-{request.benchmark_number}_{request.index + 1}_T-1",
        affiliation=f"PlannerForge; map data: {request.attribution}",
        source=f"PlannerForge MCP, SUMO {sumo_version()}",
        latitude=site.latitude,
        longitude=site.longitude,
        projection=net.projection,
        offset_m=net.offset_m,
        tags=("simulated", *_TAGS[site.kind]),
        speed_sign=speed_limit_number(country),
        conditions=request.conditions,
    )


def plain_name(place: str) -> str:
    """Return a place's name in ASCII letters and digits, each word capitalised; ``Site`` if it has no letters."""
    spelled = unicodedata.normalize("NFKD", place.translate(_UMLAUTS))
    letters = spelled.encode("ascii", "ignore").decode()
    if not any(letter.isalpha() for letter in letters):
        from anyascii import anyascii

        letters = anyascii(spelled)  # transliterate a name in another script
    words = "".join(letter if letter.isalnum() else " " for letter in letters).split()
    return "".join(word[0].upper() + word[1:] for word in words)[:40] or "Site"


def _no_pavements_in_lanelets() -> NotPossible:
    return NotPossible(
        "the lanelet network of this map is used unchanged, without added pavements",
        next_step="leave pedestrian out of vehicles, or use an OpenStreetMap extract or a SUMO network as the map",
    )


def _fill_lanelets(
    request: GenerationRequest,
    lanelets: LaneletMap,
    site: Site,
    radius_m: float,
    folder: Path,
    report: ProgressReporter,
) -> SiteNetwork:
    """Return a lanelet network unchanged, or the part of a large one around the site.

    Raises:
        NotPossible: no lanelet at the site is open to cars.
    """
    report(0.05, "building a net over the lanelets")
    net_path, cut = folder / "scenario.net.xml", folder / "roads.xml"
    net_path.write_bytes(lanelets.net)
    middle = middle_of(site, read_net(net_path))
    if lane_km_of(read_net(net_path)) > WHOLE_LANE_KM and cut_lanelets(
        lanelets, (float(middle[0]), float(middle[1])), radius_m, cut
    ):
        lanelets = replace(read_lanelet_map(cut), is_located=lanelets.is_located)
    net_path.write_bytes(lights_begin_at(lanelets.net, WARM_UP_S))
    if not _is_drivable(net_path) or lanelets.network is None:
        raise _closed_to_cars()
    roads = RoadFile.read(lanelets.path)
    friction = _friction_of(request, frozenset({roads.friction}))
    cap_speeds(net_path, friction)
    net, network = read_net(net_path), lanelets.network
    metadata = replace(_metadata_of(request, site, net), tags=("simulated", *roads.tags), friction=friction)
    points = np.concatenate([lanelet.polygon for lanelet in network.lanelets.values()])
    reach_m = float(np.linalg.norm(points - middle_of(site, net), axis=1).max())
    notes = () if lanelets.is_located else (NOT_LOCATED,)
    notes = (*notes, *_friction_notes(request, friction))
    return SiteNetwork(site, reach_m, net_path, net, network, metadata, (), notes, roads=roads)


def _convert_site(
    site: Site,
    cut: Path,
    net_path: Path,
    *,
    lefthand: bool,
    on_foot: bool,
    folded: tuple[str, ...],
    report: ProgressReporter,
) -> tuple[tuple[str, ...], list[str], list[str], RoadNetwork]:
    """Convert a cut; nearby junctions stay apart if joining them would lose the site.

    If turns that are too tight belong to the site, as on a small ring, the corners of junctions are drawn tighter. A
    ring with two junctions is closed again: netconvert mistakes its second half for a way back.

    Returns:
        netconvert's warnings, notes on changes, notes on removed turns, and the lanelets.

    Raises:
        NotPossible: no road at the site is open to cars.
    """
    report(0.1, "running netconvert")
    warnings, notes = convert_map(cut, net_path, lefthand=lefthand, pavements=on_foot)
    warnings += _close_ring(site, net_path, cut.parent)
    net = read_net(net_path)
    lost = why_not_realised(site, net) is not None
    report(0.15, "building the lanelets")
    network = _lanelets(net)
    service, joined = bool(notes), True
    if lost or len(network.dropped_lanes) > MANY_HAIRPINS:
        joined = False
        warnings = convert_osm(
            cut, net_path, lefthand=lefthand, drivable_service_roads=service, join_junctions=False, pavements=on_foot
        )
        why = "the site was lost in one of them" if lost else "one of them became too large to be drawn"
        warnings += _close_ring(site, net_path, cut.parent)
        notes.append(f"junctions close together were not joined, because {why}")
        net = read_net(net_path)
        network = _lanelets(net)
    was_shown = bool(network.dropped_lanes) and why_not_realised(site, net) is None
    later, hairpins, network = _without_hairpins(network, net_path, cut.parent)
    if was_shown and why_not_realised(site, read_net(net_path)) is not None:
        warnings = convert_osm(
            cut,
            net_path,
            lefthand=lefthand,
            drivable_service_roads=service,
            join_junctions=joined,
            tight_corners=True,
            pavements=on_foot,
        )
        warnings += _close_ring(site, net_path, cut.parent)
        notes.append(
            "corners of junctions were drawn tighter, because the site was lost with turns that were too tight"
        )
        later, hairpins, network = _without_hairpins(_lanelets(read_net(net_path)), net_path, cut.parent)
    if folded:
        later += remove_edges(net_path, folded, cut.parent)
        again, more, network = _without_hairpins(_lanelets(read_net(net_path)), net_path, cut.parent)
        later, hairpins = (*later, *again), [*hairpins, *more]
        notes.append(f"{counted(len(folded), 'road')} left out because no lanelet can follow them: {_ways_of(folded)}")
    return (*warnings, *later), notes, hairpins, network


def _close_ring(site: Site, net_path: Path, scratch: Path) -> tuple[str, ...]:
    """Connect the edges of a ring if one does not lead to the next, in place; return netconvert's warnings."""
    if site.kind != "roundabout":
        return ()
    net = read_net(net_path)
    ring = drawn_ring(site, net)
    met = {(turn.from_edge, turn.to_edge) for turn in net.connections}
    open_ends = [pair for pair in pairwise((*ring, *ring[:1])) if pair not in met]
    return add_connections(net_path, open_ends, scratch) if open_ends else ()


_SHOWN_WAYS = 3
"""Maximum number of ways that a note lists (chosen)."""


def _ways_of(edges: tuple[str, ...]) -> str:
    """Return text with the ids of the OSM ways that edges come from: the first few, and the number of the rest."""
    ways = list(dict.fromkeys(edge.lstrip("-").partition("#")[0] for edge in edges))
    more = [f"{len(ways) - _SHOWN_WAYS} more"] if len(ways) > _SHOWN_WAYS else []
    return ", ".join([*(f"way {way}" for way in ways[:_SHOWN_WAYS]), *more])


def _without_hairpins(
    network: RoadNetwork, net_path: Path, folder: Path
) -> tuple[tuple[str, ...], list[str], RoadNetwork]:
    """Remove turns that no lanelet can follow from a net, in place; return netconvert's warnings, a note, and lanelets.

    ``network``: the lanelets of the unchanged net.
    """
    if not network.dropped_lanes:
        return (), [], network
    removed, warnings = remove_hairpins(net_path, folder)
    note = f"{counted(removed, 'turn')} too tight for a lanelet removed from the network"
    return warnings, [note], _lanelets(read_net(net_path))


def convert_map(
    cut: Path, net_path: Path, *, lefthand: bool, pavements: bool = False
) -> tuple[tuple[str, ...], list[str]]:
    """Convert a map with the mildest settings that give a net on which cars can drive.

    Returns:
        netconvert's warnings, and notes on changes.

    Raises:
        NotPossible: no setting gives a road that is open to cars.
    """
    warnings = convert_osm(cut, net_path, lefthand=lefthand, pavements=pavements)
    if _is_drivable(net_path):
        return warnings, []
    warnings = convert_osm(cut, net_path, lefthand=lefthand, drivable_service_roads=True, pavements=pavements)
    if not _is_drivable(net_path):
        raise _closed_to_cars()
    return warnings, ["this place has only service roads; they were opened to all vehicles"]


def _is_drivable(net_path: Path) -> bool:
    return bool(read_net(net_path).drivable_edges("passenger"))


def _closed_to_cars() -> NotPossible:
    return NotPossible("no road here is open to cars", next_step="choose other road_classes or another place")


def _lanelets(net: SumoNet) -> RoadNetwork:
    """Return the lanelets of a net with the posted limits; speeds are capped for curves only afterwards."""
    return build_road_network(net, step_s=STEP_S, elapsed_s=WARM_UP_S)


def _network_findings(built: SiteNetwork) -> tuple[RuleFinding, ...]:
    """Return the rules' findings on a network in the form that the file will have."""
    root = etree.Element("commonRoad", {"benchmarkID": built.metadata.benchmark_id})
    if built.roads is not None:
        copy_network(root, built.roads)
    else:
        write_network(root, built.network, built.metadata.speed_sign)
    return check_network(road_document(root))
