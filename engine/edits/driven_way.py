"""The lanelets that a vehicle drives over, from the lanes that SUMO shows it on."""

from collections.abc import Iterable
from itertools import groupby

from plannerforge.engine.edits.changes import DrivePlan
from plannerforge.engine.edits.handover import TouchedTrack
from plannerforge.engine.edits.scene import Scene

SHORT_M = 5.0
"""A vehicle may be past a lanelet shorter than this within one step, so that no step shows it there."""

LOOK_BACK = 4


def driven_lanelets(scene: Scene, track: TouchedTrack, plan: DrivePlan) -> tuple[int, ...]:
    """Lanelets under the front bumper of the driven part, in order, as SUMO assigns its lanes."""
    first = plan.lanelets[:1] if track.first_step == plan.start.first_step else ()
    found = lanelets_passed(scene, track.lanes, first)
    over = plan.steering_over
    if over is None or over.lanelet_id not in found:
        return found
    return first + found[found.index(over.lanelet_id) :]


def lanelets_passed(scene: Scene, lanes: Iterable[str], first: Iterable[int] = ()) -> tuple[int, ...]:
    """The lanelets of SUMO's lanes in order, after those of ``first``, with those that are leapt over in one step."""
    found = list(first)
    for lane, _ in groupby(lanes):
        for key in scene.layout.lanelets_of_lane.get(lane, ()):
            if key not in found[-LOOK_BACK:]:
                found += [*_leapt_over(scene, found[-1:], key), key]
    return tuple(found)


def _leapt_over(scene: Scene, before: list[int], after: int) -> tuple[int, ...]:
    graph = scene.lanelet_graph
    if not before or after in (*graph.successors.get(before[0], ()), *graph.neighbours.get(before[0], ())):
        return ()
    between = (graph.shortest_route(before, [after]) or ())[1:-1]
    return between if all(graph.length_m[key] < SHORT_M for key in between) else ()
