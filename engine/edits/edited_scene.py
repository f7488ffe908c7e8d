"""A scene after its edits: every road user as the edits leave it, as tracks and as moving rectangles.

``EditedScene`` is what the checks, the explanations, the report and the ego's risk look at; it hides which tracks come
from the recording, from SUMO or from an edit. Collisions are overlaps of bodies that are not in the recording.
Lengths are in m, steps are time steps of the scenario.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import numpy as np

from ...schemas.modification import Edit
from ..commonroad import Track
from ..cosimulation import DrivePlan, Replay, TakenOverTrack
from ..geometry import Points, Values, oriented_rectangle, rectangles_overlap
from ..scene import Scene
from ..vehicles import EGO_SIZE_M
from .changes import Changes, EditStep

_TOUCH_M = 0.05
"""Bodies that overlap by less are not colliding: recorded positions are not better than that."""
_NEAR_STEPS = 10
"""An overlap that begins so few steps before or after a recorded one of the same two is the recorded one (chosen)."""
REACTION_S = 4.0
"""A handed-over vehicle is driven from this long before the collision on, which is time to brake gently (chosen)."""
EGO = 0
"""Stands for the ego's id among bodies; obstacles have positive ones."""


@dataclass(frozen=True)
class Body:
    """A moving rectangle: centres (n, 2) and headings (n,) from ``first_step`` on, length and width in m.

    ``shifted_steps``: how much later than recorded it moves, of a recording moved in time.
    """

    key: int
    first_step: int
    positions: Points
    headings_rad: Values
    size_m: tuple[float, float]
    shifted_steps: int = 0

    @classmethod
    def of_track(cls, track: Track) -> "Body":
        """A recorded road user."""
        size = (track.length_m, track.width_m)
        return cls(track.obstacle_id, track.first_step, track.positions, track.headings_rad, size)

    @classmethod
    def of_touched(cls, track: TakenOverTrack) -> "Body":
        """A vehicle that SUMO drove, from its hand-over on."""
        size = (track.length_m, track.width_m)
        return cls(track.vehicle_id, track.first_step, track.motion.positions, track.motion.headings_rad, size)

    @classmethod
    def of_replay(cls, replay: Replay) -> "Body":
        """A recording as it is moved in time, or an added pedestrian."""
        return replace(cls.of_track(replay.track), shifted_steps=replay.shifted_steps)

    def beginning(self, states: int) -> "Body":
        """The first states of the body."""
        return replace(self, positions=self.positions[:states], headings_rad=self.headings_rad[:states])

    def slowed(self, share: float, states: int) -> "Body":
        """The first states of the body on the same path at a share of its speed."""
        steps = np.round(np.arange(min(len(self.positions), states)) * share).astype(int)
        return replace(self, positions=self.positions[steps], headings_rad=self.headings_rad[steps])


@dataclass(frozen=True)
class Overlap:
    """The step from which on two bodies overlap; ``first`` is a touched one."""

    first: int
    second: int
    step: int


@dataclass(frozen=True)
class SimulationResult:
    """The outcome of all rounds: plans and new tracks of the driven vehicles, and the overlaps that are left.

    ``missing``: ids of the vehicles that have a plan and that SUMO did not drive.
    """

    plans: Mapping[int, DrivePlan]
    tracks: Mapping[int, TakenOverTrack]
    overlaps: tuple[Overlap, ...]
    missing: tuple[int, ...]


@dataclass(frozen=True)
class EditedScene:
    """A scene, the changes that edits make in it, and the result of their simulation.

    ``scene``: with the recordings that edits move in time, added pedestrians and the ego's new start; vehicles that
    SUMO drives are in it as recorded. ``ego``: the ego as an ordinary driver drives it after the edits; None without
    one.
    """

    scene: Scene
    changes: Changes
    result: SimulationResult
    ego: Track | None = None

    @cached_property
    def after(self) -> Scene:
        """The scene with simulated tracks in place of recorded ones, and without those that edits removed."""
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
        """All road users after the edits: recorded, standing and driven ones by ascending id, then regions."""
        tracks = (track for _, track in sorted((self.after.tracks | self.after.standing).items()))
        return (*tracks, *(region.track for region in self.after.regions))

    @cached_property
    def road_users(self) -> dict[int, Track]:
        """All road users after the edits by id, and the ego's drive."""
        return {track.obstacle_id: track for track in (*self.tracks, *(() if self.ego is None else (self.ego,)))}

    @cached_property
    def bodies(self) -> dict[int, Body]:
        """The bodies of all road users after the edits, by the id of the track."""
        return {track.obstacle_id: Body.of_track(track) for track in self.tracks}

    def simulated_body(self, key: int) -> Body:
        """The body of a road user: of a driven one from its hand-over on, of any other as recorded."""
        if key in self.result.tracks:
            return Body.of_touched(self.result.tracks[key])
        regions = {region.obstacle_id: region.track for region in self.scene.regions}
        return Body.of_track((regions | self.scene.tracks | self.scene.standing)[key])

    @cached_property
    def requested_bodies(self) -> dict[int, Body]:
        """The bodies without any hand-over: only what the edits ask for moves anew; and the ego where it starts."""
        tracks = {key: track for key, track in self.result.tracks.items() if key not in self.handed_over}
        replays = {key: replay for key, replay in self.changes.replays.items() if key not in tracks}
        asked = EditedScene(self.scene, self.changes, replace(self.result, tracks=tracks))
        bodies = asked.bodies | {key: Body.of_replay(replay) for key, replay in replays.items()}
        ego = self.scene.ego
        if ego is None:
            return bodies
        return bodies | {EGO: Body(EGO, ego.step, ego.position[None], np.array([ego.heading_rad]), EGO_SIZE_M)}

    @cached_property
    def handed_over(self) -> frozenset[int]:
        """The vehicles that no edit drives, and that are driven because they would hit others."""
        return frozenset(key for key in self.result.tracks if self.result.plans[key].cause == "handed_over")

    @cached_property
    def shifted_bodies(self) -> dict[int, Body]:
        """The bodies of recordings as edits move them in time, by ascending id; driven or not."""
        replays = self.changes.replays.items()
        return {key: Body.of_replay(replay) for key, replay in replays if replay.recording is not None}

    @property
    def driven_shifts(self) -> tuple[int, ...]:
        """The vehicles that edits only move in time and that are driven nevertheless, by ascending id."""
        return tuple(key for key in self.shifted_bodies if key in self.handed_over)

    @cached_property
    def entries(self) -> dict[int, Track]:
        """Where and when each road user enters that edits add, by ascending id."""
        driven = {key: plan.start for key, plan in self.changes.driven.items() if plan.cause == "added"}
        walking = {key: replay.track for key, replay in self.changes.replays.items() if replay.recording is None}
        return dict(sorted((driven | walking).items()))


@dataclass(frozen=True)
class SimulatedEdits(EditedScene):
    """An edited scene with the edits that made it.

    ``steps``: what each of the edits did. ``notes``: sentences on what was done besides.
    """

    edits: tuple[Edit, ...] = ()
    steps: tuple[EditStep, ...] = ()
    notes: tuple[str, ...] = ()


def new_overlaps(touched: Iterable[Body], others: Iterable[Body], recorded: Mapping[int, Body]) -> tuple[Overlap, ...]:
    """First overlaps of touched bodies with all others and with one another, ordered by step.

    An overlap that begins where the same two overlap in the recording is left out: no edit caused it. The recordings
    of two that are moved in time alike count as recorded, those of two that are moved otherwise do not. Several of the
    others may have one key: they stand for one obstacle.
    """
    moved, rest = list(touched), list(others)
    first_overlaps: dict[tuple[int, int], Overlap] = {}
    for number, body in enumerate(moved):
        among_moved = [(other, recorded.get(other.key)) for other in moved[number + 1 :]]
        for other, before in among_moved + [(other, recorded.get(other.key, other)) for other in rest]:
            step, pair = _first_new(body, other, recorded.get(body.key), before), (body.key, other.key)
            if step is not None and (pair not in first_overlaps or step < first_overlaps[pair].step):
                first_overlaps[pair] = Overlap(*pair, step)
    return tuple(sorted(first_overlaps.values(), key=lambda hit: (hit.step, hit.first, hit.second)))


def _first_new(first: Body, second: Body, first_before: Body | None, second_before: Body | None) -> int | None:
    """The first step at which two bodies begin to overlap and did not about then as they were before; or None."""
    steps = overlap_steps(first, second)
    step = next(steps, None)
    if step is None or first_before is None or second_before is None:
        return step
    if first_before.shifted_steps != second_before.shifted_steps:
        return step
    known = tuple(overlap_steps(first_before, second_before))
    before = -2
    for now in chain([step], steps):
        if now > before + 1 and not any(abs(now - recorded) <= _NEAR_STEPS for recorded in known):
            return now
        before = now
    return None


def overlap_steps(first: Body, second: Body) -> Iterator[int]:
    """The steps at which two bodies overlap, ascending."""
    begin = max(first.first_step, second.first_step)
    end = min(first.first_step + len(first.positions), second.first_step + len(second.positions))
    if begin >= end:
        return
    one, two = (
        slice(begin - first.first_step, end - first.first_step),
        slice(begin - second.first_step, end - second.first_step),
    )
    apart = np.linalg.norm(first.positions[one] - second.positions[two], axis=1)
    reach = (math.hypot(*first.size_m) + math.hypot(*second.size_m)) / 2
    for offset in np.flatnonzero(apart < reach).tolist():
        corners = [
            oriented_rectangle(body.positions[index], float(body.headings_rad[index]), body.size_m)
            for body, index in ((first, one.start + offset), (second, two.start + offset))
        ]
        if rectangles_overlap(corners[0], corners[1], _TOUCH_M):
            yield int(begin + offset)
