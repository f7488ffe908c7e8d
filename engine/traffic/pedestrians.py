"""Pedestrians in SUMO: their walks, their insertion, and their recorded motion.

A walk leads along a pavement to a junction, most often over a crossing there, and on along the pavements beyond it.
People start near enough to their crossing to be on it during the recording; SUMO's model (striping) moves them, stops
them at red lights and where vehicles have priority, and vehicles stop for them at crossings.
"""

import math
import random
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..geometry import BoxTrack, Points, Values, first_overlaps, gaussian
from ..network import Crossing, Pavement, WalkNet, Walkway
from ..vehicles import PEDESTRIAN, Motion
from .motions import DECIMALS, GeneratedVehicle
from .simulation import WARM_UP_S
from .sumo import Sumo, heading_of_angle_rad, vehicle_type

WALKING_MPS, SPEED_SPREAD = 1.34, 0.19
"""Mean free speed of pedestrians and its standard deviation as a share of it (0.26 m/s)."""
WALKING_SOURCE = "Weidmann, Transporttechnik der Fussgänger, ETH Zürich, 1993"
_SLOWEST, _FASTEST = 0.6, 1.6
"""Bounds of a person's free speed relative to the mean (chosen)."""
CROSSING_SHARE = 0.75
"""Share of the people who walk over a crossing (chosen); the others walk along a pavement."""
INSERTED_S = WARM_UP_S - 4.0
"""When people start to walk: shortly before step 0, and long enough to have found their pace (chosen)."""
FIRST_AT_S, LAST_AT_SHARE = 0.0, 0.35
"""Earliest and latest time after step 0, the latter as a share of the recording, at which a person reaches the corner
before the crossing (chosen): the corner, and vehicles or red lights, take some more time.
"""
HALF_AS_LIKELY_M = 40.0
"""A crossing this much farther from the centre of the site is half as likely to be chosen (chosen)."""
MOST_EDGES = 12
"""Largest number of pavements of a walk (chosen)."""
_MARGIN_M = 0.3
"""Least distance of a start from the end of a pavement (chosen)."""
_SMOOTHED_STEPS = 3.0
"""Standard deviation of the smoothing of tracks in steps (chosen): SUMO's people step sideways at once."""
_JOINT_M, _KERB_M = 0.05, 0.03
"""Walkways touch with a gap up to twice the first; centres of people keep the second from their edge (chosen)."""
_MOVED_M = 0.02
"""A person who moves less in a step has no heading (chosen)."""


@dataclass(frozen=True)
class Walk:
    """A walk along edges, from a point on the first edge to a point on the last, in m from the start of the road."""

    key: str
    edges: tuple[str, ...]
    begin_m: float
    end_m: float


def plan_walks(
    net: WalkNet, count: int, middle: Points, *, duration_s: float, choice: random.Random
) -> tuple[Walk, ...]:
    """Return ``count`` walks that last through a recording if the pavements allow it.

    Crossings near ``middle`` (2,) are chosen more often. If there are none, people walk along pavements.
    """
    crossings = [one for one in net.crossings.values() if _approaches(net, one)]
    weights = [0.5 ** (float(np.linalg.norm(one.line.mean(axis=0) - middle)) / HALF_AS_LIKELY_M) for one in crossings]
    along = sorted(net.pavements)
    metres = [net.pavements[edge].length_m for edge in along]
    walks = []
    for number in range(count):
        key = f"pedestrian{number:03d}"
        if crossings and number < math.ceil(CROSSING_SHARE * count):
            crossing = choice.choices(crossings, weights)[0]
            walks.append(_walk_over(net, crossing, key, duration_s, choice))
        elif along:
            edge = choice.choices(along, metres)[0]
            walks.append(_walk_along(net, net.pavements[edge], key, duration_s, choice))
    return tuple(walks)


def _approaches(net: WalkNet, crossing: Crossing) -> list[tuple[Pavement, str, Pavement]]:
    """Return triples: a pavement that leads to a crossing, the corner where they meet, and a pavement beyond it.

    Pairs of pavements that also meet at another junction (the two sides of one road) are a last resort: SUMO would
    connect them at the second junction.
    """
    approaches = []
    for near, far in (crossing.corners, crossing.corners[::-1]):
        behind = net.pavements_at(far)
        approaches += [
            (before, near, after) for before in net.pavements_at(near) for after in behind if after != before
        ]
    return [
        approach for approach in approaches if not _meet_elsewhere(approach[0], approach[2], _junction(approach[1]))
    ] or approaches


def _meet_elsewhere(one: Pavement, other: Pavement, junction: str) -> bool:
    """Return True if two pavements that meet at a junction also meet at another junction."""
    ends = [{_junction(end) for end in (way.begins_at, way.ends_at) if end is not None} for way in (one, other)]
    return bool((ends[0] & ends[1]) - {junction})


def _junction(corner: str) -> str:
    """Return the junction that a corner belongs to."""
    return corner.rpartition("_w")[0]


def _walk_over(net: WalkNet, crossing: Crossing, key: str, duration_s: float, choice: random.Random) -> Walk:
    before, corner, after = choice.choice(_approaches(net, crossing))
    at_s = choice.uniform(FIRST_AT_S, max(FIRST_AT_S, LAST_AT_SHARE * duration_s))
    back_m = min(WALKING_MPS * (WARM_UP_S - INSERTED_S + at_s), before.length_m - _MARGIN_M)
    back_m = max(back_m, _MARGIN_M)
    begin_m = before.length_m - back_m if before.ends_at == corner else back_m
    far = crossing.corners[1] if crossing.corners[0] == corner else crossing.corners[0]
    return _onward(net, Walk(key, (before.edge_id, after.edge_id), begin_m, 0.0), far, duration_s, choice)


def _walk_along(net: WalkNet, pavement: Pavement, key: str, duration_s: float, choice: random.Random) -> Walk:
    begin_m = choice.uniform(_MARGIN_M, max(pavement.length_m - _MARGIN_M, _MARGIN_M))
    start = choice.choice((pavement.begins_at, pavement.ends_at))
    return _onward(net, Walk(key, (pavement.edge_id,), begin_m, 0.0), start, duration_s, choice)


def _onward(net: WalkNet, walk: Walk, entered_at: str | None, duration_s: float, choice: random.Random) -> Walk:
    """Return the walk extended by pavements that follow around the last far corner, without another crossing.

    It ends where even the fastest people do not arrive in time: from the far end of a long pavement, a different path
    may be shorter.
    """
    wanted_m = _FASTEST * WALKING_MPS * (duration_s + WARM_UP_S - INSERTED_S)
    edges, walked_m = list(walk.edges), 0.0
    while True:
        last = net.pavements[edges[-1]]
        ahead = last.begins_at == entered_at
        corner = last.ends_at if ahead else last.begins_at
        onward = [] if corner is None or corner in net.open_ends else net.pavements_at(corner)
        onward = [one for one in onward if one.edge_id not in edges]
        if not onward or len(edges) >= MOST_EDGES or walked_m + last.length_m >= wanted_m:
            most_m = max(last.length_m - _MARGIN_M, 0.0)
            along_m = most_m if len(edges) == 1 else min(wanted_m - walked_m, most_m)
            return replace(walk, edges=tuple(edges), end_m=along_m if ahead else last.length_m - along_m)
        walked_m += last.length_m
        edges.append(choice.choice(onward).edge_id)
        entered_at = corner


def _pedestrian_type() -> str:
    """Return the ``vType`` element for people."""
    return vehicle_type(
        PEDESTRIAN.name,
        vClass=PEDESTRIAN.sumo_class,
        length=f"{PEDESTRIAN.length_m:g}",
        width=f"{PEDESTRIAN.width_m:g}",
        minGap=f"{PEDESTRIAN.minimum_gap_m:g}",
        maxSpeed=f"{PEDESTRIAN.maximum_speed_mps:g}",
        desiredMaxSpeed=f"{WALKING_MPS:g}",
        speedFactor=f"normc(1,{SPEED_SPREAD:g},{_SLOWEST:g},{_FASTEST:g})",
    )


@dataclass
class _WalkRecording:
    """The recorded data of a person: the first step, fronts, headings from SUMO and edges."""

    first_step: int
    fronts: list[tuple[float, float]] = field(default_factory=list)
    headings_rad: list[float] = field(default_factory=list)
    edges: list[str] = field(default_factory=list)


class Pedestrians:
    """Puts people onto the pavements of a simulation that starts at step 1, and records them.

    ``ground``: the walkways; SUMO leads people around corners in curves that cut across the kerb.
    """

    def __init__(self, walks: Sequence[Walk], ground: Sequence[Walkway], step_s: float) -> None:
        self._walks, self._ground, self._step_s = walks, ground, step_s
        self._begin, self._start = round(INSERTED_S / step_s), round(WARM_UP_S / step_s)
        self._seen: dict[str, _WalkRecording] = {}
        self.sumo_type = _pedestrian_type()

    def before_step(self, sumo: Sumo, step: int) -> None:
        """Insert all people at the right step."""
        if step == self._begin:
            for walk in self._walks:
                sumo.add_pedestrian(walk.key, walk.edges, (walk.begin_m, walk.end_m), PEDESTRIAN.name)

    def after_step(self, sumo: Sumo, step: int) -> None:
        """Record where all people are."""
        if step < self._begin:
            return
        for key in sumo.pedestrians():
            seen = self._seen.setdefault(key, _WalkRecording(step))
            seen.fronts.append(sumo.pedestrian_front(key))
            seen.headings_rad.append(heading_of_angle_rad(sumo.pedestrian_angle_deg(key)))
            seen.edges.append(sumo.pedestrian_edge(key))

    def people(self) -> tuple["WalkedPerson", ...]:
        """Return the people who are present at step 0; those who are on a crossing in the recording come first."""
        found = []
        ground = _Ground(self._ground)
        for walk in self._walks:
            seen = self._seen.get(walk.key)
            if seen is None or seen.first_step + len(seen.fronts) <= self._start + 1:
                continue
            found.append(_person(walk, seen, self._start - seen.first_step, self._step_s, ground))
        return tuple(sorted(found, key=lambda person: (not person.crosses, person.body.vehicle_id)))


@dataclass(frozen=True)
class WalkedPerson:
    """A person in the form of generated road users, and whether they are on a crossing during the recording."""

    body: GeneratedVehicle
    crosses: bool


def _person(walk: Walk, seen: _WalkRecording, lead_in: int, step_s: float, ground: "_Ground") -> WalkedPerson:
    headings = np.unwrap(np.array(seen.headings_rad))
    fronts = np.array(seen.fronts)
    along = np.stack([np.cos(headings), np.sin(headings)], axis=1)
    centers = ground.nearest(fronts - PEDESTRIAN.length_m / 2 * along)
    centers = ground.nearest(gaussian(centers, _SMOOTHED_STEPS))
    motion = walked_motion(centers, float(headings[0]), step_s, lead_in)
    crosses = any("_c" in edge and edge.startswith(":") for edge in seen.edges[lead_in:])
    return WalkedPerson(GeneratedVehicle(walk.key, PEDESTRIAN, motion, True), crosses)


class _Ground:
    """The walkways as one area, shrunk slightly away from the kerb."""

    def __init__(self, walkways: Sequence[Walkway]) -> None:
        from shapely import Polygon, make_valid, prepare, union_all

        outlines = [make_valid(Polygon(np.concatenate([way.right, way.left[::-1]]))) for way in walkways]
        joined = union_all([outline.buffer(_JOINT_M) for outline in outlines]).buffer(-_JOINT_M - _KERB_M)
        self._area = joined
        prepare(self._area)

    def nearest(self, points: Points) -> Points:
        """Return the points (n, 2), with those off the walkways moved onto them."""
        from shapely import Point, contains_xy
        from shapely.ops import nearest_points

        moved = points.copy()
        for index in np.flatnonzero(~contains_xy(self._area, points[:, 0], points[:, 1])):
            on_way = nearest_points(self._area, Point(points[index]))[0]
            moved[index] = on_way.x, on_way.y
        return moved


def walked_motion(centers: Points, first_heading_rad: float, step_s: float, lead_in: int = 0) -> Motion:
    """Return the motion along centres (n, 2) from a given index; a standing person keeps their heading."""
    moved = np.gradient(centers, axis=0) if len(centers) > 1 else np.zeros_like(centers)
    length = np.hypot(moved[:, 0], moved[:, 1])
    headings = _fill_forward(np.arctan2(moved[:, 1], moved[:, 0]), length > _MOVED_M, first_heading_rad)
    turned = gaussian(np.unwrap(headings), _SMOOTHED_STEPS)
    turned = np.arctan2(np.sin(turned), np.cos(turned))
    speeds = length / step_s
    accelerations = np.gradient(speeds, step_s) if len(speeds) > 1 else np.zeros_like(speeds)
    return Motion(*(value[lead_in:].round(DECIMALS) for value in (centers, turned, speeds, accelerations)))


def _fill_forward(values: Values, known: "np.ndarray[tuple[int], np.dtype[np.bool_]]", first: float) -> Values:
    """Return the values, with unknown values replaced by the last known value before."""
    filled, last = [], first
    for value, is_known in zip(values.tolist(), known.tolist(), strict=True):
        last = value if is_known else last
        filled.append(last)
    return np.array(filled)


def apart(people: Iterable[WalkedPerson], vehicles: Sequence[GeneratedVehicle]) -> tuple[WalkedPerson, ...]:
    """Return the people, in order, who overlap no vehicle and no earlier person at any step."""
    everyone = list(people)
    bodies: list[BoxTrack] = [vehicle.body for vehicle in vehicles] + [person.body.body for person in everyone]
    first = len(vehicles)
    meets: dict[int, set[int]] = {}
    for pair in first_overlaps(bodies):
        meets.setdefault(pair.second, set()).add(pair.first)
    kept: list[int] = []
    for index in range(first, len(bodies)):
        if not any(other < first or other in kept for other in meets.get(index, ())):
            kept.append(index)
    return tuple(everyone[index - first] for index in kept)
