"""How SUMO's drivers see somebody who walks across their lanes.

To a lane-based driver, nobody is on a lane but who drives along it: a walker stands for as long as he is on a lane, and
a little before, as an obstacle in its middle.
"""

from dataclasses import replace

import numpy as np

from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.geometry.polyline import point_at, project
from plannerforge.engine.scenarios.tracks import Track

FORESIGHT_S = 2.0
"""A driver sees that somebody is about to step onto the lane."""

SHADOWS_PER_WALKER = 1000


def walker_shadows(scene: Scene, walker: Track) -> tuple[tuple[Track, int], ...]:
    """Standing tracks, one for each lanelet that the walker is on (in their order), and those lanelets."""
    on: dict[int, list[int]] = {}
    for index, found in enumerate(scene.network.find_lanelet_by_position(list(walker.positions))):
        for key in sorted(int(one) for one in found):
            if key in scene.layout.table.lanes:
                on.setdefault(key, []).append(index)
    return tuple(
        (_shadow(scene, walker, key, (indices[0], indices[-1]), number), key)
        for number, (key, indices) in enumerate(on.items())
    )


def walker_of(shadow_id: int) -> int:
    """The id of the walker for whom a standing track stands."""
    return -shadow_id // SHADOWS_PER_WALKER


def _shadow(scene: Scene, walker: Track, lanelet_id: int, span: tuple[int, int], number: int) -> Track:
    begin = max(span[0] - round(FORESIGHT_S / scene.step_s), 0)
    count = span[1] - begin + 1
    line = scene.layout.table.lanes[lanelet_id].center
    station, _ = project(line, walker.positions[(span[0] + span[1]) // 2])
    point, heading = point_at(line, station)
    return replace(
        walker,
        obstacle_id=-(walker.obstacle_id * SHADOWS_PER_WALKER + number),
        first_step=walker.first_step + begin,
        positions=np.repeat(point[None], count, axis=0),
        headings_rad=np.full(count, heading),
        speeds_mps=np.zeros(count),
    )
