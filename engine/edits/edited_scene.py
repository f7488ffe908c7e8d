"""A scene after its edits: tracks of all road users as the edits leave them.

``EditedScene`` is the input of the checks, the explanations, the report and the ego's risk; it hides whether a track
comes from the recording, from SUMO or from an edit. Collisions are overlaps of rectangles that are not in the
recording. Lengths are in m, steps are time steps of the scenario.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from types import MappingProxyType

import numpy as np

from ...schemas.modification import Edit, EditCollision
from ..commonroad import Track
from ..cosimulation import DrivePlan, HandoverTrack
from ..geometry import rectangles_overlap
from ..scene import Scene
from .changes import Changes, EditStep, car_at_start

_TOUCH_M = 0.05
"""Rectangles that overlap by less do not collide: recorded positions are not more precise."""
NEAR_STEPS = 10
"""An overlap that starts within this many steps of a recorded one of the same pair is the recorded one (chosen)."""
EGO = 0
"""The ego's id among road users; obstacles have positive ones."""


@dataclass(frozen=True)
class Overlap:
    """The step at which two road users begin to overlap; ``first`` is a road user that the edits touch."""

    first: int
    second: int
    step: int


@dataclass(frozen=True)
class SimulationResult:
    """The outcome of all rounds: plans and new tracks of the driven vehicles, and the remaining overlaps.

    ``missing``: ids of vehicles with a plan that SUMO did not drive.
    """

    plans: Mapping[int, DrivePlan]
    tracks: Mapping[int, HandoverTrack]
    overlaps: tuple[Overlap, ...]
    missing: tuple[int, ...]


@dataclass(frozen=True)
class EditedScene:
    """A scene, the changes that edits make to it, and the result of their simulation.

    ``scene``: contains the recordings that edits move in time, added pedestrians and the ego's new start; vehicles that
    SUMO drives are included as recorded. ``ego``: the ego's motion under an ordinary driver after the edits; None if
    there is no ego.
    """

    scene: Scene
    changes: Changes
    result: SimulationResult
    ego: Track | None = None

    @cached_property
    def after(self) -> Scene:
        """The scene with simulated tracks in place of recorded tracks, and without removed road users."""
        scene, removed = self.scene, self.changes.removed
        driven = {key: track.whole(self.result.plans[key].start) for key, track in self.result.tracks.items()}
        return replace(
            scene,
            tracks={key: track for key, track in sorted((scene.tracks | driven).items()) if key not in removed},
            standing={key: track for key, track in scene.standing.items() if key not in removed},
            regions=tuple(region for region in scene.regions if region.obstacle_id not in removed),
        )

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        """All road users after the edits: those with a track by ascending id, then those given by occupancies."""
        tracks = (track for _, track in sorted((self.after.tracks | self.after.standing).items()))
        return (*tracks, *(region.track for region in self.after.regions))

    @cached_property
    def road_users(self) -> dict[int, Track]:
        """All road users after the edits by id, and the ego's drive."""
        return {track.obstacle_id: track for track in (*self.tracks, *(() if self.ego is None else (self.ego,)))}

    def simulated(self, key: int) -> Track:
        """Return the track of a road user: from its hand-over on if it is driven, else as recorded."""
        regions = {region.obstacle_id: region.track for region in self.scene.regions}
        return (regions | self.scene.tracks | self.scene.standing | dict(self.result.tracks))[key]

    @cached_property
    def requested(self) -> dict[int, Track]:
        """The tracks by id, and the ego at its start, without hand-overs: only what the edits request is new."""
        tracks = {key: track for key, track in self.result.tracks.items() if key not in self.handed_over}
        road_users = EditedScene(self.scene, self.changes, replace(self.result, tracks=tracks)).road_users
        return road_users if self.scene.ego is None else road_users | {EGO: car_at_start(self.scene.ego, EGO)}

    @cached_property
    def handed_over(self) -> frozenset[int]:
        """The vehicles that are driven only because they would hit other road users, not because of an edit."""
        return frozenset(key for key in self.result.tracks if self.result.plans[key].cause == "handed_over")

    @cached_property
    def shifted(self) -> dict[int, Track]:
        """The recordings that edits move in time, driven or not, by ascending id."""
        replays = self.changes.replays.items()
        return {key: replay.track for key, replay in replays if replay.recording is not None and replay.shifted_steps}

    @cached_property
    def ordered_speeds(self) -> frozenset[int]:
        """The driven vehicles for which an edit orders a speed."""
        plans = self.result.plans.items()
        return frozenset(key for key, plan in plans if any(order.speed_mps is not None for order in plan.manoeuvres))

    @property
    def driven_shifts(self) -> tuple[int, ...]:
        """The vehicles that edits only move in time but that are driven all the same, by ascending id."""
        return tuple(key for key in self.shifted if key in self.handed_over)

    @property
    def collisions(self) -> tuple[EditCollision, ...]:
        """The remaining overlaps, in time order."""
        return tuple(
            EditCollision(vehicles=(hit.first, hit.second), time_s=round(hit.step * self.scene.step_s, 3))
            for hit in self.result.overlaps
        )

    @cached_property
    def entries(self) -> dict[int, Track]:
        """The entry of each road user that edits add, by ascending id."""
        driven = {key: plan.start for key, plan in self.changes.driven.items() if plan.cause == "added"}
        walking = {key: replay.track for key, replay in self.changes.replays.items() if replay.recording is None}
        return dict(sorted((driven | walking).items()))


@dataclass(frozen=True)
class SimulatedEdits(EditedScene):
    """An edited scene with its edits.

    ``steps``: what each of the edits did. ``notes``: sentences on what else was done.
    """

    edits: tuple[Edit, ...] = ()
    steps: tuple[EditStep, ...] = ()
    notes: tuple[str, ...] = ()


def new_overlaps(
    touched: Iterable[Track],
    others: Iterable[Track],
    recorded: Mapping[int, Track],
    shifts: Mapping[int, int] = MappingProxyType({}),
) -> tuple[Overlap, ...]:
    """Return the first overlaps of touched road users with each other and with all others, ordered by step.

    An overlap is left out if the same two road users overlap in the recording at that time: no edit caused it. Two
    recordings that are moved in time by the same steps count as recorded; recordings moved by different steps do not.
    Several tracks may share an id: they belong to one obstacle.

    ``shifts``: the number of steps by which recordings are moved in time.
    """
    moved, rest = list(touched), list(others)
    first_overlaps: dict[tuple[int, int], Overlap] = {}
    for number, one in enumerate(moved):
        among_moved = [(other, recorded.get(other.obstacle_id)) for other in moved[number + 1 :]]
        for other, other_before in among_moved + [(other, recorded.get(other.obstacle_id, other)) for other in rest]:
            pair = one.obstacle_id, other.obstacle_id
            before = recorded.get(one.obstacle_id), other_before
            if shifts.get(pair[0], 0) != shifts.get(pair[1], 0):
                before = None, None
            step = _first_new(one, other, *before)
            if step is not None and (pair not in first_overlaps or step < first_overlaps[pair].step):
                first_overlaps[pair] = Overlap(*pair, step)
    return tuple(sorted(first_overlaps.values(), key=lambda hit: (hit.step, hit.first, hit.second)))


def _first_new(first: Track, second: Track, first_before: Track | None, second_before: Track | None) -> int | None:
    """Return the first step of an overlap that the recording does not have at about that time, or None."""
    steps = overlap_steps(first, second)
    step = next(steps, None)
    if step is None or first_before is None or second_before is None:
        return step
    known = tuple(overlap_steps(first_before, second_before))
    before = -2
    for now in chain([step], steps):
        if now > before + 1 and not any(abs(now - recorded) <= NEAR_STEPS for recorded in known):
            return now
        before = now
    return None


def overlap_steps(first: Track, second: Track) -> Iterator[int]:
    """Yield the steps at which two road users overlap, ascending."""
    begin, end = max(first.first_step, second.first_step), min(first.last_step, second.last_step) + 1
    if begin >= end:
        return
    at_first, at_second = begin - first.first_step, begin - second.first_step
    count = end - begin
    distances_m = np.linalg.norm(
        first.positions[at_first : at_first + count] - second.positions[at_second : at_second + count], axis=1
    )
    reach = (math.hypot(*first.size_m) + math.hypot(*second.size_m)) / 2
    for offset in np.flatnonzero(distances_m < reach).tolist():
        if rectangles_overlap(first.corners_at(at_first + offset), second.corners_at(at_second + offset), _TOUCH_M):
            yield int(begin + offset)
