"""Maps in formats other than OpenStreetMap: small ones, and a Lanelet2 map of a CommonRoad file's lanelets."""

import math
import subprocess
from pathlib import Path

import numpy as np
import sumo
from commonroad.common.file_reader import CommonRoadFileReader
from lxml import etree
from pyproj import Proj

PLANE = Proj("+proj=utm +zone=32 +ellps=WGS84")
ORIGIN = (500_000.0, 5_400_000.0)
SAME_M = 0.3
STRAIGHT = """<OpenDRIVE><header revMajor="1" revMinor="4">{header}</header>
<road name="Low Road" length="300" id="1" junction="-1">
 <planView><geometry s="0" x="{x}" y="0" hdg="0" length="{length}"><line/></geometry></planView>
 <elevationProfile><elevation s="0" a="2" b="0.01" c="0" d="0"/></elevationProfile>
 <lanes><laneSection s="0">
  <left>{more}<lane id="1" type="driving" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></left>
  <center><lane id="0" type="none" level="false"/></center>
  <right><lane id="-1" type="driving" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>
   <lane id="-2" type="sidewalk" level="false"><width sOffset="0" a="2" b="0" c="0" d="0"/></lane></right>
 </laneSection></lanes>
 <objects><object id="7" s="10" t="5" zOffset="0" type="tree"/></objects>
 <signals><signal s="20" t="-4" id="3" dynamic="no" orientation="+" type="274" subtype="50"/></signals>
</road></OpenDRIVE>"""


def straight_road(*, header: str = "", x: str = "0", length: str = "300", lanes: int = 0) -> str:
    """Return an OpenDRIVE file of one road with a pavement, a slope, a sign and a tree."""
    return STRAIGHT.format(header=header, x=x, length=length, more='<lane id="9" type="none"/>' * lanes)


def opendrive_of_net(net: Path, target: Path) -> Path:
    """Return a SUMO network as OpenDRIVE, as netconvert writes it."""
    program = Path(sumo.SUMO_HOME) / "bin" / "netconvert"
    options = ["-s", str(net), "--opendrive-output", str(target)]
    subprocess.run([program, *options], check=True, capture_output=True)
    return target


def lanelet2_of(scenario: Path, target: Path) -> Path:
    """Return the lanelets of a CommonRoad file as a Lanelet2 map: shared bounds are one way, every other one
    reversed.
    """
    network = CommonRoadFileReader(str(scenario)).open()[0].lanelet_network
    root = etree.Element("osm", version="0.6", generator="tests")
    nodes: dict[tuple[float, float], int] = {}
    ways: dict[tuple[int, ...], int] = {}
    relations = []

    def node_at(x: float, y: float) -> int:
        near = [key for (x0, y0), key in nodes.items() if math.hypot(x - x0, y - y0) < SAME_M]
        return near[0] if near else nodes.setdefault((x, y), 100_000 + len(nodes))

    def way_of(line: "np.ndarray[tuple[int, int], np.dtype[np.float64]]") -> int:
        keys = tuple(node_at(x, y) for x, y in line[:, :2])
        known = keys if keys in ways else keys[::-1]
        return ways.setdefault(known, 200_000 + len(ways))

    for lanelet in network.lanelets:
        relation = etree.Element("relation", id=str(lanelet.lanelet_id))
        for role, line in (("left", lanelet.left_vertices), ("right", lanelet.right_vertices)):
            etree.SubElement(relation, "member", type="way", ref=str(way_of(line)), role=role)
        for key, value in (("type", "lanelet"), ("subtype", "road"), ("speed_limit", "50 km/h")):
            etree.SubElement(relation, "tag", k=key, v=value)
        relations.append(relation)
    for (x, y), key in nodes.items():
        longitude, latitude = PLANE(x + ORIGIN[0], y + ORIGIN[1], inverse=True)
        etree.SubElement(root, "node", id=str(key), lat=f"{latitude:.10f}", lon=f"{longitude:.10f}")
    for number, (keys, way_id) in enumerate(ways.items()):
        way = etree.SubElement(root, "way", id=str(way_id))
        for key in keys[:: -1 if number % 2 else 1]:
            etree.SubElement(way, "nd", ref=str(key))
    root.extend(relations)
    target.write_bytes(etree.tostring(root))
    return target


def drive_file(view: str, *, length: float, key: int = 1, link: str = "", rule: str = "") -> str:
    """Return an OpenDRIVE file of one road with a lane in each direction, along a plan view."""
    lanes = [
        f'<{side}><lane id="{lane}" type="driving" level="false">'
        '<width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
        f"</{side}>"
        for side, lane in (("left", 1), ("right", -1))
    ]
    center = '<center><lane id="0" type="none" level="false"/></center>'
    side = f' rule="{rule}"' if rule else ""
    return (
        '<OpenDRIVE><header revMajor="1" revMinor="4"></header>'
        f'<road name="" length="{length}" id="{key}" junction="-1"{side}><link>{link}</link><planView>{view}</planView>'
        f'<lanes><laneSection s="0">{lanes[0]}{center}{lanes[1]}</laneSection></lanes></road></OpenDRIVE>'
    )


def two_roads(*, rule: str = "") -> str:
    """Return two straight roads in OpenDRIVE, 200 m each, that meet end to end."""
    view = '<geometry s="0" x="{}" y="5340000" hdg="0" length="200"><line/></geometry>'
    joint = '<{} elementType="road" elementId="{}" contactPoint="{}"/>'
    first, second = (
        drive_file(view.format(x), length=200, key=key, rule=rule, link=joint.format(*link))
        for x, key, link in ((691000, 1, ("successor", 2, "start")), (691200, 2, ("predecessor", 1, "end")))
    )
    for lane in ("1", "-1"):
        start = f'<lane id="{lane}" type="driving" level="false">'
        first = first.replace(start, f'{start}<link><successor id="{lane}"/></link>')
        second = second.replace(start, f'{start}<link><predecessor id="{lane}"/></link>')
    return first.replace("</OpenDRIVE>", "") + second[second.index("<road") :]
