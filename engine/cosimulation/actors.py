"""Everybody in a hybrid re-simulation: who is replayed, who is driven, and from when on."""

import itertools
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from xml.sax.saxutils import quoteattr

import numpy as np

from ..commonroad import Track
from ..geometry import point_at, project
from ..network import SlowPlaces
from ..scene import LaneMatch, Scene
from ..vehicles import HARDEST_BRAKING_MPS2
from .driver import Behaviour, usual_behaviour
from .manoeuvres import Halt, Manoeuvre
from .plans import DrivePlan, Replay, class_of, placed_over

# ---------- walker_shadows
# How SUMO's drivers see somebody who walks across their lanes.
#
# To a lane-based driver, nobody is on a lane but who drives along it: a walker stands for as long as he is on a lane,
# and a little before, as an obstacle in its middle.

FORESIGHT_S = 2.0
"""A driver sees that somebody is about to step onto the lane."""
SHADOWS_PER_WALKER = 1000


def _walker_shadows(scene: Scene, walker: Track) -> tuple[tuple[Track, int], ...]:
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


def pedestrian_of(shadow_id: int) -> int:
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


# ---------- all_actors
# Everybody in a hybrid re-simulation: who is replayed, who is driven, and from when on.

SIDEWAYS_SHARE = 0.25
"""Speed across a lane to speed along it, at most: a car steers over at 14°, and does not slide over while it stands."""
NO_LIMIT_MPS = 70.0
"""Replayed vehicles are put where they were, however fast that is."""
Hint = tuple[str, int]
"""SUMO edge and lane index where a recorded pose lies; ("", -1) where nobody knows."""


@dataclass(frozen=True)
class Actor:
    """A road user of the re-simulation.

    ``drive_from``: the step whose pose is still the recorded one and after which SUMO drives; None: replayed to the
    end. ``target``, ``through``: lanes that a driven vehicle changes to when on their edge. ``keep_to_route``: its
    poses are put onto its route's lanes, because SUMO took the recorded ones for another road. ``manoeuvres``: what it
    is told while it is driven. ``lanes_to_target``: SUMO's lanes that lead to the target without a change of lane; the
    vehicle waits for a gap into one of them instead of driving past (none: it does not). ``is_sent``: an edit sends it
    another way than recorded. ``maximum_speed_mps``: what a driven vehicle never exceeds, that of its class or of its
    recording. ``halts``: where it waits for others.
    """

    track: Track
    edges: tuple[str, ...]
    hints: tuple[Hint, ...]
    drive_from: int | None
    target: Hint | None
    keep_to_route: bool
    behaviour: Behaviour
    sumo_class: str
    manoeuvres: tuple[Manoeuvre, ...] = ()
    through: tuple[Hint, ...] = ()
    lanes_to_target: frozenset[str] = frozenset()
    is_sent: bool = False
    maximum_speed_mps: float = NO_LIMIT_MPS
    slow_places: Mapping[str, SlowPlaces] = field(default_factory=dict)
    halts: tuple[Halt, ...] = ()

    @cached_property
    def key(self) -> str:
        """SUMO's id of the vehicle."""
        return str(self.track.obstacle_id)

    @cached_property
    def poses(self) -> tuple[tuple[float, float, float], ...]:
        """The front bumper (x, y) in m and degrees clockwise from north, as SUMO has them, for all of the track."""
        ahead = self.track.length_m / 2
        return tuple(
            (x + ahead * math.cos(heading), y + ahead * math.sin(heading), (90.0 - math.degrees(heading)) % 360.0)
            for (x, y), heading in zip(self.track.positions.tolist(), self.track.headings_rad.tolist(), strict=True)
        )

    @cached_property
    def edges_to_target(self) -> tuple[str, ...]:
        """The edges of the route up to that of the target."""
        edge = self.target[0] if self.target else ""
        return self.edges[: self.edges.index(edge) + 1] if edge in self.edges else ()

    def hint_at(self, index: int) -> Hint:
        """The lane of the pose at an index of the track."""
        return self.hints[index]

    def vehicle_type(self) -> str:
        """The ``vType`` element with the vehicle's own size and driver."""
        attributes: dict[str, object] = {
            "id": f"t{self.key}",
            "vClass": self.sumo_class,
            "length": f"{max(self.track.length_m, 0.5):.3f}",
            "width": f"{max(self.track.width_m, 0.3):.3f}",
            "maxSpeed": f"{self.maximum_speed_mps:g}",
            "speedDev": "0",
            "lcMaxSpeedLatStanding": "0",
            "lcMaxSpeedLatFactor": f"{SIDEWAYS_SHARE:g}",
            "emergencyDecel": f"{max(HARDEST_BRAKING_MPS2, self.behaviour.values['decel']):g}",
            "apparentDecel": f"{self.behaviour.values['decel']:g}",
        }
        attributes |= {name: f"{value:g}" for name, value in self.behaviour.values.items()}
        return f"<vType {' '.join(f'{name}={quoteattr(str(value))}' for name, value in attributes.items())}/>"


def all_actors(
    scene: Scene, plans: Mapping[int, DrivePlan], removed: Collection[int] = (), replays: Iterable[Replay] = ()
) -> tuple[Actor, ...]:
    """All road users near a lane, by ascending id.

    Args:
        scene: the scene with recordings as they are replayed.
        plans: the driven ones by id, handed over ones included.
        removed: ids of those that are left out.
        replays: tracks that are given; of them, pedestrians that were added are shown to SUMO's drivers.
    """
    found = [driven_actor(scene, plan) for plan in plans.values()]
    for key, track in (scene.tracks | scene.standing).items():
        if key not in plans and key not in removed and key in scene.matches:
            found.append(replayed_actor(scene, track, scene.matches[key]))
    found += [
        replayed_actor(scene, region.track, region.match)
        for region in scene.regions
        if region.obstacle_id not in removed and region.match is not None
    ]
    for replay in replays:
        if replay.recording is None:
            shadows = _walker_shadows(scene, replay.track)
            found += [replayed_actor(scene, shadow, LaneMatch((0,), (key,))) for shadow, key in shadows]
    return tuple(sorted(found, key=lambda one: one.track.obstacle_id))


def driven_actor(scene: Scene, plan: DrivePlan) -> Actor:
    """A road user that SUMO drives by a plan."""
    match = scene.matches.get(plan.start.obstacle_id)
    if plan.cause == "added" or match is None or plan.lanelets[0] != match.lanelets[0]:
        match = LaneMatch((0,), plan.lanelets[:1])
    if plan.junction_lane_change is not None:
        match = LaneMatch((0,), (plan.junction_lane_change.lanelet_id,))
    lane_of, aims = scene.layout.lane_of, _aims(scene, plan)
    target = next((lane_of[key] for key in reversed(plan.lanelets) if key in aims and key in lane_of), None)
    return Actor(
        track=placed_over(scene, plan),
        edges=plan.edges,
        hints=_hints(scene, plan.start, match, plan.edges),
        drive_from=plan.from_step,
        target=target,
        keep_to_route=False,
        behaviour=plan.behaviour,
        sumo_class=plan.vehicle_class.sumo_class,
        manoeuvres=plan.manoeuvres,
        halts=plan.halts,
        lanes_to_target=_lanes_to(scene, plan, aims, target),
        is_sent=bool(plan.targets) and plan.cause == "edited",
        maximum_speed_mps=max(plan.vehicle_class.maximum_speed_mps, float(plan.start.speeds_mps.max())),
        slow_places=scene.slow_places,
        through=tuple(lane_of[key] for key in plan.lanelets if key in plan.through and key in lane_of),
    )


def _aims(scene: Scene, plan: DrivePlan) -> frozenset[int]:
    """The targets; where all lie inside a junction, the lanelet before it: lanes are kept inside."""
    outside = scene.layout.lane_of
    if not plan.targets or not plan.targets.isdisjoint(outside):
        return plan.targets
    return frozenset(itertools.islice((key for key in reversed(plan.lanelets) if key in outside), 1))


def _lanes_to(scene: Scene, plan: DrivePlan, aims: frozenset[int], target: Hint | None) -> frozenset[str]:
    """SUMO's lanes on the way that lead to an aim without a change of lane; none where all lanes of its edge do."""
    if target is None or target[0] not in plan.edges or aims.issuperset(scene.layout.edges[target[0]]):
        return frozenset()
    lanes = aims.intersection(scene.layout.edges[target[0]])
    layout = scene.layout
    found = {"{}_{}".format(*layout.lane_of[key]) for key in lanes}
    for edge in reversed(plan.edges[: plan.edges.index(target[0])]):
        ways = [index for key in layout.edges[edge] for index in scene.edge_graph.paths_from.get(key, ())]
        ways = [index for index in ways if layout.paths[index].exit in lanes]
        lanes = frozenset(layout.paths[index].entry for index in ways)
        found |= {f"{layout.internal_edge_of_path[index]}_0" for index in ways}
        found |= {"{}_{}".format(*layout.lane_of[key]) for key in lanes}
    return frozenset(found)


def replayed_actor(scene: Scene, track: Track, match: LaneMatch) -> Actor:
    """A road user that moves by its track and that the driven ones see."""
    route = scene.edge_graph.route(match.sequence) or scene.edge_graph.route(match.sequence[:1])
    edges = route or next(iter(scene.layout.edges.items()))[:1]
    vehicle_class = class_of(track.kind)
    return Actor(
        track=track,
        edges=edges,
        hints=_hints(scene, track, match, edges),
        drive_from=None,
        target=None,
        keep_to_route=False,
        behaviour=usual_behaviour(vehicle_class),
        sumo_class="passenger",
    )


def _hints(scene: Scene, track: Track, match: LaneMatch, edges: tuple[str, ...]) -> tuple[Hint, ...]:
    by_lanelet = {key: _hint(scene, key, edges) for key in match.sequence}
    return tuple(by_lanelet[key] for key in match.at_each(len(track.positions)))


def _hint(scene: Scene, lanelet_id: int, edges: tuple[str, ...]) -> Hint:
    if lanelet_id in scene.layout.lane_of:
        return scene.layout.lane_of[lanelet_id]
    path = scene.edge_graph.path_for(lanelet_id, edges)
    return ("", -1) if path is None else (scene.layout.internal_edge_of_path[path], 0)
