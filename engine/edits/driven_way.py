"""The lanelets that a vehicle drives over: those of SUMO's lanes that the motion which is written gets onto."""

from collections.abc import Iterable
from itertools import groupby

import numpy as np
import shapely

from plannerforge.engine.edits.changes import DrivePlan
from plannerforge.engine.edits.handover import TouchedTrack
from plannerforge.engine.edits.scene import Scene

SHORT_M = 5.0
"""A vehicle may be past a lanelet shorter than this within one step, so that no step shows it there."""

LOOK_BACK = 4

ON_IT_M = 0.5
"""So much of a vehicle's front half is on a lanelet, or half of a shorter one's length: with less it is at its line."""


def driven_lanelets(scene: Scene, track: TouchedTrack, plan: DrivePlan) -> tuple[int, ...]:
    """Lanelets that the driven part gets onto, in order, as SUMO assigns its lanes."""
    first = plan.lanelets[:1] if track.first_step == plan.start.first_step else ()
    found = lanelets_passed(scene, track.lanes, first)
    over = plan.steering_over
    if over is not None and over.lanelet_id in found:
        found = first + found[found.index(over.lanelet_id) :]
    return found[:1] + _gone_onto(scene, track, found[1:])


def driven_since(scene: Scene, track: TouchedTrack, step: int) -> tuple[int, ...]:
    """Lanelets that a vehicle gets onto from a step on, in order."""
    begin = max(step - track.first_step, 0)
    return _gone_onto(scene, track, lanelets_passed(scene, track.lanes[begin:]), begin)


def lanelets_passed(scene: Scene, lanes: Iterable[str], first: Iterable[int] = ()) -> tuple[int, ...]:
    """The lanelets of SUMO's lanes in order, after those of ``first``, with those that are leapt over in one step."""
    found = list(first)
    for lane, _ in groupby(lanes):
        for key in scene.layout.lanelets_of_lane.get(lane, ()):
            if key not in found[-LOOK_BACK:]:
                found += [*_leapt_over(scene, found[-1:], key), key]
    return tuple(found)


def _gone_onto(scene: Scene, track: TouchedTrack, lanelets: tuple[int, ...], begin: int = 0) -> tuple[int, ...]:
    """The lanelets without those at the end that the vehicle, from an index of its motion on, does not get onto."""
    count = len(lanelets)
    while count and not _gets_onto(scene, track, lanelets[count - 1], begin):
        count -= 1
    return lanelets[:count]


def _gets_onto(scene: Scene, track: TouchedTrack, lanelet_id: int, begin: int) -> bool:
    """Whether more of a vehicle's front half than its bumper is on a lanelet at any step."""
    area = scene.matcher.area(lanelet_id)
    least_m = min(ON_IT_M, scene.lanelet_graph.length_m[lanelet_id] / 2)
    halves = np.stack([track.fronts, track.motion.positions], axis=1)[begin:]
    return any(
        bool((shapely.length(shapely.intersection(area, shapely.linestrings(part))) > least_m).any())
        for part in (halves[-1:], halves)
    )


def _leapt_over(scene: Scene, before: list[int], after: int) -> tuple[int, ...]:
    graph = scene.lanelet_graph
    if not before or after in (*graph.successors.get(before[0], ()), *graph.neighbours.get(before[0], ())):
        return ()
    between = (graph.shortest_route(before, [after]) or ())[1:-1]
    return between if all(graph.length_m[key] < SHORT_M for key in between) else ()
