"""Lanelet networks from XML as commonroad-io makes them, without the copy of each lanelet that it makes on the way.

commonroad-io reads a scenario's points one by one and copies every lanelet when it puts it into the network: a third of
the time that a small file costs. Everything but the points and that copy is read by commonroad-io's own factories.
"""

from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from commonroad.common.reader.file_reader_xml import (
    IntersectionFactory,
    LaneletFactory,
    LaneletNetworkFactory,
    LocationFactory,
    ScenarioFactory,
    TagsFactory,
    TrafficLightFactory,
    TrafficSignFactory,
)
from commonroad.scenario.lanelet import LaneletNetwork
from commonroad.scenario.scenario import Scenario, ScenarioID

from ..geometry import Points

_POINT = ["point", "x", "y"]


def scenario_of(tree: Any, step_s: float, benchmark_id: str, version: str, metadata: Mapping[str, Any]) -> Scenario:
    """A scenario of format 2020a from an ElementTree; its header is given as commonroad-io's reader has read it."""
    tags, location = TagsFactory.create_from_xml_node(tree), LocationFactory.create_from_xml_node(tree)
    scenario_id = ScenarioID.from_benchmark_id(benchmark_id, version)
    scenario = Scenario(step_s, scenario_id, **metadata, tags=tags, location=location)
    scenario.add_objects(_network(tree))
    scenario.add_objects(ScenarioFactory._obstacles(tree, scenario.lanelet_network, False))
    scenario.footways = [_Lanelets.create_from_xml_node(node) for node in tree.findall("lanelet") if _is_footway(node)]
    return scenario


def _is_footway(node: Element) -> bool:
    """Whether a lanelet is open to pedestrians in both directions, and to nobody else.

    Such lanelets are kept beside the network: whatever asks the network here asks where vehicles drive.
    """
    both_ways = [user.text for user in node.findall("userBidirectional")]
    return both_ways == ["pedestrian"] and node.find("userOneWay") is None


def _network(tree: Any) -> LaneletNetwork:
    network = LaneletNetwork()
    for node in tree.findall("lanelet"):
        if _is_footway(node):
            continue
        network.add_lanelet(_Lanelets.create_from_xml_node(node), rtree=False)
    network._create_strtree()
    country = LaneletNetworkFactory._find_country(tree)
    first_with_sign = LaneletNetworkFactory._find_first_traffic_sign_occurence(network)
    for node in tree.findall("trafficSign"):
        network.add_traffic_sign(TrafficSignFactory.create_from_xml_node(node, country, first_with_sign, network), [])
    for node in tree.findall("trafficLight"):
        network.add_traffic_light(TrafficLightFactory.create_from_xml_node(node, country, network), [])
    for node in tree.findall("intersection"):
        network.add_intersection(IntersectionFactory.create_from_xml_node(node))
    return network


class _Lanelets(LaneletFactory):  # type: ignore[misc]  # commonroad-io has no types
    """Lanelets with their bounds read in one go, where all points are in the plane."""

    @classmethod
    def _vertices(cls, xml_node: Element) -> Points:
        points = xml_node.findall("point")
        if any([inner.tag for inner in point.iter()] != _POINT for point in points):
            return np.asarray(super()._vertices(xml_node))
        return np.array([[float(point[0].text or ""), float(point[1].text or "")] for point in points])

    @classmethod
    def _speed_limit_exists(cls, xml_node: Element) -> None:
        """None: limits of lanelets belong to format 2018b, and commonroad-io would keep them in the class."""
