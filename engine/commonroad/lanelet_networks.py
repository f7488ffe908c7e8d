"""Builds lanelet networks from XML like commonroad-io, but without copying each lanelet.

commonroad-io reads points one by one and copies every lanelet into the network, which takes a third of a small file's
reading time. Everything except the points and that copy comes from commonroad-io's own factories.
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
    """Build a scenario of format 2020a from an ElementTree, with the header from commonroad-io's reader."""
    tags, location = TagsFactory.create_from_xml_node(tree), LocationFactory.create_from_xml_node(tree)
    scenario_id = ScenarioID.from_benchmark_id(benchmark_id, version)
    scenario = Scenario(step_s, scenario_id, **metadata, tags=tags, location=location)
    scenario.add_objects(_network(tree))
    scenario.add_objects(ScenarioFactory._obstacles(tree, scenario.lanelet_network, False))
    scenario.footways = [_Lanelets.create_from_xml_node(node) for node in tree.findall("lanelet") if _is_footway(node)]
    return scenario


def _is_footway(node: Element) -> bool:
    """Return whether a lanelet is open to pedestrians in both directions, and to no other users.

    Such lanelets are kept outside the network, because all queries of the network concern vehicles.
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
    """Reads each bound of a lanelet in one step if its points have only x and y."""

    @classmethod
    def _vertices(cls, xml_node: Element) -> Points:
        points = xml_node.findall("point")
        if any([inner.tag for inner in point.iter()] != _POINT for point in points):
            return np.asarray(super()._vertices(xml_node))
        return np.array([[float(point[0].text or ""), float(point[1].text or "")] for point in points])

    @classmethod
    def _speed_limit_exists(cls, xml_node: Element) -> None:
        """Return None, so that commonroad-io keeps no limit in the class; lanelets have limits only in format 2018b."""
