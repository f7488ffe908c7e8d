"""The road users of a re-simulation: which are replayed, which SUMO drives, and from which step.

SUMO's lane-based driver model only notices road users that drive along a lane. A pedestrian who crosses lanes is
therefore represented by proxies: while the pedestrian is on a lane, and shortly before, an obstacle stands in the
middle of that lane.
"""

import itertools
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..commonroad import Track
from ..geometry import point_at, project
from ..network import SlowPlaces
from ..scene import LaneMatch, Scene
from ..traffic import NO_LANE, LaneHint, sumo_pose, vehicle_type
from ..vehicles import hardest_braking_mps2
from .driver import Behaviour, usual_behaviour
from .manoeuvres import Halt, Manoeuvre
from .plans import DrivePlan, Replay, class_of, halts_at_stops, shown_track

LATERAL_SHARE = 0.25
"""Largest lateral speed per speed along the lane (chosen): a car changes lanes at 14°, and not while it stands."""
NO_LIMIT_MPS = 70.0
"""Replayed vehicles are put at their recorded places, however fast that is (SUMO's default maximum is 55.6 m/s)."""
SHORTEST_M, NARROWEST_M = 0.5, 0.3
"""Least length and width of a vehicle type (chosen): SUMO rejects a vehicle without a size."""


@dataclass(frozen=True)
class Actor:
    """A road user of the re-simulation.

    ``drive_from``: the last step with a recorded pose, after which SUMO drives; None: replayed to the end. ``target``,
    ``through``: lanes that a driven vehicle changes to once it is on their edge. ``keep_to_route``: its poses are put
    onto its route's lanes, because SUMO matched the recorded poses to a different road. ``manoeuvres``: its orders
    while it is driven. ``lanes_to_target``: SUMO's lanes that lead to the target without a lane change; the vehicle
    waits for a gap into one of them instead of driving past it (empty: it does not wait). ``is_sent``: an edit reroutes
    it. ``branch``: the lane after a junction that distinguishes the path to the target from other paths to the same
    edge. ``maximum_speed_mps``: the speed that a driven vehicle never exceeds, from its class or its recording.
    ``halts``: where it must stop. ``ignores_lights``: it does not stop at red lights or yield at junctions.
    ``friction``: the road's coefficient of friction, which limits its braking; None if it is not stated.
    """

    track: Track
    edges: tuple[str, ...]
    hints: tuple[LaneHint, ...]
    behaviour: Behaviour
    sumo_class: str = "passenger"
    drive_from: int | None = None
    target: LaneHint | None = None
    keep_to_route: bool = False
    manoeuvres: tuple[Manoeuvre, ...] = ()
    through: tuple[LaneHint, ...] = ()
    lanes_to_target: frozenset[str] = frozenset()
    is_sent: bool = False
    branch: LaneHint | None = None
    maximum_speed_mps: float = NO_LIMIT_MPS
    slow_places: Mapping[str, SlowPlaces] = field(default_factory=dict)
    halts: tuple[Halt, ...] = ()
    ignores_lights: bool = False
    friction: float | None = None

    @property
    def hardest_braking_mps2(self) -> float:
        """The vehicle's maximum deceleration."""
        return hardest_braking_mps2(self.friction)

    @cached_property
    def key(self) -> str:
        """The vehicle's SUMO id."""
        return str(self.track.obstacle_id)

    @property
    def route(self) -> str:
        """The SUMO id of the vehicle's route."""
        return f"r{self.key}"

    @property
    def type_id(self) -> str:
        """The SUMO id of the vehicle's type."""
        return f"t{self.key}"

    def pose_at(self, index: int) -> tuple[float, float, float]:
        """Return the front bumper (x, y) in m and the angle in SUMO's degrees, as :meth:`Sumo.move_to` takes them."""
        if index not in self._poses:
            x, y = self.track.positions[index].tolist()
            self._poses[index] = sumo_pose(x, y, float(self.track.headings_rad[index]), self.track.length_m)
        return self._poses[index]

    @cached_property
    def _poses(self) -> dict[int, tuple[float, float, float]]:
        return {}

    def stands_at(self, index: int) -> bool:
        """Return True if the vehicle is standing at a state: its speed is 0, and the state before is the same."""
        return bool(self._stands[index])

    @cached_property
    def _stands(self) -> NDArray[np.bool_]:
        track = self.track
        poses = np.column_stack([track.positions, track.headings_rad, track.speeds_mps])
        same = (poses[1:] == poses[:-1]).all(axis=1)
        return np.concatenate([[False], same & (track.speeds_mps[1:] == 0.0)])

    @cached_property
    def edges_to_target(self) -> tuple[str, ...]:
        """The edges of the route up to the target's edge."""
        edge = self.target[0] if self.target else ""
        return self.edges[: self.edges.index(edge) + 1] if edge in self.edges else ()

    @property
    def handover_index(self) -> int:
        """The index of the state at ``drive_from`` in the track."""
        return (self.drive_from or 0) - self.track.first_step

    def drives_at(self, step: int) -> bool:
        """Return True if the state after a step comes from SUMO, not from the recording."""
        return self.drive_from is not None and step > self.drive_from

    def vehicle_type(self) -> str:
        """Return the ``vType`` element with the vehicle's own size and driver."""
        driver = self.behaviour.values
        return vehicle_type(
            self.type_id,
            vClass=self.sumo_class,
            length=f"{max(self.track.length_m, SHORTEST_M):.3f}",
            width=f"{max(self.track.width_m, NARROWEST_M):.3f}",
            maxSpeed=f"{self.maximum_speed_mps:g}",
            speedDev="0",
            lcMaxSpeedLatStanding="0",
            lcMaxSpeedLatFactor=f"{LATERAL_SHARE:g}",
            emergencyDecel=f"{max(self.hardest_braking_mps2, driver['decel']):g}",
            apparentDecel=f"{driver['decel']:g}",
            **{name: f"{value:g}" for name, value in driver.items()},
        )


def all_actors(
    scene: Scene, plans: Mapping[int, DrivePlan], removed: Collection[int] = (), replays: Iterable[Replay] = ()
) -> tuple[Actor, ...]:
    """Return all road users near a lane, by ascending id.

    Args:
        scene: the scene, with the recordings that are replayed.
        plans: the plans of driven vehicles by id, including handed-over vehicles.
        removed: ids of the road users that are left out.
        replays: given tracks; added pedestrians among them are shown to SUMO's drivers.
    """
    actors = [driven_actor(scene, plan) for plan in plans.values()]
    for key, track in (scene.tracks | scene.standing).items():
        if key not in plans and key not in removed and key in scene.matches:
            actors.append(replayed_actor(scene, track, scene.matches[key]))
    actors += [
        replayed_actor(scene, region.track, region.match)
        for region in scene.regions
        if region.obstacle_id not in removed and region.match is not None
    ]
    for replay in replays:
        if replay.recording is None and replay.match is None:
            actors += _pedestrian_proxies(scene, replay.track)
    return tuple(sorted(actors, key=lambda actor: actor.track.obstacle_id))


def driven_actor(scene: Scene, plan: DrivePlan) -> Actor:
    """Return a road user that SUMO drives by a plan."""
    match = scene.matches.get(plan.start.obstacle_id)
    if plan.cause == "added" or match is None or plan.lanelets[0] != match.lanelets[0]:
        match = LaneMatch((0,), plan.lanelets[:1])
    if plan.junction_lane_change is not None:
        match = LaneMatch((0,), (plan.junction_lane_change.lanelet_id,))
    lane_of, aims = scene.layout.lane_of, _aims(scene, plan)
    target = next((lane_of[key] for key in reversed(plan.lanelets) if key in aims and key in lane_of), None)
    return Actor(
        track=shown_track(scene, plan),
        edges=plan.edges,
        hints=_hints(scene, plan.start, match, plan.edges),
        drive_from=plan.from_step,
        target=target,
        behaviour=plan.behaviour.on_road(scene.friction),
        sumo_class=plan.vehicle_class.sumo_class,
        manoeuvres=plan.manoeuvres,
        halts=(*plan.halts, *halts_at_stops(scene, plan)),
        ignores_lights=plan.ignores_lights,
        friction=scene.friction,
        lanes_to_target=_lanes_to(scene, plan, aims, target),
        is_sent=bool(plan.targets) and plan.cause == "edited",
        branch=_branch(scene, plan),
        maximum_speed_mps=max(plan.vehicle_class.maximum_speed_mps, float(plan.start.speeds_mps.max())),
        slow_places=scene.slow_places,
        through=tuple(lane_of[key] for key in plan.lanelets if key in plan.through and key in lane_of),
    )


def _aims(scene: Scene, plan: DrivePlan) -> frozenset[int]:
    """Return the targets or, if all are inside a junction, the lanelet before it: lanes are kept in junctions."""
    outside = scene.layout.lane_of
    if not plan.targets or not plan.targets.isdisjoint(outside):
        return plan.targets
    return frozenset(itertools.islice((key for key in reversed(plan.lanelets) if key in outside), 1))


def _branch(scene: Scene, plan: DrivePlan) -> LaneHint | None:
    """Return the exit of the path to a target inside a junction; None if the route has no alternative path."""
    layout = scene.layout
    inside = (key for key in plan.lanelets if key in plan.targets and key not in layout.lane_of)
    through = next((layout.paths[index] for key in inside for index in layout.paths_through.get(key, ())), None)
    if through is None:
        return None
    exits = {layout.paths[index].exit for index in scene.edge_graph.paths_from[through.entry]}
    edge = layout.lane_of[through.exit][0]
    same = {key for key in exits if layout.lane_of[key][0] == edge}
    return layout.lane_of[through.exit] if edge in plan.edges and len(same) > 1 else None


def _lanes_to(scene: Scene, plan: DrivePlan, aims: frozenset[int], target: LaneHint | None) -> frozenset[str]:
    """Return SUMO's lanes that lead to an aim without a lane change; empty if all lanes of the aim's edge do."""
    if target is None or target[0] not in plan.edges or aims.issuperset(scene.layout.edges[target[0]]):
        return frozenset()
    lanes = aims.intersection(scene.layout.edges[target[0]])
    layout = scene.layout
    leading = {"{}_{}".format(*layout.lane_of[key]) for key in lanes}
    for edge in reversed(plan.edges[: plan.edges.index(target[0])]):
        paths = [index for key in layout.edges[edge] for index in scene.edge_graph.paths_from.get(key, ())]
        paths = [index for index in paths if layout.paths[index].exit in lanes]
        lanes = frozenset(layout.paths[index].entry for index in paths)
        leading |= {f"{layout.internal_edge_of_path[index]}_0" for index in paths}
        leading |= {"{}_{}".format(*layout.lane_of[key]) for key in lanes}
    return frozenset(leading)


def replayed_actor(scene: Scene, track: Track, match: LaneMatch) -> Actor:
    """Return an actor that follows its track and is visible to the driven vehicles; made once for a track."""
    key = "replayed actor", id(track), id(match)
    return scene.made.get(key, lambda: _replayed_actor(scene, track, match), track, match)


def _replayed_actor(scene: Scene, track: Track, match: LaneMatch) -> Actor:
    route = scene.edge_graph.route(match.sequence) or scene.edge_graph.route(match.sequence[:1])
    edges = route or next(iter(scene.layout.edges.items()))[:1]
    behaviour = usual_behaviour(class_of(track.kind)).on_road(scene.friction)
    return Actor(track, edges, _hints(scene, track, match, edges), behaviour, friction=scene.friction)


def _hints(scene: Scene, track: Track, match: LaneMatch, edges: tuple[str, ...]) -> tuple[LaneHint, ...]:
    by_lanelet = {key: lane_hint(scene, key, edges) for key in match.sequence}
    return tuple(by_lanelet[key] for key in match.at_each(len(track.positions)))


def lane_hint(scene: Scene, lanelet_id: int, edges: tuple[str, ...] = ()) -> LaneHint:
    """Return SUMO's lane for a lanelet; inside a junction, the lane of the path that fits a route best."""
    if lanelet_id in scene.layout.lane_of:
        return scene.layout.lane_of[lanelet_id]
    path = scene.edge_graph.path_for(lanelet_id, edges)
    return NO_LANE if path is None else (scene.layout.internal_edge_of_path[path], 0)


FORESIGHT_S = 2.0
"""How long before a pedestrian steps onto the lane a driver sees it (chosen)."""
PROXIES_PER_PEDESTRIAN = 1000
"""Ids of proxies are negative: -(1000 × the pedestrian's + a number); no walk crosses that many lanelets."""


def _pedestrian_proxies(scene: Scene, pedestrian: Track) -> list[Actor]:
    """Return an actor for each lanelet that a pedestrian visits, in order; it stands there for that time."""
    indices_on: dict[int, list[int]] = {}
    for index, lanelets in enumerate(scene.network.find_lanelet_by_position(list(pedestrian.positions))):
        for key in sorted(int(lanelet) for lanelet in lanelets):
            if key in scene.layout.table.lanes:
                indices_on.setdefault(key, []).append(index)
    return [
        replayed_actor(
            scene, _proxy_track(scene, pedestrian, key, (indices[0], indices[-1]), number), LaneMatch((0,), (key,))
        )
        for number, (key, indices) in enumerate(indices_on.items())
    ]


def _proxy_track(scene: Scene, pedestrian: Track, lanelet_id: int, span: tuple[int, int], number: int) -> Track:
    begin = max(span[0] - round(FORESIGHT_S / scene.step_s), 0)
    count = span[1] - begin + 1
    line = scene.layout.table.lanes[lanelet_id].center
    station, _ = project(line, pedestrian.positions[(span[0] + span[1]) // 2])
    point, heading = point_at(line, station)
    return replace(
        pedestrian,
        obstacle_id=-(pedestrian.obstacle_id * PROXIES_PER_PEDESTRIAN + number),
        first_step=pedestrian.first_step + begin,
        positions=np.repeat(point[None], count, axis=0),
        headings_rad=np.full(count, heading),
        speeds_mps=np.zeros(count),
    )


def pedestrian_of(proxy_id: int) -> int:
    """Return the id of the pedestrian that a proxy represents."""
    return -proxy_id // PROXIES_PER_PEDESTRIAN
