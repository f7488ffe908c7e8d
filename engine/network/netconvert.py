"""Running SUMO's netconvert: OpenStreetMap → SUMO net, and changes to a net.

The program is native code on foreign input: it gets only scanned files, runs without a shell, with a time limit, and
its output is deleted first, so that an old file is never taken for a result.
"""

import os
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from plannerforge.engine.network.junction_curves import mend_corners
from plannerforge.schemas.errors import NotPossible, WorkerTimeout

TIME_LIMIT_S = 120.0
GEOMETRY_OPTIONS = (
    "--no-turnarounds",
    "true",
    "--junctions.internal-link-detail",
    "10",
    "--junctions.corner-detail",
    "5",
    "--junctions.small-radius",
    "4",
    "--junctions.scurve-stretch",
    "1",
    "--geometry.max-angle.fix",
    "true",
    "--precision",
    "3",
)
"""Detail inside junctions makes smooth lanelets; turnarounds make hairpins that no lanelet can follow.

Junctions without conflicts get the radius of the others (1.5 m otherwise) and room for lanes that shift sideways, and
roads that fold back at one point are straightened.
"""

OSM_OPTIONS = (
    "--geometry.remove",
    "true",
    "--ramps.guess",
    "true",
    "--roundabouts.guess",
    "true",
    "--tls.guess-signals",
    "true",
    "--tls.discard-simple",
    "true",
    "--tls.join",
    "true",
    "--output.street-names",
    "true",
    "--keep-edges.by-vclass",
    "passenger,bus,truck,delivery,motorcycle,taxi",
)


@dataclass(frozen=True)
class Conversion:
    """A net that netconvert wrote, with its warnings in the order in which they came."""

    net_path: Path
    warnings: tuple[str, ...]


def convert_osm(
    osm: Path, net: Path, *, lefthand: bool, drivable_service_roads: bool = False, join_junctions: bool = True
) -> Conversion:
    """Turn an OSM extract into a SUMO net.

    Args:
        osm: the scanned extract.
        net: where to write.
        lefthand: whether traffic keeps to the left.
        drivable_service_roads: open service roads (delivery only by SUMO's default) to all vehicles.
        join_junctions: make one junction of those that lie close together.

    Raises:
        NotPossible: netconvert refuses the extract, naming its error.
    """
    import sumo

    types = [Path(sumo.SUMO_HOME) / "data" / "typemap" / "osmNetconvert.typ.xml"]
    if drivable_service_roads:
        types.append(Path(__file__).parent.parent / "maps" / "service_roads.typ.xml")
    options = ["--osm-files", str(osm), "--type-files", ",".join(str(path) for path in types), *OSM_OPTIONS]
    options += ["--lefthand", str(lefthand).lower(), "--junctions.join", str(join_junctions).lower()]
    return run_netconvert(options, net)


def remove_connections(net: Path, connections: Sequence[tuple[str, str, int, int]], scratch: Path) -> Conversion:
    """Take lane connections (from edge, to edge, from lane, to lane) out of a net, which is replaced."""
    from lxml import etree

    root = etree.Element("connections")
    for start, end, from_lane, to_lane in connections:
        ends = {"from": start, "to": end, "fromLane": str(from_lane), "toLane": str(to_lane)}
        etree.SubElement(root, "delete", ends)
    patch = scratch / "removed.con.xml"
    patch.write_bytes(etree.tostring(root))
    options = ["--sumo-net-file", str(net), "--connection-files", str(patch), "--offset.disable-normalization", "true"]
    result = run_netconvert(options, scratch / "without.net.xml")
    result.net_path.replace(net)
    return Conversion(net, result.warnings)


def run_netconvert(options: Sequence[str], net: Path) -> Conversion:
    """Run netconvert with the options and those for good junction geometry, and mend the corners that it leaves.

    Raises:
        NotPossible: it ended with an error.
        WorkerTimeout: it ran longer than the limit.
    """
    import sumo

    net.unlink(missing_ok=True)
    program = str(Path(sumo.SUMO_HOME) / "bin" / "netconvert")
    environment = {**os.environ, "SUMO_HOME": str(sumo.SUMO_HOME), "LC_ALL": "C"}
    command = [program, *options, *GEOMETRY_OPTIONS, "--output-file", str(net)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=TIME_LIMIT_S, env=environment, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise WorkerTimeout(
            f"netconvert ran longer than {TIME_LIMIT_S:.0f} s", next_step="use a smaller map"
        ) from error
    lines = done.stderr.splitlines()
    if done.returncode != 0 or not net.exists():
        reasons = [line.removeprefix("Error:").strip() for line in lines if line.startswith("Error")]
        reason = "; ".join(reasons[:3]) or f"it ended with code {done.returncode}"
        raise NotPossible(
            f"no road network can be made from this map: {reason}", next_step="choose another site or map"
        )
    mend_corners(net)
    return Conversion(net, tuple(line.removeprefix("Warning:").strip() for line in lines if line.startswith("Warning")))
