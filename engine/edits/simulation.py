"""Simulate edits: SUMO drives the edited vehicles in rounds until no avoidable collision remains.

After each round, replayed vehicles that a driven one hits are also handed over to SUMO, early enough to react; if two
driven vehicles collide, one of them waits.

SUMO knows lanes, not bodies: it does not see a vehicle that stands across two lanes, a rear that cuts a corner, or two
lanelets that overlap before they meet. It also ignores vehicles that have passed their stop line.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from ..commonroad import Track
from ..cosimulation import (
    Actor,
    DrivenTrack,
    DrivePlan,
    Halt,
    HandoverTrack,
    SimulationSetup,
    all_actors,
    handover_track,
    not_drivable,
    recorded_plan,
    resimulate,
)
from ..geometry import Points, arc_length, project, rectangles_overlap
from ..scene import Scene
from ..vehicles import HAND_OVER_S, HARDEST_BRAKING_MPS2, hardest_braking_mps2
from .changes import Changes
from .edited_scene import EditedScene, Overlap, SimulationResult, new_overlaps

_ROUNDS = 8
"""Rounds of simulation (chosen): each may reach one vehicle farther back in a queue; 8 end within seconds."""
_END_M = 0.5
"""A vehicle has left the network if its front is nearer than this to the network's end at its hand-over."""
_CLEAR_LENGTH_M, _CLEAR_WIDTH_M = 0.5, 0.3
"""The body must find room with this extra length and width where a vehicle waits (chosen)."""
_STOP_BEFORE_M = 0.5
"""Smoothing moves a vehicle along its path by at most this."""
_SAME_PLACE_M = 0.1
"""Poses nearer to each other than this are checked once."""
_AFTER_STEPS = 2
"""A waiting vehicle continues this many steps after the other one is gone (chosen)."""


@dataclass(frozen=True)
class Simulation:
    """The rounds of one simulation of a scene with its changes."""

    scene: Scene
    changes: Changes
    setup: SimulationSetup

    def until_clear(self, shown: tuple[Actor, ...], *, all_react: bool) -> SimulationResult:
        """Simulate, hand over the vehicles that a driven vehicle hits, and simulate again, at most eight more rounds.

        If all vehicles that are hit are already driven, one of them gives way, as long as that leaves fewer collisions.

        Args:
            shown: further road users (the ego) that the driven vehicles see. Their collisions do not count. They are
                replayed, unless a collision remains and they drive through a driven vehicle: then they are driven too.
            all_react: hand over all vehicles at their first step.
        """
        plans = dict(sorted({**(self._all_handed_over() if all_react else {}), **self.changes.driven}.items()))
        best = result = self._round(plans, shown)
        seen_by_best = shown
        for _ in range(_ROUNDS):
            more, reacting = self._handed_over(plans, result.overlaps), self._reacting(shown, result)
            if not more and reacting is None:
                more = self._plans_giving_way(result)
                if not more:
                    break
            shown = reacting or shown
            plans = dict(sorted({**plans, **more}.items()))
            result = self._round(plans, shown)
            if len(result.overlaps) < len(best.overlaps) or not any(plan.gives_way for plan in plans.values()):
                best, seen_by_best = result, shown
        if best is not result and self.setup.keeps_routes:
            # The last simulation's files remain; they must be those of the written motion.
            return self._round(best.plans, seen_by_best)
        return best

    def _all_handed_over(self) -> dict[int, DrivePlan]:
        return {
            key: recorded_plan(self.scene, key, "handed_over", self.scene.tracks[key].first_step)
            for key in self.scene.tracks
            if key not in self.changes.removed | self.changes.scripted and not not_drivable(self.scene, key)
        }

    def _round(self, plans: Mapping[int, DrivePlan], shown: tuple[Actor, ...]) -> SimulationResult:
        scene, removed, replays = self.scene, self.changes.removed, self.changes.replays
        driven = resimulate(self.setup, (*all_actors(scene, plans, removed, replays.values()), *shown))
        tracks: dict[int, HandoverTrack] = {}
        for key, plan in plans.items():
            seen = driven.get(key) or self._track_outside_network(plan)
            over_m = plan.junction_lane_change.within_m if plan.junction_lane_change else None
            track = None if seen is None else handover_track(plan.start, seen, scene.step_s, scene.last_step, over_m)
            if track is not None:
                tracks[key] = track
        overlaps = self._new_overlaps({key: track.whole(plans[key].start) for key, track in tracks.items()})
        return SimulationResult(plans, tracks, overlaps, tuple(key for key in plans if key not in tracks))

    def _new_overlaps(self, tracks: Mapping[int, Track]) -> tuple[Overlap, ...]:
        """Return overlaps of driven vehicles and time-shifted recordings with each other and with all other road users.

        ``tracks``: the tracks of the driven vehicles from their first appearance: before a late hand-over, a vehicle
        may hit another driven vehicle while it still follows its recording.
        """
        scene, removed, replays = self.scene, self.changes.removed, self.changes.replays
        known = scene.tracks | scene.standing
        moved = [known[key] for key in replays if key not in tracks]
        recorded = {key: track for key, track in known.items() if not self.changes.is_added(key)}
        changed = {key: replay.recording for key, replay in replays.items() if replay.shifted_steps == 0}
        recorded |= {key: recording for key, recording in changed.items() if recording is not None}
        kept = recorded.keys() - tracks.keys() - replays.keys() - removed
        others = [recorded[key] for key in sorted(kept)]
        regions = [region for region in scene.regions if region.obstacle_id not in removed]
        others += [replace(region.track, obstacle_id=region.obstacle_id) for region in regions]
        return new_overlaps([*moved, *tracks.values()], others, recorded, self.changes.shifts)

    def _track_outside_network(self, plan: DrivePlan) -> DrivenTrack | None:
        """Return the track of a vehicle that never appeared in SUMO because its bumper is beyond the network's end."""
        table = self.scene.layout.table
        index = plan.from_step - plan.start.first_step
        match = self.scene.matches.get(plan.start.obstacle_id)
        lanelet = plan.lanelets[0] if match is None else match.at(index)
        lane, front = table.lanes[lanelet], plan.start.front_at(index)
        station, _ = project(lane.center, front)
        if table.successors[lanelet] or station < lane.length_m - _END_M:
            return None
        return DrivenTrack(plan.from_step, front[None], (), leaves=True)

    def _handed_over(self, plans: Mapping[int, DrivePlan], overlaps: tuple[Overlap, ...]) -> dict[int, DrivePlan]:
        """Return plans, by vehicle id, for replayed vehicles that are hit, and earlier hand-overs if needed."""
        scene, more = self.scene, dict[int, DrivePlan]()
        for hit in overlaps:
            for key in (hit.first, hit.second):
                plan = plans.get(key)
                if (plan is not None and plan.cause != "handed_over") or key in self.changes.scripted:
                    continue
                if plan is None and (key not in scene.tracks or not_drivable(scene, key)):
                    continue
                first = scene.tracks[key].first_step
                latest = hit.step if plan is None else min(hit.step, plan.from_step)
                step = max(first, latest - self._reaction_steps)
                if plan is not None and step == plan.from_step:
                    continue
                handed_over = plan or recorded_plan(scene, key, "handed_over", step)
                earliest = min(step, more[key].from_step) if key in more else step
                more[key] = replace(handed_over, from_step=earliest, halts=(), gives_way=False)
        return more

    @property
    def _reaction_steps(self) -> int:
        return round(HAND_OVER_S / self.scene.step_s)

    def _plans_giving_way(self, result: SimulationResult) -> dict[int, DrivePlan]:
        """Return plans that give way, by vehicle id, without vehicles that enter on top of another, which are
        refused.
        """
        overlaps = tuple(hit for hit in result.overlaps if not self._is_at_entry(result.plans, hit))
        if not overlaps:
            return {}
        road_users = EditedScene(self.scene, self.changes, result).road_users
        hardest = hardest_braking_mps2(self.scene.friction)
        return plans_giving_way(result.plans, result.tracks, road_users, overlaps, hardest)

    def _is_at_entry(self, plans: Mapping[int, DrivePlan], hit: Overlap) -> bool:
        entering = {key: plan.from_step for key, plan in plans.items() if plan.cause == "added"}
        entering |= {key: replay.track.first_step for key, replay in self.changes.replays.items()}
        return hit.step in (entering.get(hit.first), entering.get(hit.second))

    def _reacting(self, shown: tuple[Actor, ...], result: SimulationResult) -> tuple[Actor, ...] | None:
        """Return the shown road users; SUMO drives those that would pass through a driven vehicle, from before they do.

        The result is None if no shown road user passes through a driven vehicle.

        SUMO keeps its order of the vehicles on a lane even if one is placed through another. Vehicles behind then see
        the placed vehicle as their leader instead of the vehicle that it passed through, which they then hit.
        """
        if not result.overlaps or any(plan.gives_way for plan in result.plans.values()):
            return None
        reacting = {}
        for one in shown:
            hits = new_overlaps([one.track], result.tracks.values(), {}) if one.drive_from is None else ()
            if hits:
                drive_from = max(one.track.first_step, hits[0].step - self._reaction_steps)
                reacting[one.key] = replace(one, drive_from=drive_from)
        return tuple(reacting.get(one.key, one) for one in shown) if reacting else None


@dataclass(frozen=True)
class _Wait:
    """A vehicle that can give way: where it halts, and the step at which it reaches the place where it waits."""

    plan: DrivePlan
    halt: Halt
    step: int


def plans_giving_way(
    plans: Mapping[int, DrivePlan],
    tracks: Mapping[int, HandoverTrack],
    road_users: Mapping[int, Track],
    overlaps: Iterable[Overlap],
    hardest_mps2: float = HARDEST_BRAKING_MPS2,
) -> dict[int, DrivePlan]:
    """Return plans in which one vehicle of every overlapping pair has one more halt, if it can still stop.

    A handed-over vehicle waits rather than an edited one; if both were handed over, the later one waits.

    Args:
        plans: those of the driven vehicles, with new motions in ``tracks``.
        road_users: all road users after the edits, by id.
        hardest_mps2: the vehicles' maximum deceleration.
    """
    waiting: dict[int, DrivePlan] = {}
    for hit in overlaps:
        if hit.first in waiting or hit.second in waiting:
            continue
        pairs = ((hit.first, hit.second), (hit.second, hit.first))
        waits = [
            _wait(plans[key], tracks[key], road_users[other], hit.step, hardest_mps2)
            for key, other in pairs
            if key in tracks and other in road_users and not plans[key].ignores_lights
        ]
        possible = [wait for wait in waits if wait is not None]
        if possible:
            best = min(possible, key=lambda wait: (wait.plan.cause != "handed_over", -wait.step))
            waiting[best.plan.start.obstacle_id] = replace(
                best.plan, halts=(*best.plan.halts, best.halt), gives_way=True
            )
    return waiting


def _wait(plan: DrivePlan, track: HandoverTrack, other: Track, hit_step: int, hardest_mps2: float) -> _Wait | None:
    """Return how and where a vehicle waits for another to leave the conflict area; None if it cannot stop in time.

    It does not react before the other vehicle has entered.
    """
    in_the_way, roomy_m = (
        _occupied_places(other, hit_step),
        (track.length_m + _CLEAR_LENGTH_M, track.width_m + _CLEAR_WIDTH_M),
    )
    index, gone = hit_step - track.first_step, hit_step
    while index >= 0:
        mine = track.corners_at(index, roomy_m)
        met = [step for step, corners in in_the_way if rectangles_overlap(mine, corners)]
        if not met:
            break
        gone, index = max(gone, met[-1]), index - 1
    if index < 0:
        return None
    from_step = max(track.first_step, other.first_step)
    stations = arc_length(track.positions)
    rolled_m = max(float(stations[index]) - _STOP_BEFORE_M, 0.0)
    now = from_step - track.first_step
    if float(track.speeds_mps[now]) ** 2 > 2 * hardest_mps2 * (rolled_m - float(stations[now])):
        return None
    return _Wait(plan, Halt(from_step, gone + _AFTER_STEPS, rolled_m), track.first_step + index)


def _occupied_places(track: Track, from_step: int) -> list[tuple[int, Points]]:
    """Return a road user's places after a step, each with its corners and the last step at which it is occupied."""
    places: list[tuple[int, int]] = []
    for index in range(max(from_step - track.first_step, 0), len(track.positions)):
        stays = bool(places) and math.dist(track.positions[places[-1][0]], track.positions[index]) < _SAME_PLACE_M
        first = places.pop()[0] if stays else index
        places.append((first, index))
    return [(track.first_step + last, track.corners_at(first)) for first, last in places]
