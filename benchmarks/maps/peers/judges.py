"""Independent views of a foreign file and its import: commonroad-io, SUMO, sumolib, ASAM's checker.

Nothing here uses the product's own readers.
"""

import re
import subprocess
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import commonroad
import numpy as np
from commonroad.common.file_reader import CommonRoadFileReader
from lxml import etree
from numpy.typing import NDArray

Line = NDArray[np.float64]
JOINT_M = 0.01
"""Lanelets follow each other if their bounds meet within this distance."""
_RULE = re.compile(rb"""\brule\s*=\s*["'](LHT|RHT)["']""")
_HEADER = ("commonRoad", "location", "scenarioTags")
_TIME_S = 120


def commonroad_verdict(path: Path) -> str:
    """Return why a file is not CommonRoad's, or an empty text: commonroad-io reads it and the schema accepts it."""
    try:
        scenario, _ = CommonRoadFileReader(str(path)).open()
    except Exception as error:  # noqa: BLE001 - whatever commonroad-io raises, it does not read the file
        return f"commonroad-io: {type(error).__name__}"
    if not scenario.lanelet_network.lanelets:
        return "no lanelet"
    tree = etree.parse(path)
    if tree.getroot().get("commonRoadVersion") != "2020a":
        return ""
    folder = Path(str(commonroad.__file__)).parent / "scenario_definition" / "xml_definition_files"
    schema = etree.XMLSchema(etree.parse(folder / "XML_commonRoad_XSD.xsd"))
    schema.validate(tree)
    faults = [one for one in schema.error_log if str(one.path or "").rsplit("/", 1)[-1] not in _HEADER]  # type: ignore[attr-defined]
    return f"schema: {faults[0].message[:120]}" if faults else _gap(tree.getroot())


def _gap(root: etree._Element) -> str:
    """Return a break in a recording: CommonRoad's states follow one another step by step."""
    for obstacle in root.iterfind("dynamicObstacle"):
        steps = [int(one.text or 0) for one in obstacle.iterfind("trajectory/state/time/exact")]
        if any(after - before != 1 for before, after in pairwise(steps)):
            return f"the states of obstacle {obstacle.get('id')} have a gap or a step twice"
    return ""


def bad_goals(path: Path) -> int:
    """Return how many planning problems of a CommonRoad file lack a start, a time of the goal, or a lanelet of it."""
    root = ElementTree.parse(path).getroot()  # noqa: S314 - the product has read the file already
    lanelets = {one.get("id") for one in root.iterfind("lanelet")}
    bad = 0
    for problem in root.iterfind("planningProblem"):
        goals = problem.findall("goalState")
        lost = any(one.get("ref") not in lanelets for one in problem.iterfind("goalState/position/lanelet"))
        no_start = problem.find("initialState/position") is None
        bad += no_start or lost or any(goal.find("time") is None for goal in goals)
    return bad


def netconvert_reads(path: Path, scratch: Path) -> bool:
    """Return True if netconvert with its default settings makes a network with a car lane from an OpenDRIVE file.

    It ignores the rule of traffic, and draws a file with both rules wrongly; such a file does not count.
    """
    import sumo
    import sumolib

    if len(set(_RULE.findall(path.read_bytes()))) > 1:
        return False
    program, net = Path(sumo.SUMO_HOME) / "bin" / "netconvert", scratch / "judged.net.xml"
    net.unlink(missing_ok=True)
    command = [str(program), "--opendrive-files", str(path), "--output-file", str(net)]
    try:
        done = subprocess.run(command, capture_output=True, check=False, timeout=_TIME_S)
    except subprocess.TimeoutExpired:
        return False
    if done.returncode != 0 or not net.exists():
        return False
    return any(edge.allows("passenger") for edge in sumolib.net.readNet(str(net)).getEdges())


def rule_of(path: Path) -> str:
    """Return the traffic rule that most roads of an OpenDRIVE file state, or RHT by default."""
    rules = _RULE.findall(path.read_bytes())
    return "LHT" if rules.count(b"LHT") > rules.count(b"RHT") else "RHT"


@dataclass(frozen=True)
class NetVerdict:
    """The links between roads of a network, the ones that the lanelets lost, and the number of turned roads."""

    links: int
    lost: int
    wrong_side: int


def net_verdict(net_path: Path, following: Mapping[str, set[str]], rule: str) -> NetVerdict:
    """Compare the lanelets of a network, as SUMO lane → the lanes that follow it, with the network as sumolib reads it.

    A road is on the wrong side if the road back between the same junctions does not lie on its left in a right-hand
    country, or on its right in a left-hand one.
    """
    import sumolib

    net = sumolib.net.readNet(str(net_path), withInternal=True)
    links = lost = 0
    for edge in net.getEdges(withInternal=False):
        for lane in edge.getLanes():
            for link in lane.getOutgoing():
                if lane.allows("passenger") and link.getToLane().allows("passenger"):
                    links += 1
                    goals = _drawn(link.getToLane(), following)
                    is_there = lane.getID() in following or lane.getLength() > _TINY_M
                    lost += is_there and not all(_leads(lane.getID(), goal, following) for goal in goals)
    return NetVerdict(links, lost, _wrong_side(net, rule))


_TINY_M = 0.2
"""A shorter lane of a road need not be drawn (chosen): the lane before it then leads to those after it."""


def _drawn(lane: Any, following: Mapping[str, set[str]]) -> set[str]:
    """Return the lane, or the drawn ones behind it if it is too short to be drawn."""
    if lane.getID() in following or lane.getLength() > _TINY_M:
        return {lane.getID()}
    behind = [link.getToLane() for link in lane.getOutgoing() if link.getToLane().allows("passenger")]
    return set[str]().union(*(_drawn(one, following) for one in behind if one.getID() != lane.getID()))


def _leads(start: str, goal: str, following: Mapping[str, set[str]]) -> bool:
    waiting, seen = [start], set[str]()
    while waiting:
        for lane in following.get(waiting.pop(), ()):
            if lane == goal:
                return True
            if lane.startswith(":") and lane not in seen:
                seen.add(lane)
                waiting.append(lane)
    return False


def _wrong_side(net: Any, rule: str) -> int:
    by_ends = defaultdict(list)
    edges = [edge for edge in net.getEdges(withInternal=False) if edge.allows("passenger")]
    for edge in edges:
        by_ends[edge.getFromNode().getID(), edge.getToNode().getID()].append(edge)
    wrong = 0
    for (start, end), one in by_ends.items():
        back = by_ends.get((end, start), [])
        if start >= end or len(one) != 1 or len(back) != 1:
            continue
        here, there = (_middle(lines[0]) for lines in (one, back))
        if np.linalg.norm(there[0] - here[0]) > _APART_M:
            continue
        across = there[0] - here[0]
        left = here[1][0] * across[1] - here[1][1] * across[0]
        wrong += (left > 0) != (rule == "RHT") and abs(left) > _LEAST_M
    return wrong


_APART_M, _LEAST_M = 15.0, 0.5
"""Opposite roads farther apart are separate roads; nearer ones share a line, and have no side (chosen)."""


def _middle(edge: Any) -> tuple[Line, Line]:
    """Return position and direction in the middle of a road's lanes."""
    lines = [np.array(lane.getShape(), dtype=float)[:, :2] for lane in edge.getLanes()]
    line = lines[0]
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    half = int(np.clip(np.searchsorted(at, at[-1] / 2), 1, len(line) - 1))
    ahead = line[half] - line[half - 1]
    points = [_at_half(one) for one in lines]
    return np.mean(points, axis=0), ahead / max(float(np.linalg.norm(ahead)), 1e-9)


def _at_half(line: Line) -> Line:
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    return np.array([np.interp(at[-1] / 2, at, line[:, axis]) for axis in (0, 1)])


def lanelet2_lanelets(path: Path) -> int:
    """Return how many lanelets of a Lanelet2 map have two bounds of nodes that are there."""
    root = etree.parse(path, etree.XMLParser(resolve_entities=False, huge_tree=True)).getroot()
    ways = {way.get("id"): len(way.findall("nd")) for way in root.iterfind("way")}
    count = 0
    for relation in root.iterfind("relation"):
        if any(tag.get("k") == "type" and tag.get("v") == "lanelet" for tag in relation.iterfind("tag")):
            sides = {m.get("role"): ways.get(m.get("ref"), 0) for m in relation.iterfind("member[@type='way']")}
            count += sides.get("left", 0) > 1 and sides.get("right", 0) > 1
    return count


def torn_joints(path: Path) -> tuple[int, int]:
    """Count the lanelets of a CommonRoad file that begin exactly at another's end, and those pairs that are not
    linked.
    """
    root = etree.parse(path).getroot()
    ends, starts = defaultdict(list), defaultdict(list)
    after = {}
    for lanelet in root.iterfind("lanelet"):
        lines = [
            [(float(p.findtext("x", "0")), float(p.findtext("y", "0"))) for p in lanelet.iterfind(f"{side}/point")]
            for side in ("leftBound", "rightBound")
        ]
        key = lanelet.get("id", "")
        after[key] = {one.get("ref") for one in lanelet.iterfind("successor")}
        starts[_cell(lines[0][0], lines[1][0])].append(key)
        ends[_cell(lines[0][-1], lines[1][-1])].append(key)
    pairs = [(one, other) for cell, keys in ends.items() for one in keys for other in starts.get(cell, ())]
    pairs = [(one, other) for one, other in pairs if one != other]
    return len(pairs), sum(other not in after[one] for one, other in pairs)


def _cell(left: tuple[float, float], right: tuple[float, float]) -> tuple[int, ...]:
    return tuple(round(value / JOINT_M) for value in (*left, *right))


def asam_issues(program: Path, file: Path, scratch: Path) -> list[str]:
    """Return the issues that ASAM's checker for OpenDRIVE (qc_opendrive) finds in a file."""
    settings, verdict = scratch / "asam.xml", scratch / "asam.xqar"
    verdict.unlink(missing_ok=True)
    bundle = f'<CheckerBundle application="xodrBundle"><Param name="resultFile" value="{verdict}"/></CheckerBundle>'
    settings.write_text(f'<Config><Param name="InputFile" value="{file}"/>{bundle}</Config>', encoding="utf-8")
    subprocess.run([str(program), "-c", str(settings)], capture_output=True, check=False, timeout=_TIME_S)
    if not verdict.exists():
        return ["the checker gave no verdict"]
    return [str(issue.get("ruleUID", "")) for issue in etree.parse(verdict).iter("Issue")]
