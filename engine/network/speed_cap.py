"""Lane speeds that bends allow.

SUMO slows down for turns inside junctions only, never in the bends of a road: a quarter of its cars would break the
friction circle there. The limit of every lane is lowered to what its sharpest bend allows.
"""

import math
from pathlib import Path

import numpy as np
from lxml import etree

from plannerforge.engine.geometry.polyline import maximum_curvature

LATERAL_ACCELERATION_MPS2 = 3.5
SLOWEST_MPS = 2.0


def cap_speeds(net_path: Path, lateral_acceleration_mps2: float = LATERAL_ACCELERATION_MPS2) -> int:
    """Lower lane speeds in place to √(a / κ); comments (netconvert's date and paths) are left out of the file.

    Returns:
        The number of lanes that were changed.
    """
    root = etree.parse(net_path, etree.XMLParser(remove_comments=True)).getroot()
    changed = 0
    for lane in root.iter("lane"):
        shape = [tuple(float(v) for v in point.split(",")[:2]) for point in lane.get("shape", "").split()]
        curvature = maximum_curvature(np.array(shape, dtype=float)) if len(shape) > 2 else 0.0
        if curvature > 0 and float(lane.get("speed", "0")) ** 2 * curvature > lateral_acceleration_mps2:
            lane.set("speed", f"{max(SLOWEST_MPS, math.sqrt(lateral_acceleration_mps2 / curvature)):.2f}")
            changed += 1
    net_path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n")
    return changed
