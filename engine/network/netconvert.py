"""Runs SUMO's netconvert, and prepares its nets for driving: smooth junctions, speeds for curves.

The program is native code on foreign input: it gets only scanned files, and runs without a shell and with a time limit.
Its output is deleted first, so that an old file never counts as a result.

If a junction is small or joined from several, netconvert replaces its own curve with a straight line, or with a line
that ends across the next road. Vehicles and lanelets follow these lines. Every run of netconvert is therefore followed
by ``smooth_junction_lanes``, in the net.
"""

import math
import os
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from itertools import pairwise, product
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from ...schemas.errors import NotPossible, WorkerTimeout
from ...schemas.text import one_line
from ..execution import end_with_parent
from ..geometry import (
    Points,
    Values,
    arc_length,
    headings,
    hermite,
    interpolate,
    length_m,
    maximum_curvature,
    resample,
    unit,
    without_repeats,
    wrap_angles,
)
from ..vehicles import GRAVITY_MPS2
from .net_parser import read_net, shape_of
from .walk_net import read_walk_net

_TIME_LIMIT_S = 120.0
"""Chosen: maps within the size limits take seconds."""
_MOST_WARNINGS = 1_000
"""Maximum number of warnings kept; chosen: a site has a few, and they repeat text from the map's file."""
_GEOMETRY_OPTIONS = """
--no-turnarounds true --junctions.internal-link-detail 10 --junctions.corner-detail 5 --junctions.small-radius 4
--junctions.scurve-stretch 1 --geometry.max-angle.fix true --precision 3
"""
"""Options for smooth lanelets inside junctions, and without turnarounds, which make hairpins for lanelets.

Junctions without conflicts get the radius of the others (1.5 m otherwise) and room for lanes that shift sideways. Roads
that fold back at one point are straightened.
"""
_OSM_OPTIONS = """
--geometry.remove true --ramps.guess true --roundabouts.guess true --tls.guess-signals true --tls.discard-simple true
--tls.join true --output.street-names true --osm.turn-lanes true --osm.lane-access true
--keep-edges.by-vclass passenger,bus,truck,delivery,motorcycle,taxi
"""
"""The options that SUMO's guide to importing OpenStreetMap recommends, with street names, for motor vehicles only."""


_TIGHT_RADIUS_M = 1.5
"""netconvert's own radius for junctions in which no vehicle needs room to turn (``--junctions.small-radius``)."""


def convert_osm(
    osm: Path,
    net: Path,
    *,
    lefthand: bool,
    drivable_service_roads: bool = False,
    join_junctions: bool = True,
    tight_corners: bool = False,
    pavements: bool = False,
) -> tuple[str, ...]:
    """Convert an OSM extract to a SUMO net; return netconvert's warnings.

    Args:
        osm: the scanned extract; its types of road, if any, are in a ``.typ.xml`` file next to it.
        net: the file to write.
        lefthand: whether traffic keeps left.
        drivable_service_roads: open service roads (delivery only by SUMO's default) to all vehicles.
        join_junctions: join nearby junctions into one.
        tight_corners: round the corners of junctions with 1.5 m instead of 4 m, which preserves more of small rings.
        pavements: build tagged pavements, crossings where they meet at a junction and where nodes mark them, and cycle
            lanes.

    Raises:
        NotPossible: netconvert rejects the extract; the error quotes its message.
    """
    import sumo

    types = [Path(sumo.SUMO_HOME) / "data" / "typemap" / "osmNetconvert.typ.xml"]
    if drivable_service_roads:
        types.append(Path(__file__).parent.parent / "maps" / "road_tags" / "service_roads.typ.xml")
    if (own := osm.with_suffix(".typ.xml")).exists():
        types.append(own)
    options = ["--osm-files", str(osm), "--type-files", ",".join(str(path) for path in types), *_OSM_OPTIONS.split()]
    options += ["--lefthand", str(lefthand).lower(), "--junctions.join", str(join_junctions).lower()]
    if tight_corners:
        options += ["--default.junctions.radius", f"{_TIGHT_RADIUS_M:g}"]
    if pavements:
        options[options.index("--keep-edges.by-vclass") + 1] += ",pedestrian"
        options += ["--osm.sidewalks", "true", "--crossings.guess", "true", "--osm.bike-access", "true"]
        options += ["--osm.crossings", "true"]
    warnings = run_netconvert(options, net)
    return (*warnings, *_remove_double_crossings(net)) if pavements else warnings


def _remove_double_crossings(net: Path) -> tuple[str, ...]:
    """Remove duplicate crossings between two corners from a net, in place; return netconvert's warnings.

    If a node marks a crossing in the middle of a road, netconvert builds a crossing on each side of the node.
    """
    root, joined = etree.Element("connections"), set()
    for crossing in read_walk_net(net).crossings.values():
        corners = frozenset(crossing.corners)
        if corners in joined:
            node = crossing.edge_id.removeprefix(":").rpartition("_")[0]
            over = " ".join(sorted(crossing.over))
            etree.SubElement(root, "crossing", {"node": node, "edges": over, "discard": "true"})
        joined.add(corners)
    return _patched(net, root, net.parent) if len(root) else ()


def remove_connections(net: Path, connections: Sequence[tuple[str, str, int, int]], scratch: Path) -> tuple[str, ...]:
    """Remove lane connections (from edge, to edge, from lane, to lane) from a net, in place; return the warnings."""
    root = etree.Element("connections")
    for start, end, from_lane, to_lane in connections:
        ends = {"from": start, "to": end, "fromLane": str(from_lane), "toLane": str(to_lane)}
        etree.SubElement(root, "delete", ends)
    return _patched(net, root, scratch)


def add_connections(net: Path, pairs: Iterable[tuple[str, str]], scratch: Path) -> tuple[str, ...]:
    """Connect the lanes of edges with those of the next edge in a net, in place; return netconvert's warnings.

    Each lane leads to the lane of the same index, or to the last lane.
    """
    lanes = {edge: len(known.lane_ids) for edge, known in read_net(net).edges.items()}
    root = etree.Element("connections")
    for start, end in pairs:
        for lane in range(lanes[start]):
            ends = {"from": start, "to": end, "fromLane": str(lane), "toLane": str(min(lane, lanes[end] - 1))}
            etree.SubElement(root, "connection", ends)
    return _patched(net, root, scratch)


def remove_edges(net: Path, edges: Iterable[str], scratch: Path) -> tuple[str, ...]:
    """Remove edges from a net, in place; return netconvert's warnings."""
    root = etree.Element("edges")
    for edge in edges:
        etree.SubElement(root, "delete", {"id": edge})
    return _patched(net, root, scratch, "edge")


def _patched(net: Path, document: etree._Element, scratch: Path, kind: str = "connection") -> tuple[str, ...]:
    """Change a net, in place, with a document of connections or edges; return netconvert's warnings."""
    patch = scratch / f"removed.{kind[:3]}.xml"
    patch.write_bytes(etree.tostring(document))
    options = ["--sumo-net-file", str(net), f"--{kind}-files", str(patch), "--offset.disable-normalization", "true"]
    warnings = run_netconvert(options, scratch / "without.net.xml")
    (scratch / "without.net.xml").replace(net)
    return warnings


def run_netconvert(options: Sequence[str], net: Path) -> tuple[str, ...]:
    """Run netconvert with options for good geometry inside junctions, and smooth the lanes there.

    Returns:
        Its warnings in order, each on one line, since they repeat names from the map.

    Raises:
        NotPossible: netconvert ended with an error.
        WorkerTimeout: netconvert ran longer than the limit.
    """
    import sumo

    net.unlink(missing_ok=True)
    program = str(Path(sumo.SUMO_HOME) / "bin" / "netconvert")
    environment = {**os.environ, "SUMO_HOME": str(sumo.SUMO_HOME), "LC_ALL": "C"}
    command = [program, *options, *_GEOMETRY_OPTIONS.split(), "--output-file", str(net)]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=_TIME_LIMIT_S,
            env=environment,
            check=False,
            preexec_fn=partial(end_with_parent, os.getpid()),
        )
    except subprocess.TimeoutExpired as error:
        raise WorkerTimeout(
            f"netconvert ran longer than {_TIME_LIMIT_S:.0f} s", next_step="use a smaller map"
        ) from error
    lines = done.stderr.splitlines()
    if done.returncode != 0 or not net.exists():
        reasons = [line.removeprefix("Error:").strip() for line in lines if line.startswith("Error")]
        reason = "; ".join(reasons[:3]) or f"it ended with code {done.returncode}"
        raise NotPossible(
            f"netconvert cannot build a road network from this map: {reason}", next_step="choose another site or map"
        )
    smooth_junction_lanes(net)
    warnings = [one_line(line.removeprefix("Warning:")) for line in lines if line.startswith("Warning")]
    more = [f"{len(warnings) - _MOST_WARNINGS:,} more warnings"] if len(warnings) > _MOST_WARNINGS else []
    return (*warnings[:_MOST_WARNINGS], *more)


_FOLD_RAD = math.radians(100.0)
"""Chosen: roads turn less at one point; only lines that run back over themselves turn more."""
_LARGEST_CORNER_RAD = math.radians(20.0)
"""Chosen: a larger turn at one point is a corner; netconvert's own curves turn less from point to point."""
_HOOK_RADIUS_M, _LEAST_GAIN = 3.0, 1.2
"""Chosen: a curve of a smaller radius (too small for cars) is a hook, if another has a radius larger by this factor."""
_REACHES = (0.2, 0.35, 0.5, 0.75, 1.0, 1.4)
"""Distances of the inner control points from the ends to try, as shares of the distance between the ends."""
_SAMPLES = 33
"""Chosen: points on a curve while curves are compared."""
_SPACING_M, _FEWEST_POINTS = 1.0, 10
"""Points on the written curve: as dense as netconvert's own (``internal-link-detail`` below 10 m)."""
_DECIMALS = 3
"""As in all of the net (``precision``)."""


def smooth_junction_lanes(net_path: Path) -> int:
    """Redraw, in place, lanes that cross a junction and have a hook or a corner where they meet their roads.

    Vertices at which road lanes fold back are removed first.

    Returns:
        The number of redrawn road lanes and routes across junctions.
    """
    root = etree.parse(net_path).getroot()
    lanes = {lane.get("id", ""): lane for lane in root.iter("lane")}
    changed = sum(_unfold(lane) for key, lane in lanes.items() if not key.startswith(":"))
    for before, inside, after in _junction_routes(root):
        if not all(lane in lanes for lane in (before, *inside, after)):
            continue
        arriving, *parts, leaving = (shape_of(lanes[lane]) for lane in (before, *inside, after))
        if any(len(line) < 2 for line in (arriving, *parts, leaving)):
            continue
        path = without_repeats(np.concatenate(parts))
        curve = smoothest_curve(arriving[-1] - arriving[-2], path, leaving[1] - leaving[0])
        if curve is not None:
            for lane, part in zip(inside, _split(curve, [length_m(part) for part in parts]), strict=True):
                _set_shape(lanes[lane], part)
            changed += 1
    if changed:
        net_path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n")
    return changed


def _unfold(lane: etree._Element) -> bool:
    """Remove vertices at which a lane folds back; return whether there were any."""
    old = shape_of(lane)
    new = without_folds(old)
    if len(new) < len(old):
        _set_shape(lane, new)
    return len(new) < len(old)


def without_folds(line: Points) -> Points:
    """Return the line without the inner vertices at which it turns back by more than 100°."""
    while len(line) > 2:
        turns = np.abs(np.diff(headings(line)))
        sharpest = int(np.argmax(turns))
        if turns[sharpest] <= _FOLD_RAD:
            break
        line = np.delete(line, sharpest + 1, axis=0)
    return line


def smoothest_curve(ahead: Points, path: Points, onward: Points) -> Points | None:
    """Return the curve with the smallest peak curvature between a path's ends and with the given end directions.

    The result is None if the path has neither a corner at its ends nor a hook, or if no curve is smoother.
    """
    if len(path) < 2:
        return None
    corner = _sharpest_corner(ahead, path, onward)
    curvature = _largest_curvature(path)
    if corner <= _LARGEST_CORNER_RAD and curvature <= 1 / _HOOK_RADIUS_M:
        return None
    curve = _least_curved(unit(ahead), path[0], path[-1], unit(onward))
    if _sharpest_corner(ahead, curve, onward) < corner - _LARGEST_CORNER_RAD / 2:
        return curve
    hooked = corner <= _LARGEST_CORNER_RAD and curvature > _LEAST_GAIN * _largest_curvature(curve)
    return curve if hooked else None


def _least_curved(ahead: Points, start: Points, end: Points, onward: Points) -> Points:
    span, shares = float(np.linalg.norm(end - start)), np.linspace(0.0, 1.0, _SAMPLES)
    first, last = np.array([(3 * span * first, 3 * span * last) for first, last in product(_REACHES, _REACHES)]).T
    curves = hermite(start, ahead, end, onward, shares, (first[:, None, None], last[:, None, None]))
    best: Points = curves[int(np.argmin(_largest_curvatures(curves)))]
    return resample(best, max(_FEWEST_POINTS, math.ceil(length_m(best) / _SPACING_M) + 1))


def _sharpest_corner(ahead: Points, path: Points, onward: Points) -> float:
    """Return the larger turn in rad at the ends of a path that is entered and left in the given directions."""
    directions = np.vstack([ahead, np.diff(path, axis=0)[[0, -1]], onward])
    angles = np.arctan2(directions[:, 1], directions[:, 0])
    return float(np.abs(wrap_angles(angles[[1, 3]] - angles[[0, 2]])).max())


def _largest_curvature(curve: Points) -> float:
    """Return the largest curvature in 1/m."""
    return 0.0 if len(curve) < 3 else float(_largest_curvatures(curve[None])[0])


def _largest_curvatures(curves: NDArray[np.float64]) -> Values:
    """Return the largest curvature in 1/m of each of several curves, shape (k, n, 2), n at least 3."""
    along, across = np.moveaxis(curves[:, 1:] - curves[:, :-1], 2, 0)
    steps, turns = np.sqrt(along * along + across * across), np.unwrap(np.arctan2(across, along))
    largest: Values = np.max(np.abs(np.diff(turns)) / np.maximum((steps[:, 1:] + steps[:, :-1]) / 2, 1e-6), axis=1)
    return largest


def _junction_routes(root: etree._Element) -> Iterator[tuple[str, list[str], str]]:
    """Yield the lanes of every connection between two roads: before, inside (in order) and after the junction."""
    connections = list(root.iterfind("connection"))
    following = {f"{link.get('from')}_{link.get('fromLane')}": link.get("via") for link in connections}
    for link in connections:
        lane = link.get("via")
        if lane is None or link.get("from", "").startswith(":"):
            continue
        inside = []
        while lane is not None and lane not in inside:
            inside.append(lane)
            lane = following.get(lane)
        yield f"{link.get('from')}_{link.get('fromLane')}", inside, f"{link.get('to')}_{link.get('toLane')}"


def _split(curve: Points, lengths_m: list[float]) -> Iterator[Points]:
    """Yield the curve in pieces that have the given shares of its length."""
    stations = arc_length(curve)
    for begin, end in pairwise(np.concatenate([[0.0], np.cumsum(lengths_m)]) / sum(lengths_m) * stations[-1]):
        between = stations[(stations > begin + 0.05) & (stations < end - 0.05)]
        yield interpolate(curve, stations, np.concatenate([[begin], between, [end]]))


def _set_shape(lane: etree._Element, shape: Points) -> None:
    lane.set("shape", " ".join(f"{x:.{_DECIMALS}f},{y:.{_DECIMALS}f}" for x, y in shape))
    lane.set("length", f"{max(length_m(shape), 0.1):.{_DECIMALS}f}")


_LATERAL_ACCELERATION_MPS2 = 3.5
"""Chosen: brisk but usual in curves; tyres hold 8 m/s² on a dry road."""
_SLOWEST_MPS = 2.0
"""Chosen: kinks of a coarse line have a curvature that no vehicle drives."""


def stated_frictions(net_path: Path) -> frozenset[float | None]:
    """Return the friction coefficients of a net's lanes, with None for lanes that have none."""
    lanes = etree.parse(net_path).getroot().iterfind("edge[@from]/lane")
    return frozenset(None if (text := lane.get("friction")) is None else float(text) for lane in lanes)


def cap_speeds(net_path: Path, friction: float | None = None) -> int:
    """Lower the speed limit of every lane of a net, in place, to √(a / κ) for its sharpest curve.

    SUMO slows down for turns inside junctions only, never in the curves of a road: a quarter of its cars would exceed
    the friction circle there. On a road with a stated friction, drivers use at most half of the tyres' grip. Comments
    (netconvert's date and paths) are left out of the file.

    Returns:
        The number of changed lanes.
    """
    lateral_mps2 = min(_LATERAL_ACCELERATION_MPS2, math.inf if friction is None else friction * GRAVITY_MPS2 / 2)
    root = etree.parse(net_path, etree.XMLParser(remove_comments=True)).getroot()
    changed = 0
    for lane in root.iter("lane"):
        curvature = maximum_curvature(shape_of(lane))
        if curvature > 0 and float(lane.get("speed", "0")) ** 2 * curvature > lateral_mps2:
            lane.set("speed", f"{max(_SLOWEST_MPS, math.sqrt(lateral_mps2 / curvature)):.2f}")
            changed += 1
    net_path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n")
    return changed
