"""The ground of a scenario: a place that shows what was asked for, with a road network that passes the rules.

Judged before traffic is made for it, so that a site that is not fit costs little.
"""

from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from plannerforge.engine.execution.progress import ProgressReporter
from plannerforge.engine.maps.osm_reader import OsmMap
from plannerforge.engine.maps.sites import Site
from plannerforge.engine.network.road_document_reader import road_document
from plannerforge.engine.network.road_network import RoadNetwork
from plannerforge.engine.network.rules.check import check_network, told
from plannerforge.engine.scenarios.generate_place import Place, build_place
from plannerforge.engine.scenarios.realised_site import why_not_realised
from plannerforge.engine.scenarios.scenario_head import head_of
from plannerforge.engine.scenarios.writer import ScenarioHead
from plannerforge.engine.scenarios.writer_network import write_network
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.generation import GenerationRequest
from plannerforge.schemas.network_rules import RuleFinding

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
    findings = network_findings(place.network, head)
    if errors := told(findings, "error"):
        where = f"{site.latitude:.5f}, {site.longitude:.5f}"
        raise NotPossible(
            f"the road network at {where} is wrong: {'; '.join(errors)}",
            next_step="choose another place, scenario_type or seed",
        )
    return Ground(place, net_path, head, findings)


def network_findings(network: RoadNetwork, head: ScenarioHead) -> tuple[RuleFinding, ...]:
    """What the rules find in a network as it will stand in the file."""
    root = etree.Element("commonRoad", {"benchmarkID": head.benchmark_id})
    write_network(root, network, head.speed_sign)
    return check_network(road_document(root))
