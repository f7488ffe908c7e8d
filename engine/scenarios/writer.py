"""Writing CommonRoad 2020a XML: the same content always gives the same bytes.

The elements' order follows CommonRoad's schema; ids are given in the order of writing, numbers are decimals without
exponents, and the date is fixed, because a date would make every file differ.
"""

from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from plannerforge.engine.network.road_network import RoadNetwork
from plannerforge.engine.scenarios.planning_problem import PlanningTask
from plannerforge.engine.scenarios.writer_network import write_network
from plannerforge.engine.scenarios.writer_traffic import write_obstacle, write_planning_problem
from plannerforge.engine.traffic.motions import Participant

FIXED_DATE = "2025-01-01"


@dataclass(frozen=True)
class ScenarioHead:
    """What stands before the content: id, author, source, place in degrees, projection and its offset in m, tags."""

    benchmark_id: str
    affiliation: str
    source: str
    latitude: float
    longitude: float
    projection: str
    offset_m: tuple[float, float]
    tags: tuple[str, ...]
    step_s: float
    speed_sign: str | None


def write_scenario(
    path: Path, head: ScenarioHead, network: RoadNetwork, traffic: tuple[Participant, ...], task: PlanningTask
) -> dict[str, int]:
    """Write a scenario.

    Returns:
        CommonRoad's obstacle id by the vehicle's id.
    """
    root = etree.Element(
        "commonRoad",
        {
            "timeStepSize": f"{head.step_s:g}",
            "commonRoadVersion": "2020a",
            "author": "PlannerForge",
            "affiliation": head.affiliation,
            "source": head.source,
            "benchmarkID": head.benchmark_id,
            "date": FIXED_DATE,
        },
    )
    _write_location(root, head)
    tags = etree.SubElement(root, "scenarioTags")
    for tag in sorted(set(head.tags)):
        etree.SubElement(tags, tag)
    write_network(root, network, head.speed_sign)
    ids: dict[str, int] = {}
    next_id = network.next_id
    for vehicle in traffic:
        ids[vehicle.vehicle_id] = next_id
        write_obstacle(root, next_id, vehicle)
        next_id += 1
    write_planning_problem(root, next_id, task)
    etree.indent(root, space=" ")
    path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n")
    return ids


def _write_location(root: etree._Element, head: ScenarioHead) -> None:
    location = etree.SubElement(root, "location")
    etree.SubElement(location, "geoNameId").text = "-999"
    etree.SubElement(location, "gpsLatitude").text = f"{head.latitude:.6f}"
    etree.SubElement(location, "gpsLongitude").text = f"{head.longitude:.6f}"
    if not head.projection:
        return
    transformation = etree.SubElement(location, "geoTransformation")
    etree.SubElement(transformation, "geoReference").text = head.projection
    additional = etree.SubElement(transformation, "additionalTransformation")
    etree.SubElement(additional, "xTranslation").text = f"{head.offset_m[0]:.3f}"
    etree.SubElement(additional, "yTranslation").text = f"{head.offset_m[1]:.3f}"
    etree.SubElement(additional, "zRotation").text = "0.0"
    etree.SubElement(additional, "scaling").text = "1.0"
