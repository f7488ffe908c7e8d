"""What the motion of touched vehicles shows in the file that was written, whatever the report says of it."""

from typing import TYPE_CHECKING

import numpy as np
import shapely

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.evals.modification_reach import beside, length_m

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

BESIDE_M, ON_ROUTE_SHARE = 1.0, 0.95

LINE_M = 0.5
"""A vehicle whose bumper is so little past the end of a lanelet stands at it."""


def fronts(track: Track) -> Points:
    """Front bumpers (n, 2) in m."""
    ahead = np.column_stack([np.cos(track.headings_rad), np.sin(track.headings_rad)])
    return np.asarray(track.positions + track.length_m / 2 * ahead)


def arrives_on(network: "LaneletNetwork", track: Track, begin: int, targets: set[int]) -> bool:
    """Whether the vehicle's front half gets onto one of the lanelets, and then stays there or drives on from it.

    A bumper over the line is no arrival: more than half a metre of the front half (half its length of a shorter
    lanelet) is on the lanelet, or on those that it alone leads to. ``begin``: index of the track from which on it was
    driven. A vehicle that arrives does not vanish: whoever is on the target early drives on along what follows it.
    """
    there, centres = fronts(track)[max(begin, 0) :], track.positions[max(begin, 0) :]
    # A lanelet may be shorter than one step of the way, so that the way between the steps counts and not their ends.
    steps = shapely.linestrings(np.stack([np.vstack([there[:1], there[:-1]]), there, centres], axis=1))
    halves = shapely.linestrings(np.stack([there, centres], axis=1))
    for key in sorted(targets):
        touching = np.flatnonzero(shapely.intersects(_area(network, (key,)), steps))
        if not len(touching):
            continue
        first, least_m = int(touching[0]), min(LINE_M, length_m(network.find_lanelet_by_id(key)) / 2)
        over_m = shapely.length(shapely.intersection(_area(network, _only_through(network, key)), halves[first:]))
        if (over_m > least_m).any() and follows(network, _onwards(network, key), there[first:]):
            return True
    return False


def follows(network: "LaneletNetwork", lanelets: tuple[int, ...], positions: Points) -> bool:
    """Whether positions (n, 2) lie on the lanelets or on their neighbours of the same direction."""
    way = [network.find_lanelet_by_id(key) for key in lanelets]
    every = [*way, *(network.find_lanelet_by_id(key) for one in way for key in beside(one))]
    area = shapely.union_all([one.polygon.shapely_object.buffer(BESIDE_M) for one in every])
    return float(np.mean(shapely.contains_xy(area, positions[:, 0], positions[:, 1]))) >= ON_ROUTE_SHARE


def handover_errors(old: Track, new: Track, from_step: int, step_s: float) -> tuple[float, float] | None:
    """What the hand-over adds to the motion: m beyond v·dt, and m/s; None where nothing was written after it.

    The state at the hand-over is held against the recording, the one after it against that state.
    """
    before, here = old.index_at(from_step), new.index_at(from_step)
    if before is None or here is None or here + 1 >= len(new.positions):
        return None
    speeds, moved = new.speeds_mps[here : here + 2], np.diff(new.positions[here : here + 2], axis=0)[0]
    jumps = (
        float(np.linalg.norm(new.positions[here] - old.positions[before])),
        float(np.linalg.norm(moved)) - float(speeds.max()) * step_s,
    )
    steps = abs(float(speeds[0] - old.speeds_mps[before])), abs(float(speeds[1] - speeds[0]))
    return max(*jumps, 0.0), max(steps)


def _area(network: "LaneletNetwork", lanelets: tuple[int, ...]) -> shapely.Geometry:
    areas = [network.find_lanelet_by_id(key).polygon.shapely_object for key in lanelets]
    return shapely.union_all([shapely.make_valid(area) for area in areas])


def _only_through(network: "LaneletNetwork", key: int) -> tuple[int, ...]:
    """A lanelet and those after it that no other way leads to."""
    found, queue = [key], [key]
    while queue:
        after = [network.find_lanelet_by_id(one) for one in network.find_lanelet_by_id(queue.pop()).successor]
        more = [int(one.lanelet_id) for one in after if set(one.predecessor) <= set(found)]
        queue += [one for one in more if one not in found]
        found += [one for one in more if one not in found]
    return tuple(found)


def _onwards(network: "LaneletNetwork", key: int) -> tuple[int, ...]:
    """A lanelet and all that follow it; where one ends without a successor, those that follow the ones beside it."""
    found, queue = [key], [key]
    while queue:
        lanelet = network.find_lanelet_by_id(queue.pop())
        ends = [lanelet] if lanelet.successor else [network.find_lanelet_by_id(one) for one in beside(lanelet)]
        after = [int(one) for end in ends for one in end.successor]
        queue += [one for one in after if one not in found]
        found += [one for one in after if one not in found]
    return tuple(found)
