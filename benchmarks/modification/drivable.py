"""``make bench-drivable``: how many recorded road users an edit can drive, and why it cannot drive the others.

Keys: ``files``, ``unreadable`` (files), ``vehicles`` (recorded, of kinds that can be driven), and ``drivable_share``.
The rest are ``off_lanelets`` (on no lanelet), ``against_lanes`` (from one lanelet to another in the opposite
direction), ``beside_lanes`` (to a lanelet that starts next to or near the end of the first) and ``far_lanes`` (farther
away).
"""

import math
from collections import Counter
from pathlib import Path

import numpy as np

from plannerforge.engine.commonroad import read_scenario
from plannerforge.engine.cosimulation import not_drivable
from plannerforge.engine.scene import NOT_DRIVEN, Scene
from plannerforge.schemas.errors import PlannerForgeError

from ..harness import print_figures, process_pool, scenario_arguments, scenario_files

_PROCESSES = 2
_OPPOSITE_RAD = 2.1
"""Lanelets with a larger difference of direction are opposite (chosen)."""
_NEAR_M = 20.0
"""A lanelet that starts this close to another's end is next to it (chosen: two lanes and a junction's corner)."""
_CAUSES = ("off_lanelets", "against_lanes", "beside_lanes", "far_lanes")


def counts(files: list[Path]) -> Counter[str]:
    """Count files, vehicles and causes over the files."""
    total: Counter[str] = Counter(files=len(files))
    with process_pool(_PROCESSES) as pool:
        for of_file in pool.map(_counts_of, files):
            total.update(of_file)
    return total


def _counts_of(file: Path) -> Counter[str]:
    try:
        scene = Scene.of(read_scenario(file))
    except PlannerForgeError:
        return Counter(unreadable=1)
    driven = [key for key, track in scene.tracks.items() if track.kind not in NOT_DRIVEN]
    return Counter(vehicles=len(driven)) + Counter(_cause(scene, key) for key in driven if not_drivable(scene, key))


def _cause(scene: Scene, vehicle_id: int) -> str:
    if vehicle_id not in scene.matches:
        return "off_lanelets"
    sequence = scene.matches[vehicle_id].sequence
    before, after = scene.edge_graph.first_gap(sequence) or (sequence[0], sequence[-1])
    ending, starting = (scene.layout.table.lanes[key].center for key in (before, after))
    (from_x, from_y), (to_x, to_y) = ending[-1] - ending[-2], starting[1] - starting[0]
    if abs(math.remainder(math.atan2(from_y, from_x) - math.atan2(to_y, to_x), math.tau)) > _OPPOSITE_RAD:
        return "against_lanes"
    return "beside_lanes" if float(np.linalg.norm(ending[-1] - starting[0])) < _NEAR_M else "far_lanes"


if __name__ == "__main__":
    folder, limit = scenario_arguments(__doc__)
    counted = counts(scenario_files(folder, limit))
    undrivable = sum(counted[cause] for cause in _CAUSES)
    print_figures(
        "Recorded road users that edits can drive",
        {
            "files": counted["files"],
            "unreadable": counted["unreadable"],
            "vehicles": counted["vehicles"],
            "drivable_share": round(1 - undrivable / max(counted["vehicles"], 1), 4),
            **{cause: counted[cause] for cause in _CAUSES},
        },
    )
