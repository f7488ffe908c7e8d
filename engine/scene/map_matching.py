"""Map matching: which lanelets a recorded vehicle drove on.

The module runs a Viterbi search over the lanelets near the sampled positions of a track. Each lanelet has a cost for
the distance outside it and from its centre line, and for the difference in heading. Each step has a cost that depends
on whether the next lanelet follows or is adjacent. Costs are plain numbers, tuned by hand on recorded traffic.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..commonroad import Track
from ..geometry import Points, Values, wrap_angles
from ..network import NetLayout
from ..vehicles import HEADING_MPS
from .poses import COST_OF_NO_DIFFERENCE, COST_PER_M_LATERAL, COST_PER_M_OUTSIDE, COST_PER_RAD, REACH_M

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

_LARGEST_TURN_RAD = 1.2
"""A moving vehicle is not on lanelets that it is turned from by more (chosen: 69°, short of driving across it)."""
_SAMPLES = 40
"""Approximate number of examined positions per track (chosen): one every half second of a usual recording."""
_COST_OF_A_STEP, _COST_OF_A_LEAP = 0.3, 8.0
"""Costs (chosen): a jump to a lanelet that neither follows nor is adjacent costs as much as 2.7 m outside."""
_MOST_COMPARED = 64
"""Number of lanelets per pose that are compared with the next pose's (chosen): only stacked lanelets exceed it."""


@dataclass(frozen=True)
class LaneMatch:
    """Lanelets of a track: at array index ``indices[i]`` (ascending) the vehicle is on ``lanelets[i]``."""

    indices: tuple[int, ...]
    lanelets: tuple[int, ...]

    def at(self, index: int) -> int:
        """Return the lanelet at an array index of the track: the lanelet of the last sample up to this index."""
        place = int(np.searchsorted(self.indices, index, side="right")) - 1
        return self.lanelets[max(place, 0)]

    def at_each(self, count: int) -> list[int]:
        """Return the lanelets at the first ``count`` array indices of the track."""
        places = np.searchsorted(self.indices, np.arange(count), side="right") - 1
        return [self.lanelets[place] for place in np.maximum(places, 0).tolist()]

    @property
    def sequence(self) -> tuple[int, ...]:
        """The lanelets in order without consecutive repeats."""
        return tuple(key for place, key in enumerate(self.lanelets) if place == 0 or self.lanelets[place - 1] != key)


@dataclass(frozen=True)
class MapMatcher:
    """The drivable lanelets of a network, ready for queries by position."""

    layout: NetLayout
    keys: tuple[int, ...]
    polygons: tuple[Any, ...]
    tree: Any
    related: dict[int, frozenset[int]]

    @classmethod
    def of(cls, layout: NetLayout, network: "LaneletNetwork") -> "MapMatcher":
        """Index the lanelets of a network."""
        from shapely import STRtree, prepare

        keys = tuple(layout.table.lanes)
        polygons = []
        for key in keys:
            polygon = network.find_lanelet_by_id(key).polygon.shapely_object
            polygons.append(polygon if polygon.is_valid else polygon.buffer(0))
        prepare(polygons)
        related = {key: _related(layout, key) for key in keys}
        return cls(layout, keys, tuple(polygons), STRtree(polygons), related)

    def area(self, lanelet_id: int) -> Any:
        """Return shapely's polygon of a drivable lanelet, valid regardless of its bounds."""
        return self.polygons[self._place_of[lanelet_id]]

    @cached_property
    def _place_of(self) -> dict[int, int]:
        return {key: place for place, key in enumerate(self.keys)}

    def match(self, track: Track) -> LaneMatch | None:
        """Return the most likely lanelets of a track; None if it is never near a lanelet in its direction."""
        return self.match_all({track.obstacle_id: track}).get(track.obstacle_id)

    def match_all(self, tracks: Mapping[int, Track]) -> dict[int, LaneMatch]:
        """Return the matches of many tracks by key, computed together; tracks never near a lanelet are left out."""
        if not tracks:
            return {}
        samples = {key: _samples(len(track.positions)) for key, track in tracks.items()}
        at = [(track, samples[key]) for key, track in tracks.items()]
        poses = [(track.positions[some], track.headings_rad[some], track.speeds_mps[some]) for track, some in at]
        near = iter(self._near(*(np.concatenate(column) for column in zip(*poses, strict=True))))
        matches = {}
        for key, indices in samples.items():
            of_track = itertools.islice(near, len(indices))
            candidates = [
                (at, _likeliest(lanelets)) for at, lanelets in zip(indices, of_track, strict=True) if lanelets
            ]
            if candidates:
                best = self._best([lanelets for _, lanelets in candidates])
                matches[key] = LaneMatch(tuple(at for at, _ in candidates), best)
        return matches

    def near(self, position: Points, heading_rad: float, speed_mps: float) -> list[tuple[int, float]]:
        """Return the lanelets within reach of a pose and their costs, by ascending id; the heading counts in motion."""
        return self._near(position[None], np.array([heading_rad]), np.array([speed_mps]))[0]

    def near_as_well(self, position: Points, heading_rad: float, speed_mps: float, key: int) -> tuple[int, ...]:
        """Return lanelets that fit a pose nearly as well as the given lanelet, best first: they overlap at the pose."""
        costs = dict(self.near(position, heading_rad, speed_mps))
        most = costs.get(key, 0.0) + COST_OF_NO_DIFFERENCE
        others = sorted((cost, other) for other, cost in costs.items() if other != key and cost <= most)
        return tuple(other for _, other in others)

    def _near(self, positions: Points, headings_rad: Values, speeds_mps: Values) -> list[list[tuple[int, float]]]:
        """Return lanelets and costs, as ``near`` does, for n poses together."""
        import shapely

        points = shapely.points(positions)
        near: list[list[tuple[int, float]]] = [[] for _ in positions]
        # Box queries are ten times as fast as distances, which are needed below anyway.
        (left, below), (right, above) = (positions - REACH_M).T, (positions + REACH_M).T
        nearby, places = self.tree.query(shapely.box(left, below, right, above))
        order = np.lexsort((nearby, places))
        reached, begins = np.unique(places[order], return_index=True)
        for place, samples in zip(reached.tolist(), np.split(nearby[order], begins[1:]), strict=False):
            outside = _outside_m(self.polygons[place], points[samples])
            samples, outside = samples[outside <= REACH_M], outside[outside <= REACH_M]
            lateral, direction = _offsets(self.layout.table.lanes[self.keys[place]].center, positions[samples])
            turn = np.abs(wrap_angles(direction - headings_rad[samples]))
            costs = COST_PER_M_OUTSIDE * outside + COST_PER_M_LATERAL * lateral + COST_PER_RAD * turn
            fits = (turn <= _LARGEST_TURN_RAD) | (speeds_mps[samples] <= HEADING_MPS)
            for sample, cost in zip(samples[fits].tolist(), costs[fits].tolist(), strict=True):
                near[sample].append((self.keys[place], cost))
        return near

    def _best(self, candidates: list[list[tuple[int, float]]]) -> tuple[int, ...]:
        """Return the cheapest sequence that has one candidate per sample."""
        if all(len(lanelets) == 1 for lanelets in candidates):
            return tuple(lanelets[0][0] for lanelets in candidates)
        costs = [cost for _, cost in candidates[0]]
        back: list[list[int]] = []
        for before, current in itertools.pairwise(candidates):
            cheapest = [self._cheapest(costs, before, new) for new, _ in current]
            back.append([place for _, place in cheapest])
            costs = [least + cost for (least, _), (_, cost) in zip(cheapest, current, strict=True)]
        place = costs.index(min(costs))
        chosen = [candidates[-1][place][0]]
        for layer in range(len(back) - 1, -1, -1):
            place = back[layer][place]
            chosen.append(candidates[layer][place][0])
        return tuple(reversed(chosen))

    def _cheapest(self, costs: list[float], before: list[tuple[int, float]], new: int) -> tuple[float, int]:
        """Return the lowest cost of reaching a lanelet from the previous lanelets, and the best one's index."""
        least, place = math.inf, 0
        for at, (old, _) in enumerate(before):
            cost = costs[at]
            if old != new:
                cost += _COST_OF_A_STEP if new in self.related[old] else _COST_OF_A_LEAP
            if cost < least:
                least, place = cost, at
        return least, place


def _outside_m(polygon: Any, points: NDArray[np.object_]) -> Values:
    """Return distances (n,) in m of points from a prepared polygon; most points are inside, which is quick to test."""
    import shapely

    outside_m = np.zeros(len(points))
    outside = np.flatnonzero(~shapely.intersects(polygon, points))
    outside_m[outside] = shapely.distance(polygon, points[outside])
    return outside_m


def _likeliest(lanelets: list[tuple[int, float]]) -> list[tuple[int, float]]:
    """Return the cheapest lanelets of a pose, in the given order; only they are compared with the next pose's."""
    if len(lanelets) <= _MOST_COMPARED:
        return lanelets
    return sorted(sorted(lanelets, key=lambda one: (one[1], one[0]))[:_MOST_COMPARED])


def _samples(count: int) -> list[int]:
    indices = list(range(0, count, max(1, count // _SAMPLES)))
    return indices if indices[-1] == count - 1 else [*indices, count - 1]


def _related(layout: NetLayout, key: int) -> frozenset[int]:
    """Return the lanelets that a vehicle may be on one sample later: followers, neighbours, and their followers."""
    following = layout.table.successors
    lane = layout.table.lanes[key]
    adjacent = [other for other in (lane.left, lane.right) if other is not None and other in layout.table.lanes]
    direct = {*following[key], *adjacent}
    return frozenset(direct | {after for other in direct for after in following[other]})


def _offsets(center: Points, points: Points) -> tuple[Values, Values]:
    """Return, for n points, the distance to a polyline in m and its heading in rad at the nearest point, each (n,)."""
    step_x, step_y = np.diff(center, axis=0).T
    # Coordinate by coordinate, because numpy is slow at reducing axes of two.
    away_x, away_y = points[:, :1] - center[:-1, 0], points[:, 1:] - center[:-1, 1]
    squared = np.maximum(step_x * step_x + step_y * step_y, 1e-12)
    along = np.clip((away_x * step_x + away_y * step_y) / squared, 0.0, 1.0)
    away_x -= along * step_x
    away_y -= along * step_y
    distances = np.sqrt(away_x * away_x + away_y * away_y)
    nearest = distances.argmin(axis=1)
    heading = np.arctan2(step_y[nearest], step_x[nearest])
    return distances[np.arange(len(points)), nearest], heading


def straightness(first: Points, second: Points) -> float:
    """Return the cosine between the end of one polyline and the start of another, rounded to a tenth."""
    one, two = first[-1] - first[-2], second[1] - second[0]
    norm = float(np.linalg.norm(one) * np.linalg.norm(two))
    return round(float(one @ two) / max(norm, 1e-9), 1) if math.isfinite(norm) else 0.0
